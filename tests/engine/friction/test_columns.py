"""Bands of efforts at rest: each is of the quantity that it is named after."""

from contextlib import nullcontext

import pytest

from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.forces.along_coordinate import JointEffort
from pinarm.mechanics.laws import Constant
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import State, Statics

G, ARM = 9.81, {"axis": "0 -1 0", "com": "0.5 0 0", "mass": 1.0}


@pytest.fixture
def arm(mechanism, chain):
    """Return two arms of 1 m and 1 kg in a row, with friction in both joints."""
    bodies = {"name": "O", **ARM}, {"name": "A", **ARM, "at": "1 0 0"}
    phi = {"kind": "sum", "of": {"O": 1, "A": 1}}
    friction = {"O": {"constant": "0.5 N*m"}, "A": {"constant": "0.3 N*m"}}
    return mechanism(chain(*bodies), coordinates={"phi": phi}, friction=friction)


def test_bands_of_joints_and_of_drives_hold_the_efforts_that_they_are_named_after(arm):
    """The drive along phi carries the second arm, m g l / 2; the one at O the rest of 2 m g l at O.

    Friction of A is between the two arms: it takes effort from one drive to the other, not from their sum at O.
    """
    found = Quantities(Statics(hold={"O": 0.0, "A": 0.0}, drives=["O", "phi"])
                       .solve(arm, Accuracy(), lambda *path: nullcontext()).rows)  # fmt: skip
    expected = {"coordinate.O": (1.5 * G, 0.8), "coordinate.phi": (0.5 * G, 0.3), "joint.O": (2.0 * G, 0.5)}
    for name, (effort, half) in expected.items():
        values = [found[f"{name}.effort{part}"].values[0] for part in (".lower", "", ".upper")]
        assert values == pytest.approx([effort - half, effort, effort + half], rel=1e-12)


@pytest.mark.parametrize(("speed", "locked"), [(0.0, True), (1.0, False)])
def test_a_drive_that_moves_is_not_self_locking_whatever_a_joint_at_rest_holds(mechanism, chain, speed, locked):
    """A table of two slides, driven along x + y and x - y: y holds 5 N, half of it at each drive, also while x moves.

    A force of 1 N along y loads the drives by 0.5 N and -0.5 N, or the friction.
    """
    slides = [{"name": name, "kind": "prismatic", "axis": axis} for name, axis in (("y", "0 1 0"), ("x", "1 0 0"))]
    sums = {name: {"kind": "sum", "of": {"x": 1, "y": sign}} for name, sign in (("u", 1), ("w", -1))}
    table = mechanism(chain(*slides), gravity="none", coordinates=sums, friction={"y": {"constant": "5 N"}})
    push = JointEffort(joint="y", effort=Constant(value=-1.0))
    asked = State(hold={"x": 0.0, "y": 0.0}, velocity={"x": speed, "y": 0.0}, drives=["u", "w"], loads={"push": push})
    found = asked.solve(table, Accuracy(), lambda *path: nullcontext())
    band = [found.rows.columns[f"coordinate.u.effort.{side}"].values[0] for side in ("lower", "upper")]
    assert band == pytest.approx([0.5 - 2.5, 0.5 + 2.5], rel=1e-12)
    assert any("self-locking" in note for note in found.notes) == locked
    assert all("though the coordinate moves" in note for note in found.notes) == (not locked)
    assert all("the other drives free to take their part" in note for note in found.notes)

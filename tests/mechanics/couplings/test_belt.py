"""Tensions of belts and the bearings that hold them, in closed form."""

import numpy as np
import pytest
from catalogue import disc
from motions import anywhere, driven

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.forces.along_coordinate import JointEffort
from pinarm.mechanics.laws import Constant, ConstantSpeed
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Statics

R1, R2, DISTANCE = 0.05, 0.15, 0.5


def belt(mechanism, axis="0 0 1", **more):
    xml = f'<robot name="b"><link name="base"/>{disc("one", 0.3)}{disc("two", 0.05, f"{DISTANCE} 0 0", axis)}</robot>'
    coupling = {"kind": "belt", "joints": ["one", "two"], "radii": [f"{R1} m", f"{R2} m"], **more}
    return mechanism(xml, gravity="none", couplings={"belt": coupling})


def at_rest(wheels, moment):
    loads = {"load": JointEffort(joint="two", effort=Constant(value=moment))}
    return Quantities(Statics(hold={"one": 0.2}, drives=["one"], loads=loads).solve(wheels, Accuracy(), anywhere).rows)


@pytest.mark.parametrize(("course", "sense"), [("open", 1.0), ("crossed", -1.0)])
@pytest.mark.parametrize("load", [-12.0])
def test_strands_pull_both_wheels_by_their_tensions(mechanism, course, sense, load):
    """``F1 - F2 = M / r``, ``F1 + F2 = 2 F0``; the strands are at ``asin((r2 -+ r1) / d)`` to the centre line."""
    found = at_rest(belt(mechanism, pretension="100 N", course=course), load)
    assert found["joint.one.effort"].values == pytest.approx(-sense * load * R1 / R2, rel=1e-14)
    tight, slack = 100.0 + 12.0 / R2 / 2, 100.0 - 12.0 / R2 / 2
    assert found["coupling.belt.tight"].values == pytest.approx(tight, rel=1e-14)
    assert found["coupling.belt.slack"].values == pytest.approx(slack, rel=1e-14)
    angle = np.arcsin((R2 - sense * R1) / DISTANCE)
    pull = 200.0 * np.cos(angle)
    assert found["joint.one.force.x"].values == pytest.approx(-pull, rel=1e-13)
    assert found["joint.two.force.x"].values == pytest.approx(pull, rel=1e-13)
    # across the centre line the strands differ: an open belt opens towards the larger wheel
    across = abs(found["joint.two.force.y"].values)
    assert across == pytest.approx((tight - slack) * np.sin(angle), rel=1e-12)
    length = np.sqrt(tight**2 + slack**2 + 2.0 * tight * slack * np.cos(2.0 * angle))
    assert found["joint.one.force.norm"].values == pytest.approx(length, rel=1e-13)
    assert found["joint.two.force.norm"].values == pytest.approx(length, rel=1e-13)


@pytest.mark.parametrize("pretension", [30.0])
def test_a_strand_is_not_pushed(mechanism, pretension):
    """30 N are not enough for 12 N m at 0.15 m: the tight strand carries 80 N alone, as that of a chain does."""
    found = at_rest(belt(mechanism, pretension=f"{pretension} N"), 12.0)
    assert found["coupling.belt.slack"].values == 0.0
    assert found["coupling.belt.tight"].values == pytest.approx(80.0, rel=1e-14)
    assert found["joint.one.force.norm"].values == pytest.approx(80.0, rel=1e-13)


@pytest.mark.parametrize(("axis", "course", "ratio"), [
    ("0 0 1", "crossed", -R1 / R2), ("0 0 -1", "open", -R1 / R2),
])  # fmt: skip
def test_wheels_turn_by_their_radii(mechanism, axis, course, ratio):
    run = driven(belt(mechanism, axis, course=course), {"one": ConstantSpeed(speed=3.0)})
    assert run.v[:, run.mechanism.joints["two"].v] == pytest.approx(3.0 * ratio, rel=1e-14)


def test_without_a_pretension_the_bearings_are_refused(mechanism):
    found = at_rest(belt(mechanism), 12.0)
    assert found["coupling.belt.effort"].values == pytest.approx(-12.0, rel=1e-14)
    with pytest.raises(InputError, match=r"'belt' \(belt\): it has no pretension"):
        found["joint.one.force.x"]


def test_what_is_no_belt_is_refused(mechanism, gearbox):
    with pytest.raises(InputError, match=r"0\.5 m apart: wheels of these radii leave no place"):
        belt(mechanism, radii=["0.1 m", "0.7 m"], pretension="1 N")
    with pytest.raises(InputError, match="the axes of sun and cone are not parallel"):
        gearbox(it={"kind": "belt", "joints": ["sun", "cone"], "radii": ["1 cm", "1 cm"]})
    with pytest.raises(InputError, match="a belt couples two wheels"):
        gearbox(it={"kind": "belt", "joints": ["sun", "nut"], "radii": ["1 cm", "1 cm"]})

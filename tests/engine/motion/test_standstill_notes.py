"""Rows at which joints stand still: bands that gears with losses hold, and sides of reversals."""

import re
from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.mechanics.laws import Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Inverse
from pinarm.problems.states import Statics
from pinarm.problems.time_grid import TimeGrid

SWING = Harmonic(amplitude=1.0, pulsation=2.0 * np.pi, phase=0.5 * np.pi)
BODY = {"name": "arm", "axis": "0 -1 0", "com": "0.5 0 0"}
LOSSY = {"drives": {"servo": {"joint": "arm", "ratio": 10, "efficiency": 0.7}}}


def notes(problem, mechanism):
    return problem.solve(mechanism, Accuracy(), lambda *path: nullcontext()).notes


def band(note):
    return [float(x) for x in re.search("from ([0-9.]+) to ([0-9.]+) N[*]m in the first of them", note).groups()]


@pytest.mark.parametrize(("gravity", "held"), [({"direction": "-z"}, 1), ("none", 0)])
def test_a_gear_that_holds_a_load_has_a_band(mechanism, chain, gravity, held):
    """From ``eta tau / N`` to ``tau / (eta N)``; without a load there is none."""
    found = notes(Statics(hold={"arm": 0.0}), mechanism(chain(BODY), gravity=gravity, **LOSSY))
    assert len(found) == held
    if held:
        assert found[0].startswith("drive.servo.torque: at rest its gear holds the load with any torque of a band")
        assert band(found[0]) == pytest.approx([0.5 * 9.81 * 0.07, 0.5 * 9.81 / 7.0], rel=1e-3)


def test_friction_behind_a_gear_that_holds_widens_the_band(mechanism, chain):
    """``(m g l - F) eta / N`` to ``(m g l + F) / (eta N)``, with a friction of F = 1 N*m."""
    friction = {"arm": {"constant": "1 N*m"}}
    found = notes(Statics(hold={"arm": 0.0}), mechanism(chain(BODY), friction=friction, **LOSSY))
    weight = 0.5 * 9.81
    assert band(found[-1]) == pytest.approx([(weight - 1.0) * 0.07, (weight + 1.0) / 7.0], rel=1e-3)


@pytest.mark.parametrize(
    ("losses", "quantity"),
    [(LOSSY, "drive.servo.torque"), ({"friction": {"arm": {"constant": "1 N*m"}}}, "joint.arm.friction")],
)
@pytest.mark.parametrize(("samples", "between"), [(2, 0), (9, 3)])
def test_rows_at_reversals_say_that_they_have_one_side(mechanism, chain, losses, quantity, samples, between):
    """Reversals are at every half second; of the first and the last row, at 0 and 2 s, the other side is none."""
    problem = Inverse(time=TimeGrid(end=2.0, samples=samples), motion={"arm": SWING})
    found = [note for note in notes(problem, mechanism(chain(BODY), **losses)) if "turns back" in note]
    assert found == [note for note in found if note.startswith(f"{quantity} jumps")]
    assert len(found) == bool(between)
    if between:
        assert f"in {between} of {samples} rows" in found[0]

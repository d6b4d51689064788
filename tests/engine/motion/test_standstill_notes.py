"""Rows at which joints stand still: bands that gears with losses hold, and sides of reversals."""

import re
from contextlib import nullcontext

import pytest

from pinarm.problems.accuracy import Accuracy
from pinarm.problems.states import Statics

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

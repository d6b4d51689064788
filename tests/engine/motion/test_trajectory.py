from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.engine.motion.outcome import on_interval
from pinarm.errors import InputError
from pinarm.mechanics.laws import ConstantSpeed, Trapezoid
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid

LAW = Trapezoid(start=0.0, end=1.0, acceleration=1.0, begin=0.5)


def outcome(problem, mechanism):
    return problem.solve(mechanism, Accuracy(tolerance=1e-12), lambda *path: nullcontext())


def solve(problem, mechanism):
    return outcome(problem, mechanism).rows


@pytest.fixture
def arm(mechanism, chain):
    drives = {"motor": {"joint": "arm", "efficiency": 0.5}}
    return mechanism(chain({"name": "arm", "axis": "0 1 0", "com": "0.5 0 0"}), drives=drives)


@pytest.fixture
def solved(arm):
    return outcome(Inverse(time=TimeGrid(end=3.0, samples=7), motion={"arm": LAW}), arm)


@pytest.fixture
def run(solved):
    return solved.rows


def test_direction_at_standstill_is_that_of_the_motion_beside_it(run):
    assert run.grid.t.tolist() == [0.0, 0.5, 0.5, 1.0, 1.5, 1.5, 2.0, 2.5, 2.5, 3.0]
    assert run.direction(0).tolist() == [0, 0, 1, 1, 1, 1, 1, 1, 0, 0]


@pytest.mark.parametrize("interval", [1, 2])
def test_the_same_motion_at_other_instants_of_a_stretch(solved, run, interval):
    cuts = run.grid.cuts
    t = np.linspace(cuts[interval], cuts[interval + 1], 5)
    part = on_interval(solved.motion, cuts, interval, t)
    s, ds, dds = LAW.on(cuts[interval], cuts[interval + 1])(t)
    assert part.grid.t.tolist() == t.tolist()
    for found, expected in ((part.q, s), (part.v, ds), (part.a, dds)):
        assert found[:, 0] == pytest.approx(expected, abs=1e-14)
    rows = slice(run.grid.rows[interval], run.grid.rows[interval + 1])
    assert part.tau[[0, -1]] == pytest.approx(run.tau[rows][[0, -1]], abs=1e-14)


def test_the_effort_of_a_drive_along_a_sum_of_joints(mechanism, chain):
    """Drives e and f along a + b and 2 a + b give the joints e + 2 f and e + f, which hold the weights."""
    bodies = [{"name": "a", "axis": "0 -1 0", "com": "0.5 0 0", "mass": 2.0},
              {"name": "b", "axis": "0 -1 0", "com": "0.5 0 0", "at": "1 0 0"}]  # fmt: skip
    sums = {"total": {"kind": "sum", "of": ["a", "b"]}, "twice": {"kind": "sum", "of": ["a", "a", "b"]}}
    arm = mechanism(chain(*bodies), coordinates=sums)
    q = np.radians([[30.0, 20.0]])
    outer = 9.81 * 0.5 * np.cos(np.radians(50.0))
    inner = outer + 9.81 * (2.0 * 0.5 + 1.0) * np.cos(np.radians(30.0))
    both = arm.at(q, drives=["total", "twice"])
    assert both["coordinate.twice.effort"].values == pytest.approx([inner - outer], rel=1e-13)
    assert both["coordinate.total.effort"].values == pytest.approx([2.0 * outer - inner], rel=1e-13)
    assert both["joint.a.effort"].values == pytest.approx([inner], rel=1e-13)
    mixed = arm.at(q, drives=["a", "total"])
    assert mixed["coordinate.total.effort"].values == pytest.approx([outer], rel=1e-13)
    assert mixed["coordinate.a.effort"].values == pytest.approx([inner - outer], rel=1e-13)  # of the drive at a alone
    with pytest.raises(InputError, match="no drive acts along 'twice'"):
        mixed["coordinate.twice.effort"]


def test_the_effort_of_a_law_along_a_sum_of_joints_in_a_free_motion(mechanism, chain):
    """What one drive along a + b gives both joints; the other motion is free."""
    bodies = [{"name": name, "axis": "0 -1 0", "com": "0.5 0 0"} for name in "ab"]
    arm = mechanism(chain(*bodies), coordinates={"total": {"kind": "sum", "of": ["a", "b"]}})
    forward = Forward(time=TimeGrid(end=1.0, samples=3), motion={"total": ConstantSpeed(speed=1.0)})
    run = forward.solve(arm, Accuracy(), lambda *path: nullcontext()).rows
    assert run.effort_along("total") == pytest.approx(run.tau[:, 0], rel=1e-12)
    assert np.abs(run.tau).max() > 1.0

from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.problems.accuracy import Accuracy


def outcome(problem, mechanism):
    return problem.solve(mechanism, Accuracy(tolerance=1e-12), lambda *path: nullcontext())


def solve(problem, mechanism):
    return outcome(problem, mechanism).rows


@pytest.fixture
def arm(mechanism, chain):
    drives = {"motor": {"joint": "arm", "efficiency": 0.5}}
    return mechanism(chain({"name": "arm", "axis": "0 1 0", "com": "0.5 0 0"}), drives=drives)


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

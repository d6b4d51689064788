"""Many motions in compiled code, in one thread and in several, against each integrated by itself."""

import numpy as np
import pytest

from pinarm.engine.integration import compiled_batch
from pinarm.engine.integration.batch_driver import integrate_batch
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.kernel.library import absence
from pinarm.mechanics.forces.joint_efforts import AppliedEffort
from pinarm.mechanics.laws import Constant

from ..kernel.known_trees import states
from .test_compiled_steps import intervals, regular

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")

METHOD = Adaptive(1e-9)


@pytest.fixture(scope="module")
def motion():
    """A tree with a ball joint under a steady effort, the motion in two intervals, and states of no special kind."""
    dynamics = regular(["RZ", "Spherical", "PX"], forces={"push": AppliedEffort(0, Constant(value=0.7))})
    compiled, python = intervals(dynamics, 0.0, 0.4, 1.5)
    q, v = (np.array(x) for x in zip(*states(dynamics.model, 9), strict=True))
    return dynamics.manifold, compiled, python, q, 0.5 * v


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_steps_are_those_of_each_motion_by_itself(motion, threads, monkeypatch):
    """To the last digit: the same code takes them, from a first step that Pinocchio's batch call gives to rounding."""
    manifold, compiled, _, q, v = motion
    monkeypatch.setattr(compiled_batch, "MOST", 7)  # several rounds in an interval
    monkeypatch.setattr(compiled_batch, "ROOM", 63)
    ensemble = integrate_batch(compiled, manifold, q, v, METHOD, threads=threads)
    t = np.linspace(0.0, 1.5, 23)
    together = ensemble.states(t)
    for number in range(len(q)):
        single, ours = integrate(compiled, manifold, q[number], v[number], METHOD), ensemble.solution(number)
        assert (len(ours.steps), ours.count.rejected) == (len(single.steps), single.count.rejected)
        assert ours.count.evaluations == 12 * (len(ours.steps) + ours.count.rejected) + 2 + 1
        for one, other in zip(together, single.states(t), strict=True):
            assert one[number] == pytest.approx(other, rel=1e-11, abs=1e-11)


def test_threads_do_not_change_a_digit(motion):
    manifold, compiled, _, q, v = motion
    alone, shared = (integrate_batch(compiled, manifold, q, v, METHOD, threads=threads) for threads in (1, 3))
    assert alone.last.tobytes() == shared.last.tobytes()


def test_motions_are_those_of_python(motion):
    """Their errors are made up of local ones of 1e-9, which hardly grow in 1.5 s."""
    manifold, compiled, python, q, v = motion
    t = np.linspace(0.0, 1.5, 5)
    ours, theirs = (integrate_batch(each, manifold, q, v, METHOD).states(t) for each in (compiled, python))
    for one, other in zip(ours, theirs, strict=True):
        assert one == pytest.approx(other, rel=1e-7, abs=1e-7)


def test_motions_that_cannot_go_on_leave_the_others(motion):
    """One spins so fast that its steps are used up."""
    manifold, compiled, _, q, v = motion
    v = v.copy()
    v[4] *= 1e3
    usual = integrate_batch(compiled, manifold, q, v / 1e3, METHOD, threads=2)
    most = int(max(usual.evaluations) / 12) + 20
    fast = integrate_batch(compiled, manifold, q, np.where(np.arange(9)[:, None] == 4, v, v / 1e3), METHOD,
                           max_steps=most, threads=2)  # fmt: skip
    assert list(fast.failures) == [4]
    assert f"it has taken {most} steps" in fast.failures[4]
    assert fast.ends[4] < 1.5
    others = np.arange(9) != 4
    assert (fast.last[:, others] == usual.last[:, others]).all()

"""Compiled steps of Radau IIA against those of the Python stepper, and against motions in closed form."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Solution
from pinarm.engine.integration.methods import stiff as stiff_methods
from pinarm.engine.integration.methods.stiff import CompiledRadau, Radau, radau_of
from pinarm.engine.kernel.library import absence
from pinarm.mechanics.forces.joint_forces import SpringDamper

from ..test_compiled_steps import both, intervals, regular
from .known_motions import ATTITUDE, SPIN, body, slope, turned

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")

NAMES = [["RX", "PY", "RZ"], ["FreeFlyer", "RX", "Spherical", "RY"]]


def stiff(names, stiffness=1e4, damping=1e2, seed=0):
    """Return the dynamics of a chain whose joints with one coordinate are held by stiff springs, with dampers."""
    dynamics = regular(names, seed)
    joints = [dynamics.model.joints[k] for k in range(1, dynamics.model.njoints)]
    q, v = (np.array([getattr(j, x) for j in joints if j.nq == 1]) for x in ("idx_q", "idx_v"))
    one = np.ones(len(q))
    return regular(names, seed, {"springs": SpringDamper(q, v, stiffness * one, damping * one, 0.1 * one)})


def assert_same(found, expected, near):
    """Compare the number of steps and their work, and the states at the end and between.

    The Jacobian by differences errs by 1e-8, with rounding, and so do corrections: less than the tolerance by as much.
    """
    assert [len(found.steps), found.count] == [len(expected.steps), expected.count]
    t = np.linspace(found.intervals[0].start, found.end, 101)
    for one, other in zip(found.states(t), expected.states(t), strict=True):
        assert one == pytest.approx(other, rel=near, abs=near)


class TestSteps:
    @pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
    @pytest.mark.parametrize("names", NAMES, ids=str)
    def test_are_those_of_python(self, names, tolerance):
        assert_same(*both(stiff(names), radau_of(tolerance), 0.0, 0.5), 1e-2 * tolerance)

    @pytest.mark.parametrize("tolerance", [1e-3, 1e-8])
    @pytest.mark.parametrize(("stiffness", "damping"), [(1e6, 3e3), (1e3, 1e6), (1e9, 1e7)])
    def test_follow_a_slow_motion_in_closed_form(self, stiffness, damping, tolerance):
        """A mass of 1 kg on a spring, overdamped: ``x = A exp(s t) + B exp(f t)``, with roots s and f < s."""
        model = pin.Model()
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
        place, zero = np.array([0]), np.zeros(1)
        spring = SpringDamper(place, place, np.full(1, stiffness), np.full(1, damping), zero)
        dynamics = Dynamics.of(model, {"spring": spring})
        given, t = intervals(dynamics, 0.0, 2.0)[0], np.linspace(0.0, 2.0, 101)
        solution = integrate(given, dynamics.manifold, np.ones(1), zero, radau_of(tolerance))
        fast = -0.5 * damping - np.sqrt(0.25 * damping**2 - stiffness)
        slow = stiffness / fast
        expected = (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow)
        assert np.abs(solution.states(t)[0][:, 0] - expected).max() < 5.0 * tolerance
        assert solution.count.evaluations < 800  # an explicit method takes 2e3 to 1e7


@pytest.mark.parametrize(("stages", "counts"), [(3, (20, 40, 80)), (5, (8, 12, 16)), (7, (3, 4, 5))])
def test_the_order_is_that_of_the_method(stages, counts, monkeypatch):
    """Steps of one length that are never refused, on the body free to turn of the tests of orders.

    The references are right to 1e-12, and iterations end at 1e-13: the range of steps between is short with 7 stages.
    """
    monkeypatch.setattr(stiff_methods, "ITERATIONS", 30)  # long steps near rounding take more than are allowed
    dynamics = body()
    (interval,) = intervals(dynamics, 0.0, 4.0)[0]
    errors = []
    for count in counts:
        method = Radau(1.0, stages)
        solution, h = Solution(method, dynamics.manifold, [interval]), 4.0 / count
        stepper = method.stepper(dynamics.manifold, solution.count)
        stepper.enough = 1e-13
        stepper.begin(interval, np.concatenate([ATTITUDE, SPIN]))
        steps, t = CompiledRadau(solution, stepper), 0.0
        for k in range(count):
            t, _ = steps.take(0, interval, t, (k + 1) * h - t, 1)
        assert [len(solution.steps), solution.count.rejected] == [count, 0]
        errors.append(np.abs(stepper.y - turned()(4.0)).max())
    assert 1e-12 < errors[-1] < errors[0] < 1e-3
    assert slope(counts, errors) == pytest.approx(2 * stages - 1, abs=0.5)

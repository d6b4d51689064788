"""Steps of the compiled library against those of the Python stepper, which computes the same."""

import math
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Watch
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.integration.runge_kutta import DOPRI5
from pinarm.engine.kernel.library import absence
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems.loop_system import LoopSystem
from pinarm.errors import IntegrationError
from pinarm.mechanics.ball_joints import coordinate_at
from pinarm.mechanics.forces.along_coordinate import EffortAlong
from pinarm.mechanics.forces.joint_forces import SpringDamper
from pinarm.mechanics.forces.load_laws import LoadLaw
from pinarm.mechanics.laws import Constant
from pinarm.records import replace

from ..kernel.known_trees import states, tree

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")

PAIRS = [Adaptive(1e-12), Adaptive(1e-5), Adaptive(1e-8, DOPRI5)]


def label(method):
    return f"{method.name} {method.tolerance}"


def regular(names, seed=0, forces=None):
    """Return the dynamics of a tree with bodies of about 1 kg and 1 m, so that its motion is as slow as it is tame."""
    model = tree(names, seed, branching=False)
    for joint in range(1, model.njoints):
        lever = 0.3 * np.sin(joint + np.arange(3.0))
        model.inertias[joint] = pin.Inertia(1.0, lever, np.diag([0.5, 0.6, 0.7]))
        model.jointPlacements[joint] = pin.SE3(model.jointPlacements[joint].rotation, lever)
    model.armature = np.full(model.nv, 0.1)
    return Dynamics.of(model, forces or {})


def intervals(dynamics, *bounds):
    """Return the intervals of a free motion, in compiled code and in Python."""
    system = LoopSystem.of(
        Closure.of(dynamics.model), dynamics, PrescribedCoordinates((), (), ()), pin.neutral(dynamics.model)
    )
    compiled = [system.interval(dynamics, *span) for span in pairwise(bounds)]
    assert all(interval.compiled for interval in compiled)
    return compiled, [replace(interval, compiled=None) for interval in compiled]


def both(dynamics, method, *bounds, **options):
    """Return the solutions from a state in compiled code and in Python."""
    q, v = states(dynamics.model, 1)[0]
    return [integrate(each, dynamics.manifold, q, 0.5 * v, method, **options) for each in intervals(dynamics, *bounds)]


RESOLVED = 1e-3
"""Relative difference of steps: the error estimate is a sum that cancels to 1e-13 of its terms, down to their rounding;
its tenth root chooses the step."""


def assert_same(found, expected):
    """Compare steps, work and dense output of two solutions; other lengths of steps make parts of the tolerance."""
    assert [len(found.steps), found.count] == [len(expected.steps), expected.count]
    owners = [solution.owners(np.arange(len(solution.steps))) for solution in (found, expected)]
    assert np.array_equal(*owners)
    for name in ("t", "h", "until"):
        times = [getattr(solution.steps, name) for solution in (found, expected)]
        assert times[0] == pytest.approx(times[1], rel=RESOLVED)
    t, near = np.linspace(found.intervals[0].start, found.end, 101), max(found.method.tolerance, 1e-11)
    for one, other in zip(found.states(t), expected.states(t), strict=True):
        assert one == pytest.approx(other, rel=near, abs=near)


class TestSteps:
    @pytest.mark.parametrize("method", PAIRS, ids=label)
    def test_are_those_of_python(self, method):
        assert_same(*both(regular(["RX", "RevoluteUnaligned", "Spherical"]), method, 0.0, 1.0))

    def test_with_loads_over_several_intervals_are_those_of_python(self):
        """The step of one interval begins the next; the end of an interval is the end of a step."""
        one, places = np.ones(2), np.arange(2)
        free = regular(["RX", "RY"])
        motor = EffortAlong(free.model, coordinate_at(free.model, 1), LoadLaw(Constant(value=3.0)))
        spring = SpringDamper(places, places, 50.0 * one, one, 0.1 * one)
        forced = Dynamics.of(free.model, {"spring": spring, "motor": motor})
        found, expected = both(forced, Adaptive(1e-9), 0.0, 0.3, 0.35, 1.0)
        assert_same(found, expected)
        assert {0.3, 0.35, 1.0} <= set(found.steps.until.tolist())


def linear(rate, offset=0.0):
    """Return the watch of a coordinate, or of the time."""
    return Watch(lambda t, q, v: rate * q[:, 0] + offset, 0, stops=False)


class TestEvents:
    """A mass on a spring: ``x = x0 cos(w t)``."""

    W = 10.0

    def motion(self, watches, end=20.0, compiled=True):
        model = pin.Model()
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
        spring = SpringDamper(np.array([0]), np.array([0]), np.array([self.W**2]), np.zeros(1), np.zeros(1))
        given = intervals(Dynamics.of(model, {"spring": spring}), 0.0, end)[0 if compiled else 1]
        return integrate(given, Dynamics.of(model).manifold, np.ones(1), np.zeros(1), Adaptive(1e-11), watches=watches)

    def test_are_located(self):
        found = self.motion([linear(1.0)])
        expected = (np.arange(64) + 0.5) * math.pi / self.W
        times = [one.t for one in found.crossings]
        assert expected[-1] < 20.0 < expected[-1] + math.pi / self.W
        assert times == pytest.approx(expected, abs=1e-9)  # of some hundred steps of 1e-11


class TestFailures:
    def test_a_motion_of_too_many_steps_is_given_up(self):
        dynamics = regular(["RX", "RY"])
        for given in intervals(dynamics, 0.0, 1e3):
            with pytest.raises(IntegrationError, match="has taken 150 steps") as caught:
                integrate(given, dynamics.manifold, np.ones(2), np.zeros(2), Adaptive(1e-9), max_steps=150)
            partial = caught.value.partial
            assert len(partial.steps) + partial.count.rejected == 150

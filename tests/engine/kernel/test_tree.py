"""Accelerations of the compiled kernel against Pinocchio's, and closed forms."""

import itertools

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics.dynamics import Dynamics, configuration_space
from pinarm.mechanics.ball_joints import coordinate_at
from pinarm.mechanics.coordinates import PathLength, distance
from pinarm.mechanics.forces.along_coordinate import EffortAlong
from pinarm.mechanics.forces.joint_forces import BallSpring, SpringDamper
from pinarm.mechanics.forces.load_laws import LoadLaw
from pinarm.mechanics.forces.points import TwoPointSpring
from pinarm.mechanics.laws import Constant

from .known_trees import JOINTS, compiled, states, tree

pytestmark = pytest.mark.usefixtures("compiled")

ROUNDING = 1e-12
"""Relative to the largest acceleration: rounding of some thousand operations, and of random trees' condition."""


def compare(model, tau=None):
    """Compare the slopes of random states with Pinocchio's."""
    data = model.createData()
    tau = np.zeros(model.nv) if tau is None else tau
    flow = compiled(model, tau, ())
    for q, v in states(model, 10):
        slope, a = flow.slope(0.0, np.concatenate([q, v])), pin.aba(model, data, q, v, tau)
        assert np.abs(slope[model.nq :] - a).max() <= ROUNDING * np.abs(a).max()
        turning = pin.tangentMap(model, q).reshape(model.nq, model.nv)  # of one velocity Pinocchio gives a vector
        assert slope[: model.nq] == pytest.approx(turning @ v, abs=1e-14)  # |v| is about 1


class TestAccelerations:
    @pytest.mark.parametrize("name", JOINTS)
    def test_of_one_joint_of_every_kind(self, name):
        compare(tree([name], 1))

    @pytest.mark.parametrize("seed", range(6))
    def test_of_trees_of_all_kinds(self, seed):
        names = np.random.default_rng(seed).permutation(list(JOINTS)).tolist()
        model = tree(names, seed)
        compare(model, np.random.default_rng(seed).normal(size=model.nv))

    def test_of_a_body_on_a_thread(self):
        """Helical joint of the pitch p under g along its axis: ``(I + m p^2) phi'' = -m g p``."""
        model, p, mass, inertia = pin.Model(), 0.1, 2.0, 0.3
        joint = model.addJoint(0, pin.JointModelHZ(p), pin.SE3.Identity(), "thread")
        body = pin.Inertia(mass, np.zeros(3), np.diag([1.0, 1.0, inertia]))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        a = compiled(model, np.zeros(1), ()).slope(0.0, np.array([0.7, 3.0]))[1]
        assert a == pytest.approx(-mass * 9.81 * p / (inertia + mass * p**2), rel=1e-14)

    def test_of_a_body_that_tumbles(self):
        """Euler's equations: ``I w' = -w x I w``, and no acceleration of the centre in a frame that turns but g."""
        model, moments = pin.Model(), np.array([1.0, 2.0, 3.5])
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
        model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), np.diag(moments)), pin.SE3.Identity())
        (q, v), w = states(model, 1)[0], states(model, 1)[0][1][3:]
        a = compiled(model, np.zeros(6), ()).slope(0.0, np.concatenate([q, v]))[7:]
        turned = pin.Quaternion(q[3:]).toRotationMatrix()
        assert a[3:] == pytest.approx(-np.cross(w, moments * w) / moments, abs=1e-14)
        assert a[:3] == pytest.approx(turned.T @ [0.0, 0.0, -9.81] - np.cross(w, v[:3]), abs=1e-13)


class TestLoads:
    """Springs, dampers and efforts are those of the force elements in Python."""

    @staticmethod
    def compare(model, forces):
        dynamics = Dynamics.of(model, forces).on(0.0, 1.0)
        flow, acceleration = compiled(model, dynamics.steady, dynamics.changing), dynamics.acceleration()
        for q, v in states(model, 5):
            a = acceleration(0.0, q, v)
            assert np.abs(flow.slope(0.0, np.concatenate([q, v]))[model.nq :] - a).max() <= ROUNDING * np.abs(a).max()
        return flow

    def test_of_springs_and_dampers_and_efforts(self):
        model = tree(["RX", "PrismaticUnaligned", "HZ"], 4)
        places, numbers = np.arange(3), np.array([1.0, 2.0, 3.0])
        self.compare(model, {
            "springs": SpringDamper(places, places, 10.0 * numbers, numbers, -numbers),
            "another": SpringDamper(places[1:2], places[1:2], numbers[:1], numbers[:1], numbers[:1]),
            "motor": EffortAlong(model, coordinate_at(model, 1), LoadLaw(Constant(value=7.0))),
        })  # fmt: skip

    def test_of_the_damper_of_a_joint_with_cosine_and_sine(self):
        model = tree(["Spherical", "RUBZ", "RX"], 4)
        spring = SpringDamper(np.array([6]), np.array([4]), np.array([5.0]), np.array([1.0]), np.array([0.5]))
        damper = SpringDamper(np.array([4]), np.array([3]), np.array([0.0]), np.array([2.0]), np.array([0.0]))
        self.compare(model, {"spring": spring, "damper": damper})

    def test_of_springs_and_dampers_between_points(self):
        model = tree(["Spherical", "PrismaticUnaligned", "RX"], 4)
        joints, where = ("universe", *model.names[2:]), pin.SE3(np.eye(3), np.array([0.3, -0.2, 0.4]))
        ends = [model.addFrame(pin.Frame(f"on {one}", model.getJointId(one), where, pin.OP_FRAME)) for one in joints]
        forces = [
            TwoPointSpring(model, PathLength((distance(*pair).way,)), 30.0, 4.0, 0.5, 7.0)
            for pair in itertools.pairwise(ends)
        ]
        self.compare(model, dict(zip("ab", forces, strict=True)))

    def test_of_springs_of_ball_joints(self):
        model = tree(["RX", "Spherical", "Spherical"], 4)
        self.compare(model, {"one": BallSpring(1, 1, 20.0), "other": BallSpring(5, 4, 30.0)})

    def test_of_a_ball_joint_at_its_zero_and_on_the_other_side(self):
        """A quaternion and its opposite are one rotation; at zero the spring is free, and no division is by 0."""
        model = tree(["Spherical"], 4)
        flow = self.compare(model, {"spring": BallSpring(0, 0, 20.0)})
        free = compiled(model, np.zeros(3), ())
        zero, (q, v) = np.array([0.0, 0.0, 0.0, 1.0, 0.1, 0.2, 0.3]), states(model, 1)[0]
        assert np.array_equal(flow.slope(0.0, zero), free.slope(0.0, zero))
        there, beyond = (flow.slope(0.0, np.concatenate([x, v]))[4:] for x in (q, -q))
        assert there == pytest.approx(beyond, rel=1e-12)


class TestStates:
    def test_are_brought_back_to_the_manifold(self):
        """The slope of a quaternion that is too long is that of the unit one, as in the Python route."""
        model = tree(["FreeFlyer", "Planar", "RUBX", "Spherical"], 6)
        flow, space = compiled(model, np.zeros(model.nv), ()), configuration_space(model)
        for q, v in states(model, 3):
            longer = q.copy()
            longer[3:7] *= 1.1
            longer[9:11] *= 0.8
            longer[11:13] *= 1.3
            longer[13:] *= 0.9
            assert space.project(longer) == pytest.approx(q, abs=1e-14)
            found, expected = (flow.slope(0.0, np.concatenate([x, v])) for x in (longer, q))
            assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)

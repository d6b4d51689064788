import math
from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import InputError
from pinarm.mechanics.coordinates import AngleSum, Distance, PointCoordinate, Rotation
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import joints_of
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.mechanics.points import PointDefinition, with_points

ARM = (
    {"name": "turn", "axis": "0 0 1"},
    {"name": "slide", "kind": "prismatic", "axis": "1 0 0", "at": "0.3 0 0.1"},
    {"name": "tilt", "axis": "0 1 0", "at": "0.2 0.1 0"},
    {"name": "roll", "axis": "1 0 0", "at": "0 0 0.4"},
    {"name": "tip", "kind": "fixed", "at": "0.1 0.2 0.3"},
)


@pytest.fixture
def model(chain):
    return build_model(chain(*ARM)).model


def evaluate(coordinate, model, q, v, a):
    """Return w, w' and w'' from the value, the row and the drift."""
    state = Kinematics.at(model, q, v)
    row = coordinate.row(state)
    return coordinate.value(state), row @ v, row @ a + coordinate.drift(state)


def motion(t, n):
    """A smooth motion of n joints with its derivatives."""
    k = np.arange(1, n + 1)
    return 0.5 * np.sin(k * t + k), 0.5 * k * np.cos(k * t + k), -0.5 * k**2 * np.sin(k * t + k)


DEFINITIONS = {
    "sum": AngleSum(of=["turn", "turn"]),
    "length": AngleSum(of=["slide"]),
    "tip along x": PointCoordinate(point="tip_link", along="x"),
    "tip along a slant": PointCoordinate(point="tip_link", along=(2.0, -1.0, 0.5)),
    "reach": Distance(between=("base", "tip_link")),
    "reach of the tilting link": Distance(between=("tip_link", "slide_link")),
    **{f"rotation about {axis}": Rotation(body="tip_link", about=axis) for axis in "xyz"},
    "rotation about y of a link": Rotation(body="tip_link", about="y", relative_to="turn_link"),
}
TIP_AT_REST = np.array([0.6, 0.3, 0.8])
"""Sum of the placements of the joints."""


@pytest.mark.parametrize("along", [(2.0, -1.0, 0.5), (0.0, 1e-100, 0.0), (1e100, 0.0, 0.0)])
def test_a_slanted_direction_counts_by_its_direction_only(model, along):
    coordinate = PointCoordinate(point="tip_link", along=along).bind(model, joints_of(model))
    value, *_ = evaluate(coordinate, model, np.zeros(4), np.zeros(4), np.zeros(4))
    direction = np.array(along) / max(along, key=abs)
    sign = np.sign(max(along, key=abs))
    assert value == pytest.approx(sign * TIP_AT_REST @ direction / np.linalg.norm(direction), rel=1e-14)


@pytest.mark.parametrize("along", [(0.0, 0.0, 0.0), (np.inf, 0.0, 0.0)])
def test_a_direction_without_a_length_is_refused(model, along):
    with pytest.raises(InputError, match="is no direction"):
        PointCoordinate(point="tip_link", along=along).bind(model, joints_of(model))


BALL_STATES = [0.0, 1e-5, 0.009, 0.011, 3.1]
"""Angles on both sides of where the series of the drift takes over, and close to half a turn."""


@pytest.fixture(scope="module")
def ball():
    """A body on a spherical joint."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    model.addBodyFrame("body", joint, pin.SE3.Identity(), 0)
    return model


class TestRotation:
    axis = np.array([2.0, -1.0, 2.0]) / 3.0

    def at(self, ball, w, v, a):
        """Return all three components with their rates, shape (3, 3)."""
        q = pin.Quaternion(pin.exp3(w)).coeffs()
        coordinates = [Rotation(body="body", about=x).bind(ball, {}) for x in "xyz"]
        return np.array([evaluate(coordinate, ball, q, v, a) for coordinate in coordinates]).T

    @pytest.mark.parametrize("angle", BALL_STATES)
    def test_value_is_the_axis_times_the_angle(self, ball, angle):
        found = self.at(ball, angle * self.axis, np.zeros(3), np.zeros(3))
        # the angle of a matrix near half a turn is known to the square root of rounding over its distance from it
        assert found[0] == pytest.approx(angle * self.axis, abs=1e-13)

    @pytest.mark.parametrize("angle", BALL_STATES)
    def test_rates_are_those_of_a_motion_of_the_rotation_vector(self, ball, angle):
        """w(t) is given; omega and its rate follow from the series of the right Jacobian of exp, summed to its end."""
        w, dw, ddw = angle * self.axis, np.array([0.3, -0.8, 0.5]), np.array([-1.1, 0.4, 0.9])

        def term(k, skews):
            """k-th coefficient: (-1)^k / (k + 1)! times the sum over places of the differentiated factor."""
            return (-1.0) ** k / math.factorial(k + 1) * skews

        skew, rate = pin.skew(w), pin.skew(dw)
        jacobian, growth, power, grown = np.eye(3), np.zeros((3, 3)), np.eye(3), np.zeros((3, 3))
        for k in range(1, 40):
            grown = grown @ skew + power @ rate  # derivative of skew^k
            power = power @ skew
            jacobian, growth = jacobian + term(k, power), growth + term(k, grown)
        omega, alpha = jacobian @ dw, jacobian @ ddw + growth @ dw
        found = self.at(ball, w, omega, alpha)
        # B grows as 1 / (pi - angle) near half a turn, its rate as the square of that
        near = 1.0 / min(1.0, np.pi - angle)
        assert found[1] == pytest.approx(dw, abs=1e-13 * near**2)
        assert found[2] == pytest.approx(ddw, abs=1e-12 * near**3)


@pytest.mark.parametrize(
    ("definition", "message"),
    [
        (AngleSum(of=["turn", "slide"]), "cannot mix angles and lengths"),
        (AngleSum(of=["turn", "tild"]), "no joint 'tild'"),
        (PointCoordinate(point="tap_link", along="x"), "no link 'tap_link'"),
        (Distance(between=("base", "tap_link")), "no link 'tap_link'"),
        (Rotation(body="tip_link", about="x", relative_to="roll_link"), "on the same body"),
    ],
)
def test_impossible_coordinates_are_refused(model, definition, message):
    with pytest.raises(InputError, match=message):
        definition.bind(model, joints_of(model))


@pytest.mark.parametrize(
    ("first", "between", "last", "message"),
    [
        ("0 0 1", "0 0 1", "0 0 -1", "'first' and 'last' are opposite"),
        ("0 0 1", "0 0 1", "0 0.01 1", "'first' and 'last' are not parallel"),
        ("0 0 1", "1 0 0", "0 0 1", "'first' and 'last' are not parallel"),  # but where 'between' is at 0
        ("0 0 1", "0 0 1", "0 1e-5 1", None),
    ],
)
def test_a_sum_about_axes_that_are_not_parallel_is_refused(chain, first, between, last, message):
    axes = {"first": first, "between": between, "last": last}
    model = build_model(chain(*({"name": name, "axis": axis} for name, axis in axes.items()))).model
    with pytest.raises(InputError, match=message) if message else nullcontext():
        AngleSum(of=["first", "last"]).bind(model, joints_of(model))


@pytest.mark.parametrize("name", [name for name in DEFINITIONS if name not in ("sum", "length")])
def test_the_wrenches_of_an_effort_have_its_power(model, name):
    """Through Pinocchio's Jacobians of the bodies: ``sum J_i^T wrench_i = effort row``."""
    coordinate = DEFINITIONS[name].bind(model, joints_of(model))
    q, *_ = motion(0.4, model.nv)
    wrenches = coordinate.wrenches(LinkPlacements.at(model, q[None]), np.array([2.0]))
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    loads = sum(pin.getJointJacobian(model, data, joint, pin.WORLD).T @ wrenches[joint][0] for joint in wrenches)
    assert loads == pytest.approx(2.0 * coordinate.row(Kinematics.at(model, q)), abs=1e-14)


def test_a_tool_turned_over_with_its_reference_is_not_turned(chain):
    """Half a turn from the world, where its rotation vector is singular, is nothing relative to a point turned so."""
    joints = ({"name": "lift", "kind": "prismatic"}, {"name": "flip", "axis": "1 0 0"})
    plain = build_model(chain(*joints)).model
    over = PointDefinition(link="base", at=(0.0, 0.0, 0.0), rpy=(np.pi, 0.0, 0.0))
    model = with_points(plain, [("over", over)])
    coordinate = Rotation(body="flip_link", about="x", relative_to="over").bind(model, joints_of(model))
    state = evaluate(coordinate, model, np.array([0.3, np.pi + 0.2]), np.array([1.0, -0.7]), np.array([0.0, 2.0]))
    assert state == pytest.approx((0.2, -0.7, 2.0), abs=1e-15)

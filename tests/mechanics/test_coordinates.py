import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.mechanics.coordinates import AXES, AngleSum, PointCoordinate, coordinates_of, frame_of, joints_of
from pinarm.mechanics.model import build_model

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
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.updateFramePlacements(model, data)
    row = coordinate.row(model, data)
    return coordinate.value(data, q), row @ v, row @ a + coordinate.drift(model, data)


def motion(t, n):
    """A smooth motion of n joints with its derivatives."""
    k = np.arange(1, n + 1)
    return 0.5 * np.sin(k * t + k), 0.5 * k * np.cos(k * t + k), -0.5 * k**2 * np.sin(k * t + k)


DEFINITIONS = {
    "sum": AngleSum(kind="sum", of=["turn", "tilt", "roll"]),
    "length": AngleSum(kind="sum", of=["slide"]),
    **{f"tip along {axis}": PointCoordinate(kind="point", point="tip_link", along=axis) for axis in AXES},
}


@pytest.mark.parametrize("name", DEFINITIONS)
def test_rates_are_the_derivatives_of_the_value(model, differentiate, name):
    coordinate = DEFINITIONS[name].bind(model, joints_of(model))

    def rates(t):
        return np.array(evaluate(coordinate, model, *motion(t, model.nv)))

    for t in (0.0, 0.7, 1.9):
        # differences of order 8 at h = 0.02 of sines up to 8 rad/s: 1e-10
        assert differentiate(rates, t)[:2] == pytest.approx(rates(t)[1:], abs=1e-9)


def test_coordinates_with_opposite_axes_have_opposite_signs(model):
    q, v, a = motion(0.4, model.nv)
    for axis in "xyz":
        plus, minus = (
            evaluate(DEFINITIONS[f"tip along {name}"].bind(model, joints_of(model)), model, q, v, a)
            for name in (axis, f"-{axis}")
        )
        assert plus == pytest.approx(-np.array(minus), abs=1e-15)


def test_point_stands_where_the_placements_say(model):
    coordinate = DEFINITIONS["tip along x"].bind(model, joints_of(model))
    value, *_ = evaluate(coordinate, model, np.zeros(4), np.zeros(4), np.zeros(4))
    assert value == pytest.approx(0.3 + 0.2 + 0.1, abs=1e-15)


def test_joints_have_names_places_and_units(model):
    joints = joints_of(model)
    assert list(joints) == ["turn", "slide", "tilt", "roll"]
    assert [joint.q for joint in joints.values()] == [joint.v for joint in joints.values()] == [0, 1, 2, 3]
    assert [str(joint.unit) for joint in joints.values()] == ["rad", "m", "rad", "rad"]


def test_sum_is_weighted_by_how_often_a_joint_is_named(model):
    coordinate = AngleSum(kind="sum", of=["turn", "roll", "turn"]).bind(model, joints_of(model))
    assert coordinate.weights.tolist() == [2.0, 0.0, 0.0, 1.0]
    assert coordinate.unit == unit("rad")


def test_places_differ_where_another_joint_has_more_numbers_in_q_than_in_v():
    model = pin.Model()
    ball = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.addJoint(ball, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    hinge = joints_of(model)["hinge"]
    assert (hinge.q, hinge.v) == (4, 3)
    coordinate = coordinates_of(model, joints_of(model), {})["hinge"]
    assert coordinate.value(model.createData(), np.array([0, 0, 0, 1, 0.7])) == 0.7


@pytest.mark.parametrize(
    ("definition", "message"),
    [
        (AngleSum(kind="sum", of=["turn", "slide"]), "cannot mix angles and lengths"),
        (AngleSum(kind="sum", of=["turn", "tild"]), "no joint 'tild'"),
        (PointCoordinate(kind="point", point="tap_link", along="x"), "no link 'tap_link'"),
    ],
)
def test_impossible_coordinates_are_refused(model, definition, message):
    with pytest.raises(InputError, match=message):
        definition.bind(model, joints_of(model))


def test_the_message_suggests_the_name_that_was_meant(model):
    with pytest.raises(InputError) as caught:
        frame_of(model, "tap_link")
    assert caught.value.hint == "tip_link"


def test_a_coordinate_cannot_take_the_name_of_a_joint(model):
    with pytest.raises(InputError, match="has the name of a joint"):
        coordinates_of(model, joints_of(model), {"turn": DEFINITIONS["sum"]})

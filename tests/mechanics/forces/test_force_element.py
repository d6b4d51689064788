import typing

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.linear.derivatives import element_derivatives
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import Distance, PointCoordinate, coordinates_of
from pinarm.mechanics.forces.along_coordinate import (
    CoordinateEffort,
    CoordinateSpring,
    JointEffort,
    JointSpring,
    RegularisedFriction,
    TorqueSpeed,
)
from pinarm.mechanics.forces.bushing import Bushing, DampingRates, SpringRates
from pinarm.mechanics.forces.kinds import Force
from pinarm.mechanics.forces.points import ElasticCable, PointSpring, Wrench
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.laws import Constant, Harmonic, SpeedPoints, Spline, Trapezoid

MEMBERS = typing.get_args(Force)
RUBBER = SpringRates(
    translation=(30.0, 50.0, 20.0), rotation=(6.0, 9.0, 4.0),
    coupling={"x_y": 7.0, "y_rz": -8.0, "z_ry": 5.0, "x_rx": 3.0, "rx_rz": 2.0},
)  # fmt: skip
OIL = DampingRates(translation=(3.0, 1.0, 2.0), rotation=(0.6, 0.9, 0.4), coupling={"y_rz": -0.4, "z_rx": 0.3})
SAMPLES = {
    JointSpring: [
        JointSpring(joint="turn", stiffness=30.0, damping=0.7, rest=0.2),
        JointSpring(joint="slide", stiffness=200.0, rest=-0.1),
        JointSpring(joint="slide", damping=4.0),
    ],
    JointEffort: [
        JointEffort(joint="turn", effort=Harmonic(mean=1.0, amplitude=3.0, pulsation=2.0)),
        JointEffort(joint="slide", effort=Trapezoid(start=-2.0, end=5.0, acceleration=4.0)),
        JointEffort(joint="turn", over="turn", effort=Spline(points=[(-1.0, 4.0), (0.3, -6.0), (1.2, 9.0)])),
        JointEffort(joint="slide", over="turn", period=np.pi, effort=Harmonic(amplitude=8.0, pulsation=6.0)),
        JointEffort(joint="slide", over="apart", effort=Harmonic(amplitude=8.0, pulsation=6.0)),
        JointEffort(joint="turn", while_={"across": "decreasing"}, effort=Constant(value=8.0)),
    ],
    RegularisedFriction: [
        RegularisedFriction(joint="turn", friction=3.0, creep=0.4),
        RegularisedFriction(joint="slide", friction=20.0),
    ],
    TorqueSpeed: [
        TorqueSpeed(joint="turn", curve=[(-1.0, 9.0), (0.0, 6.0), (1.5, 5.0), (3.0, -1.0)]),
        TorqueSpeed(joint="slide", curve=[(-0.5, 90.0), (0.5, 60.0)]),
    ],
    PointSpring: [
        PointSpring(between=("post", "slide_link"), stiffness=90.0, free_length=0.4),
        PointSpring(between=("slide_link", "post"), damping=7.0),
        PointSpring(between=("post", "slide_link"), force=-12.0),
        PointSpring(between=("turn_link", "slide_link"), stiffness=50.0, damping=2.0, force=9.0),
    ],
    Bushing: [
        Bushing(between=("post", "slide_link"), stiffness=RUBBER),
        Bushing(between=("slide_link", "turn_link"), damping=OIL),
        Bushing(between=("turn_link", "post"), stiffness=RUBBER, damping=OIL),
    ],
    ElasticCable: [
        ElasticCable(through=["post", "slide_link"], stiffness=90.0, free_length=0.2),
        ElasticCable(through=["slide_link", "post", "turn_link"], stiffness=60.0, free_length=0.3, damping=5.0),
    ],
    Wrench: [
        Wrench(point="slide_link", force=(3.0, -8.0, 5.0), moment=(1.0, 2.0, -4.0)),
        Wrench(point="slide_link", force=(0.0, 9.0, 1.0), moment=(0.0, 1.0, 6.0), axes="slide_link"),
        Wrench(point="turn_link", moment=(1.0, 2.0, 7.0), axes="post"),
        Wrench(point="slide_link", force=(3.0, -8.0, 5.0), axes="turn_link",
               factor=Harmonic(mean=1.0, amplitude=0.7, pulsation=5.0)),
        Wrench(point="slide_link", force=(3.0, -8.0, 5.0), over="across",
               factor=Harmonic(amplitude=2.0, pulsation=3.0)),
    ],
    CoordinateSpring: [
        CoordinateSpring(coordinate="apart", stiffness=90.0, damping=7.0, rest=0.4),
        CoordinateSpring(coordinate="across", stiffness=90.0, rest=-0.1),
        CoordinateSpring(coordinate="turn", stiffness=30.0, damping=0.7, rest=0.2),
    ],
    CoordinateEffort: [
        CoordinateEffort(coordinate="across", effort=Harmonic(mean=1.0, amplitude=9.0, pulsation=2.0)),
        CoordinateEffort(coordinate="apart", effort=Constant(value=8.0)),
        CoordinateEffort(coordinate="apart", over="turn", effort=Harmonic(amplitude=8.0, pulsation=6.0)),
    ],
}  # fmt: skip
ALONG = {"apart": Distance(between=("post", "slide_link")), "across": PointCoordinate("slide_link", (1.0, 2.0, 1.0))}
AT_POINTS = [
    force for samples in SAMPLES.values() for force in samples if isinstance(force, PointSpring | Bushing | Wrench)
]
at_points = pytest.mark.parametrize("force", AT_POINTS, ids=lambda force: type(force).__struct_config__.tag)
every_force = pytest.mark.parametrize(
    "force",
    [pytest.param(force, id=f"{member.__name__} {k}") for member in SAMPLES for k, force in enumerate(SAMPLES[member])],
)


def motion(t):
    """A smooth motion of both joints: q and v, each of shape (..., 2)."""
    x = np.asarray(t)[..., None] * np.array([1.3, 2.1]) + np.array([0.4, 1.0])
    return np.sin(x), np.array([1.3, 2.1]) * np.cos(x)


def load(element, t, q, v):
    tau = np.zeros_like(v)
    element.add_load(t, q, v, tau)
    return tau


def wrenches_of(element, model, t, q, v):
    """Return the wrenches in one state, shape (6,) each."""
    acting = element.wrenches(LinkPlacements.at(model, q[None]), np.array([t]), v[None])
    return {joint: wrench[0] for joint, wrench in acting.items()}


def made(force, model, joints):
    """Return the element of a force on an interval between two breakpoints of every sample."""
    return force.bind(model, joints, coordinates_of(model, joints, ALONG)).on(0.1, 0.9)


@pytest.mark.house
def test_every_force_of_the_union_has_a_sample():
    assert set(SAMPLES) == set(MEMBERS)
    assert all(type(force) is member for member, samples in SAMPLES.items() for force in samples)


@every_force
def test_power_of_the_load_is_what_leaves_the_potential_and_is_not_dissipated(force, model, joints, differentiate):
    element = made(force, model, joints)
    worked = 0.0
    for t in np.linspace(0.2, 0.8, 9):
        q, v = motion(t)
        power = float(load(element, t, q, v) @ v)
        change = differentiate(lambda x: element.potential_energy(motion(x)[0]), t)
        # differences of order 8 at h = 0.02, of energies up to 100 J
        assert power == pytest.approx(-change - element.dissipated_power(t, q, v), abs=1e-9)
        assert not element.conservative or element.dissipated_power(t, q, v) == 0.0
        worked = max(worked, abs(power))
    assert worked > 1.0, "the motion must make the element work"


@every_force
def test_complex_steps_give_the_derivatives_of_the_load(force, model, joints, differentiate):
    """Against real differences of order 8; no sample is at a kink in this state."""
    element, (q, v) = made(force, model, joints), motion(0.37)
    by_q, by_v = element_derivatives(model, element, 0.37, q, v)
    for k, way in enumerate(np.eye(2)):
        of_q = differentiate(lambda x, way=way: load(element, 0.37, q + x * way, v), 0.0, h=2e-3)
        of_v = differentiate(lambda x, way=way: load(element, 0.37, q, v + x * way), 0.0, h=2e-3)
        assert by_q[:, k] == pytest.approx(of_q, abs=1e-8)  # rounding of loads of 100 N over the step
        assert by_v[:, k] == pytest.approx(of_v, abs=1e-8)
        for power in (element.potential_energy, lambda x: element.dissipated_power(0.37, x, x - q + v)):
            of_both = differentiate(lambda x, way=way, power=power: power(q + x * way), 0.0, h=2e-3)
            assert power(q + 1e-30j * way).imag / 1e-30 == pytest.approx(of_both, abs=1e-8)


@at_points
def test_wrenches_on_the_links_make_up_the_load(force, model, joints):
    """The power of all wrenches, moved to the world's origin, on the twists of their links there."""
    t = 0.8
    element, (q, v) = made(force, model, joints), motion(t)
    wrenches = wrenches_of(element, model, t, q, v)
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    total = np.zeros(model.nv)
    for joint, wrench in wrenches.items():
        assert wrench.shape == (6,)
        total += pin.getJointJacobian(model, data, joint, pin.WORLD).reshape(6, -1).T @ wrench
    assert total == pytest.approx(load(element, t, q, v), abs=1e-13)
    names = {model.names[joint] for joint in wrenches}
    ends = (force.point,) if isinstance(force, Wrench) else force.between
    assert names == {"universe" if end == "post" else end.removesuffix("_link") for end in ends}


class TestEffortOverACoordinate:
    def test_it_is_the_law_at_the_place_of_the_other_joint_and_repeats(self, model, joints):
        law = SpeedPoints(points=[(0.0, 2.0), (0.5 - 5e-10, 2.0), (0.5 + 5e-10, -2.0)])  # a saw of height 1
        push = JointEffort(joint="slide", effort=law, over="turn", period=1.0).bind(model, joints).on(0.0, 1.0)
        turn = np.array([0.0, 0.2, 0.5, 0.75, 1.25, -0.25, -3.8])
        q = np.stack([turn, np.full(7, 9.0)], axis=1)
        tau = load(push, 0.0, q, np.zeros((7, 2)))
        assert tau[:, 0].tolist() == [0.0] * 7
        assert tau[:, 1] == pytest.approx([0.0, 0.4, 1.0, 0.5, 0.5, 0.5, 0.4], abs=1e-8)

    @pytest.mark.parametrize(("given", "message", "path"), [
        ({"over": "trun"}, "no coordinate 'trun'", ("over",)),
        ({"over": "slide", "effort": Harmonic(amplitude="1 N*m", pulsation="1 rad/s")}, "'rad/s' is not a unit",
         ("effort", "pulsation")),
        ({"over": "slide", "effort": Constant(value="1 N")}, "'N' is not a unit", ("effort", "value")),
        ({"over": "slide", "period": "1 s"}, "'s' is not a unit", ("period",)),
    ])  # fmt: skip
    def test_its_units_are_those_of_the_two_joints(self, model, joints, given, message, path):
        keys = {"effort": Constant(value="1 N*m"), **given}
        with pytest.raises(InputError, match=message) as caught:
            JointEffort(joint="turn", **keys).bind(model, joints)
        assert caught.value.path == path

    @pytest.mark.parametrize(("points", "message"), [
        ([(-1.0, 3.0), (-0.5, 7.0), (0.0, 0.0), (3.0, 0.0)], "a point at -1, and repeats what it says from 0 to 4"),
        ([(1.0, 3.0), (2.0, 7.0), (5.0, 3.0)], "a point at 5, and repeats what it says from 0 to 4"),
        ([(0.0, 1.0), (2.0, 2.0)], "its value is 1 at 0 and 2 after a period"),
    ])  # fmt: skip
    def test_no_point_beyond_a_period_is_left_out_and_no_period_ends_in_a_jump(self, points, message, joints, model):
        """A load from -1 to 3 was taken from 0 to 4, where it had stayed at its last value from 3 on."""
        push = JointEffort(joint="slide", over="turn", period=4.0, effort=Spline(points=points))
        with pytest.raises(InputError, match=message) as caught:
            push.bind(model, joints)
        assert caught.value.path == ("period",)

import typing

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import DynamicsError, InputError, UnitError
from pinarm.input.units import unit
from pinarm.input.yaml.schema import Measured
from pinarm.mechanics.forces import Force
from pinarm.mechanics.forces.bushing import Bushing, DampingRates, SpringRates
from pinarm.mechanics.forces.joint_definitions import CREEP, JointEffort, JointFriction, JointSpring, TorqueSpeed
from pinarm.mechanics.forces.point import PointSpring, Wrench
from pinarm.mechanics.joints import frame_of, joints_of
from pinarm.mechanics.laws import Constant, Harmonic, SpeedPoints, Spline, Trapezoid
from pinarm.mechanics.loading.pinocchio_model import build_model

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
        JointEffort(joint="slide", over="turn", period=0.7, effort=Harmonic(amplitude=8.0, pulsation=3.0)),
    ],
    JointFriction: [
        JointFriction(joint="turn", friction=3.0, creep=0.4),
        JointFriction(joint="slide", friction=20.0),
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
    Wrench: [
        Wrench(point="slide_link", force=(3.0, -8.0, 5.0), moment=(1.0, 2.0, -4.0)),
        Wrench(point="slide_link", force=(0.0, 9.0, 1.0), moment=(0.0, 1.0, 6.0), axes="slide_link"),
        Wrench(point="turn_link", moment=(1.0, 2.0, 7.0), axes="post"),
        Wrench(point="slide_link", force=(3.0, -8.0, 5.0), axes="turn_link",
               factor=Harmonic(mean=1.0, amplitude=0.7, pulsation=5.0)),
    ],
}  # fmt: skip
AT_JOINTS = [force for forces in SAMPLES.values() for force in forces if hasattr(force, "joint")]
AT_POINTS = [force for forces in SAMPLES.values() for force in forces if not hasattr(force, "joint")]
at_joints = pytest.mark.parametrize(
    "force", AT_JOINTS, ids=lambda force: f"{type(force).__struct_config__.tag} {force.joint}"
)
at_points = pytest.mark.parametrize("force", AT_POINTS, ids=lambda force: type(force).__struct_config__.tag)
every_force = pytest.mark.parametrize(
    "force",
    [pytest.param(force, id=f"{member.__name__} {k}") for member in SAMPLES for k, force in enumerate(SAMPLES[member])],
)


@pytest.fixture
def model(chain):
    """A turning link with a sliding one on it, both off the axis, and a post that stands still beside them."""
    bodies = ({"name": "turn", "at": "0.2 -0.1 0.3", "axis": "0.6 0 0.8"},
              {"name": "slide", "kind": "prismatic", "axis": "1 0 0", "at": "1.4 0.3 0.2"})  # fmt: skip
    post = (
        '<link name="post"/><joint name="foot" type="fixed"><parent link="base"/><child link="post"/>'
        '<origin xyz="0.5 1.5 -0.4" rpy="0.3 -0.7 1.1"/></joint></robot>'
    )
    return build_model(chain(*bodies).replace("</robot>", post)).model


@pytest.fixture
def joints(model):
    return joints_of(model)


def motion(t):
    """A smooth motion of both joints: q and v, each of shape (..., 2)."""
    x = np.asarray(t)[..., None] * np.array([1.3, 2.1]) + np.array([0.4, 1.0])
    return np.sin(x), np.array([1.3, 2.1]) * np.cos(x)


def load(element, t, q, v):
    tau = np.zeros_like(v)
    element.add_load(t, q, v, tau)
    return tau


def bound(force, model, joints):
    """Return the element of a force on an interval between two breakpoints of every sample."""
    return force.bind(model, joints).on(0.1, 0.9)


def test_every_force_of_the_union_has_a_sample():
    assert set(SAMPLES) == set(MEMBERS)
    assert all(type(force) is member for member, forces in SAMPLES.items() for force in forces)


@every_force
def test_power_of_the_load_is_what_leaves_the_potential_and_is_not_dissipated(force, model, joints, differentiate):
    element = bound(force, model, joints)
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
@pytest.mark.parametrize("n", [3, 20])
def test_many_states_at_once_are_the_same_as_one_by_one(force, model, joints, n):
    element = bound(force, model, joints)
    t = np.linspace(0.2, 0.8, n)
    q, v = motion(t)
    many = load(element, t, q, v), element.potential_energy(q), element.dissipated_power(t, q, v)
    for k in range(len(t)):
        one = (
            load(element, t[k], q[k], v[k]),
            element.potential_energy(q[k]),
            element.dissipated_power(t[k], q[k], v[k]),
        )
        for together, alone in zip(many, one, strict=True):
            assert together[k] == pytest.approx(alone, rel=1e-13, abs=1e-13)
    assert [x.shape for x in many] == [(n, 2), (n,), (n,)]


@every_force
def test_a_load_is_steady_that_is_the_same_in_all_states_and_at_all_times(force, model, joints):
    element, t = bound(force, model, joints), np.linspace(0.2, 0.8, 6)
    assert element.steady == bool(np.ptp(load(element, t, *motion(t)), axis=0).max() == 0.0)


@every_force
def test_load_is_added_to_what_is_there(force, model, joints):
    element, (q, v) = bound(force, model, joints), motion(0.5)
    tau = np.array([10.0, 20.0])
    element.add_load(0.5, q, v, tau)
    assert tau == pytest.approx(np.array([10.0, 20.0]) + load(element, 0.5, q, v), abs=1e-14)


@at_joints
def test_load_acts_at_the_named_joint_only(force, model, joints):
    q, v = motion(0.5)
    other = 1 - joints[force.joint].v
    assert load(bound(force, model, joints), 0.5, q, v)[other] == 0.0
    assert bound(force, model, joints).wrenches(0.5, q, v) == {}


@at_joints
def test_unknown_joints_are_refused(force, model, joints):
    with pytest.raises(InputError, match="no joint 'trun'"):
        msgspec.structs.replace(force, joint="trun").bind(model, joints)


@at_points
@pytest.mark.parametrize("t", [0.2, 0.5, 0.8])
def test_wrenches_on_the_links_make_up_the_load(force, model, joints, t):
    """The power of all wrenches, moved to the world's origin, on the twists of their links there."""
    element, (q, v) = bound(force, model, joints), motion(t)
    wrenches = element.wrenches(t, q, v)
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


@pytest.mark.parametrize("force", SAMPLES[PointSpring], ids=range(len(SAMPLES[PointSpring])))
def test_the_ends_of_a_point_spring_pull_at_each_other(force, model, joints):
    q, v = motion(0.5)
    one, other = bound(force, model, joints).wrenches(0.5, q, v).values()
    assert one == pytest.approx(-other, abs=1e-13)
    assert np.linalg.norm(one[:3]) > 1.0


@pytest.mark.parametrize(
    ("force", "names"),
    [
        *((PointSpring(between=ends), ends) for ends in [("pots", "turn_link"), ("post", "pots")]),
        (Wrench(point="pots"), None),
        (Wrench(point="post", axes="pots"), None),
        (Wrench(point="post", axes="wrold"), None),
        (Wrench(point="turn"), None),  # a joint
    ],
)
def test_unknown_links_are_refused(force, names, model, joints):
    with pytest.raises(InputError, match=r"no link '(pots|wrold|turn)'") as caught:
        force.bind(model, joints)
    assert "turn_link" in caught.value.expected


@pytest.mark.parametrize("point", ["slide_link", "turn_link"])
@pytest.mark.parametrize("axes", ["world", "slide_link", "turn_link", "post"])
def test_load_of_a_wrench_is_its_virtual_work(model, joints, differentiate, point, axes):
    """Force times the displacement of the point, moment times the rotation, both by differences of the placement."""
    force, moment = np.array([3.0, -8.0, 5.0]), np.array([1.0, 2.0, -4.0])
    element = Wrench(point=point, force=force, moment=moment, axes=axes).bind(model, joints).on(0, 1)
    q, data = np.array([0.7, -0.4]), model.createData()

    def placement(x, name=point):
        pin.framesForwardKinematics(model, data, x)
        return data.oMf[frame_of(model, name)].copy() if name != "world" else pin.SE3.Identity()

    given, here = placement(q, axes).rotation, placement(q)
    for k, direction in enumerate(np.eye(2)):

        def moved(h, direction=direction):
            there = placement(pin.integrate(model, q, h * direction))
            return np.concatenate([there.translation, pin.log3(there.rotation @ here.rotation.T)])

        change = differentiate(moved, 0.0)
        expected = (given @ force) @ change[:3] + (given @ moment) @ change[3:]
        # differences of order 8 at h = 0.02
        assert load(element, 0.5, q, np.zeros(2))[k] == pytest.approx(expected, abs=1e-11)


def test_a_wrench_follows_its_factor(model, joints):
    q, v = motion(0.0)
    plain, varied = (
        Wrench(point="slide_link", force=(1.0, 2.0, 3.0), **factor).bind(model, joints).on(0.0, 1.0)
        for factor in ({}, {"factor": Harmonic(amplitude=2.0, pulsation=3.0)})
    )
    for t in (0.1, 0.7):
        scale = 2.0 * np.sin(3.0 * t)
        assert load(varied, t, q, v) == pytest.approx(scale * load(plain, t, q, v), abs=1e-14)
        [one], [other] = varied.wrenches(t, q, v).values(), plain.wrenches(t, q, v).values()
        assert one == pytest.approx(scale * other, abs=1e-14)
    with pytest.raises(ValueError, match="on an interval of time"):
        load(SAMPLES[Wrench][3].bind(model, joints), 0.5, q, v)


@pytest.fixture
def held(chain):
    """A pendulum of 0.8 m about z, and a hook at (0.3, 1.1) that its tip is tied to."""
    ends = (
        '<link name="tip"/><joint name="end" type="fixed"><parent link="arm_link"/><child link="tip"/>'
        '<origin xyz="0.8 0 0"/></joint><link name="hook"/><joint name="wall" type="fixed"><parent link="base"/>'
        '<child link="hook"/><origin xyz="0.3 1.1 0"/></joint></robot>'
    )
    model = build_model(chain({"name": "arm"}).replace("</robot>", ends)).model
    return model, joints_of(model)


@pytest.mark.parametrize("ends", [("hook", "tip"), ("tip", "hook")])
@pytest.mark.parametrize("theta", [0.2, 1.0, 2.7])
def test_point_spring_on_a_pendulum_by_hand(held, ends, theta):
    element = PointSpring(between=ends, stiffness=40.0, damping=6.0, free_length=0.5,
                          force=3.0).bind(*held)  # fmt: skip
    rate = 1.7
    x, y = 0.8 * np.cos(theta) - 0.3, 0.8 * np.sin(theta) - 1.1
    length = np.hypot(x, y)
    # l^2 = 0.8^2 + 0.3^2 + 1.1^2 - 2 * 0.8 (0.3 cos + 1.1 sin), so that l dl/dtheta = 0.8 (0.3 sin - 1.1 cos)
    slope = 0.8 * (0.3 * np.sin(theta) - 1.1 * np.cos(theta)) / length
    tension = 40.0 * (length - 0.5) + 6.0 * slope * rate + 3.0
    q, v = np.array([theta]), np.array([rate])
    assert load(element, 0.0, q, v) == pytest.approx([-tension * slope], rel=1e-13)
    stretched = length - 0.5
    assert element.potential_energy(q) == pytest.approx(20.0 * stretched**2 + 3.0 * stretched, rel=1e-13)
    assert element.dissipated_power(0.0, q, v) == pytest.approx(6.0 * (slope * rate) ** 2, rel=1e-13)
    pull = element.wrenches(0.0, q, v)[1]
    point = np.array([0.8 * np.cos(theta), 0.8 * np.sin(theta), 0.0])
    expected = -tension * np.array([x, y, 0.0]) / length
    assert pull == pytest.approx(np.concatenate([expected, np.cross(point, expected)]), abs=1e-12)


@pytest.mark.parametrize("act", [
    lambda element, q, v: load(element, 0.0, q, v), lambda element, q, v: element.wrenches(0.0, q, v),
    lambda element, q, v: element.potential_energy(q), lambda element, q, v: element.dissipated_power(0.0, q, v),
])  # fmt: skip
def test_points_that_meet_are_refused(chain, act):
    ends = "".join(
        f'<link name="{name}"/><joint name="to_{name}" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="0.8 0 0"/></joint>' for name, parent in (("tip", "arm_link"), ("hook", "base"))
    )  # fmt: skip
    model = build_model(chain({"name": "arm"}).replace("</robot>", f"{ends}</robot>")).model
    element = PointSpring(between=("tip", "hook"), stiffness=1.0, damping=1.0).bind(model, joints_of(model))
    with pytest.raises(
        DynamicsError, match=r"points tip and hook of a two-point spring meet: .* where arm = 0 rad"
    ) as caught:
        act(element, np.zeros(1), np.ones(1))
    assert caught.value.data["q"].tolist() == [0.0]
    with pytest.raises(DynamicsError, match="points tip and hook of a two-point spring meet"):
        element.potential_energy(np.repeat([[1.0], [0.0]], 20, axis=0))


@pytest.mark.parametrize("creep", [None, 0.02])
def test_friction_is_its_bound_far_above_creep_and_gives_way_below(model, joints, creep):
    given = {} if creep is None else {"creep": creep}
    element = JointFriction(joint="turn", friction=3.0, **given).bind(model, joints)
    scale = CREEP if creep is None else creep

    def at(rate):
        return load(element, 0.0, np.zeros(2), np.array([rate, 50.0]))[0]

    for sign in (1.0, -1.0):
        assert at(sign * 5 * scale) == pytest.approx(-sign * 3.0, rel=1e-4)
        assert at(sign * 1e3 * scale) == -sign * 3.0
        # a load of half the bound makes the joint creep at atanh(1/2)
        assert at(sign * scale * np.arctanh(0.5)) == pytest.approx(-sign * 1.5, rel=1e-14)
    assert at(0.0) == 0.0
    assert element.dissipated_power(0.0, np.zeros(2), np.array([-2.0, 50.0])) == pytest.approx(6.0, rel=1e-14)
    assert element.potential_energy(np.ones(2)) == 0.0


def test_motor_curve_is_linear_between_its_points_and_constant_beyond(model, joints):
    element = SAMPLES[TorqueSpeed][0].bind(model, joints)
    rates = np.array([-7.0, -1.0, -0.5, 0.0, 0.75, 1.5, 2.0, 3.0, 40.0])
    expected = [9.0, 9.0, 7.5, 6.0, 5.5, 5.0, 3.0, -1.0, -1.0]
    v = np.stack([rates, np.full(9, 50.0)], axis=1)
    assert load(element, 0.0, np.zeros((9, 2)), v)[:, 0] == pytest.approx(expected, abs=1e-14)
    assert element.dissipated_power(0.0, np.zeros((9, 2)), v) == pytest.approx(-rates * expected, abs=1e-13)


@pytest.mark.parametrize("speeds", [(1.0, 0.0), (0.0, 0.0), (0.0, 2.0, 1.0)])
def test_a_curve_that_descends_is_refused(speeds):
    with pytest.raises(InputError, match="velocities of the curve do not ascend"):
        TorqueSpeed(joint="turn", curve=[(speed, 1.0) for speed in speeds])


def test_a_curve_of_one_point_is_refused():
    with pytest.raises(InputError, match="do not ascend"):
        TorqueSpeed(joint="turn", curve=[(0.0, 1.0)])


def test_spring_and_damper_by_hand(model, joints):
    element = SAMPLES[JointSpring][0].bind(model, joints)
    q, v = np.array([0.5, 9.0]), np.array([-2.0, 9.0])
    assert load(element, 0.0, q, v) == pytest.approx([-30.0 * 0.3 + 0.7 * 2.0, 0.0])
    assert element.potential_energy(q) == pytest.approx(0.5 * 30.0 * 0.3**2)
    assert element.dissipated_power(0.0, q, v) == pytest.approx(0.7 * 4.0)
    assert element.laws() == []


def test_effort_is_its_law_on_each_side_of_a_jump(model, joints):
    law = Trapezoid(start=0.0, end=1.0, acceleration=1.0, begin=0.5)
    element = JointEffort(joint="turn", effort=law).bind(model, joints)
    q, v = motion(0.0)
    assert element.laws() == [law]
    assert load(element.on(1.5, 2.5), 1.0, q, v)[0] == pytest.approx(1.0 - 0.5 * 1.5**2)
    assert load(element.on(0.5, 1.5), 1.0, q, v)[0] == pytest.approx(0.125)
    with pytest.raises(ValueError, match="on an interval of time"):
        load(element, 1.0, q, v)


def measured(value, text):
    number = Measured(value)
    number.unit = unit(text)
    return number


UNITS = {
    "turn": {"stiffness": "N*m/rad", "damping": "N*m*s/rad", "rest": "deg"},
    "slide": {"stiffness": "N/mm", "damping": "N*s/m", "rest": "mm"},
}


@pytest.mark.parametrize("field", ["stiffness", "damping", "rest"])
@pytest.mark.parametrize(("joint", "other"), [("turn", "slide"), ("slide", "turn")])
def test_springs_check_their_units_against_the_joint(model, joints, joint, other, field):
    JointSpring(joint=joint, **{field: measured(1.0, UNITS[joint][field])}).bind(model, joints)
    with pytest.raises(UnitError, match="not a unit of this quantity"):
        JointSpring(joint=joint, **{field: measured(1.0, UNITS[other][field])}).bind(model, joints)


@pytest.mark.parametrize(("joint", "right", "wrong"), [("turn", "N*m", "N"), ("slide", "kN", "N*m")])
def test_efforts_check_their_units_against_the_joint(model, joints, joint, right, wrong):
    def effort(text):
        return JointEffort(joint=joint, effort=Harmonic(amplitude=measured(1.0, text), pulsation=1.0))

    effort(right).bind(model, joints)
    with pytest.raises(UnitError, match="not a unit of this quantity"):
        effort(wrong).bind(model, joints)


@pytest.mark.parametrize(("joint", "other"), [("turn", "slide"), ("slide", "turn")])
@pytest.mark.parametrize("what", ["friction", "creep", "speed of a curve", "effort of a curve"])
def test_friction_and_curves_check_their_units_against_the_joint(model, joints, joint, other, what):
    units = {"turn": ("N*m", "rpm"), "slide": ("kN", "mm/s")}

    def element(effort, rate):
        one = {"friction": measured(1.0, effort), "creep": measured(1.0, rate)}
        two = {"curve": [(0.0, 0.0), (measured(1.0, rate), measured(1.0, effort))]}
        if what.endswith("curve"):
            return TorqueSpeed(joint=joint, **two)
        return JointFriction(joint=joint, **one)

    right, wrong = units[joint], units[other]
    element(*right).bind(model, joints)
    mixed = (wrong[0], right[1]) if what.startswith(("friction", "effort")) else (right[0], wrong[1])
    with pytest.raises(UnitError, match="not a unit of this quantity"):
        element(*mixed).bind(model, joints)


@pytest.mark.parametrize("field", ["stiffness", "damping"])
def test_springs_and_dampers_that_give_energy_away_are_refused(field):
    with pytest.raises(ValueError, match="out of bounds"):
        JointSpring(joint="turn", **{field: -1.0})
    with pytest.raises(ValueError, match="out of bounds"):
        PointSpring(between=("a", "b"), **{field: -1.0})


@pytest.mark.parametrize(("field", "value"), [("friction", -1.0), ("creep", 0.0), ("creep", -1.0)])
def test_friction_that_drives_is_refused(field, value):
    with pytest.raises(ValueError, match="out of bounds"):
        JointFriction(joint="turn", **{"friction": 1.0, field: value})


class TestEffortOverACoordinate:
    def test_it_is_the_law_at_the_place_of_the_other_joint_and_repeats(self, model, joints):
        law = SpeedPoints(points=[(0.0, 2.0), (0.5, 2.0), (0.5 + 1e-9, -2.0)])  # up and down again: a saw of height 1
        push = JointEffort(joint="slide", effort=law, over="turn", period=1.0).bind(model, joints)
        turn = np.array([0.0, 0.2, 0.5, 0.75, 1.25, -0.25, -3.8])
        q = np.stack([turn, np.full(7, 9.0)], axis=1)
        tau = load(push, 0.0, q, np.zeros((7, 2)))
        assert tau[:, 0].tolist() == [0.0] * 7
        assert tau[:, 1] == pytest.approx([0.0, 0.4, 1.0, 0.5, 0.5, 0.5, 0.4], abs=1e-8)
        assert push.laws() == []

    @pytest.mark.parametrize(("given", "message", "path"), [
        ({"over": "trun"}, "no joint 'trun'", ("over",)),
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

    def test_a_period_needs_a_coordinate(self):
        with pytest.raises(InputError, match="a law over time has no period"):
            JointEffort(joint="turn", effort=Constant(value=1.0), period=2.0)

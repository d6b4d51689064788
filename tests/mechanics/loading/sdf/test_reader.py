"""SDF models: each feature against the same model in URDF, written by hand; and what is refused."""

import math

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import ModelError
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.use.mechanism import Mechanism

BODY = (
    "<inertial><pose>{com}</pose><mass>{mass}</mass><inertia><ixx>0.02</ixx><iyy>0.03</iyy><izz>0.04</izz>"
    "<ixy>0.001</ixy></inertia></inertial>"
)


def link(name, pose="0 0 0 0 0 0", mass=1.5, com="0.1 0.02 0 0.3 0 0", attributes=""):
    return f'<link name="{name}"><pose {attributes}>{pose}</pose>{BODY.format(com=com, mass=mass)}</link>'


def joint(name, parent, child, kind="revolute", axis="0 0 1", inside="", pose="", expressed=""):
    return (
        f'<joint name="{name}" type="{kind}">{pose}<parent>{parent}</parent><child>{child}</child>'
        f"<axis><xyz {expressed}>{axis}</xyz>{inside}</axis></joint>"
    )


def sdf(*parts, version="1.9", model=""):
    return f'<sdf version="{version}"><model name="m">{model}{"".join(parts)}</model></sdf>'


def urdf_link(name, mass=1.5, xyz="0.1 0.02 0", rpy="0.3 0 0"):
    return (
        f'<link name="{name}"><inertial><origin xyz="{xyz}" rpy="{rpy}"/><mass value="{mass}"/>'
        '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0" iyz="0"/></inertial></link>'
    )


def urdf_joint(name, parent, child, kind="continuous", axis="0 0 1", xyz="0 0 0", rpy="0 0 0", inside=""):
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/>{inside}</joint>'
    )


def urdf(*parts):
    return f'<robot name="m"><link name="world"/>{"".join(parts)}</robot>'


def assert_same(first, second, names=("a", "b")):
    """Mass matrix, weights with centrifugal terms, and placements of links are equal in some states."""
    one, two = build_model(first).model, build_model(second).model
    assert [*one.names] == [*two.names]
    rng = np.random.default_rng(3)
    for _ in range(3):
        v = rng.normal(size=one.nv)
        q = pin.integrate(one, pin.neutral(one), rng.normal(size=one.nv))
        data, other = one.createData(), two.createData()
        assert pin.crba(one, data, q) == pytest.approx(pin.crba(two, other, q), abs=1e-14)
        assert pin.nle(one, data, q, v) == pytest.approx(pin.nle(two, other, q, v), abs=1e-12)
        for model, buffers in ((one, data), (two, other)):
            pin.framesForwardKinematics(model, buffers, q)
        for name in names:
            places = [buffers.oMf[model.getFrameId(name)].homogeneous for model, buffers in ((one, data), (two, other))]
            assert places[0] == pytest.approx(places[1], abs=1e-14)


BOUNDS = '<limit lower="-1" upper="2" effort="5" velocity="3"/>'
CHAIN = urdf(
    urdf_link("a"), urdf_link("b"),
    urdf_joint("j", "world", "a", xyz="0.1 0.2 0.3", rpy="0 0 0.5"),
    urdf_joint("k", "a", "b", "prismatic", "1 0 0", xyz="0.4 0 0", rpy="0.2 0 0", inside=BOUNDS),
)  # fmt: skip
LIMIT = "<limit><lower>-1</lower><upper>2</upper><effort>5</effort><velocity>3</velocity></limit>"


IN_MODEL = 'expressed_in="__model__"'


def in_chain(b, second):
    return link("a", "0.1 0.2 0.3 0 0 0.5"), b, joint("j", "world", "a"), second


EQUAL = {
    "a link placed in the joint of another": in_chain(
        link("b", "0.4 0 0 0.2 0 0", attributes='relative_to="a"'), joint("k", "a", "b", "prismatic", "2 0 0", LIMIT)
    ),
    "a joint placed in the parent, the link in the joint": in_chain(
        link("b", attributes='relative_to="k"'),
        joint("k", "a", "b", "prismatic", "1 0 0", LIMIT, pose='<pose relative_to="a">0.4 0 0 0.2 0 0</pose>'),
    ),
    "a frame on the parent": in_chain(
        '<frame name="f" attached_to="a"><pose>0.4 0 0 0 0 0</pose></frame>'
        + link("b", "0 0 0 0.2 0 0", attributes='relative_to="f"'),
        joint("k", "f", "b", "prismatic", "1 0 0", LIMIT),
    ),
    "degrees": in_chain(
        link("b", f"0.4 0 0 {math.degrees(0.2)!r} 0 0", attributes='relative_to="a" degrees="true"'),
        joint("k", "a", "b", "prismatic", "1 0 0", LIMIT),
    ),
    "a quaternion": in_chain(
        link("b", f"0.4 0 0 {math.sin(0.1)!r} 0 0 {math.cos(0.1)!r}",
             attributes='relative_to="a" rotation_format="quat_xyzw"'),
        joint("k", "a", "b", "prismatic", "1 0 0", LIMIT),
    ),
    "an axis in the axes of the model": in_chain(
        link("b", "0.4 0 0 0.2 0 0", attributes='relative_to="a"'),
        joint("k", "a", "b", "prismatic", f"{math.cos(0.5)!r} {math.sin(0.5)!r} 0", LIMIT, expressed=IN_MODEL),
    ),
    "an axis in the axes of a link": in_chain(
        link("b", "0.4 0 0 0.2 0 0", attributes='relative_to="a"'),
        joint("k", "a", "b", "prismatic", "1 0 0", LIMIT, expressed='expressed_in="a"'),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", EQUAL)
def test_an_arm_is_that_of_its_urdf(name):
    assert_same(sdf(*EQUAL[name]), CHAIN)
    model = build_model(sdf(*EQUAL[name])).model
    assert (model.lowerPositionLimit[1], model.upperPositionLimit[1]) == (-1.0, 2.0)
    assert (model.effortLimit[1], model.velocityLimit[1]) == (5.0, 3.0)


@pytest.mark.parametrize(
    ("version", "inside"), [("1.4", ""), ("1.6", "<use_parent_model_frame>1</use_parent_model_frame>")]
)
def test_axes_of_old_versions_are_in_the_axes_of_the_model(version, inside):
    turned = f"0.1 0.2 0.3 0 0 0.5 {math.cos(0.5)!r} {math.sin(0.5)!r} 0".split()
    place = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.5), np.array([0.1, 0.2, 0.3]))
    b = place * pin.SE3(pin.rpy.rpyToMatrix(0.2, 0.0, 0.0), np.array([0.4, 0.0, 0.0]))
    pose = " ".join(repr(float(x)) for x in (*b.translation, *pin.rpy.matrixToRpy(b.rotation)))
    parts = link("a", " ".join(turned[:6])), link("b", pose), joint("j", "world", "a"), joint(
        "k", "a", "b", "prismatic", " ".join(turned[6:]), LIMIT + inside)  # fmt: skip
    assert_same(sdf(*parts, version=version), CHAIN)


CLOSED = sdf(
    link("a", "0 0 0 0 0 0.6"), link("b", "0.3 0.2 0 0 0 0.1"), link("c", "0.8 0 0 0 0 1.2"),
    joint("A", "world", "a"), joint("B", "a", "b"), joint("C", "world", "c"),
    joint("D", "c", "b", pose="<pose>0.5 0 0 0 0 0</pose>", inside="<dynamics><damping>0.1</damping></dynamics>"),
)  # fmt: skip


def test_a_loop_moves_as_that_of_a_urdf_with_its_mechanism_file(tmp_path):
    """Efforts of a crank at constant speed: the four-bar of the file, and one with frames placed by hand."""
    (tmp_path / "m.sdf").write_text(CLOSED)
    a, b, c = (pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, turn), np.array([x, y, 0.0]))
               for x, y, turn in ((0, 0, 0.6), (0.3, 0.2, 0.1), (0.8, 0, 1.2)))  # fmt: skip
    between, pin_place = a.actInv(b), b * pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
    xyz, rpy = (
        " ".join(map(repr, map(float, x))) for x in (between.translation, pin.rpy.matrixToRpy(between.rotation))
    )
    p, turn = c.actInv(pin_place).translation, c.actInv(pin_place).rotation
    frame = urdf_joint("p_fixed", "c", "p", "fixed", xyz=" ".join(map(repr, map(float, p))),
                       rpy=" ".join(map(repr, map(float, pin.rpy.matrixToRpy(turn)))))  # fmt: skip
    (tmp_path / "m.urdf").write_text(urdf(
        urdf_link("a"), urdf_link("b"), urdf_link("c"), '<link name="p"/><link name="q"/>', frame,
        urdf_joint("q_fixed", "b", "q", "fixed", xyz="0.5 0 0"), urdf_joint("A", "world", "a", rpy="0 0 0.6"),
        urdf_joint("B", "a", "b", xyz=xyz, rpy=rpy), urdf_joint("C", "world", "c", xyz="0.8 0 0", rpy="0 0 1.2"),
    ))  # fmt: skip
    law = {"law": "constant_speed", "speed": "1.5 rad/s"}
    problem = {"kind": "inverse", "time": {"end": "0.3 s", "samples": 7}, "motion": {"A": law}}
    loops = {"loops": {"D": {"kind": "revolute", "between": ["p", "q"], "axis": "z"}}}
    runs = [
        pinarm.run({"pinarm": 1, "mechanism": Mechanism.load(tmp_path / name, values=values), "problem": problem,
                    "outputs": ["joint.A.effort", "B", "C"]})
        for name, values in (("m.sdf", None), ("m.urdf", loops))
    ]  # fmt: skip
    for name in ("joint.A.effort", "B", "C"):
        assert runs[0][name].values == pytest.approx(runs[1][name].values, abs=1e-10)


def test_springs_damping_friction_and_mimics():
    dynamics = (
        "<dynamics><damping>0.2</damping><friction>0.3</friction><spring_stiffness>4</spring_stiffness>"
        "<spring_reference>0.5</spring_reference></dynamics>"
    )
    follow = '<mimic joint="j"><multiplier>2</multiplier><offset>0.1</offset><reference>0.3</reference></mimic>'
    robot = build_model(sdf(link("a"), link("b"), joint("j", "world", "a", inside=dynamics),
                            joint("k", "a", "b", inside=follow)))  # fmt: skip
    assert robot.model.damping.tolist() == [0.2, 0.0]
    assert robot.friction == {"j": 0.3}
    spring = robot.forces["joint springs"]
    assert (spring.stiffness.tolist(), spring.rest.tolist()) == ([4.0], [0.5])
    (mimic,) = robot.tree.mimics
    assert (mimic.joint, mimic.of, mimic.multiplier) == ("k", "j", 2.0)
    assert mimic.offset == pytest.approx(0.1 - 2 * 0.3)


def test_a_model_without_a_joint_to_the_world_floats_at_its_pose():
    xml = sdf(link("a", "0 0 1 0 0 0"), link("b"), joint("j", "a", "b"), model="<pose>0 2 0 0 0 0</pose>")
    robot = build_model(xml)
    assert (robot.model.nv, robot.model.nq) == (7, 8)
    assert any("'base: fixed' holds it" in note for note in robot.notes)
    held = build_model(xml, base="fixed").model
    data = held.createData()
    pin.framesForwardKinematics(held, data, np.zeros(1))
    assert data.oMf[held.getFrameId("a")].translation.tolist() == [0.0, 2.0, 1.0]


ARM = (link("a"), joint("j", "world", "a"))


def world_of(inside, version="1.9"):
    world = sdf(*ARM, version=version).replace("<model", f"<world name='w'>{inside}<model")
    return world.replace("</sdf>", "</world></sdf>")


PHYSICS = "<physics type='ode'><gravity>0 0 -{}</gravity></physics>"


@pytest.mark.parametrize(
    ("version", "inside", "down", "note"),
    [
        ("1.5", PHYSICS.format(3), 3.0, ""), ("1.9", "<gravity>0 0 -3</gravity>", 3.0, ""),
        ("1.6", PHYSICS.format(3), 9.8, "the world has no <gravity>"),
        ("1.6", PHYSICS.format(3) + "<gravity>0 0 -4</gravity>", 4.0, ""),
        ("1.9", "", 9.8, "by the format 0 0 -9.8 m/s"),
    ],
)  # fmt: skip
def test_gravity_is_where_its_version_has_it(version, inside, down, note):
    """sdf/1.4/physics.sdf to sdf/1.6/world.sdf of SDFormat, its default too."""
    robot = build_model(world_of(inside, version))
    assert robot.tree.gravity.tolist() == [0.0, 0.0, -down]
    assert note in " ".join(robot.notes)


def test_inertias_to_be_computed_of_shapes_are_refused():
    with pytest.raises(ModelError, match="link 'a': its inertia is to be computed"):
        build_model(sdf('<link name="a"><inertial auto="true"/></link>', joint("j", "world", "a")))


STILL = sdf(link("a"), link("b"), joint("j", "a", "b", "fixed"), model="<static>yes</static>")


@pytest.mark.parametrize("word", ["1", " TRUE "])
def test_a_static_model_does_not_move(word):
    for broken in (STILL, STILL.replace("fixed", "revolute")):
        with pytest.raises(ModelError, match="joint j moves" if "revolute" in broken else "no joint that moves"):
            build_model(broken.replace("yes", word))
    assert build_model(STILL.replace("yes", "False")).model.nv == 6


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        (sdf(*ARM, version="2.0"), "SDF of version '2.0'"),
        (sdf(*ARM, "<include><uri>../../etc/passwd</uri></include>"), "made of other models"),
        (sdf(*ARM).replace("<mass>", "<masss>").replace("</mass>", "</masss>"), "contains no <masss>"),
        (sdf(link("a"), joint("j", "world", "c")), "there is no frame 'c'"),
        (sdf(link("a", attributes='relative_to="b"'), link("b", attributes='relative_to="a"'), joint("j", "a", "b")),
         "placed in each other"),
        (sdf(link("a", attributes='frame="b"'), joint("j", "world", "a")), "which no version defines"),
    ],
)  # fmt: skip
def test_mistakes_are_told(xml, message):
    with pytest.raises(ModelError, match=message):
        build_model(xml)


def in_world(model, *parts):
    return (
        sdf(*ARM, model=model)
        .replace("<model", f"<world name='w'>{''.join(parts)}<model")
        .replace("</sdf>", "</world></sdf>")
    )


def test_a_model_is_placed_in_a_frame_of_its_world():
    pose = '<pose relative_to="f">1 0 0 0 0 0</pose>'
    frames = '<frame name="f"><pose relative_to="g">10 0 0 0 0 0</pose></frame>', (
        f'<frame name="g"><pose>0 0 2 0 0 {math.pi / 2!r}</pose></frame>')  # fmt: skip
    assert_same(in_world(pose, *frames), in_world(f"<pose>0 11 2 0 0 {math.pi / 2!r}</pose>"), "a")
    for text in (in_world(pose.replace('"f"', '"h"'), *frames), sdf(*ARM, model=pose.replace('"f"', '"h"'))):
        with pytest.raises(ModelError, match="the model: there is no frame 'h'"):
            build_model(text)
    with pytest.raises(ModelError, match="placed in each other: m -> f -> m"):
        build_model(in_world(pose, '<frame name="f" attached_to="m"/>'))


def test_the_model_of_a_world_is_the_one_that_moves_or_that_is_named():
    ground = '<model name="ground"><static>true</static><link name="floor"/></model><include><uri>sun</uri></include>'
    alone, beside = in_world("", ""), in_world("", ground)
    assert_same(beside, alone, "a")
    assert "not read, beside the model 'm': ground" in build_model(beside).notes
    two = in_world("", f'<model name="n">{"".join(ARM)}</model>')
    with pytest.raises(ModelError, match="the file has 2 models") as caught:
        build_model(two)
    assert (caught.value.expected, caught.value.hint) == ("one of m, n", "model: NAME in the mechanism file")
    assert build_model(two, name="n").model.name == "n"
    with pytest.raises(ModelError, match="the file has no model 'o'"):
        build_model(two, name="o")
    with pytest.raises(ModelError, match="the file is no SDF"):
        build_model(CHAIN, name="m")


@pytest.mark.parametrize(
    ("inside", "note"),
    [("<mass>0.001</mass>", "no ixx, iyy, izz, and by the format 1 kg*m^2"),

     ("", "no mass, ixx, iyy, izz, and by the format 1 kg and 1 kg*m^2")],
)  # fmt: skip
def test_what_the_format_completes_of_an_inertia_is_told(inside, note):
    notes = build_model(sdf(f'<link name="a"><inertial>{inside}</inertial></link>', joint("j", "world", "a"))).notes
    assert f"link 'a': its <inertial> has {note}" in notes

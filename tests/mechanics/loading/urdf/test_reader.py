from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import ModelError
from pinarm.input.roots import example_robot_data
from pinarm.mechanics.loading.model_tree import Mimic
from pinarm.mechanics.loading.pinocchio_model import build_model

ROBOTS = sorted((example_robot_data() / "robots").glob("*/*/*.urdf"))
JOINTLESS = {"ur3", "quadrotor_base", "iris_simple"}
ARM = {"name": "arm", "axis": "0 1 0", "mass": 2.0, "com": "0.5 0 0", "inertia": (0.1, 0.2, 0.2)}
LIMIT = '<limit lower="-1000" upper="1000" effort="1000" velocity="1000"/>'


def refusal(xml):
    with pytest.raises(ModelError) as caught:
        build_model(xml)
    return caught.value


def counting_turns(xml):
    """The same text with its continuous joints revolute: Pinocchio's reader has no angle for them otherwise."""
    robot = ElementTree.fromstring(xml)
    for joint in robot.findall("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit", effort="1", velocity="1") if limit is None else limit
            limit.attrib.update(lower="-1e9", upper="1e9")
    return ElementTree.tostring(robot, encoding="unicode")


FEW = ("double_pendulum_continuous", "panda", "tiago", "ur5_robot", "solo12", "so101")
"""Of every robot that is read among the slow tests, some with continuous joints, tables of points and fixed links."""


@pytest.mark.parametrize("file", [
    pytest.param(one, id=one.stem, marks=[] if one.stem in FEW else pytest.mark.slow)
    for one in ROBOTS if one.stem not in JOINTLESS
])  # fmt: skip
def test_a_published_robot_is_what_pinocchios_own_reader_makes_of_it(file):
    xml = file.read_text()
    ours, theirs = build_model(xml, defects="noted").model, pin.buildModelFromXML(counting_turns(xml))
    assert list(ours.names) == list(theirs.names)
    for one, other in zip(ours.frames, theirs.frames, strict=True):
        assert (one.name, one.type, one.parentJoint) == (other.name, other.type, other.parentJoint)
        assert one.placement.homogeneous == pytest.approx(other.placement.homogeneous, abs=1e-14)
    for one, other in zip(ours.inertias, theirs.inertias, strict=True):
        assert one.toDynamicParameters() == pytest.approx(other.toDynamicParameters(), abs=1e-13)
    q, v, a = np.random.default_rng(0).normal(size=(3, ours.nv))
    expected = pin.rnea(theirs, theirs.createData(), q, v, a)
    assert pin.rnea(ours, ours.createData(), q, v, a) == pytest.approx(expected, abs=1e-13 * np.abs(expected).max())
    assert ours.damping == pytest.approx(theirs.damping)


@pytest.mark.parametrize(
    ("part", "broken", "message"),
    [
        ('<link name="base"/>', '<link name="base"/><link name="base"/>', "two links have the name 'base'"),
        ('type="continuous"', 'type="universal"', "joint 'arm': its type is 'universal'"),
        ("</robot>", '<joint name="arm2" type="fixed"><parent link="base"/><child link="arm_link"/></joint></robot>',
         "link 'arm_link' is carried by two joints, 'arm' and 'arm2'"),
        ("</robot>", '<joint name="back" type="fixed"><parent link="arm_link"/><child link="base"/></joint></robot>',
         "the model has 0 links that no joint carries"),
    ],
)  # fmt: skip
def test_what_is_no_tree_of_bodies_is_refused(chain, part, broken, message):
    xml = chain(ARM)
    assert part in xml
    assert refusal(xml.replace(part, broken, 1)).message == message


def test_a_mass_without_inertia_is_a_point_and_is_noted(chain):
    xml = chain(ARM)
    bare = xml[: xml.index("<inertia ")] + xml[xml.index("</inertial>") :]
    robot = build_model(bare)
    assert robot.model.inertias[1].mass == 2.0
    assert not robot.model.inertias[1].inertia.any()
    assert "link 'arm_link': it has a mass but no <inertia>, and is taken for a point mass" in robot.notes


def test_limits_of_nothing_are_unknown_and_noted(chain):
    known, unknown = ({**ARM, "name": name, "kind": "revolute"} for name in ("known", "unknown"))
    xml = chain(known, unknown).replace(LIMIT, '<limit lower="-1" upper="2" effort="3" velocity="4"/>', 1)
    robot = build_model(xml.replace(LIMIT, '<limit effort="-1" velocity="0"/>'))
    model = robot.model
    assert (model.lowerPositionLimit.tolist(), model.upperPositionLimit.tolist()) == ([-1.0, -np.inf], [2.0, np.inf])
    assert (model.effortLimit.tolist(), model.velocityLimit.tolist()) == ([3.0, np.inf], [4.0, np.inf])
    for kind in ("position", "effort", "velocity"):
        assert f"{kind} limits of 0 or less, or none, are taken for unknown: unknown" in robot.notes


def test_a_quaternion_says_an_orientation(chain):
    """Half of the angle 0.6 about the unit vector (2, 3, 6)/7, as URDF 1.2 has it: x, y, z, w."""
    axis, half = np.array([2.0, 3.0, 6.0]) / 7, 0.3
    quat = " ".join(map(repr, [*(np.sin(half) * axis).tolist(), float(np.cos(half))]))
    xml = chain(ARM).replace('<origin xyz="0 0 0"/>', f'<origin xyz="1 2 3" quat_xyzw="{quat}"/>')
    place = build_model(xml).model.jointPlacements[1]
    assert place.rotation == pytest.approx(pin.exp3(0.6 * axis), abs=1e-15)
    assert place.translation.tolist() == [1.0, 2.0, 3.0]
    for broken in (xml.replace("quat_xyzw", 'rpy="0 0 1" quat_xyzw'), xml.replace(quat, "0 0 0 0")):
        assert "is 0, or there is an rpy too" in refusal(broken).message


def coupled(chain, *mimics):
    """Three joints a, b, c; each mimic is text in the joint of its name."""
    xml = chain(*({**ARM, "name": name} for name in "abc"))
    for name, text in mimics:
        xml = xml.replace(f'<joint name="{name}" type="continuous">', f'<joint name="{name}" type="continuous">{text}')
    return xml


def test_joints_that_mimic_others_are_read(chain):
    robot = build_model(coupled(
        chain, ("b", '<mimic joint="a" multiplier="-2.5" offset="0.3"/>'), ("c", '<mimic joint="b"/>')))  # fmt: skip
    assert robot.tree.mimics == [Mimic("b", "a", -2.5, 0.3), Mimic("c", "b", 1.0, 0.0)]


@pytest.mark.parametrize(
    ("mimics", "message"),
    [
        ([("b", '<mimic joint="d"/>')], "joint 'b' mimics 'd', which does not exist"),
        ([("b", '<mimic joint="b"/>')], "joint 'b' mimics itself: b -> b"),
        ([("a", '<mimic joint="c"/>'), ("b", '<mimic joint="a"/>'), ("c", '<mimic joint="b"/>')],
         "joint 'a' mimics itself: a -> c -> b -> a"),
        ([("b", '<mimic joint="a" multiplier="nan"/>')],
         "joint 'b': mimic: multiplier: 'nan' is not a finite number"),
    ],
)  # fmt: skip
def test_couplings_that_cannot_be_are_refused(chain, mimics, message):
    assert refusal(coupled(chain, *mimics)).message == message


def test_defects_are_taken_as_written_where_that_is_asked_for(chain):
    xml = coupled(chain, ("b", '<mimic joint="d"/>')).replace('ixx="0.1"', 'ixx="-0.1"', 1)
    robot = build_model(xml, defects="noted")
    assert robot.model.inertias[1].inertia[0, 0] == pytest.approx(-0.1)
    assert robot.tree.mimics == []
    assert "joint 'b' mimics 'd', which does not exist; taken as written" in robot.notes
    assert any(note.startswith("link 'a_link': a principal moment of inertia is negative") for note in robot.notes)
    assert "say 'defects: noted'" in refusal(xml).hint


class TestBase:
    """The root of a model held or afloat."""

    def test_floats_where_it_is_asked_to(self, chain):
        model = build_model(chain(ARM), base="floating").model
        assert list(model.names)[1:] == ["root.x", "root.y", "root.z", "root", "arm"]
        assert (model.nq, model.nv) == (8, 7)

    def test_is_held_where_the_model_lets_it_float(self, chain):
        floating = chain({**ARM, "name": "free", "kind": "floating"}, ARM)
        assert build_model(floating).model.nv == 7
        assert build_model(floating, base="floating").model.nv == 7
        assert build_model(floating, base="fixed").model.nv == 1

    def test_needs_its_names(self, chain):
        taken = chain({**ARM, "name": "root"})
        with pytest.raises(ModelError, match="two joints have the name 'root': a part of 'base: floating'"):
            build_model(taken, base="floating")
        with pytest.raises(ModelError, match="have the name 'world': the root, 'world', and what joint"):
            build_model(chain(ARM).replace("arm_link", "world"), base="floating")

    def test_with_a_mass_is_the_base_itself(self, chain):
        """A ball that flies beside a base with a mass is neither that base nor held with it."""
        base = '<link name="base"><inertial><mass value="5"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
        text = chain(ARM, {**ARM, "name": "ball", "kind": "floating"}).replace('<link name="base"/>', base)
        heavy = text.replace('<parent link="arm_link"/>', '<parent link="base"/>')
        assert [build_model(heavy, base=said).model.nv for said in (None, "fixed", "floating")] == [7, 7, 13]
        light = heavy.replace(base, '<link name="base"/>')
        assert build_model(light, base="fixed").model.nv == 1
        with pytest.raises(ModelError, match="'base' lets joint ball float already, and carries joint arm too"):
            build_model(light, base="floating")

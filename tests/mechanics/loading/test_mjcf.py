"""MJCF, held to MuJoCo itself: ``chain.json`` is what MuJoCo 4.0.0 computes for ``chain.xml`` at one state."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import ModelError
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.use.mechanism import Mechanism

HERE = Path(__file__).parent / "mujoco"
MUJOCO = json.loads((HERE / "chain.json").read_text())
SPHERE = '<geom size="0.1"/>'
HINGE = '<joint name="j"/>'
UNIT = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'


def body(inside, name="b", attributes=""):
    return f'<body name="{name}" {attributes}>{inside}</body>'


def model(*bodies, before=""):
    return f'<mujoco model="m">{before}<worldbody>{"".join(bodies)}</worldbody></mujoco>'


def refusal(xml):
    with pytest.raises(ModelError) as caught:
        build_model(xml)
    return caught.value


def turn(values):
    """Return a quaternion in MuJoCo's order (w, x, y, z) as Pinocchio's."""
    return pin.Quaternion(*values)


@pytest.fixture(scope="module")
def chain():
    return Mechanism.load(HERE / "chain.xml")


@pytest.fixture(scope="module")
def state(chain):
    """q, v and the index in our v of every degree of freedom of MuJoCo."""
    q, v, index = pin.neutral(chain.model), np.zeros(chain.model.nv), np.zeros(chain.model.nv, int)
    drawn, given, rates = MUJOCO["qpos0"], MUJOCO["qpos"], MUJOCO["qvel"]
    for joint in MUJOCO["joints"]:
        name, at, dof = joint["name"], joint["qpos"], joint["dof"]
        if joint["type"] in ("hinge", "slide"):
            q[chain.joints[name].q], index[dof] = given[at], chain.joints[name].v
            continue
        if joint["type"] == "free":
            for k, axis in enumerate("xyz"):
                one = chain.joints[f"{name}.{axis}"]
                q[one.q], index[dof + k] = given[at + k] - drawn[at + k], one.v
            at, dof = at + 3, dof + 3
        ball = chain.balls[name]
        q[ball.q : ball.q + 4] = (turn(drawn[at : at + 4]).inverse() * turn(given[at : at + 4])).coeffs()
        index[dof : dof + 3] = range(ball.v, ball.v + 3)
    v[index] = rates
    return q, v, index


class TestAgainstMujoco:
    """Every way to say an orientation, default classes, frames, several joints of a body, references, springs."""

    def test_mass_matrix(self, chain, state):
        q, _, index = state
        upper = np.triu(pin.crba(chain.model, chain.model.createData(), q))
        found = (upper + np.triu(upper, 1).T)[np.ix_(index, index)]
        assert found == pytest.approx(np.array(MUJOCO["M"]), abs=1e-12)

    def test_gravity_and_gyroscopic_forces(self, chain, state):
        q, v, index = state
        found = pin.nonLinearEffects(chain.model, chain.model.createData(), q, v)[index]
        assert found == pytest.approx(MUJOCO["bias"], abs=1e-11)

    def test_springs_and_dampers(self, chain, state):
        q, v, index = state
        tau = np.zeros(chain.model.nv)
        assert {"joint damping", "joint springs", "joint friction", "spring of j2"} == chain.forces.keys()
        for name, force in chain.forces.items():
            if name != "joint friction":
                force.add_load(0.0, q, v, tau)
        assert tau[index] == pytest.approx(MUJOCO["passive"], abs=1e-13)

    def test_dry_friction_at_full_speed(self, chain, state):
        q, _, index = state
        fast, tau = np.ones(chain.model.nv), np.zeros(chain.model.nv)
        for contact in chain.frictions:
            tau[contact.slip.joint] = -contact.law.constant
        if "joint friction" in chain.forces:  # of ball joints
            chain.forces["joint friction"].add_load(0.0, q, fast, tau)
        assert tau[index] == pytest.approx(-np.array(MUJOCO["frictionloss"]), abs=1e-15)

    def test_places_of_the_bodies(self, chain, state):
        data = chain.model.createData()
        pin.framesForwardKinematics(chain.model, data, state[0])
        for name, place in MUJOCO["bodies"].items():
            frame = chain.model.getFrameId(name, pin.FrameType.BODY)
            assert data.oMf[frame].translation == pytest.approx(place, abs=1e-13), name

    def test_ranges(self, chain):
        for name, (lower, upper) in MUJOCO["range"].items():
            index = chain.joints[name].q
            limits = chain.model.lowerPositionLimit[index], chain.model.upperPositionLimit[index]
            assert limits == pytest.approx((lower, upper))


def test_gravity_is_that_of_the_file_unless_the_mechanism_says_otherwise(tmp_path):
    option = '<option gravity="0 3 -4"/>'
    (tmp_path / "m.xml").write_text(model(body(HINGE + SPHERE), before=option))
    assert Mechanism.load(tmp_path / "m.xml").model.gravity.linear.tolist() == [0.0, 3.0, -4.0]
    assert Mechanism.load(tmp_path / "m.xml", values={"gravity": "none"}).gravity == 0.0
    off = build_model(model(body(HINGE + SPHERE), before='<option><flag gravity="disable"/></option>'))
    assert off.tree.gravity.tolist() == [0.0, 0.0, 0.0]
    assert build_model(model(body(HINGE + SPHERE))).tree.gravity.tolist() == [0.0, 0.0, -9.81]


def test_flags_switch_forces_off():
    joint = '<joint name="j" stiffness="1" damping="2" frictionloss="3"/>'

    def forces(text):
        return set(build_model(text, creep=1e-3).forces)

    assert forces(model(body(joint + SPHERE))) == {"joint springs", "joint damping", "joint friction"}
    for flag, left in (("spring", {"joint damping", "joint friction"}), ("passive", {"joint friction"}),
                       ("frictionloss", {"joint springs", "joint damping"}),
                       ("constraint", {"joint springs", "joint damping"})):  # fmt: skip
        flags = f'<option><flag {flag}="disable"/></option>'
        assert forces(model(body(joint + SPHERE), before=flags)) == left


def test_a_coupling_by_an_equality_counts_from_the_references():
    """polycoef relates the ways from the references: q1 - ref1 = c0 + c1 (q2 - ref2)."""
    two = body('<joint name="a" ref="90"/>' + SPHERE), body('<joint name="b" type="slide" ref="0.5"/>' + SPHERE, "c")
    equality = '<equality><joint joint1="a" joint2="b" polycoef="0.1 3"/></equality>'
    mimic = build_model(model(*two, before=equality)).tree.mimics[0]
    assert (mimic.joint, mimic.of, mimic.multiplier) == ("a", "b", 3.0)
    assert mimic.offset == pytest.approx(0.1 + np.pi / 2 - 3.0 * 0.5, abs=1e-15)
    assert build_model(model(*two, before=equality.replace("joint1", 'active="false" joint1'))).tree.mimics == []


def mass_matrix(robot):
    upper = np.triu(pin.crba(robot.model, robot.model.createData(), pin.neutral(robot.model)))
    return upper + np.triu(upper, 1).T


def load(robot, v):
    """Return the load of the forces at the neutral configuration, shape (nv,)."""
    tau = np.zeros(robot.model.nv)
    for force in robot.forces.values():
        force.add_load(0.0, pin.neutral(robot.model), np.full(robot.model.nv, v), tau)
    return tau


def test_an_inertial_stands_in_its_frame():
    """MuJoCo 4.0.0: body_ipos (2, 0, 0), and M = 9."""
    inside = '<frame pos="1 0 0" euler="0 90 0"><inertial pos="0 0 1" mass="2" diaginertia="1 2 3"/></frame>'
    robot = build_model(model(body(HINGE + inside)))
    assert robot.model.inertias[1].lever == pytest.approx([2.0, 0.0, 0.0], abs=1e-15)
    assert mass_matrix(robot) == pytest.approx(np.array([[9.0]]), abs=1e-14)


@pytest.mark.parametrize(
    ("compiler", "geoms", "mass"),
    [
        ('inertiafromgeom="true"', "", 3.0),
        ('inertiafromgeom="true"', '<geom size="0.1" mass="0"/>', 3.0),
        ('inertiafromgeom="true" inertiagrouprange="1 2"', SPHERE, 3.0),
        ("", '<geom size="0.1" mass="2"/>', 3.0),
    ],
)
def test_an_inertial_stays_where_no_geom_has_a_mass(compiler, geoms, mass):
    """Masses are body_mass of MuJoCo 4.0.0."""
    inertial = '<inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/>'
    robot = build_model(model(body(HINGE + inertial + geoms), before=f"<compiler {compiler}/>"))
    assert robot.model.inertias[1].mass == mass


@pytest.mark.parametrize(
    ("joint", "before", "actuator", "mass", "passive"),
    [
        ('armature="0.1" damping="0.2"', "", '<motor joint="j" armature="0.5" gear="3"/>', 5.6, -0.2),
        ('damping="0.2"', '<option><flag damper="disable"/></option>',
         '<motor joint="j" damping="0.7" armature="1" gear="3"/>', 10.0, 0.0),
        ("", '<default><position armature="0.25" gear="2"/><motor armature="1"/></default>',
         '<motor joint="j" damping="0.7"/>', 5.0, -2.8),
        ('type="ball" damping="0.2"', "", '<motor joint="j" damping="0.7" armature="1" gear="2 1 0"/>', 5.0, -3.0),
    ],
)  # fmt: skip
def test_rotors_and_dampers_of_actuators_are_at_their_joints(joint, before, actuator, mass, passive):
    """The last two are what MuJoCo 4.0.0 computes: M, and qfrc_passive with all velocities 1."""
    xml = model(body(f'<joint name="j" {joint}/>{UNIT}'), before=f"{before}<actuator>{actuator}</actuator>")
    robot = build_model(xml)
    assert mass_matrix(robot) == pytest.approx(mass * np.eye(robot.model.nv), abs=1e-14)
    assert load(robot, 1.0) == pytest.approx(np.full(robot.model.nv, passive), abs=1e-14)


@pytest.mark.parametrize(("compiler", "moments"), [
    ('balanceinertia="true"', [1.4, 1.4, 1.4]), ('boundinertia="2"', [2.0, 2.0, 3.0]),
])  # fmt: skip
def test_moments_that_no_body_can_have_are_mended_as_mujoco_does(compiler, moments):
    """As body_inertia of MuJoCo 4.0.0: raised first, then, where asked for, replaced by their mean."""
    spiky = body(HINGE + '<inertial pos="0 0 0" mass="1" diaginertia="1 0.2 3"/>')
    robot = build_model(model(spiky, before=f"<compiler {compiler}/>"))
    assert np.linalg.eigvalsh(robot.model.inertias[1].inertia) == pytest.approx(moments)
    assert not any("not read" in note for note in robot.notes)


@pytest.mark.parametrize(
    ("place", "inside", "lever"),
    [
        ('pos="1 0 0"', "", [1.0, 0.0, 0.0]),
        ('pos="1 2 3" euler="0 0 90"', "", [1.0, 2.0, 3.0]),
        ('pos="1 0 0"', '<geom size="0.1" mass="0" pos="0 0 5"/>', [1.0, 0.0, 0.0]),
        ('pos="1 0 0"', '<inertial pos="0 0 5" mass="0" diaginertia="0 0 0"/>', [0.0, 0.0, 5.0]),
    ],
)
def test_a_least_mass_stands_where_mujoco_has_it(place, inside, lever):
    """That of a body without mass is at its ``pos``, in its own axes: body_ipos of MuJoCo 4.0.0."""
    bounds = '<compiler boundmass="0.5" boundinertia="0.01"/>'
    light = build_model(model(body(HINGE + UNIT + body('<joint name="k"/>' + inside, "light", place)), before=bounds))
    assert light.model.inertias[2].mass == 0.5
    assert light.model.inertias[2].lever.tolist() == lever


PLACES = {"quat": "0.9 0.2 0.3 0.1", "axisangle": "1 2 0 30", "euler": "10 20 50", "xyaxes": "1 1 0 -1 1 0.5",
          "zaxis": "1 0 1", "fromto": "0 0 0 1 0.5 0"}  # fmt: skip


@pytest.mark.parametrize("tag", ["geom", "site"])
def test_an_orientation_takes_the_place_of_that_of_a_class_but_not_of_two_points(tag):
    mujoco = pytest.importorskip("mujoco")
    for ways in product(("", "fromto"), ("", "axisangle"), ("", *PLACES)):
        main, inner, own = (f'{way}="{PLACES[way]}"' if way else "" for way in ways)
        classes = (f'<default><{tag} type="capsule" size="0.1 0.2" {main}/>'
                   f'<default class="c"><{tag} {inner}/></default></default>')  # fmt: skip
        xml = model(body(f'{HINGE}<{tag} name="part" class="c" {own}/>' + (UNIT if tag == "site" else "")),
                    before=classes)  # fmt: skip
        theirs, ours = mujoco.MjModel.from_xml_string(xml), build_model(xml).model
        state = mujoco.MjData(theirs)
        mujoco.mj_forward(theirs, state)
        if tag == "geom":
            axes = state.ximat[1].reshape(3, 3)
            moments = axes @ np.diag(theirs.body_inertia[1]) @ axes.T
            assert ours.inertias[1].inertia == pytest.approx(moments, rel=1e-6, abs=1e-6), ways
            assert ours.inertias[1].lever == pytest.approx(theirs.body_ipos[1], abs=1e-9), ways
        else:
            place = ours.frames[ours.getFrameId("part", pin.FrameType.BODY)].placement
            assert place.rotation.ravel() == pytest.approx(state.site_xmat[0], abs=1e-9), ways
            assert place.translation == pytest.approx(state.site_xpos[0], abs=1e-9), ways


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        ('<joint name="j" type="screw"/>' + SPHERE, "joint 'j': type is 'screw'"),
        ('<joint name="j" actuatorfrclimited="true"/>' + SPHERE,
         "joint 'j': actuatorfrclimited='true', and it has no actuatorfrcrange"),
        (HINGE + '<inertial pos="0 0 0" mass="1" fullinertia="1 1 1 0 0 0" diaginertia="1 1 1"/>',
         "body 'b': inertial: it has fullinertia and diaginertia"),
        ('<joint name="j" springdamper="0.1 0"/>' + SPHERE, "joint 'j': springdamper='0.1 0' is not read"),
        (SPHERE + body('<freejoint name="f"/>' + SPHERE, "c"),
         "body 'c': a free joint stands alone, in a body of the world"),
        (HINGE + '<geom size="-1"/>', "body 'b': geom: size='-1'"),
        (HINGE + '<inertial pos="0 0 0" mass="1" diaginertia="1 1 9"/>',
         "body 'b': no body has principal moments of inertia 1, 1, 9 kg*m^2: each is at most the sum of the other two"),
        ('<joint name="j" axs="1 0 0"/>' + SPHERE, "<joint> 'j' has no attribute 'axs'"),
        (HINGE + SPHERE + '<replicate count="3"/>', "in 'b': <replicate> is not read"),
    ],
)  # fmt: skip
def test_what_no_body_or_joint_can_have_is_refused(inside, message):
    assert refusal(model(body(inside))).message == message


@pytest.mark.parametrize(
    ("before", "message"),
    [
        ('<compiler angel="radian"/>', "<compiler> has no attribute 'angel'"),
        ('<optoin gravity="0 0 0"/>', "<mujoco> contains no <optoin>"),
        ('<extension><plugin plugin="p"/></extension>', "the model has a section <extension>, which is not read"),
    ],
)  # fmt: skip
def test_sections_that_would_change_the_motion_are_refused(before, message):
    assert refusal(model(body(HINGE + SPHERE), before=before)).message == message


@pytest.mark.parametrize(
    ("inside", "before", "note"),
    [
        (HINGE + SPHERE, "", "geoms do not touch: contacts are not modelled"),
        (HINGE + SPHERE, '<tendon/><actuator><motor tendon="t" armature="1"/></actuator>',
         "armature and damping beyond joints are not modelled: actuator 'motor'"),
        ('<joint name="j" ref="30"/>' + SPHERE, "", "drawn at their ref, but begin at 0 where nothing is said: j"),
    ],
)  # fmt: skip
def test_what_is_left_out_is_noted(inside, before, note):
    assert note in build_model(model(body(inside), before=before)).notes


def test_an_unknown_name_is_told_with_its_line(tmp_path):
    text = model("\n" + body(HINGE + '\n  <geom size="0.1" masss="2"/>'))
    (tmp_path / "m.xml").write_text(text)
    with pytest.raises(ModelError) as caught:
        Mechanism.load(tmp_path / "m.xml")
    assert (caught.value.location.line, caught.value.location.column) == (3, 20)
    assert caught.value.hint == "mass"

"""Joints that mimic others, against Pinocchio's own mimic joints: they leave no coordinate of theirs in the model."""

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm import Mechanism
from pinarm.errors import InputError

CHAIN = """\
<robot name="chain">
  <link name="base"/>
  <joint name="a" type="continuous"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/></joint>
  <link name="one"><inertial><origin xyz="1 0 0"/><mass value="2"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="b" type="continuous"><parent link="one"/><child link="two"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>
    <mimic joint="a" multiplier="-1"/></joint>
  <link name="two"><inertial><origin xyz="0.5 0 0"/><mass value="3"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="c" type="prismatic"><parent link="two"/><child link="three"/><axis xyz="1 0 0"/>
    <limit lower="-9" upper="9" effort="9" velocity="9"/><mimic joint="b" multiplier="0.25" offset="0.5"/></joint>
  <link name="three"><inertial><mass value="1"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""


@pytest.fixture(params=["panda", "tiago_pro"], scope="module")
def pair(request):
    """Return a robot and Pinocchio's model of it, with the map from its velocities to ours."""
    robot = Mechanism.load(request.param)
    theirs = pin.buildModelFromXML(robot.xml, mimic=True)
    names = [name for name in robot.joints if theirs.joints[theirs.getJointId(name)].nv]
    spread = np.zeros((robot.model.nv, theirs.nv))
    for name in names:
        spread[robot.joints[name].v, theirs.joints[theirs.getJointId(name)].idx_v] = 1.0
    for one in robot.constraints:  # leaders of these robots follow none
        weights = one.coordinate.weights.copy()
        weights[one.follower] = 0.0
        spread[one.follower] = -weights @ spread
    return robot, theirs, names, spread


def states(pair, rng):
    """Return q, v and a of a robot, 20 rows each, and the configurations of Pinocchio's model."""
    robot, theirs, names, spread = pair
    turns = rng.uniform(-1.0, 1.0, (20, len(names)))
    their_q = np.tile(pin.neutral(theirs), (20, 1))
    for k, name in enumerate(names):
        joint = theirs.joints[theirs.getJointId(name)]
        circle = np.array([np.cos(turns[:, k]), np.sin(turns[:, k])]).T
        their_q[:, joint.idx_q : joint.idx_q + joint.nq] = circle if joint.nq == 2 else turns[:, k : k + 1]
    offsets = np.zeros(robot.model.nv)
    for one in robot.constraints:
        offsets[one.follower] = one.constant
    columns = [theirs.joints[theirs.getJointId(name)].idx_v for name in names]
    q = turns @ spread[:, columns].T + offsets
    rates = rng.normal(size=(2, 20, theirs.nv))
    return q, *(rates @ spread.T), their_q, *rates


def test_leaders_carry_what_their_followers_demand(pair):
    robot, theirs, _, spread = pair
    q, v, a, their_q, their_v, their_a = states(pair, np.random.default_rng(0))
    tau, data = robot.inverse(q, v, a), theirs.createData()
    expected = [pin.rnea(theirs, data, *row) for row in zip(their_q, their_v, their_a, strict=True)]
    loads = robot.dynamics.loads(0.0, q, v)  # they ignore damping and friction
    for one in robot.frictions:
        loads[:, one.slip.joint] -= one.law.constant * np.sign(v[:, one.slip.joint])
    dissipated = np.array([load @ spread for load in loads])
    found = tau @ spread + dissipated
    assert found == pytest.approx(np.array(expected), rel=1e-11, abs=1e-11 * np.abs(expected).max())
    assert not tau[:, [one.follower for one in robot.constraints]].any()
    assert robot.forward(q, v, tau) == pytest.approx(a, abs=1e-8)


def test_a_follower_that_keeps_its_direction_turns_the_motion_into_that_of_one_mass(tmp_path):
    """With b = -a the second link does not turn, and c = 0.5 - a/4 slides on it: one degree of freedom is left."""
    (tmp_path / "chain.urdf").write_text(CHAIN)
    (tmp_path / "mechanism.yaml").write_text("pinarm: 1\nrobot: chain.urdf\ngravity: none\n")
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: mechanism.yaml\n"
        "problem: {kind: forward, time: {end: 3 s, samples: 31}, initial: {velocity: {a: 1 rad/s}}}\n"
        "outputs: [a, b, c, joint.a.velocity]\naccuracy: {tolerance: 1e-11}\n"
    )
    run = pinarm.load(tmp_path / "s.yaml").run()
    a, rate = run["a"].values, run["joint.a.velocity"].values
    assert run["b"].values == pytest.approx(-a, abs=1e-14)
    assert run["c"].values == pytest.approx(0.5 - 0.25 * a, abs=1e-14)
    # twice the energy over rate^2: masses 2 and 3 at radius 1, and 1 that slides along x by -a/4 besides
    inertia = 2.0 + 3.0 + (np.cos(a) ** 2 + (np.sin(a) + 0.25) ** 2)
    assert inertia * rate**2 == pytest.approx(inertia[0], rel=1e-9)


def test_states_that_tear_a_coupling_are_refused_by_name(pair):
    robot = pair[0]
    q = np.arange(1.0, 1.0 + robot.model.nq)
    names = "|".join(one.name for one in robot.constraints)
    with pytest.raises(InputError, match=f"the positions tear '({names})' by"):
        robot.inverse(q, np.zeros(robot.model.nv), np.zeros(robot.model.nv))


HOIST = """\
<robot name="hoist"><link name="base"/>
  <joint name="one" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint>
  <link name="wheel"><inertial><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="two" type="continuous"><parent link="base"/><child link="drum"/><origin xyz="0.3 0 0"/>
    <axis xyz="0 0 1"/></joint>
  <link name="drum"><inertial><origin xyz="0.2 0 0"/><mass value="3"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="side" type="continuous"><parent link="base"/><child link="swing"/><axis xyz="0 0 1"/></joint>
  <link name="swing"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""


@pytest.fixture
def hoist(tmp_path):
    """A scenario in which gears stand still while a pendulum beside them swings."""
    (tmp_path / "hoist.urdf").write_text(HOIST)
    (tmp_path / "mechanism.yaml").write_text(
        "pinarm: 1\nrobot: hoist.urdf\ngravity: {direction: -y, magnitude: 9.81 m/s^2}\n"
        "couplings:\n  mesh: {kind: gear, joints: [one, two], ratio: -2, pressure_angle: 20 deg}\n"
    )
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: mechanism.yaml\n"
        "problem:\n  kind: forward\n  time: {end: 0.2 s, samples: 3}\n"
        "  motion: {one: {law: constant, value: 0 rad}}\n"
        "outputs: [coupling.mesh.effort, coupling.mesh.radial, coupling.mesh.force.y]\n"
    )
    return tmp_path / "s.yaml"

"""A body with six free coordinates, tied by a loop joint, moves and pulls as the same joint does in a tree."""

import numpy as np
import pytest

BODY = """<link name="body"><inertial><origin xyz="0.3 -0.2 0.15" rpy="0.3 0.2 -0.5"/><mass value="2.5"/>
  <inertia ixx="0.05" iyy="0.08" izz="0.06" ixy="0.004" ixz="-0.006" iyz="0.003"/></inertial></link>"""
PLACE, TURN = np.array([0.2, 0.1, -0.3]), (0.4, -0.3, 0.7)
"""Where the frames of the joint are, on base and on the body, while all coordinates are 0."""
GRAVITY = {"direction": "-z", "magnitude": "9.81 m/s^2"}
SLIDES, TURNS = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}, {"rx": "1 0 0", "ry": "0 1 0", "rz": "0 0 1"}
KINDS = {  # kind -> what the file says beside it, joints of the tree in the axes of the frame, efforts of nature
    "fixed": ({}, []),
    "revolute": ({"axis": "z"}, ["rz"]),
    "prismatic": ({"axis": "z"}, ["z"]),
    "cylindrical": ({"axis": "z"}, ["z", "rz"]),
    "spherical": ({}, ["rx", "ry", "rz"]),
    "universal": ({"axes": ["x", "y"]}, ["rx", "ry"]),
    "planar": ({"axis": "z"}, ["x", "y", "rz"]),
    "point_on_line": ({"axis": "z"}, ["z", "rx", "ry", "rz"]),
    "point_on_plane": ({"axis": "z"}, ["x", "y", "rx", "ry", "rz"]),
}
SPEEDS = {"x": 0.7, "y": -0.4, "z": 0.5, "rx": 1.1, "ry": -0.8, "rz": 2.3}


def chain(names, parent, child):
    """Joints one after the other, their links without mass but for the last."""
    xml = ""
    for name in names:
        last = name == names[-1]
        kind, axis = ("prismatic", SLIDES[name]) if name in SLIDES else ("continuous", TURNS[name])
        inner = child if last else f"after_{name}"
        xml += (
            ("" if last else f'<link name="{inner}"/>')
            + f"""<joint name="{name}" type="{kind}">
          <parent link="{parent}"/><child link="{inner}"/><axis xyz="{axis}"/>
          <limit lower="-99" upper="99" effort="1e9" velocity="1e9"/></joint>"""
        )
        parent = inner
    return xml


def fixed(name, parent, place, turn=(0.0, 0.0, 0.0)):
    return f"""<joint name="{name}_fixed" type="fixed"><parent link="{parent}"/><child link="{name}"/>
      <origin xyz="{place[0]!r} {place[1]!r} {place[2]!r}" rpy="{turn[0]} {turn[1]} {turn[2]}"/></joint>"""


def named(name, parent, place, turn=(0.0, 0.0, 0.0)):
    return f'<link name="{name}"/>' + fixed(name, parent, [float(x) for x in place], turn)


def rotation(roll, pitch, yaw):
    (a, b, c), (d, e, f) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x, about_y = np.array([[1, 0, 0], [0, a, -d], [0, d, a]]), np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]])
    return np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]]) @ about_y @ about_x


def angles_of(turn):
    return np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(turn[2, 0]), np.arctan2(turn[1, 0], turn[0, 0])


@pytest.fixture
def tied(mechanism):
    """Return the body on six coordinates, tied by a loop joint of a kind."""

    def build(kind):
        xml = f"""<robot name="tied"><link name="base"/>{BODY}{chain(["x", "y", "z", "rx", "ry", "rz"], "base", "body")}
          {named("one", "base", PLACE, TURN)}{named("two", "body", PLACE, TURN)}</robot>"""
        loop = {"kind": kind, "between": ["one", "two"], **KINDS[kind][0]}
        return mechanism(xml, gravity=GRAVITY, loops={"tie": loop})

    return build


@pytest.fixture
def jointed(mechanism):
    """Return the body on joints of the tree that allow what a kind allows."""

    def build(names):
        back = rotation(*TURN).T
        place = [float(x) for x in -back @ PLACE]
        xml = f"""<robot name="jointed"><link name="base"/>{named("one", "base", PLACE, TURN)}<link name="two"/>
          {chain(names, "one", "two")}{BODY}{fixed("body", "two", place, angles_of(back))}</robot>"""
        return mechanism(xml, gravity=GRAVITY)

    return build


@pytest.mark.parametrize("kind", [kind for kind, (_, names) in KINDS.items() if names])
def test_motion_and_reaction_are_those_of_the_joint_in_a_tree(solve, tied, jointed, kind):
    names = KINDS[kind][1]
    velocity = {name: SPEEDS[name] for name in names}
    tree = solve(jointed(names), "forward", end=0.6, samples=31, initial={"velocity": velocity})
    start = {axis: tree[f"point.body.velocity.{axis}"].values[0] for axis in "xyz"}
    start |= {f"r{axis}": tree[f"body.body.angular_velocity.{axis}"].values[0] for axis in "xyz"}
    zero = dict.fromkeys(start, 0.0)
    loop = solve(tied(kind), "forward", end=0.6, samples=31, initial={"position": zero, "velocity": start})
    for axis in "xyz":
        for rate, near in (("position", 1e-10), ("velocity", 1e-9), ("acceleration", 1e-8)):
            name = f"point.body.{rate}.{axis}"
            assert loop[name].values == pytest.approx(tree[name].values, abs=near)
        name = f"body.body.angular_velocity.{axis}"
        assert loop[name].values == pytest.approx(tree[name].values, abs=1e-9)
        about = "about.two."
        reaction = tree[f"joint.{names[0]}.force.{axis}"].values, tree[f"joint.{names[0]}.moment.{about}{axis}"].values
        assert loop[f"loop.tie.force.{axis}"].values == pytest.approx(reaction[0], abs=1e-7)
        assert loop[f"loop.tie.moment.{axis}"].values == pytest.approx(reaction[1], abs=1e-7)
    assert max(np.abs(loop[f"loop.tie.force.{axis}"].values).max() for axis in "xyz") > 1.0


def test_a_body_that_is_fixed_by_a_loop_joint_stays_and_is_carried(solve, tied):
    still = solve(tied("fixed"), "statics")
    assert still["loop.tie.force.z"].values == pytest.approx(2.5 * 9.81, rel=1e-12)
    assert still["loop.tie.force.x"].values == pytest.approx(0.0, abs=1e-10)
    arm = np.array([0.3, -0.2, 0.15]) - PLACE
    assert still["loop.tie.moment.x"].values == pytest.approx(arm[1] * 2.5 * 9.81, rel=1e-10)
    assert still["loop.tie.moment.y"].values == pytest.approx(-arm[0] * 2.5 * 9.81, rel=1e-10)


def test_a_body_on_a_rod_is_a_pendulum_on_two_ball_joints(solve, mechanism):
    """A point mass on a rod: the spherical pendulum, and the rod pulls along itself with what the mass needs."""
    mass = """<link name="body"><inertial><mass value="1.5"/>
      <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
    xml = f'<robot name="pendulum"><link name="base"/>{mass}{chain(["x", "y", "z"], "base", "body")}</robot>'
    length = 0.8
    rod = {"kind": "rod", "between": ["base", "body"], "length": f"{length} m"}
    pendulum = mechanism(xml, gravity=GRAVITY, loops={"rod": rod})
    tilt, spin = 0.7, np.sqrt(9.81 / (length * np.cos(0.7)))  # the conical pendulum
    initial = {"position": {"x": length * np.sin(tilt), "y": 0.0, "z": -length * np.cos(tilt)},
               "velocity": {"x": 0.0, "y": length * np.sin(tilt) * spin, "z": 0.0}}  # fmt: skip
    found = solve(pendulum, "forward", end=3.0, initial=initial)
    t = found["t"].values
    assert found["x"].values == pytest.approx(length * np.sin(tilt) * np.cos(spin * t), abs=1e-9)
    assert found["y"].values == pytest.approx(length * np.sin(tilt) * np.sin(spin * t), abs=1e-9)
    assert found["z"].values == pytest.approx(-length * np.cos(tilt), abs=1e-9)
    assert found["loop.rod.force.norm"].values == pytest.approx(1.5 * 9.81 / np.cos(tilt), rel=1e-9)
    assert found["loop.rod.force.z"].values == pytest.approx(1.5 * 9.81, rel=1e-9)

"""What rounding leaves of rows next to singular positions, against closed forms that do not lose digits there."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import pinarm

FOUR_BAR = """
pinarm: 1
gravity: none
planar:
  points: {O: [0, 0], A: [-250 mm, 0], B: [625 mm, 0], C: [1 m, 0]}
  ground: [O, C]
  links:
    crank: {points: [O, A], mass: 1 kg}
    coupler: {points: [A, B], mass: 2 kg}
    rocker: {points: [B, C], mass: 1 kg}
"""
"""Drawn at its change point, 250 + 1000 = 875 + 375 mm: mirrored at the line O C the motion through it is the same one
backwards, so that the rocker's angle is odd in the crank's, and its acceleration 0 there."""

SLIDER_CRANK = """
pinarm: 1
gravity: none
planar:
  points: {O: [0, 0], A: [250 mm, 0], B: [1 m, 0]}
  ground: [O]
  links: {crank: {points: [O, A], mass: 1 kg}, rod: {points: [A, B], mass: 1 kg}, piston: {points: [B], mass: 1 kg}}
  sliders: {x: {link: piston, along: [O, B]}}
"""
R, L = 0.25, 0.75
W = 2.0


def told(result, what: str) -> float:
    """Return to which part of their largest values a note says that something is known; 0 where none says so."""
    for note in result.notes():
        if found := re.search(rf"{what} (?:to ([^ ,]+)|(not at all)),", note):
            return 1.0 if found[2] else float(found[1])
    return 0.0


def beside_change_point(path: Path, offset: float):
    """Return the state in which the crank turns so far beside the change point [rad]."""
    problem = {"kind": "state", "hold": {"O": f"{offset!r} rad"}, "velocity": {"O": f"{W} rad/s"},
               "start": {"C": f"{0.5 * offset!r} rad"}}  # fmt: skip
    with pinarm.file_root(path.parent):
        return pinarm.run({"pinarm": 1, "mechanism": str(path), "problem": problem, "outputs": ["O", "C"]})


@pytest.mark.parametrize("offset", [1e-3, 1e-4, 2e-5, -1e-5])
def test_accelerations_beside_a_change_point_are_as_wrong_as_is_told(tmp_path, offset):
    (tmp_path / "four_bar.yaml").write_text(FOUR_BAR)
    result = beside_change_point(tmp_path / "four_bar.yaml", offset)
    trajectory = result.trajectory
    acceleration = float(np.asarray(result["joint.C.acceleration"])[0])
    beside = abs(offset) * W**2  # a third derivative of about 1
    part = told(result, "accelerations")
    size = max(np.abs(trajectory.a).max(), np.abs(trajectory.v).max() ** 2)
    assert abs(acceleration) - beside <= part * size
    assert part > (1e-9 if abs(offset) > 1e-4 else 1e-6)


def test_nothing_is_said_where_rounding_leaves_all_digits(tmp_path):
    (tmp_path / "four_bar.yaml").write_text(FOUR_BAR)
    assert told(beside_change_point(tmp_path / "four_bar.yaml", 0.3), "accelerations") == 0.0


@pytest.mark.parametrize("way", [1e-6, 1e-8, 1e-10])
def test_velocities_of_a_crank_that_its_piston_drives_at_the_dead_centre(tmp_path, way):
    """``1 - cos(O) = way (2 L - way) / (2 r (r + L - way))``, by the law of cosines."""
    (tmp_path / "slider_crank.yaml").write_text(SLIDER_CRANK)
    problem = {"kind": "state", "hold": {"x": f"{-way!r} m"}, "velocity": {"x": "-1 m/s"}, "drives": ["x"],
               "start": {"O": "0.1 rad", "A": "-0.13 rad"}}  # fmt: skip
    scenario = {"pinarm": 1, "mechanism": str(tmp_path / "slider_crank.yaml"), "problem": problem, "outputs": ["O"]}
    with pinarm.file_root(tmp_path):
        result = pinarm.run(scenario)
    angle = 2.0 * math.asin(math.sqrt(way * (2.0 * L - way) / (4.0 * R * (R + L - way))))
    place = R + L - way - R * math.cos(angle)
    velocity = 1.0 / (R * math.sin(angle) * (1.0 + R * math.cos(angle) / place))
    error = abs(abs(float(np.asarray(result["joint.O.velocity"])[0])) / velocity - 1.0)
    assert error <= told(result, "velocities") + 1e-9
    assert told(result, "velocities") > (0.1 * np.finfo(float).eps / way if way < 1e-7 else -1.0)


def test_rows_next_to_singular_positions_may_have_ball_joints(tmp_path):
    """A tip 1 m from a ball joint, held at ``x = cos e`` with no pitch, has the yaw e, of which little is known."""
    aside = 4e-3
    (tmp_path / "ball.urdf").write_text(f"""<robot name="ball">
  <link name="base"/><link name="wall"/><link name="tip"/>
  <link name="body"><inertial><mass value="3"/>
    <inertia ixx="0.01" iyy="0.04" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="J" type="spherical"><parent link="base"/><child link="body"/></joint>
  <joint name="a" type="fixed"><parent link="base"/><child link="wall"/><origin xyz="{math.cos(aside)!r} 0 0"/></joint>
  <joint name="b" type="fixed"><parent link="body"/><child link="tip"/><origin xyz="1 0 0"/></joint>
</robot>""")
    loops = {"P": {"kind": "point_on_plane", "between": ["wall", "tip"], "axis": "x"}}
    problem = {"kind": "statics", "hold": {"J.pitch": "0 rad", "J.roll": "0.3 rad"}, "start": {"J.yaw": "5e-3 rad"}}
    mechanism = {"pinarm": 1, "robot": str(tmp_path / "ball.urdf"), "loops": loops}
    with pinarm.file_root(tmp_path):
        result = pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": ["joint.J.yaw"]})
    assert float(np.asarray(result["joint.J.yaw"])[0]) == pytest.approx(aside, abs=1e-12)

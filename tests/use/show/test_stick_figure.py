"""Cams, rollers and wheels: they touch, and drawings and replays show the same."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.use.show.replay.overlays import pairs
from pinarm.use.show.replay.sticks import plate, sticks
from pinarm.use.show.replay.tracks import nodes_of
from pinarm.use.show.stick_figure import Disc, stick_figure

FILE = Path(pinarm.__file__).parents[1] / "models" / "bottle_capper" / "mechanism.yaml"


def test_the_cam_is_as_far_from_its_axis_as_the_base_circle_and_the_stroke() -> None:
    """Roller of 15 mm whose centre is 60 mm from the axis in the lower dwell, 100 mm in the upper one."""
    mechanism = pinarm.Mechanism.load(FILE)
    nodes = nodes_of(mechanism.model, np.zeros((1, 2)))
    cam, roller = stick_figure(mechanism, nodes, pairs(mechanism, {})).discs
    ways = np.linalg.norm(cam.outline - cam.middle, axis=1)
    assert [ways.min(), ways.max()] == pytest.approx([0.045, 0.085], abs=1e-9)
    assert np.linalg.norm(roller.outline - roller.middle, axis=1) == pytest.approx(np.full(73, 0.015))
    assert (cam.outline - cam.middle) @ cam.axis == pytest.approx(np.zeros(len(cam.outline)), abs=1e-12)


def test_a_plate_is_a_closed_surface_turned_outwards() -> None:
    """By the divergence theorem its volume is that of a square of 4 m^2 times its thickness, 0.12 of 2 m."""
    square = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
    mesh = plate(Disc(1, np.zeros(3), square, np.array([0.0, 0.0, 1.0]))).mesh
    assert mesh is not None
    corners = mesh.vertices[mesh.triangles]
    assert np.linalg.det(corners).sum() / 6.0 == pytest.approx(4.0 * 0.24)


def test_a_disc_without_a_shape_is_the_same_wheel_in_drawing_and_replay(tmp_path: Path) -> None:
    """A homogeneous disc of 2 kg and 0.3 m has 0.09 kg m^2 about its axis, and half of it across."""
    (tmp_path / "wheel.urdf").write_text(
        '<robot name="w"><link name="base"/><link name="wheel"><inertial><mass value="2"/>'
        '<inertia ixx="0.045" iyy="0.045" izz="0.09" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="a" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint>'
        "</robot>"
    )
    mechanism = pinarm.Mechanism.load(tmp_path / "wheel.urdf")
    nodes = nodes_of(mechanism.model, np.zeros((1, 1)))
    figure = stick_figure(mechanism, nodes, [])
    [rim, spoke] = figure.lines
    assert np.linalg.norm(rim.points, axis=1) == pytest.approx(np.full(len(rim.points), 0.3))
    assert np.linalg.norm(spoke.points, axis=1) == pytest.approx([0.0, 0.3])
    [wheel] = [shape for shape in sticks(mechanism.model, nodes, figure, {1}) if shape.kind == "mesh"]
    assert wheel.mesh is not None
    assert np.linalg.norm(wheel.mesh.vertices[:-2, :2], axis=1) == pytest.approx(np.full(2 * len(rim.points), 0.3))

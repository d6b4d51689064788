"""Bodies that draw nothing are shown by rods, pins, discs and boxes, alike in drawings and replays."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.use.show.bodies import nodes_of
from pinarm.use.show.scene import stick_figure

FILE = Path(pinarm.__file__).parents[1] / "models" / "bottle_capper" / "mechanism.yaml"


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
    figure = stick_figure(mechanism, nodes, [], frozenset({1}))
    [rim, spoke] = figure.lines
    assert np.linalg.norm(rim.points, axis=1) == pytest.approx(np.full(len(rim.points), 0.3))
    assert np.linalg.norm(spoke.points, axis=1) == pytest.approx([0.0, 0.3])
    [wheel] = [shape for shape in figure.solids if shape.kind == "mesh"]
    assert wheel.mesh is not None
    assert np.linalg.norm(wheel.mesh.vertices[:-2, :2], axis=1) == pytest.approx(np.full(2 * len(rim.points), 0.3))


def test_a_stick_figure_reaches_from_joint_to_joint(picture: Callable[..., Any], chain: Callable[..., str]) -> None:
    """Rods of the lengths of the links, along them; a pin along each axis, here y; the end at the centre of mass."""
    scene, _ = picture(
        chain({"name": "a", "axis": "0 1 0"}, {"name": "b", "axis": "0 1 0", "at": "0.3 0 0.4", "com": "0 0 2"})
    )
    rods = {s["node"]: s for s in scene["shapes"] if s["kind"] == "cylinder" and s["size"][1] > 0.4}
    assert [rods[k]["size"][1] for k in (1, 2)] == pytest.approx([0.5, 2.0])
    assert rods[1]["place"][:3] == pytest.approx([0.15, 0.0, 0.2])
    along = pin.Quaternion(np.array(rods[1]["place"][3:])).toRotationMatrix()[:, 2]
    assert along == pytest.approx([0.6, 0.0, 0.8])
    pins = [s for s in scene["shapes"] if s["kind"] == "cylinder" and s["size"][1] < 0.4]
    for one in pins:
        assert abs(pin.Quaternion(np.array(one["place"][3:])).toRotationMatrix()[1, 2]) == pytest.approx(1.0)
    assert sorted(one["node"] for one in pins) == [1, 2]


def test_the_ground_is_no_bar(solved: Callable[..., Any], read: Callable[..., Any]) -> None:
    """A four-bar stands on two feet, one behind each of its fixed joints, which lie 0.4 m apart; nothing joins them."""
    scene = read(solved("four_bar_shaking").replay(plots=[]).html).scene
    fixed = [shape for shape in scene["shapes"] if shape["node"] == 0]
    assert [shape["kind"] for shape in fixed] == ["box", "box"]
    assert sorted(shape["place"][0] for shape in fixed) == pytest.approx([0.0, 0.4])
    assert all(-0.05 < shape["place"][2] < 0.0 for shape in fixed)  # without gravity the axes' direction is up
    assert all(max(shape["size"]) < 0.1 for shape in fixed)

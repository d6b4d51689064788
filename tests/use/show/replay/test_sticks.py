"""Bodies that draw nothing are shown by rods, pins and the boxes of their inertias."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest


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


def test_a_body_in_one_place_is_the_box_of_its_inertia(picture: Callable[..., Any], chain: Callable[..., str]) -> None:
    """A homogeneous box of 12 kg and edges 1, 2, 3 m has the moments 13, 10 and 5 kg m^2."""
    scene, _ = picture(chain({"name": "a", "mass": 12.0, "inertia": (13.0, 10.0, 5.0)}))
    [box] = [shape for shape in scene["shapes"] if shape["kind"] == "box"]
    assert sorted(box["size"]) == pytest.approx([1.0, 2.0, 3.0])


def test_the_ground_is_no_bar(solved: Callable[..., Any], read: Callable[..., Any]) -> None:
    """A four-bar stands on two feet, one behind each of its fixed joints, which lie 0.4 m apart; nothing joins them."""
    scene = read(solved("four_bar_shaking").replay(plots=[]).html).scene
    fixed = [shape for shape in scene["shapes"] if shape["node"] == 0]
    assert [shape["kind"] for shape in fixed] == ["box", "box"]
    assert sorted(shape["place"][0] for shape in fixed) == pytest.approx([0.0, 0.4])
    assert all(-0.05 < shape["place"][2] < 0.0 for shape in fixed)  # without gravity the axes' direction is up
    assert all(max(shape["size"]) < 0.1 for shape in fixed)

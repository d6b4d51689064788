"""Cams and rollers as bodies: they touch, and their plates are closed."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.use.show.cam_bodies import CamBody, cam_bodies
from pinarm.use.show.replay.tracks import nodes_of

FILE = Path(pinarm.__file__).parents[1] / "models" / "bottle_capper" / "mechanism.yaml"


def test_the_cam_is_as_far_from_its_axis_as_the_base_circle_and_the_stroke() -> None:
    """Roller of 15 mm whose centre is 60 mm from the axis in the lower dwell, 100 mm in the upper one."""
    mechanism = pinarm.Mechanism.load(FILE)
    cam, roller = cam_bodies(mechanism, nodes_of(mechanism.model, np.zeros((1, 2))))
    ways = np.linalg.norm(cam.outline - cam.middle, axis=1)
    assert [ways.min(), ways.max()] == pytest.approx([0.045, 0.085], abs=1e-9)
    assert np.linalg.norm(roller.outline - roller.middle, axis=1) == pytest.approx(np.full(73, 0.015))
    assert (cam.outline - cam.middle) @ cam.axis == pytest.approx(np.zeros(len(cam.outline)), abs=1e-12)


def test_a_plate_is_a_closed_surface_turned_outwards() -> None:
    """By the divergence theorem its volume is that of a square of 4 m^2 times its thickness, 0.12 of 2 m."""
    square = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
    mesh = CamBody(1, np.zeros(3), square, np.array([0.0, 0.0, 1.0])).plate().mesh
    assert mesh is not None
    corners = mesh.vertices[mesh.triangles]
    assert np.linalg.det(corners).sum() / 6.0 == pytest.approx(4.0 * 0.24)

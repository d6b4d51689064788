"""View of a motion: upward direction, direction to the eye, and the box of the whole motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.records import ValueRecord
from pinarm.use.show.bodies import Node
from pinarm.use.show.shapes import Shape

PARALLEL = 1e-6
"""Sine of the angle up to which two axes are parallel."""

DIRECTIONS, GOLDEN = 80, np.pi * (1.0 + np.sqrt(5.0))
"""Number of points that describe the extent, and the turn from one of their directions to the next."""

SLACK = 0.03
"""Distance, relative to the extent, by which a wall may stand before the mechanism."""

ABOVE = 0.99
"""Cosine of the angle to the vertical above which a view is one from above."""

FLAT = 0.7
"""Depth of a planar mechanism, relative to its extent in the plane, up to which it is seen along its axes."""

FIELD, ROOM = 28.0, 1.18
"""Angle of the camera from the lowest to the highest point [deg], and the room that is left around the motion."""


class View(ValueRecord, frozen=True):
    """Projection of a drawing: parallel, with true lengths, or central, with true lengths at the centre's distance.

    Attributes:
        axes: Right and up in the picture, in world axes, shape (2, 3).
        eye: Place of the camera of a central projection [m], shape (3,).
        centre: Point that it looks at [m], shape (3,).
    """

    axes: Array
    eye: Array | None = None
    centre: Array | None = None

    def flat(self, points: Array) -> Array:
        """Return places in the picture [m], shape (2, n), of points in the world, shape (n, 3)."""
        if self.eye is None or self.centre is None:
            return np.asarray(self.axes @ points.T)
        back = self.eye - self.centre
        distance = np.linalg.norm(back)
        depth = (self.eye - points) @ back / distance
        return np.asarray(self.axes @ (points - self.centre).T * (distance / depth))


class Framing(ValueRecord, frozen=True):
    """The box of the whole motion and the view on it, in world axes.

    Attributes:
        up: Against gravity; z where there is none. Shape (3,).
        eye: Direction from the mechanism to the eye, shape (3,).
        normal: The direction from which a planar mechanism is seen flat, shape (3,); none for others.
        low: Lower corner [m], shape (3,).
        high: Upper corner [m], shape (3,).
        outline: Its points that reach farthest in all directions [m], shape (k, 3).
    """

    up: Array
    eye: Array
    normal: Array | None
    low: Array
    high: Array
    outline: Array

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.high - self.low)) or 1.0

    def view(self) -> View:
        """Return the projection of a drawing: along the axes of a planar mechanism, else by the replay's camera."""
        towards = self.eye if self.normal is None else self.normal
        up = _upwards(towards, self.up)
        axes = np.array([np.cross(up, towards), up])
        if self.normal is not None:
            return View(axes)
        along = self.outline @ axes.T
        middle = (self.low + self.high) / 2.0
        centre = middle + axes.T @ ((along.min(axis=0) + along.max(axis=0)) / 2.0 - axes @ middle)
        offset = self.outline - centre
        needed = np.abs(offset @ axes.T).max(axis=1) / np.tan(np.deg2rad(FIELD) / 2.0) + offset @ self.eye
        return View(axes, centre + ROOM * (float(needed.max()) or 1.0) * self.eye, centre)


def framing(
    model: pin.Model, nodes: Sequence[Node], shapes: Sequence[Shape], places: Array, paths: Sequence[Array]
) -> Framing:
    """Return the view of a motion.

    Args:
        model: Pinocchio's model, with its gravity.
        nodes: Its bodies.
        shapes: Its solids.
        places: Placements of the bodies at rows of the motion, shape (rows, njoints, 4, 4).
        paths: Further points to be seen: positions in the world, each of shape (rows, 3).
    """
    still = np.concatenate([np.zeros((0, 3)), *(shape.extent() for shape in shapes if shape.node == 0)])
    moving = _moving(nodes, shapes, places, paths)
    everything = np.concatenate([still, moving])
    low, high = everything.min(axis=0), everything.max(axis=0)
    gravity, up = np.asarray(model.gravity.linear), np.array([0.0, 0.0, 1.0])
    if gravity.any():
        direction = gravity / np.abs(gravity).max()  # whose squares do not vanish
        up = -direction / np.linalg.norm(direction)
    normal = _normal(nodes, places, paths)
    if normal is not None:
        across = np.linalg.norm((high - low) * np.sqrt(np.maximum(1.0 - normal**2, 0.0)))
        normal = None if abs(normal) @ (high - low) > FLAT * across else _facing(normal, up)
    behind = still.mean(axis=0) - (moving.min(axis=0) + moving.max(axis=0)) / 2.0 if len(still) else np.zeros(3)
    eye = _slanted(up, behind, SLACK * float((high - low).max())) if normal is None else _tilted(normal, up)
    return Framing(up, eye / np.linalg.norm(eye), normal, low, high, _outline(everything))


def _moving(nodes: Sequence[Node], shapes: Sequence[Shape], places: Array, paths: Sequence[Array]) -> Array:
    """Return the corners of the moving solids at every row, in the world, shape (k, 3)."""
    carrying = [node for node in range(1, len(nodes)) if nodes[node].carries]
    points = [places[:, carrying, :3, 3].reshape(-1, 3), *paths]
    for node in carrying:
        corners = [shape.extent() for shape in shapes if shape.node == node]
        if corners:
            outer = np.concatenate(corners) @ places[:, node, :3, :3].swapaxes(1, 2) + places[:, node, None, :3, 3]
            points.append(outer.reshape(-1, 3))
    return np.asarray(np.concatenate(points))


def _outline(points: Array) -> Array:
    """Return the points that reach farthest along directions spread evenly over the sphere."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * k / DIRECTIONS, GOLDEN * k
    radius = np.sqrt(1.0 - z * z)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
    return np.asarray(points[sorted({int((points @ direction).argmax()) for direction in directions})])


def _normal(nodes: Sequence[Node], places: Array, paths: Sequence[Array]) -> Array | None:
    """Return the normal of the plane in which all bodies move; ``None`` where there is none.

    It is the axis of all revolute joints, at right angles to all slides; where bodies only slide, the normal of the
    plane of their ways and of the points that join them.
    """
    moved = [k for k, node in enumerate(nodes) if node.kind != "fixed"]
    if not moved or any(nodes[k].kind == "pose" for k in moved):
        return None
    turning, sliding = (
        np.array([places[0, k, :3, :3] @ nodes[k].axis for k in moved if nodes[k].kind == kind]).reshape(-1, 3)
        for kind in ("turn", "slide")
    )
    if len(turning):
        axis: Array = turning[0]
        skew = np.linalg.norm(np.cross(axis, turning), axis=1).max()
        return axis if max(skew, np.abs(sliding @ axis).max(initial=0.0)) < PARALLEL else None
    points = np.concatenate([places[:, moved, :3, 3].reshape(-1, 3), *paths])
    offsets = points - points.mean(axis=0)
    size = float(np.abs(offsets).max()) or 1.0
    _, sizes, axes = np.linalg.svd(np.concatenate([offsets / size, sliding, np.zeros((3, 3))]), full_matrices=False)
    return np.asarray(axes[2]) if sizes[2] < PARALLEL < sizes[1] else None


def _facing(axis: Array, up: Array) -> Array:
    """Return the direction to the eye along an axis: the side from which the third axis points right, or from above."""
    if abs(axis @ up) > ABOVE:
        return up
    right = np.cross(up, axis)
    return np.asarray(np.sign(right[np.abs(right).argmax()]) * axis)


def _tilted(normal: Array, up: Array) -> Array:
    """Return a direction to the eye from which depth is seen."""
    if abs(normal @ up) > ABOVE:
        return np.asarray(up - 0.4 * _upwards(normal, up))
    return np.asarray(normal + 0.22 * np.cross(up, normal) + 0.2 * up)


def _upwards(eye: Array, up: Array) -> Array:
    """Return the upward direction of the picture, shape (3,); seen from above, x points to the right."""
    if abs(eye @ up) > ABOVE:
        return np.asarray(np.eye(3)[1] if abs(up[1]) < 0.5 else -np.eye(3)[2])
    flat = up - (up @ eye) * eye
    return np.asarray(flat / np.linalg.norm(flat))


def _slanted(up: Array, behind: Array, slack: float) -> Array:
    """Return the direction of a three-quarter view: from the front and the right.

    Where a wall of the ground stands on that side by more than the slack, it is the first of the other corners that is
    free of it; ``behind`` is the place of the ground relative to the moving bodies.
    """
    front = np.eye(3)[0] if abs(up[0]) < 0.5 else np.eye(3)[1]
    front = front - (front @ up) * up
    front /= np.linalg.norm(front)
    left = np.cross(up, front)
    corners = [0.78 * x * front + 0.56 * y * left for x in (1.0, -1.0) for y in (-1.0, 1.0)]
    hidden = [max(float(corner @ behind) - slack, 0.0) for corner in corners]
    return np.asarray(corners[int(np.argmin(hidden))] + 0.38 * up)

"""A stick figure for bodies that draw nothing: rods between their points, their joints, the boxes of their inertias."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.use.show.replay.shapes import GROUND, Colour, Shape, colour_of
from pinarm.use.show.replay.tracks import Node

ROD, PIN, POINT, BOX = 0.014, 0.026, 0.02, 0.18
"""Radii of rods, joints and end points, and the largest edge of a box, relative to the size of the figure."""

FOOT = 0.085, 0.03
"""Width and height of what a joint on the ground stands on, relative to the size of the figure."""

LINKS = 4.0
"""Typical links in a figure: one of more and shorter links is drawn as thin as its links ask for."""

DARK: Colour = (0.27, 0.29, 0.33, 1.0)


def sticks(model: pin.Model, nodes: Sequence[Node], bare: Collection[int]) -> list[Shape]:
    """Return shapes for the bodies that have none.

    A body is drawn as rods from its joint to the joints and links it carries; one that carries nothing reaches to its
    centre of mass, and one that is all in one place is the box of its inertia.

    Args:
        model: Pinocchio's model.
        nodes: Its bodies.
        bare: Bodies without shapes of their own.
    """
    reached, joined = reaches(model, nodes), _mounts(nodes)
    points = {node: reached[node] for node in sorted(bare) if nodes[node].carries}
    size = _size(model, nodes, points)
    shapes = [shape for node in points if node for shape in _body(model, node, points[node], joined[node], size)]
    if 0 in points:  # the ground is no bar between the joints on it
        turning = [k for k, node in enumerate(nodes) if node.parent == 0 and node.kind == "turn" and node.carries]
        mounted = [nodes[k].placement.translation for k in turning if k not in points or len(points[k])]
        shapes += [_foot(model, at, size) for at in _different(np.array(mounted).reshape(-1, 3))]
    joints = [i for i in range(1, len(nodes)) if i in points or nodes[i].parent in points.keys() - {0}]
    return shapes + [shape for joint in joints for shape in _joint(nodes[joint], joint, size)]


def reaches(model: pin.Model, nodes: Sequence[Node]) -> list[Array]:
    """Return the places that every body reaches to, other than its origin, shape (k, 3) each."""
    found = _mounts(nodes)
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            found[frame.parentJoint].append(np.asarray(frame.placement.translation))
    for node, inertia in enumerate(model.inertias):
        if node and not any(point.any() for point in found[node]):
            found[node] = [np.asarray(inertia.lever)]
    return [_different(np.array([point for point in places if point.any()]).reshape(-1, 3)) for places in found]


def _mounts(nodes: Sequence[Node]) -> list[list[Array]]:
    """Return the places on every body of the joints that it carries, shape (3,) each."""
    found: list[list[Array]] = [[] for _ in nodes]
    for node in nodes[1:]:
        found[node.parent].append(np.asarray(node.placement.translation))
    return found


def _size(model: pin.Model, nodes: Sequence[Node], points: dict[int, Array]) -> float:
    """Return the length [m] that thicknesses are relative to.

    It is the reach of the stretched figure, less where that has many links; without any length, that at which boxes are
    drawn whole.
    """
    reach, links = np.zeros(len(nodes)), []
    for index, node in enumerate(nodes[1:], start=1):
        links.append(float(np.linalg.norm(node.placement.translation)))
        reach[index] = reach[node.parent] + links[-1]
    ends = [float(np.linalg.norm(point)) for each in points.values() for point in each]
    ends = [length for length in [*ends, *links] if length > 0.0]
    if ends:
        return float(min(reach.max() + max(ends), LINKS * _median(ends)))
    return max([float(cuboid(inertia)[0].max()) for inertia in model.inertias if inertia.mass > 0.0] or [BOX]) / BOX


def _body(model: pin.Model, node: int, points: Array, mounts: Sequence[Array], size: float) -> Iterator[Shape]:
    colour, carries = colour_of(node), set(map(tuple, mounts))
    for point in points:
        yield _rod(node, np.zeros(3), point, ROD * size, colour)
        if tuple(point) not in carries:
            yield Shape(node, pin.SE3(np.eye(3), point), "sphere", (POINT * size,), colour)
    inertia = model.inertias[node]
    if not len(points) and inertia.mass > 0.0:
        edges, axes = cuboid(inertia)
        box = np.maximum(edges * min(1.0, BOX * size / max(edges.max(), 1e-300)), ROD * size)
        yield Shape(node, pin.SE3(axes, inertia.lever), "box", (box[0], box[1], box[2]), colour)


def _joint(node: Node, index: int, size: float) -> Iterator[Shape]:
    """Yield the sign of a joint: a pin along a revolute axis, a block on a rail for a slide, a ball for others."""
    if node.kind == "turn":
        yield Shape(index, _along(np.zeros(3), node.axis), "cylinder", (PIN * size, 3.2 * PIN * size), DARK)
    elif node.kind == "slide":
        block = (2.4 * PIN * size, 2.4 * PIN * size, 4.0 * PIN * size)
        yield Shape(index, _along(np.zeros(3), node.axis), "box", block, DARK)
        start, end = float(node.values.min()) - 2.0 * PIN * size, float(node.values.max()) + 2.0 * PIN * size
        rail = node.placement * _along(node.axis * (start + end) / 2.0, node.axis)
        yield Shape(node.parent, rail, "cylinder", (0.5 * ROD * size, end - start), GROUND)
    elif node.placement.translation.any():
        yield Shape(index, pin.SE3.Identity(), "sphere", (PIN * size,), DARK)


def _foot(model: pin.Model, at: Array, size: float) -> Shape:
    """Return what a joint on the ground stands on: a short block below it."""
    gravity = np.asarray(model.gravity.linear)
    down = gravity / np.abs(gravity).max() if gravity.any() else np.array([0.0, 0.0, -1.0])  # its square may underflow
    down /= np.linalg.norm(down)
    edges = (FOOT[0] * size, FOOT[0] * size, FOOT[1] * size)
    return Shape(0, _along(at + (PIN * size + edges[2] / 2.0) * down, down), "box", edges, GROUND)


def _rod(node: int, start: Array, end: Array, radius: float, colour: Colour) -> Shape:
    length = float(np.linalg.norm(end - start))
    return Shape(node, _along((start + end) / 2.0, end - start), "cylinder", (radius, length), colour)


def _along(centre: Array, direction: Array) -> pin.SE3:
    """Return the placement whose z is a direction."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.asarray(direction, float))
    return pin.SE3(turn.toRotationMatrix(), centre)


def cuboid(inertia: pin.Inertia) -> tuple[Array, Array]:
    """Return edges [m] and axes of the homogeneous box of an inertia: ``a^2 = 6 (I_b + I_c - I_a) / m``."""
    moments, axes = np.linalg.eigh(inertia.inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments) / inertia.mass, 0.0)), axes


def _different(points: Array) -> Array:
    """Return the different rows of points, shape (n, 3), ascending."""
    return np.array(sorted(set(map(tuple, points.tolist())))).reshape(-1, 3)


def _median(sizes: Sequence[float]) -> float:
    """Return the median; ``np.median`` imports ``numpy.ma``."""
    ascending, n = sorted(sizes), len(sizes)
    return 0.5 * (ascending[(n - 1) // 2] + ascending[n // 2])

"""Stick figure in solids: cylinders along rods, pins and blocks at joints, blocks below joints on the ground."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.use.show.replay.meshes import Mesh
from pinarm.use.show.replay.shapes import GROUND, Colour, Shape, colour_of
from pinarm.use.show.replay.tracks import Node
from pinarm.use.show.stick_figure import Disc, StickFigure

ROD, PIN, POINT = 0.014, 0.026, 0.02
"""Radii of rods, joints and end points, relative to the size of the figure."""

FOOT = 0.085, 0.03
"""Width and height of the block below a joint on the ground, relative to the size of the figure."""

THICK = 0.12
"""Thickness of a disc, relative to its extent."""

DARK: Colour = (0.27, 0.29, 0.33, 1.0)


def sticks(model: pin.Model, nodes: Sequence[Node], figure: StickFigure, bare: Collection[int]) -> list[Shape]:
    """Return the solids of some bodies of a figure.

    Args:
        model: Pinocchio's model.
        nodes: Its bodies.
        figure: Its stick figure.
        bare: Bodies without shapes of their own; with 0 among them, joints on the ground stand on blocks.
    """
    shapes = [shape for shape in _bodies(nodes, figure) if shape.node in bare]
    shapes += [plate(disc) for disc in figure.discs if disc.node in bare]
    if 0 in bare:
        compact = {disc.node for disc in figure.discs} | {box.node for box in figure.boxes}
        standing = [k for k in figure.pins if not nodes[k].parent and k not in compact]
        places = {tuple(nodes[k].placement.translation.tolist()) for k in standing}
        shapes += [_foot(model, np.array(place), figure.size) for place in sorted(places)]
    moved = [k for k in range(1, len(nodes)) if k in bare or (nodes[k].parent and nodes[k].parent in bare)]
    return shapes + [shape for joint in moved for shape in _joint(nodes[joint], joint, figure)]


def _bodies(nodes: Sequence[Node], figure: StickFigure) -> Iterator[Shape]:
    """Yield rods, balls at the ends of rods that carry no joint, and boxes."""
    carried = {(node.parent, tuple(node.placement.translation)) for node in nodes}
    for rod in figure.rods:
        colour, (start, end) = colour_of(rod.node), rod.points
        yield _rod(rod.node, start, end, ROD * figure.size, colour)
        if (rod.node, tuple(end)) not in carried:
            yield Shape(rod.node, pin.SE3(np.eye(3), end), "sphere", (POINT * figure.size,), colour)
    yield from figure.boxes


def plate(disc: Disc) -> Shape:
    """Return a disc as a plate, its two faces as fans about the axis."""
    n, half = len(disc.outline), 0.5 * THICK * float(np.ptp(disc.outline, axis=0).max()) * disc.axis
    vertices = np.concatenate([disc.outline + half, disc.outline - half, [disc.middle + half, disc.middle - half]])
    a = np.arange(n)
    b = (a + 1) % n
    above, below = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    triangles = np.concatenate([
        np.stack(corners, axis=1) for corners in (
            (above, a, b), (below, b + n, a + n), (a, a + n, b + n), (a, b + n, b),
        )
    ])  # fmt: skip
    mesh = Mesh(vertices, triangles)
    return Shape(disc.node, pin.SE3.Identity(), "mesh", (1.0, 1.0, 1.0), colour_of(disc.node), mesh)


def _joint(node: Node, index: int, figure: StickFigure) -> Iterator[Shape]:
    """Yield the sign of a joint: a pin along a revolute axis, a block on a rail for a slide, a ball for others."""
    radius = PIN * figure.size
    if index in figure.pins:
        yield Shape(index, _along(np.zeros(3), node.axis), "cylinder", (radius, 3.2 * radius), DARK)
    elif index in figure.slides:
        block = (2.4 * radius, 2.4 * radius, 4.0 * radius)
        yield Shape(index, _along(np.zeros(3), node.axis), "box", block, DARK)
        start, end = figure.rails[figure.slides.index(index)].points
        yield _rod(node.parent, start, end, 0.5 * ROD * figure.size, GROUND)
    elif index in figure.balls:
        yield Shape(index, pin.SE3.Identity(), "sphere", (radius,), DARK)


def _foot(model: pin.Model, at: Array, size: float) -> Shape:
    """Return a short block below a joint."""
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

"""The graph of links: bodies as boxes, the frame on top, joints as lines, loop joints as dashed lines."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.use.report.mechanism_tables import body_name
from pinarm.use.report.tables import shortened

COLUMN, ROW, WIDE, HIGH, MARGIN = 150.0, 54.0, 104.0, 22.0, 6.0
"""Distances between boxes, their size, and the margin [px]."""

BESIDE, FARTHER = 34.0, 26.0
"""How far the line of a loop joint stands beside the boxes, and how much farther that of the next one [px]."""

MOST_BODIES = 26
"""Bodies of a graph that fits on a page."""

MOST_LETTERS = 17
"""Letters of a name in a box."""


@dataclass(frozen=True)
class Label:
    """A text at a place of the picture [px]."""

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class LinkGraph:
    """A graph as it is drawn.

    Attributes:
        width: Of the picture [px].
        height: Likewise.
        boxes: Bodies, by the centres of their boxes.
        joints: Joints, each with the two points that its line joins and the place of its name.
        loops: Loop joints, each with the path of its line in SVG and the place of its name.
    """

    width: float
    height: float
    boxes: list[Label]
    joints: list[tuple[float, float, float, float, Label]]
    loops: list[tuple[str, Label]]


def link_graph(mechanism: Mechanism) -> LinkGraph | None:
    """Return the graph of a mechanism; nothing where it has too many bodies for a page."""
    model = mechanism.model
    if not 1 < model.njoints <= MOST_BODIES:
        return None
    places = _places(model)
    boxes = [Label(*places[k], shortened(body_name(model, k), MOST_LETTERS)) for k in range(model.njoints)]
    joints = [_joint(model, places, index) for index in range(1, model.njoints)]
    closing = [joint for joint in mechanism.constraints if isinstance(joint, LoopJoint)]
    right = max(x for x, _ in places) + WIDE / 2
    loops = [_loop(model, places, joint, right + BESIDE + FARTHER * k) for k, joint in enumerate(closing)]
    width = right + (BESIDE + FARTHER * len(closing) + 5.5 * MOST_LETTERS if closing else COLUMN - WIDE + MARGIN)
    return LinkGraph(width, max(y for _, y in places) + HIGH / 2 + MARGIN, boxes, joints, loops)


def _places(model: pin.Model) -> list[tuple[float, float]]:
    """Return the centres of the boxes: by their distance from the frame, each above the middle of those it carries."""
    carried: list[list[int]] = [[] for _ in range(model.njoints)]
    depth = [0] * model.njoints
    for index in range(1, model.njoints):
        carried[model.parents[index]].append(index)
        depth[index] = depth[model.parents[index]] + 1
    column = [0.0] * model.njoints
    for order, leaf in enumerate(_leaves(carried)):
        column[leaf] = float(order)
    for index in reversed(range(model.njoints)):
        if carried[index]:
            column[index] = sum(column[k] for k in carried[index]) / len(carried[index])
    across, down = MARGIN + WIDE / 2, MARGIN + HIGH / 2
    return [(across + COLUMN * x, down + ROW * y) for x, y in zip(column, depth, strict=True)]


def _leaves(carried: list[list[int]]) -> list[int]:
    """Return the bodies that carry none, from left to right."""
    leaves, left = [], [0]
    while left:
        index = left.pop()
        if not carried[index]:
            leaves.append(index)
        left += reversed(carried[index])
    return leaves


def _joint(model: pin.Model, places: list[tuple[float, float]], index: int) -> tuple[float, float, float, float, Label]:
    (x, y), (u, w) = places[model.parents[index]], places[index]
    name = Label(u + 5, w - HIGH / 2 - 7, shortened(model.names[index], MOST_LETTERS))
    return x, y + HIGH / 2, u, w - HIGH / 2, name


def _loop(model: pin.Model, places: list[tuple[float, float]], closing: LoopJoint, right: float) -> tuple[str, Label]:
    """Return the line of a loop joint: from the side of one box around all others to that of the other."""
    (x, y), (u, w) = (places[model.frames[frame].parentJoint] for frame in (closing.first, closing.second))
    start, end = x + WIDE / 2, u + WIDE / 2
    path = f"M{start:.1f} {y + 5:.1f} C{right:.1f} {y + 5:.1f} {right:.1f} {w - 5:.1f} {end:.1f} {w - 5:.1f}"
    label = Label((start + 6 * right + end) / 8 + 3, (y + w) / 2 + 3, shortened(closing.name, MOST_LETTERS))
    return path, label

"""The graph of links as SVG: bodies as boxes, the frame on top, joints as lines, loop joints as dashed lines."""

from __future__ import annotations

import pinocchio as pin

from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.use.report.document import shortened, text
from pinarm.use.report.given import body_name

COLUMN, ROW, WIDE, HIGH, MARGIN = 150.0, 54.0, 104.0, 22.0, 6.0
"""Distances between boxes, their size, and the margin [px]."""

BESIDE, FARTHER = 34.0, 26.0
"""How far the line of a loop joint stands beside the boxes, and how much farther that of the next one [px]."""

MOST_BODIES = 26
"""Bodies of a graph that fits on a page."""

MOST_LETTERS = 17
"""Letters of a name in a box."""

Places = list[tuple[float, float]]


def link_graph(mechanism: Mechanism) -> str:
    """Return the graph of a mechanism; nothing where it has too many bodies for a page."""
    model = mechanism.model
    if not 1 < model.njoints <= MOST_BODIES:
        return ""
    places = _places(model)
    closing = [joint for joint in mechanism.constraints if isinstance(joint, LoopJoint)]
    right = max(x for x, _ in places) + WIDE / 2
    drawn = [_loop(model, places, joint, right + BESIDE + FARTHER * k) for k, joint in enumerate(closing)]
    drawn += [_joint(model, places, index) for index in range(1, model.njoints)]
    drawn += [_box(body_name(model, index), *places[index], frame=not index) for index in range(model.njoints)]
    width = right + (BESIDE + FARTHER * len(closing) + 5.5 * MOST_LETTERS if closing else COLUMN - WIDE + MARGIN)
    height = max(y for _, y in places) + HIGH / 2 + MARGIN
    size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
    return f'<svg class="links" role="img" aria-label="Graph of links" {size}>{"".join(drawn)}</svg>'


def _places(model: pin.Model) -> Places:
    """Return the centres of the boxes: by their distance from the frame, each above the middle of those it carries."""
    carried: list[list[int]] = [[] for _ in range(model.njoints)]
    depth = [0] * model.njoints
    for index in range(1, model.njoints):
        carried[model.parents[index]].append(index)
        depth[index] = depth[model.parents[index]] + 1
    column, leaves, left = [0.0] * model.njoints, 0, [0]
    while left:  # bodies that carry none, from left to right
        index = left.pop()
        if not carried[index]:
            column[index], leaves = float(leaves), leaves + 1
        left += reversed(carried[index])
    for index in reversed(range(model.njoints)):
        if carried[index]:
            column[index] = sum(column[k] for k in carried[index]) / len(carried[index])
    across, down = MARGIN + WIDE / 2, MARGIN + HIGH / 2
    return [(across + COLUMN * x, down + ROW * y) for x, y in zip(column, depth, strict=True)]


def _text(kind: str, x: float, y: float, name: str) -> str:
    middle = ' text-anchor="middle"' if kind == "box" else ""
    return f'<text class="{kind}"{middle} x="{x}" y="{y}">{text(shortened(name, MOST_LETTERS))}</text>'


def _box(name: str, x: float, y: float, *, frame: bool) -> str:
    kind = ' class="frame"' if frame else ""
    place = f'x="{x - WIDE / 2}" y="{y - HIGH / 2}" width="{WIDE}" height="{HIGH}"'
    return f'<rect {place} rx="3"{kind}/>{_text("box", x, y + 3.5, name)}'


def _joint(model: pin.Model, places: Places, index: int) -> str:
    (x, y), (u, w) = places[model.parents[index]], places[index]
    line = f'<line x1="{x}" y1="{y + HIGH / 2}" x2="{u}" y2="{w - HIGH / 2}"/>'
    return line + _text("joint", u + 5, w - HIGH / 2 - 7, model.names[index])


def _loop(model: pin.Model, places: Places, closing: LoopJoint, right: float) -> str:
    """Return the line of a loop joint: from the side of one box around all others to that of the other."""
    (x, y), (u, w) = (places[model.frames[frame].parentJoint] for frame in (closing.first, closing.second))
    start, end = x + WIDE / 2, u + WIDE / 2
    path = f"M{start:.1f} {y + 5:.1f} C{right:.1f} {y + 5:.1f} {right:.1f} {w - 5:.1f} {end:.1f} {w - 5:.1f}"
    return f'<path d="{path}"/>' + _text("loop", (start + 6 * right + end) / 8 + 3, (y + w) / 2 + 3, closing.name)

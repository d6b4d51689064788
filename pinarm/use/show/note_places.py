"""Where names stand in a drawing: beside their points, where they cover least."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from pinarm.arrays import Array
from pinarm.records import replace
from pinarm.use.show.chart import Line, Note, extent
from pinarm.use.show.labels import runs

DISTANCES = (5.0, 11.0, 19.0)
"""From a point to the edge of its name [points]."""

TURNS = np.deg2rad([45.0, 135.0, -45.0, -135.0, 90.0, 0.0, -90.0, 180.0])
"""Directions from a point to its name, the preferred one first."""

LETTER, LINE = 0.58, 1.15
"""Width of a letter and height of a line, relative to the size of the letters."""

DENSE = 24
"""Points by which a piece of a line is looked at."""

EDGE = 34.0
"""How far beyond the lines a name may reach [points]."""

COVERED = 1000.0
"""How much worse it is to cover a name than a point of a line."""


def note_places(
    notes: Sequence[Note], drawn: Sequence[Line], hidden: Sequence[Line], side: float, *, kept: int
) -> list[Note]:
    """Return names beside their points.

    Args:
        notes: The names, at their points.
        drawn: All lines of the drawing, which say how large it is.
        hidden: Those that names should not cover.
        side: Length on the page of the longer side of what is drawn [points].
        kept: How many of the names, from the first, must stand; others are left out where they would cover one.
    """
    low, high = extent(drawn)
    per = side / (float((high - low).max()) or 1.0)
    covered, page = per * _dense(hidden), np.concatenate([per * low - EDGE, per * high + EDGE])
    boxes, placed = np.zeros((0, 4)), []
    for k, note in enumerate(notes):
        size = np.array([_width(note), LINE * note.size])
        offset, box, worst = _best(per * np.array([note.x, note.y]), size, covered, boxes, page)
        if k < kept or worst < COVERED:
            placed.append(replace(note, dx=float(offset[0]), dy=float(offset[1])))
            boxes = np.vstack([boxes, box])
    return placed


def _best(point: Array, size: Array, covered: Array, boxes: Array, page: Array) -> tuple[Array, Array, float]:
    """Return the offset of a name, its box (left, bottom, right, top), and what it covers or how far it sticks out."""
    best: tuple[float, Array, Array] | None = None
    for k, (distance, turn) in enumerate((d, t) for d in DISTANCES for t in TURNS):
        direction = np.array([np.cos(turn), np.sin(turn)])
        offset = direction * distance + np.sign(np.round(direction, 9)) * size / 2.0
        low, high = point + offset - size / 2.0, point + offset + size / 2.0
        hidden = int(((covered > low) & (covered < high)).all(axis=1).sum())
        struck = int(((boxes[:, :2] < high) & (boxes[:, 2:] > low)).all(axis=1).sum())
        outside = float(np.maximum(page[:2] - low, 0.0).sum() + np.maximum(high - page[2:], 0.0).sum())
        cost = COVERED * struck + hidden + outside + 0.02 * k
        if best is None or cost < best[0]:
            best = cost, offset, np.concatenate([low, high])
    assert best is not None
    return best[1], best[2], best[0]


def _dense(lines: Sequence[Line]) -> Array:
    """Return points along lines, close to each other, shape (n, 2)."""
    share = np.linspace(0.0, 1.0, DENSE)[:, None]
    points = [np.zeros((0, 2))]
    for line in lines:
        corners = np.stack([np.ravel(line.x), np.ravel(line.y)], axis=1)
        points += [corners, *(a + share * (b - a) for a, b in pairwise(corners))]
    found = np.concatenate(points)
    return np.asarray(found[np.isfinite(found).all(axis=1)])


def _width(note: Note) -> float:
    """Return about how wide a name is [points]."""
    return LETTER * note.size * sum(len(run.text) * (0.7 if run.at else 1.0) for run in runs(note.text))

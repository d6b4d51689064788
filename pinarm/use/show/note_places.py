"""Names in a drawing: beside their points, where they cover least, or farther away with a line to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.use.show.picture import Note, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DISTANCES = np.array([5.0, 11.0, 19.0, 28.0, 38.0, 50.0])
"""From a point to the edge of its name [points]."""

BESIDE = 12.0
"""Distance up to which a name is seen to belong to its point; from farther away a line leads to it [points]."""

AWAY = 0.6
"""Cost of the distance to a name, in covered points of lines per point: near names are read most easily."""

CLEAR = 1.5
"""Room between two names, and between a name and a line that it could cover [points]."""

TURNS = np.deg2rad([45.0, 135.0, -45.0, -135.0, 90.0, 0.0, -90.0, 180.0])
TOWARDS = np.round(np.stack([np.cos(TURNS), np.sin(TURNS)], axis=1), 15)
"""Directions from a point to its name, the preferred one first, shape (8, 2)."""

LEADER = "#8b949e"
"""Colour of the lines to names."""

DENSE = 2.0
"""Distance of the sample points of lines [points]."""

MOST = 8
"""Sample points that a name may cover."""

ALONG = np.linspace(0.0, 1.0, 26)[:, None]
"""Sample points of a line to a name: of the longest line, one each 2 points of length."""

LED = 5
"""Times that sample points of a line to a name count: a name covers it only at its end."""

POINTS = 72.0
"""Points per inch."""


def write_beside(
    axis: Axes, notes: Sequence[Note], hidden: Sequence[Array], per: float, taken: Sequence[Array]
) -> None:
    """Write names beside their points, on the page, none over another.

    Those that come first choose first. A name that has no room, several in a row, is shortened to the first of them;
    where that has none either, it is left out.

    Args:
        axis: The drawing, with its limits.
        notes: The names.
        hidden: Corners of lines that names should not cover, shape (n, 2) each.
        per: Scale of the drawing [points per unit of the axes].
        taken: Boxes where no name may be (left, bottom, right, top), in units of the axes, shape (4,) each.
    """
    page = per * np.array([*axis.get_xlim(), *axis.get_ylim()])[[0, 2, 1, 3]]
    lines, boxes = _dense([per * corners for corners in hidden]), per * np.array(taken).reshape(-1, 4)
    for note in notes:
        for short in dict.fromkeys([note.text, _shorter(note.text)]):
            text = write(axis, Note(short, note.at, note.colour))
            box = text.get_window_extent()
            size = np.array([box.width, box.height]) * POINTS / text.figure.dpi
            offset = _best(per * note.at, size, page, lines, boxes)
            if offset is None:
                text.remove()
                continue
            text.xyann = (float(offset[0]), float(offset[1]))
            middle, nearest = per * note.at + offset, _nearest(offset, size)
            boxes = np.vstack([boxes, [*(middle - size / 2.0), *(middle + size / 2.0)]])
            if np.linalg.norm(nearest) > BESIDE:
                ends = np.array([note.at, note.at + nearest / per])
                axis.plot(*ends.T, color=LEADER, linewidth=0.5)
                lines = np.concatenate([lines, *[_dense([per * ends])] * LED])
            break


def _best(point: Array, size: Array, page: Array, lines: Array, boxes: Array) -> Array | None:
    """Return the offset of a name where it covers the fewest points of lines; ``None`` where it covers too much.

    It stays on the page, and neither it nor the line to it covers another name.

    Args:
        point: The point that is named [points], shape (2,).
        size: Width and height of the name.
        page: Left, bottom, right, top.
        lines: Sample points of lines, shape (n, 2).
        boxes: Boxes of other names, shape (m, 4).
    """
    offsets = (TOWARDS * DISTANCES[:, None, None] + np.sign(TOWARDS) * size / 2.0).reshape(-1, 2)
    names = np.hstack([point + offsets - size / 2.0, point + offsets + size / 2.0])
    low, high = names[:, None, :2], names[:, None, 2:]
    on_page = ((low >= page[:2]) & (high <= page[2:])).all(axis=(1, 2))
    over = np.any(((boxes[:, :2] < high + CLEAR) & (boxes[:, 2:] > low - CLEAR)).all(axis=2), axis=1)
    ways = point + ALONG * _nearest(offsets, size)[:, None]
    through = np.any(_inside(ways.reshape(-1, 2), boxes).any(axis=0).reshape(ways.shape[:2]), axis=1)
    led = np.linalg.norm(ways[:, -1] - point, axis=1) > BESIDE
    covered = np.count_nonzero(_inside(lines, names), axis=1)
    costs = covered + AWAY * np.repeat(DISTANCES, len(TURNS)) + 0.02 * np.arange(len(names))
    costs[~on_page | over | (led & through) | (covered > MOST)] = np.inf
    return np.asarray(offsets[costs.argmin()]) if np.isfinite(costs).any() else None


def _shorter(text: str) -> str:
    """Return the first of several names, with a sign that there are more."""
    first, *more = text.split(", ")
    return f"{first}, ..." if more else first


def _nearest(offset: Array, size: Array) -> Array:
    """Return the way from a point to the edge of a name whose middle is so far from it [points], shape (..., 2)."""
    return np.asarray(offset - np.clip(offset, -size / 2.0, size / 2.0))


def _inside(points: Array, boxes: Array) -> Flags:
    """Return which points, shape (n, 2), are in or close to which boxes, shape (m, 4), as an array (m, n)."""
    low, high = boxes[:, None, :2] - CLEAR, boxes[:, None, 2:] + CLEAR
    return np.asarray(((points > low) & (points < high)).all(axis=2))


def _dense(lines: Sequence[Array]) -> Array:
    """Return points along lines, shape (n, 2) each, close to each other [points]."""
    points = [np.zeros((0, 2))]
    for corners in lines:
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
        if np.isfinite(along[-1]):
            places = np.linspace(0.0, along[-1], 1 + int(np.ceil(along[-1] / DENSE)))
            points.append(np.stack([np.interp(places, along, corners[:, k]) for k in (0, 1)], axis=1))
    return np.concatenate(points)

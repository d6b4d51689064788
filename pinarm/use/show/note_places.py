"""Places of names in a drawing: beside their points, where they cover least, or farther away with a line to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.records import replace
from pinarm.use.show.chart import Line, Note, Window
from pinarm.use.show.labels import text_width

DISTANCES = np.array([5.0, 11.0, 19.0, 28.0, 38.0, 50.0])
"""From a point to the edge of its name [points]."""

RINGS = slice(0, 2), slice(2, None)
"""Distances that are tried together; the nearest ones are often free."""

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

LINE = 1.15
"""Height of a line of text, relative to the size of the letters."""

DENSE = 2.0
"""Distance of the sample points of lines [points]."""

MOST = 8
"""Sample points that a name may cover."""

ALONG = 26
"""Sample points of a line to a name: of the longest line, one each 2 points of length."""


def note_places(
    notes: Sequence[Note], hidden: Sequence[Line], window: Window, per: float, taken: Sequence[Array] = ()
) -> list[Note]:
    """Return names beside their points, in the window, none over another or over the line to another.

    Those that come first choose first. Lines to names do not cross. A name that has no room, several in a row, is
    shortened to the first of them; where that has none either, it is left out.

    Args:
        notes: The names, at their points.
        hidden: Lines that names should not cover.
        window: What the drawing shows.
        per: Scale of the drawing [points per unit of the axes].
        taken: Boxes where no name may stand (left, bottom, right, top), in units of the axes, each of shape (4,).
    """
    (left, right), (bottom, top) = window
    page, covered = per * np.array([left, bottom, right, top]), np.ascontiguousarray(_dense(hidden, per).T)
    boxes, leading, placed = per * np.array(taken).reshape(-1, 4), np.zeros((0, 2, 2)), list[Note]()
    for note in notes:
        for text in dict.fromkeys([note.text, _shorter(note.text)]):
            size = np.array([text_width(text, note.size), LINE * note.size])
            best = _best(per * np.array([note.x, note.y]), size, covered, boxes, leading, page)
            if best is not None:
                offset, box = best
                placed.append(replace(note, text=text, dx=float(offset[0]), dy=float(offset[1])))
                boxes = np.vstack([boxes, box])
                own = [per * np.stack([line.x, line.y], axis=1) for line in leaders(placed[-1:], per)]
                leading = np.concatenate([leading, np.reshape(own, (-1, 2, 2))])
                break
    return placed


def leaders(notes: Sequence[Note], per: float) -> list[Line]:
    """Return lines from points to the names that stand away from them.

    Args:
        notes: The names, placed.
        per: Scale of the drawing [points per unit of the axes].
    """
    lines = list[Line]()
    for note in notes:
        point, offset = np.array([note.x, note.y]), np.array([note.dx, note.dy])
        nearest = _nearest(offset, np.array([text_width(note.text, note.size), LINE * note.size]))
        if np.linalg.norm(nearest) > BESIDE:
            ends = np.array([point, point + nearest / per])
            lines.append(Line(ends[:, 0], ends[:, 1], LEADER, 0.5))
    return lines


def _shorter(text: str) -> str:
    """Return the first of several names, with a sign that there are more."""
    first, *more = text.split(", ")
    return f"{first}, ..." if more else first


def _nearest(offset: Array, size: Array) -> Array:
    """Return the way from a point to the edge of a name whose middle is so far from it [points], shape (..., 2)."""
    return np.asarray(offset - np.clip(offset, -size / 2.0, size / 2.0))


def _best(
    point: Array, size: Array, covered: Array, boxes: Array, leading: Array, page: Array
) -> tuple[Array, Array] | None:  # fmt: skip
    """Return the offset and the box of a name (left, bottom, right, top) where it covers the fewest points of lines.

    ``covered`` are these points, shape (2, n). ``None`` where it has no room, or covers too much, everywhere.
    """
    offsets = TOWARDS * DISTANCES[:, None, None] + np.sign(TOWARDS) * size / 2.0
    best, least, turns = None, np.inf, len(TOWARDS)
    for rings in RINGS:
        if least <= AWAY * DISTANCES[rings.start]:  # no place that far away costs less
            break
        tried = offsets[rings].reshape(-1, 2)
        names = np.hstack([point + tried - size / 2.0, point + tried + size / 2.0])
        free = np.flatnonzero(_free(point, point + _nearest(tried, size), names, boxes, leading, page))
        hidden = _hidden(names[free], covered)
        away = AWAY * DISTANCES[rings.start + free // turns] + 0.02 * (turns * rings.start + free)
        costs = np.where(hidden <= MOST, hidden + away, np.inf)
        if costs.min(initial=least) < least:
            k = free[costs.argmin()]
            best, least = (tried[k], names[k]), costs.min()
    return best


def _hidden(names: Array, covered: Array) -> Array:
    """Return how many points, shape (2, n), names with these boxes, shape (m, 4), cover, shape (m,)."""
    (left, bottom, right, top), (x, y) = names.T[:, :, None], covered
    inside = (x > left - CLEAR) & (x < right + CLEAR) & (y > bottom - CLEAR) & (y < top + CLEAR)
    return np.asarray(np.count_nonzero(inside, axis=1))


def _free(point: Array, edges: Array, names: Array, boxes: Array, leading: Array, page: Array) -> Flags:
    """Return at which places, shape (n,), a name has room.

    It stays on the page, and neither it nor the line to it covers a box or a line to another name. ``edges`` are those
    of the name next to its point, shape (n, 2), and ``names`` its boxes, shape (n, 4).
    """
    low, high = names[:, None, :2], names[:, None, 2:]
    on_page = ((low >= page[:2]) & (high <= page[2:])).all(axis=(1, 2))
    over = np.any(((boxes[:, :2] < high + CLEAR) & (boxes[:, 2:] > low - CLEAR)).all(axis=2), axis=1)
    free: Flags = np.asarray(on_page & ~over)
    free[free] = ~_meets(leading, names[free]).any(axis=0)
    led = np.flatnonzero(free & (np.linalg.norm(edges - point, axis=1) > BESIDE))
    own = np.stack([np.broadcast_to(point, edges[led].shape), edges[led]], axis=1)
    free[led] = ~(_meets(own, boxes).any(axis=1) | _cross(own, leading).any(axis=1))
    return free


def _meets(lines: Array, boxes: Array) -> Array:
    """Return which lines, shape (m, 2, 2), come into or close to which boxes, shape (n, 4), as an array (m, n)."""
    share = np.linspace(0.0, 1.0, ALONG)[:, None, None]
    points = (lines[:, 0] + share * (lines[:, 1] - lines[:, 0]))[:, :, None]
    inside = (points > boxes[:, :2] - CLEAR) & (points < boxes[:, 2:] + CLEAR)
    return np.asarray(inside.all(axis=3).any(axis=0))


def _cross(lines: Array, others: Array) -> Array:
    """Return which lines, shape (m, 2, 2), cross which others, shape (n, 2, 2), as an array (m, n).

    Those that begin at one point do not.
    """
    return np.asarray((_sides(lines, others) < 0.0) & (_sides(others, lines).T < 0.0))


def _sides(lines: Array, others: Array) -> Array:
    """Return numbers below 0 where the ends of others, n, are on different sides of lines, m, shape (m, n)."""
    way, ends = (lines[:, 1] - lines[:, 0])[:, None, None], others - lines[:, None, None, 0]
    return np.asarray(np.prod(way[..., 0] * ends[..., 1] - way[..., 1] * ends[..., 0], axis=2))


def _dense(lines: Sequence[Line], per: float) -> Array:
    """Return points along lines, close to each other [points], shape (n, 2)."""
    points = [np.zeros((0, 2))]
    for line in lines:
        corners = per * np.stack([np.ravel(line.x), np.ravel(line.y)], axis=1)
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        if np.isfinite(along[-1]):
            places = np.linspace(0.0, along[-1], 1 + int(np.ceil(along[-1] / DENSE)))
            points.append(np.stack([np.interp(places, along, corners[:, k]) for k in (0, 1)], axis=1))
    return np.concatenate(points)

"""Charts as data: stacked panels of lines and texts, which ``figure`` draws.

Texts may hold formulas in TeX, between dollar signs; ``labels`` makes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec.structs import force_setattr

from pinarm.arrays import Array
from pinarm.records import Record, ValueRecord

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's palette."""

WIDTH, HEIGHT, HEAD = 7.0, 1.7, 0.9
"""Inches: of a picture, of a panel, and for heading and horizontal labels."""

FLAT = 1e-9
"""Range, relative to its size, below which a curve is drawn as constant: rounding must not fill the panel."""

NOTHING = 1e-13
"""Size below which a curve is drawn as 0: rounding of terms of a few hundred. Known rounding is already 0; see
``Series.without_rounding``."""

DRAWABLE = 1e300
"""Numbers of this size and above are left out of pictures, as infinite ones are: limits of axes would overflow."""


Style = Literal["-", "--", ":", "-.", ""]
"""Full, dashed, dotted or dash-dotted, as in matplotlib; no line where it is empty."""

Window = tuple[tuple[float, float], tuple[float, float]]
"""Ends of the horizontal and of the vertical axis."""

Marker = Literal["", "o", "s", "x", "mount"]
"""Circle, square or cross, as in matplotlib, or the support of a mechanism; no mark where it is empty."""


class Line(ValueRecord, frozen=True):
    """A line through points, or marks at points, or both; with gaps where a place is not ``drawable``.

    Attributes:
        x: Places along the horizontal axis, shape (n,).
        y: Places along the vertical axis, shape (n,).
        colour: ``#rrggbb``.
        width: Of the line [points].
        style: How it is dashed.
        marker: Mark at its points.
        size: Of the marks [points].
        fill: Colour inside the marks; ``none`` for rings.
        label: Name in the legend; no entry where it is empty.
    """

    x: Array
    y: Array
    colour: str = "#000000"
    width: float = 1.5
    style: Style = "-"
    marker: Marker = ""
    size: float = 4.0
    fill: str = ""
    label: str = ""

    def __post_init__(self) -> None:
        """Leave out numbers that cannot be drawn."""
        for axis in ("x", "y"):
            force_setattr(self, axis, drawable(getattr(self, axis)))


class Note(ValueRecord, frozen=True):
    """A text at a point.

    Attributes:
        x: Place of the point along the horizontal axis.
        y: Place of the point along the vertical axis.
        text: The text.
        dx: From the point to the middle of the text, to the right [points].
        dy: From the point to the middle of the text, upwards [points].
        colour: ``#rrggbb``.
        size: Of the letters [points].
    """

    x: float
    y: float
    text: str
    dx: float = 0.0
    dy: float = 0.0
    colour: str = "#24292f"
    size: float = 8.0


THINNEST = 0.25
"""Least extent of a drawing relative to its largest: links on one line have room for names and ticks."""


class Panel(Record, frozen=True):
    """Lines and texts over one pair of axes.

    Attributes:
        lines: From the back to the front.
        notes: Texts at points.
        title: Small, above its left corner.
        across: Name and unit of the horizontal axis.
        up: Name and unit of the vertical axis; plots have them in the title instead, as long names collide.
        equal: Whether a unit is as long on both axes.
        framed: Whether axes, ticks and grid are drawn.
        margin: Room beside the lines, relative to their extent.
        ticks: Places of the ticks of the horizontal axis; round numbers where it is empty.
        grid: Whether lines run through the picture at the ticks.
        window: Ends of both axes; those of the lines, with the margin, where it is left out.
        logarithmic: Axes with logarithmic scales: none, ``x``, ``y`` or ``xy``.
        marks: Vertical lines: places on the horizontal axis, and a short text above each.
    """

    unshown = ("lines",)

    lines: Sequence[Line]
    notes: Sequence[Note] = ()
    title: str = ""
    across: str = ""
    up: str = ""
    equal: bool = False
    framed: bool = True
    margin: float = 0.01
    ticks: Sequence[float] = ()
    grid: bool = True
    window: Window | None = None
    logarithmic: str = ""
    marks: Sequence[tuple[float, str]] = ()

    def extent(self) -> Window:
        """Return the ends of both axes: the window, or those of the lines, with a margin; see ``limits``."""
        if self.window is not None:
            return self.window
        if self.equal:
            low, high = extent(self.lines)
            largest = float((high - low).max()) or 1.0
            room = self.margin * (high - low) + np.maximum(0.0, THINNEST * largest - (high - low)) / 2.0
            (x0, y0), (x1, y1) = (low - room).tolist(), (high + room).tolist()
            return (x0, x1), (y0, y1)
        across = np.concatenate([np.zeros(0), *(np.ravel(line.x) for line in self.lines)])
        up = np.concatenate([np.zeros(0), *(np.ravel(line.y) for line in self.lines)])
        return limits(across, self.margin), limits(up, 0.06)


class Chart(ValueRecord, frozen=True):
    """Panels below each other, with one horizontal axis.

    Attributes:
        title: Its heading.
        panels: From above.
        width: Of the page [inch].
        height: Of the page [inch].
        legend: Where lines are named: within each panel, or below all.
    """

    title: str
    panels: Sequence[Panel]
    width: float
    height: float
    legend: Literal["inside", "below"] = "inside"


def drawable(values: Array) -> Array:
    """Return values with gaps, NaN, where they are infinite or as large as ``DRAWABLE``."""
    return np.where(np.abs(values) < DRAWABLE, values, np.nan)


def limits(values: Array, margin: float = 0.0) -> tuple[float, float]:
    """Return the ends of an axis: those of the finite values with a margin, or an interval around a constant.

    Values that differ by rounding only are a constant; see ``FLAT`` and ``NOTHING``.
    """
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    size = max(abs(low), abs(high))
    if high - low < FLAT * size or size < NOTHING:
        centre, half = ((low + high) / 2, 0.1 * size) if size >= NOTHING else (0.0, 1.0)
        return centre - half, centre + half
    return low - margin * (high - low), high + margin * (high - low)


def extent(lines: Sequence[Line]) -> tuple[Array, Array]:
    """Return the lower left and the upper right corner of lines, shape (2,)."""
    points = np.concatenate([np.stack([np.ravel(line.x), np.ravel(line.y)], axis=1) for line in lines])
    return np.nanmin(points, axis=0), np.nanmax(points, axis=0)

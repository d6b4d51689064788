"""Charts as SVG, written directly: importing matplotlib would take longer than most runs. Texts stay texts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from pinarm.arrays import Array
from pinarm.records import ValueRecord, replace
from pinarm.use.show.chart import Chart, Line, Note, Panel
from pinarm.use.show.labels import TextRun, runs, text_width

POINTS = 72.0
"""Points per inch, the unit of the pages."""

LETTER = 0.6
"""Mean width of a letter, relative to the size of the letters; digits of DejaVu Sans are that wide."""

TEXT, SMALL, TITLE = 9.0, 8.0, 10.0
"""Sizes of ordinary letters, of legends, and of the heading [points]."""

GAP = 5.0
"""Between texts and what they belong to [points]."""

ROW = 16.0
"""Height of a line of the legend, or of a title [points]."""

SHARP = 0.25
"""Width of the columns in which only the first, least, largest and last point of a curve are drawn [points]."""

DASHES = {"--": "5.5 2.4", ":": "1.5 2.5", "-.": "9.6 2.4 1.5 2.4"}
INK, RULE = "#24292f", "#e3e6ea"
FONT = "DejaVu Sans, Verdana, Helvetica, Arial, sans-serif"
ENTITIES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#x27;"})
"""As ``html.escape`` has them, which takes longer to import than a chart to draw."""

POWERS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class Scale(ValueRecord, frozen=True):
    """How numbers of an axis become places on the page.

    Attributes:
        low: Number at the beginning of the axis.
        high: Number at its end.
        start: Place of the beginning [points].
        end: Place of the end [points].
    """

    low: float
    high: float
    start: float
    end: float

    def at(self, values: Array | float) -> Array:
        """Return places [points]."""
        share = (np.asarray(values) - self.low) / (self.high - self.low)
        return np.asarray(self.start + share * (self.end - self.start))

    def ticks(self, apart: float) -> list[float]:
        """Return round numbers, at least so many points apart."""
        return round_numbers(self.low, self.high, max(2, int(abs(self.end - self.start) / apart)))


def svg(chart: Chart) -> str:
    """Return a chart as an SVG element, which stands in HTML or in a file by itself."""
    width, height = POINTS * chart.width, POINTS * chart.height
    named = [line for panel in chart.panels[:1] for line in panel.lines if line.label]
    below = _below(named, width, height) if chart.legend == "below" else []
    lines = chart.title.split("\n") if chart.title else []
    top = GAP + 1.3 * TITLE * len(lines)
    body = [_text(width / 2, GAP + 1.3 * TITLE * (k + 0.8), text, TITLE, "middle") for k, text in enumerate(lines)]
    bottom = height - (ROW * math.ceil(len(named) / _columns(named, width)) + GAP if below else 0.0)
    for k, (panel, box) in enumerate(_boxes(chart.panels, width, top, bottom)):
        body += _panel(panel, box, last=k == len(chart.panels) - 1, named=chart.legend == "inside")
    head = (f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}pt" height="{height:g}pt" '
            f'viewBox="0 0 {width:g} {height:g}" font-family="{FONT}" fill="{INK}">')  # fmt: skip
    return "\n".join([head, f'<rect width="{width:g}" height="{height:g}" fill="#ffffff"/>', *body, *below, "</svg>\n"])


Box = tuple[float, float, float, float]
"""Left, top, right, bottom [points]."""


def _boxes(panels: Sequence[Panel], width: float, top: float, bottom: float) -> Iterator[tuple[Panel, Box]]:
    """Yield the panels with what is inside of their axes, below each other and equally wide."""
    foot = (ROW + 2 * GAP if panels[-1].framed else GAP) + (ROW - GAP / 2 if panels[-1].across else 0.0)
    each = (bottom - top - foot) / len(panels)
    left = max((_left(panel, each) for panel in panels), default=GAP)
    for k, panel in enumerate(panels):
        head = (ROW if panel.title else GAP) + (GAP if k else 0.0)
        yield panel, (left, top + k * each + head, width - 3 * GAP, top + (k + 1) * each)


def _left(panel: Panel, height: float) -> float:
    """Return the room that the numbers of the vertical axis need."""
    if not panel.framed:
        return 3 * GAP
    low, high = panel.extent()[1]
    texts, _ = tick_texts(Scale(low, high, 0.0, height - ROW).ticks(18.0))
    return 3 * GAP + LETTER * TEXT * max(map(len, texts)) + (ROW if panel.up else 0.0)


def _panel(panel: Panel, box: Box, *, last: bool, named: bool) -> Iterator[str]:
    """Yield the elements of a panel."""
    across, up = _scales(panel, box)
    if panel.framed:
        yield from _axes(panel, box, across, up, last=last)
    for line in panel.lines:
        yield from _line(line, across, up)
    for note in panel.notes:
        yield _note(note, across, up)
    lines = [line for line in panel.lines if line.label]
    if named and lines:
        yield from _legend(panel, lines, box, across, up)


def _scales(panel: Panel, box: Box) -> tuple[Scale, Scale]:
    (x0, x1), (y0, y1) = panel.extent()
    left, top, right, bottom = box
    if panel.equal:
        per = min((right - left) / (x1 - x0), (bottom - top) / (y1 - y0))
        wide, high = (right - left) / per, (bottom - top) / per
        x0, y0 = (x0 + x1 - wide) / 2, (y0 + y1 - high) / 2
        x1, y1 = x0 + wide, y0 + high
    return Scale(x0, x1, left, right), Scale(y0, y1, bottom, top)


def _axes(panel: Panel, box: Box, across: Scale, up: Scale, *, last: bool) -> Iterator[str]:
    """Yield grid, ticks, numbers and names of the axes."""
    left, top, right, bottom = box
    if panel.title:
        yield _text(left, top - GAP, panel.title, TEXT)
    places = list(panel.ticks) or across.ticks(44.0)
    texts, power = tick_texts(places)
    for x, text in zip(across.at(np.array(places)).tolist(), texts, strict=True):
        yield _rule(x, top, x, bottom, RULE) if panel.grid else ""
        yield _rule(x, bottom, x, bottom + 3.0)
        yield _text(x, bottom + 3.0 + TEXT + 1.0, text, TEXT, "middle") if last else ""
    if last:
        tail = f" [{power}]" if power else ""
        yield _text((left + right) / 2, bottom + 2 * ROW - 2.0, panel.across + tail, TEXT, "middle")
    heights = up.ticks(18.0)
    texts, power = tick_texts(heights)
    for y, text in zip(up.at(np.array(heights)).tolist(), texts, strict=True):
        yield _rule(left, y, right, y, RULE) if panel.grid else ""
        yield _rule(left - 3.0, y, left, y)
        yield _text(left - GAP, y + 0.36 * TEXT, text, TEXT, "end")
    if power:
        yield _text(right, top - GAP, power, TEXT, "end")
    if panel.up:
        y = (top + bottom) / 2
        yield f'<g transform="rotate(-90 {TEXT + GAP:g} {y:g})">{_text(TEXT + GAP, y, panel.up, TEXT, "middle")}</g>'
    yield f'<path d="M{left:g} {top:.6g}V{bottom:.6g}H{right:g}" fill="none" stroke="{INK}" stroke-width="0.8"/>'


def _line(line: Line, across: Scale, up: Scale) -> Iterator[str]:
    """Yield a line and its marks."""
    x, y = (np.atleast_1d(np.asarray(scale.at(each), float)) for scale, each in ((across, line.x), (up, line.y)))
    look = f'opacity="{line.opacity:g}"' if line.opacity < 1.0 else ""
    if line.style and len(x) > 1:
        dash = f'stroke-dasharray="{DASHES[line.style]}"' if line.style in DASHES else ""
        yield (f'<path d="{_path(x, y)}" fill="none" stroke="{line.colour}" stroke-width="{line.width:g}" '
               f'stroke-linejoin="round" {dash} {look}/>')  # fmt: skip
    known = np.isfinite(x) & np.isfinite(y)
    for px, py in zip(x[known].tolist(), y[known].tolist(), strict=True) if line.marker else ():
        yield _mark(line, px, py)


def _path(x: Array, y: Array) -> str:
    """Return the commands of a path; of a long curve only what can be seen, gaps where numbers are not finite."""
    if len(x) > 2000 and (np.diff(x) >= 0.0).all():
        rows = _visible(x, y)
        x, y = x[rows], y[rows]
    known, pieces, pen = np.isfinite(x) & np.isfinite(y), [], "M"
    for finite, px, py in zip(known.tolist(), x.tolist(), y.tolist(), strict=True):
        pieces.append(f"{pen}{px:.2f} {py:.2f}" if finite else "")
        pen = "L" if finite else "M"
    return "".join(pieces)


def _visible(x: Array, y: Array) -> Array:
    """Return the rows that a curve over growing x needs: in each narrow column the ends and the extremes."""
    starts = np.flatnonzero(np.diff(np.floor(x / SHARP), prepend=-np.inf))
    rows = {0, len(x) - 1}
    for first, end in zip(starts.tolist(), [*starts[1:].tolist(), len(x)], strict=True):
        part = y[first:end]
        rows |= {first, end - 1, first + int(part.argmin()), first + int(part.argmax())}
    return np.array(sorted(rows))


def _mark(line: Line, x: float, y: float) -> str:
    """Return a mark at a place."""
    r, fill = line.size / 2, line.fill or line.colour
    look = f'fill="{fill}" stroke="{line.colour}" stroke-width="1"'
    if line.marker == "o":
        return f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{r:g}" {look}/>'
    if line.marker == "s":
        return f'<rect x="{x - r:.2f}" y="{y - r:.2f}" width="{2 * r:g}" height="{2 * r:g}" {look}/>'
    if line.marker == "mount":
        return f'<path d="M{x:.2f} {y:.2f}l{-0.67 * r:g} {r:g}h{1.34 * r:g}z" {look}/>'
    return f'<path d="M{x - r:.2f} {y - r:.2f}l{2 * r:g} {2 * r:g}m0 {-2 * r:g}l{-2 * r:g} {2 * r:g}" {look}/>'


def _note(note: Note, across: Scale, up: Scale) -> str:
    x, y = float(across.at(note.x)) + note.dx, float(up.at(note.y)) - note.dy + 0.36 * note.size
    return _text(x, y, note.text, note.size, "middle", note.colour, halo=True)


def _legend(panel: Panel, lines: Sequence[Line], box: Box, across: Scale, up: Scale) -> Iterator[str]:
    """Yield the names of lines, in that corner of the panel where least is drawn."""
    left, top, right, bottom = box
    wide = 26.0 + max(text_width(line.label, SMALL) for line in lines)
    tall = 1.4 * SMALL * len(lines)
    x, y = np.concatenate([_dense(line, across, up) for line in panel.lines], axis=1)
    corners = [(a, b) for a in (right - wide - GAP, left + GAP) for b in (top + GAP, bottom - tall - GAP)]
    covered = [int(((x > a) & (x < a + wide) & (y > b) & (y < b + tall)).sum()) for a, b in corners]
    x0, y0 = corners[int(np.argmin(covered))]
    for k, line in enumerate(lines):
        yield from _entry(line, x0, y0 + 1.4 * SMALL * (k + 0.5))


def _dense(line: Line, across: Scale, up: Scale) -> Array:
    """Return points along a line, or its marks, close to each other on the page [points], shape (2, n)."""
    corners = np.array([np.atleast_1d(across.at(line.x)).ravel(), np.atleast_1d(up.at(line.y)).ravel()])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=1), axis=0))])
    if not line.style or not np.isfinite(along[-1]):
        return corners
    places = np.linspace(0.0, along[-1], 1 + math.ceil(along[-1] / GAP))
    return np.array([np.interp(places, along, row) for row in corners])


def _columns(lines: Sequence[Line], width: float) -> int:
    """Return how many names of lines stand beside each other: two, or one where they are long."""
    return 2 if 2.0 * _entry_width(lines) <= width else 1


def _entry_width(lines: Sequence[Line]) -> float:
    return 34.0 + max((text_width(line.label, SMALL) for line in lines), default=0.0)


def _below(lines: Sequence[Line], width: float, height: float) -> list[str]:
    """Return the names of lines below all panels, two beside each other where there is room."""
    wide = _entry_width(lines)
    elements: list[str] = []
    columns = _columns(lines, width)
    for k, line in enumerate(lines):
        beside = min(columns, len(lines) - k + k % columns)
        x = width / 2 + (k % columns - beside / 2) * wide
        elements += _entry(line, x, height - ROW * (math.ceil(len(lines) / columns) - k // columns) + GAP)
    return elements


def _entry(line: Line, x: float, y: float) -> Iterator[str]:
    flat = Scale(0.0, 1.0, x, x + 20.0), Scale(0.0, 1.0, y, y - 1.0)
    yield from _line(replace(line, x=np.array([0.0, 1.0]), y=np.zeros(2), marker=""), *flat)
    yield _mark(line, x + 10.0, y) if line.marker else ""
    yield _text(x + 26.0, y + 0.36 * SMALL, line.label, SMALL)


def _rule(x0: float, y0: float, x1: float, y1: float, colour: str = INK) -> str:
    return f'<path d="M{x0:.2f} {y0:.2f}L{x1:.2f} {y1:.2f}" stroke="{colour}" stroke-width="0.6"/>'


def _text(
    x: float, y: float, label: str, size: float, anchor: str = "start", colour: str = "", *, halo: bool = False
) -> str:
    """Return a text; a halo keeps it legible over lines."""
    parts = "".join(_run(run, size) for run in runs(label))
    look = f' fill="{colour}"' if colour else ""
    look += ' paint-order="stroke" stroke="#ffffff" stroke-width="2.5" stroke-linejoin="round"' if halo else ""
    return f'<text x="{x:.2f}" y="{y:.2f}" font-size="{size:g}" text-anchor="{anchor}"{look}>{parts}</text>'


def _run(run: TextRun, size: float) -> str:
    legible = (letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in run.text)
    text = "".join(legible).translate(ENTITIES)
    if run.at:
        shift = 0.25 * size * (1.0 if run.at == "sub" else -1.6)
        return f'<tspan dy="{shift:g}" font-size="{0.7 * size:g}">{text}</tspan><tspan dy="{-shift:g}">\u200b</tspan>'
    return f'<tspan font-style="italic">{text}</tspan>' if run.symbol else text


def round_numbers(low: float, high: float, most: int) -> list[float]:
    """Return 1, 2 or 5 times a power of ten and its multiples between two numbers, at most so many and one."""
    step = (high - low) / most
    power = 10.0 ** math.floor(math.log10(step))
    step = next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= step * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def tick_texts(places: Sequence[float]) -> tuple[list[str], str]:
    """Return round numbers with as many digits as they need, and the power of ten that is taken out of them."""
    largest = max((abs(place) for place in places), default=0.0)
    size = math.floor(math.log10(largest)) if largest else 0
    power = size if size > 5 or size < -4 else 0
    step = min((b - a for a, b in pairwise(places)), default=largest or 1.0)
    digits = max(0, power - math.floor(math.log10(step) + 1e-9))
    texts = [f"{place / 10.0**power + 0.0:.{digits}f}".replace("-", "\u2212") for place in places]
    return texts or [""], f"×10{str(power).translate(POWERS)}" if power else ""

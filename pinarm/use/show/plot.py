"""Plots of named quantities: one panel each, over time or a coordinate; for print, safe for colour-blind readers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import cycle, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import ROW
from pinarm.errors import InputError, choices
from pinarm.input.yaml.schema import in_si
from pinarm.records import ValueRecord, replace
from pinarm.use.result.curve_figures import is_figure
from pinarm.use.result.expectation import ERRATA
from pinarm.use.result.presentation import Presentation
from pinarm.use.result.row_lookup import NotReached
from pinarm.use.show.chart import COLOURS, HEAD, HEIGHT, WIDTH, Chart, Line, Panel, Style
from pinarm.use.show.labels import PLAIN, axis_label, plain, shown

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.result.section import Curve, Graph

POINTS: dict[str, Any] = {"style": "", "marker": "o"}
"""Look of separate rows: points that are not joined."""

STYLES: tuple[Style, ...] = ("-", "--", ":", "-.")
"""Dashes of the first curve in a colour, of the second one, and so on."""

ENTRY = 0.23
"""Height of a line of a legend below a graph, of more curves than there are colours [inch]."""

FEW = 12
"""Number of separate rows up to which each has its own tick."""

PER_FILE = 6
"""Quantities in one file."""

WRONG = "#D00000"
"""Colour of published values that are wrong; their marks have another shape too."""

PictureFormat = Literal["svg", "png", "pdf"]
"""Formats of picture files."""

RESOLUTION, COARSEST, FINEST = 200, 20, 1200
"""Pixels per inch of PNG files: usual, least and largest."""


def plot(result: Result, names: tuple[str, ...], *, against: str | None = None) -> Chart:
    """Return the named quantities, each in a panel.

    Args:
        result: The run.
        names: Quantities, symbols or formulas.
        against: The quantity along the horizontal axis; the run's parameter where it is left out.
    """
    run, how = result.trajectory, result.presentation
    along = result[against] if against else result.parameter
    scale, measured = shown(along, how)
    keys, look = answer_key(result, along.name), POINTS if run.numbered else {}
    own_ticks = along.name == ROW and len(run) <= FEW
    panels = []
    for index, name in enumerate(names):
        series = result[name].without_rounding()
        factor, unit = shown(series, how)
        curve = Line(along.values / scale, series.values / factor, COLOURS[index % len(COLOURS)], **look)
        bounds = _bounds(result, curve, name, factor)
        marks = _marks([entry for entry in keys if entry.quantity == name], scale, factor, joined=not look)
        panels.append(Panel(
            (curve, *bounds, *marks), title=axis_label(series.name, unit, how), margin=0.05 if look else 0.01,
            across=axis_label(along.name, measured, how) if index == len(names) - 1 else "",
            ticks=tuple(run.grid.t.tolist()) if own_ticks else (),
        ))  # fmt: skip
    return Chart(plain(result.content.title or result.name), panels, WIDTH, HEAD + HEIGHT * len(names))


def _bounds(result: Result, curve: Line, name: str, factor: float) -> list[Line]:
    """Return the least and greatest values of a quantity that static friction leaves open; none of other quantities."""
    if not result.quantities.open_rows(name).any():
        return []
    least, greatest = (replace(curve, y=bound.values / factor, width=0.8, style="--")
                       for bound in result.quantities.bounds(name))  # fmt: skip
    return [replace(least, label="least and greatest, as several frictions or stops hold one motion"), greatest]


def graph(drawn: Graph, how: Presentation = PLAIN) -> Chart:
    """Return a graph of a section."""
    panels = [_panel(drawn, curves, how) for curves in (drawn.curves, drawn.below) if curves]
    if drawn.below:
        panels = [replace(panels[0], across=""), replace(panels[1], marks=[(place, "") for place, _ in drawn.marks],
                                                         logarithmic=drawn.logarithmic.replace("y", ""))]  # fmt: skip
    height, count = WIDTH * (0.9 if drawn.below else 0.7), len(drawn.curves)
    if count <= len(COLOURS):
        return Chart(plain(drawn.title), panels, WIDTH, height)
    return Chart(plain(drawn.title), panels, WIDTH, height + ENTRY * -(-count // 2), "below")


def graph_named(result: Result, names: Sequence[str]) -> Graph | None:
    """Return the graph of a linear analysis that a name asks for: ``bode``, ``nyquist_theta4``; ``None`` of quantities.

    Raises:
        InputError: Several graphs begin with this name.
    """
    if len(names) != 1 or not result.arrays:
        return None
    graphs = {graph.name: graph for section in result.sections.values() for graph in section.graphs}
    chosen = [names[0]] if names[0] in graphs else [name for name in graphs if name.startswith(f"{names[0]}_")]
    if len(chosen) > 1:
        raise InputError(f"there are several graphs '{names[0]}'", expected=f"one of {', '.join(chosen)}")
    return graphs[chosen[0]] if chosen else None


def _panel(drawn: Graph, curves: Sequence[Curve], how: Presentation) -> Panel:
    """Return a panel of a graph; its axes are named after its first curve."""
    first = curves[0]
    (scale, along), (own, measured) = shown(first.across, how), shown(first.up, how)
    lines = [
        Line(curve.across.values / scale, curve.up.without_rounding().values / own, colour, label=plain(curve.label),
             **(POINTS if curve.points else {"style": style}))
        for curve, (style, colour) in zip(curves, cycle(product(STYLES, COLOURS)))
    ]  # fmt: skip
    return Panel(
        lines, across=axis_label(first.across.name, along, how), up=axis_label(first.up.name, measured, how),
        equal=drawn.equal, margin=0.05, logarithmic=drawn.logarithmic,
        marks=[(place / scale, text) for place, text in drawn.marks],
    )  # fmt: skip


class Printed(ValueRecord, frozen=True):
    """A published value at its place in a plot.

    Attributes:
        quantity: Its quantity.
        x: Where along the plot, in SI; an array over the rows for a published formula.
        y: The value, in SI, likewise.
        verdict: The claim about it, such as a misprint.
    """

    quantity: str
    x: float | Array
    y: float | Array
    verdict: str


def answer_key(result: Result, along: str) -> list[Printed]:
    """Return the published values of a run that can be drawn over its curves: at one row, or formulas over all rows.

    Values at places that the run does not reach are left out, and values that friction leaves open.
    """
    values = []
    for entry in result.content.expect:
        if isinstance(entry.at, str) and result.quantities.open_rows(entry.quantity).any():
            continue  # the extreme is that of one of many shares, and check refuses it
        if entry.published_formula is not None and entry.at == "all":
            figures = np.broadcast_to(result.quantities.figure(entry.published_formula), len(result))
            values.append(Printed(entry.quantity, result[along].values, figures, entry.verdict))
        elif entry.published is not None and not _over_run(entry.at):
            try:
                row = result.lookup.at(entry.at, entry.quantity)
            except NotReached:  # as the notes say
                continue
            printed = in_si(entry.published, row[entry.quantity].unit)
            values.append(Printed(entry.quantity, float(row[along].values[0]), printed, entry.verdict))
    return values


def _over_run(at: str | dict[str, str | int | float]) -> bool:
    return isinstance(at, str) and (at == "all" or is_figure(at))


def _marks(printed: list[Printed], scale: float, own: float, *, joined: bool) -> Iterator[Line]:
    """Yield published values over a curve: circles where they hold, crosses and dashes where they are wrong.

    Formulas are dashes between rows that are ``joined``, and marks at separate rows.
    """
    labelled: set[str] = set()
    for value in printed:
        formula, wrong = isinstance(value.y, np.ndarray), value.verdict in ERRATA
        curve, label = formula and joined, "printed formula" if formula else "published"
        label += f", a {value.verdict.replace('_', ' ')}" if wrong else ""
        yield Line(
            np.atleast_1d(value.x / scale), np.atleast_1d(value.y / own), WRONG if wrong else "#000000", 1.0,
            "--" if curve else "", "" if curve else "x" if wrong else "o", 6.0, "none",
            "" if label in labelled else label,
        )  # fmt: skip
        labelled.add(label)


def charts(result: Result) -> Iterator[tuple[str, Chart]]:
    """Yield the pictures of a run by the names of their files: its outputs, its sections, start and end positions."""
    from pinarm.use.show.sketch import sketch

    outputs = [] if result.arrays else list(dict.fromkeys(result.content.outputs))
    for number, group in enumerate(tuple(outputs[i : i + PER_FILE]) for i in range(0, len(outputs), PER_FILE)):
        own = re.sub(r"[^A-Za-z0-9_.-]+", "_", group[0])[:40]
        yield own if len(group) == 1 else f"outputs_{number + 1}", plot(result, group)
    for section in result.sections.values():
        for drawn in section.graphs:
            yield f"{section.key}_{drawn.name}", graph(drawn, result.presentation)
    yield "positions", sketch(result)


def save_plots(result: Result, folder: Path, form: PictureFormat = "svg", dpi: int = RESOLUTION) -> list[Path]:
    """Write the outputs, six to a picture, graphs, and start and end positions into ``plots/``; return the files."""
    folder = folder / "plots"
    folder.mkdir(exist_ok=True)
    files = []
    for name, chart in charts(result):
        files.append(folder / f"{name}.{form}")
        files[-1].write_bytes(encoded(chart, form, dpi))
    return files


def picture_format(asked: object, dpi: object = RESOLUTION) -> PictureFormat:
    """Return a format of pictures by its name, ``True`` for SVG.

    Raises:
        InputError: There is no such format, or no such resolution.
    """
    for form in get_args(PictureFormat):
        if asked == form or (asked is True and form == "svg"):
            if not isinstance(dpi, int) or not COARSEST <= dpi <= FINEST:
                raise InputError(f"{dpi!r} is no resolution", expected=f"a whole number from {COARSEST} to {FINEST}")
            return cast(PictureFormat, form)
    expected, hint = choices(str(asked), get_args(PictureFormat))
    raise InputError(f"pictures are not written as '{asked}'", expected=expected, hint=hint)


def encoded(chart: Chart, form: str, dpi: int = RESOLUTION) -> bytes:
    """Return the file of a chart: SVG, PNG with so many pixels per inch, or PDF; the same chart gives the same bytes.

    Raises:
        InputError: There is no such format, or resolution.
    """
    from pinarm.use.show.figure import figure

    return figure(chart).encoded(picture_format(form, dpi), dpi)

"""Plots of named quantities: one panel each, over time or a coordinate; for print, safe for colour-blind readers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, product
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import ROW
from pinarm.errors import InputError
from pinarm.input.yaml.schema import in_si
from pinarm.language import document, in_language, said, told
from pinarm.records import ValueRecord
from pinarm.use.result.curve_figures import is_figure
from pinarm.use.result.expectation import ERRATA
from pinarm.use.result.presentation import Presentation
from pinarm.use.result.row_lookup import NotReached
from pinarm.use.show.labels import PLAIN, axis_label, name_label, plain, shown
from pinarm.use.show.picture import (
    COLOURS,
    HEAD,
    HEIGHT,
    MARK,
    WIDTH,
    Picture,
    draw,
    drawing,
    fit,
    label,
    legend,
    legend_below,
    panels,
    write_above,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinarm.use.result.result import Result
    from pinarm.use.result.section import Curve, Graph

POINTS: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 4}
"""Look of separate rows: points that are not joined."""

STYLES = ("-", "--", ":", "-.")
"""Dashes of the first curve in a colour, of the second one, and so on."""

ENTRY = 0.23
"""Height of a line of a legend below a graph, of more curves than there are colours [inch]."""

WHOLE = 200
"""Letters of a name in a legend: more than there are."""

BAR = 0.3
"""Height of a bar with the room around it [inch]."""

FEW = 12
"""Number of separate rows up to which each has its own tick."""

WRONG = "#D00000"
"""Colour of published values that are wrong; their marks have another shape too."""

OPEN = "least and greatest, as several frictions or stops hold one motion"
"""Name of the bounds of a quantity that static friction leaves open."""


@in_language
def plot(result: Result, names: tuple[str, ...], *, against: str | None = None, titled: bool = True) -> Picture:
    """Return a figure of the named quantities, a panel each.

    Args:
        result: The run.
        names: Quantities, symbols or formulas.
        against: The quantity along the horizontal axis; the run's parameter where it is left out.
        titled: Whether the title of the scenario is above it.
    """
    run, how = result.trajectory, result.presentation
    along, units = result[against] if against else result.parameter, [shown(result[name], how)[1] for name in names]
    scale, measured = shown(along, how)
    titles = [axis_label(result[name].name, unit, how) for name, unit in zip(names, units, strict=True)]
    across = axis_label(along.name, measured, how)
    keys, title = answer_key(result, along.name), result.content.title or result.name if titled else ""
    with drawing(WIDTH, HEAD + HEIGHT * len(names), plain(title)) as picture:
        for axis, name, colour in zip(panels(picture, titles, across), names, cycle(COLOURS), strict=False):
            _quantity(axis, result, name, along.values / scale, colour)
            _marks(axis, [key for key in keys if key.quantity == name], scale, shown(result[name], how)[0])
            fit(axis, 0.05 if run.numbered else 0.01)
            legend(axis, axis.lines, loc="best")
            if along.name == ROW and len(run) <= FEW:
                axis.set_xticks(run.grid.t.tolist())
    return picture


def _quantity(axis: Axes, result: Result, name: str, x: Array, colour: str) -> None:
    """Draw a quantity, with its least and greatest values where static friction leaves it open."""
    factor = shown(result[name], result.presentation)[0]
    look = POINTS if result.trajectory.numbered else {}
    draw(axis, x, result[name].without_rounding().values / factor, color=colour, **look)
    if result.quantities.open_rows(name).any():
        for bound, text in zip(result.quantities.bounds(name), (said(OPEN), ""), strict=True):
            thin = {**look, "linewidth": 0.8, "linestyle": "--"}
            draw(axis, x, bound.values / factor, text, color=colour, **thin)


def graph(drawn: Graph, how: Presentation = PLAIN, *, titled: bool = True) -> Picture:
    """Return a graph of a section; of many curves the legend is below it."""
    with document(how.lang):
        return _graph(drawn, how, titled)


def _graph(drawn: Graph, how: Presentation, titled: bool) -> Picture:
    parts, many = [curves for curves in (drawn.curves, drawn.below) if curves], len(drawn.curves) > len(COLOURS)
    across = drawn.curves[0].across
    scale, along = shown(across, how)
    if drawn.bars:
        return _bars(drawn, how, plain(told(drawn.title)) if titled else "")
    height = WIDTH * (0.9 if drawn.below else 0.7) + (ENTRY * -(-len(drawn.curves) // 2) if many else 0.0)
    with drawing(WIDTH, height, plain(told(drawn.title)) if titled else "") as picture:
        axes = panels(picture, [""] * len(parts), axis_label(_named(across.name), along, how))
        for axis, curves in zip(axes, parts, strict=True):
            _curves(axis, curves, how)
            if drawn.equal:
                axis.set_aspect("equal", adjustable="datalim")
            elif drawn.logarithmic:
                _logarithmic(axis, "y" in drawn.logarithmic and curves is drawn.curves, curves[0].across.values)
            else:
                fit(axis, 0.05)
            if not many:
                legend(axis, axis.lines, loc="best")
            places = [place / scale for place, _ in drawn.marks]
            axis.vlines(places, 0.0, 1.0, MARK, "--", linewidth=0.9, zorder=0, transform=axis.get_xaxis_transform())
        write_above(axes[0], [(place / scale, told(text)) for place, text in drawn.marks])
        if many:
            legend_below(picture, axes[0].lines)
    return picture


def _named(name: str) -> str:
    """Return the name of an axis: words in the language of the document, names of quantities as they are."""
    return told(name) if " " in name or name in WORDS else name


WORDS = ("frequency", "phase", "amplitude")
"""Words that axes of graphs have by themselves."""


def _bars(drawn: Graph, how: Presentation, title: str) -> Picture:
    lengths = drawn.curves[0].across
    scale, measured = shown(lengths, how)
    with drawing(WIDTH, HEAD + BAR * len(drawn.bars), title) as picture:
        [axis] = panels(picture, [""], axis_label(_named(lengths.name), measured, how))
        axis.barh(range(len(drawn.bars)), lengths.without_rounding().values / scale, 0.6, color=COLOURS[0])
        axis.set_yticks(range(len(drawn.bars)), [label(plain(name)) for name in drawn.bars])
        axis.grid(visible=False, axis="y")
        axis.invert_yaxis()
    return picture


def _curves(axis: Axes, curves: Sequence[Curve], how: Presentation) -> None:
    """Draw the curves of a panel; its axes are those of its first curve."""
    (scale, _), (factor, measured) = shown(curves[0].across, how), shown(curves[0].up, how)
    axis.set_ylabel(label(axis_label(_named(curves[0].up.name), measured, how)))
    for curve, (style, colour) in zip(curves, cycle(product(STYLES, COLOURS)), strict=False):
        x, y = curve.across.values / scale, curve.up.without_rounding().values / factor
        look = POINTS if curve.points else {"linestyle": style}
        draw(axis, x, y, name_label(told(curve.label), how, WHOLE), color=colour, **look)


SOME_DECADES = 2000.0
"""Ratio of frequencies up to which 2 and 5 have ticks beside 1."""


def _logarithmic(axis: Axes, amplitudes: bool, frequencies: Array) -> None:
    """Set scales: frequencies get plain numbers, phases below them ticks at parts of a turn."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    axis.set_xscale("log")
    if frequencies.max() < SOME_DECADES * frequencies.min():
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.xaxis.set_major_formatter("{x:g}")
    if amplitudes and any(np.any(np.asarray(line.get_ydata()) > 0.0) for line in axis.lines):
        axis.set_yscale("log")
    elif "°" in axis.get_ylabel():
        axis.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 1.5, 3, 4.5, 9, 10]))
    axis.grid(visible=True, which="minor", alpha=0.12)
    axis.margins(x=0.0)


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


class Printed(ValueRecord, frozen=True):
    """A published value at its place in a plot.

    Attributes:
        quantity: Its quantity.
        x: Where along the plot, in SI; an array over the rows for a published formula.
        y: The value, in SI, likewise.
        verdict: The claim about it, such as a misprint.
        joined: Whether it is a formula, over rows that belong together.
    """

    quantity: str
    x: float | Array
    y: float | Array
    verdict: str
    joined: bool = False


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
            joined = not result.trajectory.numbered
            values.append(Printed(entry.quantity, result[along].values, figures, entry.verdict, joined))
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


ERRORS = {"misprint": "a misprint", "model_error": "a model error"}
"""Verdicts on published values that are wrong, in words."""


def _marks(axis: Axes, printed: list[Printed], scale: float, own: float) -> None:
    """Draw published values over a curve: circles where they hold, crosses and dashes where they are wrong.

    Formulas are dashes between rows that are joined, and marks at separate rows.
    """
    labelled: set[str] = set()
    for value in printed:
        wrong, formula = value.verdict in ERRATA, isinstance(value.y, np.ndarray)
        name = said("printed formula") if formula else said("published")
        name += f", {said(ERRORS[value.verdict])}" if wrong else ""
        look = {"linestyle": "--"} if value.joined else {"linestyle": "", "marker": "x" if wrong else "o"}
        look |= {"color": WRONG if wrong else "#000000", "markerfacecolor": "none"}
        x, y = np.atleast_1d(value.x / scale), np.atleast_1d(value.y / own)
        draw(axis, x, y, "" if name in labelled else name, linewidth=1.0, markersize=6.0, **look)
        labelled.add(name)

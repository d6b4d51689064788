"""Plots of named quantities: one axis each, over time or a coordinate; for print, safe for colour-blind readers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pinarm.arrays import Array
from pinarm.engine.trajectory import Series
from pinarm.input.units import Unit
from pinarm.use.expectation import in_si
from pinarm.use.instants import at
from pinarm.use.result import Result

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's palette."""

STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.alpha": 0.3, "grid.linewidth": 0.5, "lines.linewidth": 1.5,
    "text.usetex": False, "axes.formatter.useoffset": False, "svg.fonttype": "none",
    "svg.hashsalt": "pinarm", "savefig.dpi": 150, "figure.constrained_layout.use": True,
}  # fmt: skip

WIDTH, HEIGHT, HEAD = 7.0, 1.7, 0.9
"""Inches: of a figure, of an axis, and for heading and horizontal labels."""

FLAT = 1e-9
"""Range below which a curve is drawn as constant: rounding must not be blown up to the height of the axis."""


def plot(result: Result, names: tuple[str, ...], *, against: str | None = None) -> Figure:
    """Return a figure with the named quantities on stacked axes.

    Args:
        result: The run.
        names: Quantities, symbols or formulas.
        against: The quantity along the horizontal axis; the run's parameter where it is left out.
    """
    run = result.trajectory
    along = result[against or run.parameter]
    scale, measured = shown(along)
    keys = answer_key(result, along.name)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, HEAD + HEIGHT * len(names)))
        FigureCanvasAgg(figure)
        axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for index, (name, axis) in enumerate(zip(names, axes, strict=True)):
            _draw(axis, result[name], along.values / scale, COLOURS[index % len(COLOURS)])
            _mark(axis, result[name], [entry for entry in keys if entry.quantity == name], scale)
        axes[-1].set_xlabel(axis_label(along.name, measured).replace("\n", " "))
        axes[-1].margins(x=0.01)
        figure.align_ylabels()
        figure.suptitle(plain(result.content.title or result.name))
    return figure


def _draw(axis: Axes, series: Series, x: Array, colour: str) -> None:
    scale, measured = shown(series)
    values = series.values / scale
    axis.plot(x, values, color=colour)
    axis.set_ylabel(axis_label(series.name, measured))
    limit(axis, float(values.min()), float(values.max()))


def limit(axis: Axes, low: float, high: float) -> None:
    """Draw values as constant that are so but for rounding."""
    size = max(abs(low), abs(high))
    if high - low < FLAT * size or size < FLAT:
        centre, half = (low + high) / 2 if size >= FLAT else 0.0, 0.1 * size if size >= FLAT else 1.0
        axis.set_ylim(centre - half, centre + half)


@dataclass(frozen=True)
class Printed:
    """A published figure where it belongs.

    Attributes:
        quantity: What it was published of.
        x: Where along the plot, in SI; an array over the rows for a published formula.
        y: The figure, in SI, likewise.
        misprint: Whether it is confirmed to be one.
    """

    quantity: str
    x: float | Array
    y: float | Array
    misprint: bool


def answer_key(result: Result, along: str) -> list[Printed]:
    """Return what was published of a run and can be drawn over its curves: figures at one row, formulas over all."""
    found = []
    for entry in result.content.expect:
        if entry.published_formula is not None and entry.at == "all":
            figures = np.broadcast_to(result.quantities.figure(entry.published_formula), len(result))
            found.append(Printed(entry.quantity, result[along].values, figures, entry.verdict == "misprint"))
        elif entry.published is not None and entry.at != "all":
            row = at(result.quantities, entry.at, entry.quantity)
            printed = in_si(entry.published, row[entry.quantity].unit)
            found.append(Printed(entry.quantity, float(row[along].values[0]), printed, entry.verdict == "misprint"))
    return found


def _mark(axis: Axes, series: Series, printed: list[Printed], scale: float) -> None:
    """Draw published figures over a curve: circles where they hold, crosses and dashes where they are misprints."""
    own, _ = shown(series)
    labelled: set[str] = set()
    for one in printed:
        curve = isinstance(one.y, np.ndarray)
        label = ("printed formula" if curve else "published") + (", a misprint" if one.misprint else "")
        axis.plot(
            one.x / scale, one.y / own, color=WRONG if one.misprint else "black", linewidth=1.0, fillstyle="none",
            linestyle="--" if curve else "none", marker="" if curve else "x" if one.misprint else "o",
            label=None if label in labelled else label,
        )  # fmt: skip
        labelled.add(label)
    if printed:
        axis.legend(fontsize=7, frameon=False, loc="best")


WRONG = "#D00000"
"""Colour of misprints; the shape of their marks tells them apart too."""


def shown(series: Series) -> tuple[float, Unit | None]:
    """Return the factor and unit to draw in: angles in degrees, all else as it is."""
    if series.unit is not None and series.unit.text == "rad":
        return 0.017453292519943295, Unit(0.017453292519943295, (0, 0, 0), "°")
    return 1.0, series.unit


def axis_label(name: str, measured: Unit | None) -> str:
    """Return the label of an axis: a name, and below it the unit."""
    text = str(measured or "?").replace("*", "·").replace("^2", "²").replace("^3", "³")
    short = name if len(name) <= 34 else f"{name[:31]}..."
    return plain(short) if text == "1" else f"{plain(short)}\n[{plain(text)}]"


def plain(text: str) -> str:
    """Return text that matplotlib draws as it stands.

    A dollar sign would begin a formula, and characters that the font has not would be warned about one by one.
    """
    known = _characters()
    drawn = "".join(c if ord(c) in known or c == "\n" else "\N{REPLACEMENT CHARACTER}" for c in text)
    return drawn.replace("\\", "\\\\").replace("$", r"\$") if "$" in drawn else drawn


@cache
def _characters() -> frozenset[int]:
    from matplotlib.font_manager import findfont, get_font

    return frozenset(get_font(findfont("DejaVu Sans")).get_charmap())


def save_plots(result: Result, folder: Path) -> list[Path]:
    """Write all outputs on one page, ``plots.png``, and one picture each in ``plots/``; return the files."""
    folder = folder / "plots"
    folder.mkdir(exist_ok=True)
    outputs = list(dict.fromkeys(result.content.outputs))
    files = []
    for number, group in enumerate(outputs[i : i + 6] for i in range(0, len(outputs), 6)):
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", group[0])[:40] if len(group) == 1 else f"outputs_{number + 1}"
        path = folder / f"{name}.png"
        result.plot(*group).savefig(path, metadata={"Software": None})
        files.append(path)
    return files

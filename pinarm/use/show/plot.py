"""Plots of named quantities: one axis each, over time or a coordinate; for print, safe for colour-blind readers."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from functools import cache
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import ROW
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import in_si
from pinarm.use.result.curve_figures import is_figure
from pinarm.use.result.expectation import ERRATA
from pinarm.use.result.presentation import DEGREE, Presentation
from pinarm.use.result.row_lookup import NotReached

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.result.section import Graph

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's palette."""

PLAIN = Presentation()
"""Of what is drawn without the choice of a scenario."""

STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.alpha": 0.3, "grid.linewidth": 0.5, "lines.linewidth": 1.5,
    "text.usetex": False, "axes.formatter.useoffset": False, "svg.fonttype": "none",
    "svg.hashsalt": "pinarm", "savefig.dpi": 150, "figure.constrained_layout.use": True,
}  # fmt: skip

WIDTH, HEIGHT, HEAD = 7.0, 1.7, 0.9
"""Inches: of a figure, of an axis, and for heading and horizontal labels."""

SCREEN = 100
"""Pixels per inch of an ordinary screen."""

POINTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 4}
"""Look of rows that stand for themselves."""

FEW = 12
"""Rows that stand for themselves and have their own tick."""

FLAT = 1e-9
"""Range below which a curve is drawn as constant: rounding must not be blown up to the height of the axis."""


class Picture(Figure):
    """A figure that a notebook shows, which otherwise asks for pyplot and its settings."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return it as PNG, sharp on fine screens, and the width and height to show it in."""
        width, height = (round(SCREEN * inches) for inches in self.get_size_inches())
        stream = io.BytesIO()
        self.savefig(stream, format="png", dpi=2 * SCREEN, metadata={"Software": None})
        return stream.getvalue(), {"width": width, "height": height}

    def svg(self) -> str:
        """Return it as an SVG element for a page of HTML, its texts as texts, without a heading for files."""
        stream = io.StringIO()
        with matplotlib.rc_context(STYLE):
            self.savefig(stream, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
        return stream.getvalue().partition("<!DOCTYPE")[2].partition(">")[2]


def plot(result: Result, names: tuple[str, ...], *, against: str | None = None) -> Picture:
    """Return a figure with the named quantities on stacked axes.

    Args:
        result: The run.
        names: Quantities, symbols or formulas.
        against: The quantity along the horizontal axis; the run's parameter where it is left out.
    """
    run, how = result.trajectory, result.presentation
    along = result[against] if against else result.parameter
    scale, measured = shown(along, how)
    keys = answer_key(result, along.name)
    with matplotlib.rc_context(STYLE):
        figure = Picture(figsize=(WIDTH, HEAD + HEIGHT * len(names)))
        FigureCanvasAgg(figure)
        axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        look = POINTS if run.numbered else {}
        for index, (name, axis) in enumerate(zip(names, axes, strict=True)):
            _draw(axis, result[name], along.values / scale, {"color": COLOURS[index % len(COLOURS)], **look}, how)
            _mark(axis, result[name], [entry for entry in keys if entry.quantity == name], scale, how)
        axes[-1].set_xlabel(axis_label(along.name, measured, how))
        axes[-1].margins(x=0.05 if look else 0.01)
        if along.name == ROW and len(run) <= FEW:
            axes[-1].set_xticks(run.grid.t)
        figure.suptitle(plain(result.content.title or result.name))
    return figure


def graph(drawn: Graph) -> Picture:
    """Return a graph of a section."""
    (scale, along), (own, measured) = shown(drawn.curves[0].across), shown(drawn.curves[0].up)
    with matplotlib.rc_context(STYLE):
        figure = Picture(figsize=(WIDTH, WIDTH * 0.7))
        FigureCanvasAgg(figure)
        axis = figure.subplots()
        for curve, colour in zip(drawn.curves, cycle(COLOURS)):
            look = POINTS if curve.points else {}
            axis.plot(
                curve.across.values / scale, curve.up.values / own, color=colour, label=plain(curve.label), **look
            )
        axis.set_xlabel(axis_label(drawn.curves[0].across.name, along))
        axis.set_ylabel(axis_label(drawn.curves[0].up.name, measured))
        axis.set_title(plain(drawn.title))
        if any(curve.label for curve in drawn.curves):
            axis.legend(fontsize=8, frameon=False, loc="best")
        if drawn.equal:
            axis.set_aspect("equal", adjustable="datalim")
    return figure


def _draw(axis: Axes, series: Series, x: Array, look: dict[str, Any], how: Presentation) -> None:
    scale, measured = shown(series, how)
    values = series.values / scale
    axis.plot(x, values, **look)
    axis.set_title(axis_label(series.name, measured, how), loc="left", fontsize=9)  # beside it long names collide
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
        verdict: What is claimed of it.
    """

    quantity: str
    x: float | Array
    y: float | Array
    verdict: str


def answer_key(result: Result, along: str) -> list[Printed]:
    """Return what was published of a run and can be drawn over its curves: figures at one row, formulas over all.

    A figure for a place that the run does not come to is left out.
    """
    found = []
    for entry in result.content.expect:
        if entry.published_formula is not None and entry.at == "all":
            figures = np.broadcast_to(result.quantities.figure(entry.published_formula), len(result))
            found.append(Printed(entry.quantity, result[along].values, figures, entry.verdict))
        elif entry.published is not None and not _over_run(entry.at):
            try:
                row = result.lookup.at(entry.at, entry.quantity)
            except NotReached:  # as the notes say
                continue
            printed = in_si(entry.published, row[entry.quantity].unit)
            found.append(Printed(entry.quantity, float(row[along].values[0]), printed, entry.verdict))
    return found


def _over_run(at: str | dict[str, str | int | float]) -> bool:
    """Tell whether an entry is about the whole run, and not about one row."""
    return isinstance(at, str) and (at == "all" or is_figure(at))


def _mark(axis: Axes, series: Series, printed: list[Printed], scale: float, how: Presentation) -> None:
    """Draw published figures over a curve: circles where they hold, crosses and dashes where they are wrong."""
    own, _ = shown(series, how)
    labelled: set[str] = set()
    for one in printed:
        curve, wrong = isinstance(one.y, np.ndarray), one.verdict in ERRATA
        label = "printed formula" if curve else "published"
        label += f", a {one.verdict.replace('_', ' ')}" if wrong else ""
        axis.plot(
            one.x / scale, one.y / own, color=WRONG if wrong else "black", linewidth=1.0, fillstyle="none",
            linestyle="--" if curve else "none", marker="" if curve else "x" if wrong else "o",
            label=None if label in labelled else label,
        )  # fmt: skip
        labelled.add(label)
    if printed:
        axis.legend(fontsize=7, frameon=False, loc="best")


WRONG = "#D00000"
"""Colour of what is wrong in print; the shape of their marks tells them apart too."""


def shown(series: Series, how: Presentation = PLAIN) -> tuple[float, Unit | None]:
    """Return what to divide by, and the unit to draw in, degrees as ``°``."""
    measured = how.unit(series)
    if measured is None or series.unit is None:
        return 1.0, measured
    scale = measured.factor / series.unit.factor
    return scale, Unit(measured.factor, measured.dimension, "°") if measured == DEGREE else measured


def axis_label(name: str, measured: Unit | None, how: Presentation = PLAIN) -> str:
    """Return the label of an axis: a name, or what stands for it, and its unit."""
    text = str(measured or "?").replace("*", "·").replace("^2", "²").replace("^3", "³")
    short = name if len(name) <= LONG else f"{name[: LONG - 3]}..."
    label = _formula(how.labels[name]) if name in how.labels else symbol(short)
    return label if text == "1" else f"{label} [{plain(text)}]"


def _formula(label: str) -> str:
    """Return a label as matplotlib takes it: TeX where it has a backslash.

    Raises:
        InputError: It is no TeX that matplotlib knows.
    """
    if "\\" not in label:
        return plain(label)
    from matplotlib.mathtext import MathTextParser

    formula = f"${label.strip('$')}$"
    try:
        MathTextParser("path").parse(formula)
    except ValueError as error:
        problem = str(error).strip().splitlines()[-1]
        raise InputError(f"the label '{label}' is no formula: {problem}", expected=r"TeX such as \dot\psi") from None
    return formula


LONG = 70
"""Letters of a name that an axis shows."""

_GREEK = "alpha beta gamma delta epsilon theta lambda omega phi psi Delta Theta Omega Phi Psi Gamma Lambda"
_SYMBOL = re.compile(rf"(?P<greek>{_GREEK.replace(' ', '|')})_?(?P<number>\d*)(?P<rate>d{{0,2}})"
                     r"|(?P<letter>[A-Za-z])(_(?P<index>[A-Za-z0-9]+)|(?P<digits>\d+))")  # fmt: skip


def symbol(name: str) -> str:
    """Return a name as publications print it: ``theta21d`` as a Greek letter with dot and index, ``C_B`` with an index.

    Any other name is drawn as it stands.
    """
    found = _SYMBOL.fullmatch(name)
    if found is None:
        return plain(name)
    accent = {0: "", 1: r"\dot", 2: r"\ddot"}[len(found["rate"] or "")]
    letter = found["letter"] or f"\\{found['greek']}"
    letter = f"{accent}{{{letter}}}" if accent else letter
    index = found["number"] or found["index"] or found["digits"]
    return f"${letter}_{{{index}}}$" if index else f"${letter}$"


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
    """Write the outputs, six to a picture, and the start and end positions into ``plots/``; return the files."""
    folder = folder / "plots"
    folder.mkdir(exist_ok=True)
    outputs = list(dict.fromkeys(result.content.outputs))
    files = []
    for number, group in enumerate(outputs[i : i + 6] for i in range(0, len(outputs), 6)):
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", group[0])[:40] if len(group) == 1 else f"outputs_{number + 1}"
        files.append(folder / f"{name}.png")
        result.plot(*group).savefig(files[-1], metadata={"Software": None})
    for section in result.sections.values():
        for drawn in section.graphs:
            files.append(folder / f"{section.key}_{drawn.name}.png")
            graph(drawn).savefig(files[-1], metadata={"Software": None})
    files.append(folder / "positions.png")
    result.sketch().savefig(files[-1], metadata={"Software": None})
    return files

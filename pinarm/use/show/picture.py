"""Pictures by matplotlib: style, texts, limits, files; plots of quantities and graphs of sections, a panel each.

They are for print and safe for colour-blind readers. The same numbers give the same bytes.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, partial
from itertools import cycle, product
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from matplotlib.ticker import FixedFormatter
from numpy.typing import ArrayLike

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import ROW
from pinarm.errors import InputError
from pinarm.input.yaml.schema import in_si
from pinarm.language import document, in_language, said, spoken, told
from pinarm.records import ValueRecord
from pinarm.use.result.curve_figures import is_figure
from pinarm.use.result.expectation import ERRATA, Expectation
from pinarm.use.result.presentation import Presentation
from pinarm.use.result.row_lookup import NotReached
from pinarm.use.show.labels import PLAIN, axis_label, name_label, plain, shown, unicode_label

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.result.section import Curve, Graph

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's palette."""

INK = "#24292f"
"""Colour of axes and texts."""

WIDTH, HEIGHT, HEAD = 7.0, 1.7, 0.9
"""Inches: of a picture, of a panel, and for heading and horizontal labels."""

STYLE: dict[Any, Any] = {
    **{name: value for name, value in matplotlib.rcParamsDefault.items() if "backend" not in name},
    **dict.fromkeys(("xtick.color", "ytick.color", "text.color", "axes.labelcolor", "axes.edgecolor"), INK),
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.formatter.useoffset": False,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.5,
    "lines.solid_capstyle": "round",
    "legend.fontsize": 8,
    "legend.edgecolor": "none",
    "legend.framealpha": 0.7,
    "text.usetex": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "pinarm",
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.08,
}
"""Settings of all pictures; those of the user's matplotlibrc have no effect. Texts of SVG stay texts."""

MARK = "#6a737d"
"""Colour of vertical lines."""

BESIDE = 0.025
"""Distance of two texts of two letters that touch, relative to the width of the picture."""

SCREEN, PRINT = 100, 200
"""Pixels per inch of an ordinary screen, and of the files that are written."""

UNDATED: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "pdf": dict.fromkeys(("CreationDate", "Creator", "Producer")),
    "svg": dict.fromkeys(("Creator", "Date", "Format", "Type")),
}
"""Metadata that files leave out, so that the same picture gives the same bytes."""

FLAT = 1e-9
"""Range, relative to its size, below which a curve is drawn as constant: rounding must not fill the panel."""

NOTHING = 1e-13
"""Size below which a curve is drawn as 0: rounding of terms of a few hundred. Known rounding is already 0; see
``Series.without_rounding``."""

LETTERS = 6.0
"""Letters of a name, per inch of the picture, that leave room for two columns of a legend."""


SIZE = 8.0
"""Size of the letters of names in drawings [points]."""


class Picture(Figure):
    """A figure that a notebook shows without pyplot and its settings."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return it as PNG, sharp on fine screens, and the width and height to show it in."""
        width, height = (round(SCREEN * inches) for inches in self.get_size_inches())
        return self.encoded("png", 2 * SCREEN), {"width": width, "height": height}

    def savefig(self, fname: Any, **options: Any) -> None:
        """Write it to a file; see matplotlib. PNG has 200 pixels per inch where ``dpi`` does not say otherwise."""
        with matplotlib.rc_context(STYLE):
            super().savefig(fname, **{"dpi": PRINT, **options})

    def encoded(self, form: str, dpi: int = PRINT) -> bytes:
        """Return the bytes of a file: ``svg``, ``png`` with so many pixels per inch, or ``pdf``."""
        stream = io.BytesIO()
        self.savefig(stream, format=form, dpi=dpi, metadata=UNDATED[form])
        return stream.getvalue()

    def svg(self) -> str:
        """Return it as an SVG element of a page."""
        text = self.encoded("svg").decode()
        return text[text.index("<svg") :]


@contextmanager
def drawing(width: float, height: float, title: str = "") -> Iterator[Picture]:
    """Yield an empty picture of a size [inch] in the style of all pictures, to be filled; ``title`` is a label."""
    with matplotlib.rc_context(STYLE):
        picture = Picture(figsize=(width, height))
        FigureCanvasAgg(picture)
        yield picture
        picture.suptitle(label(title), fontsize=10)
        _set_decimal_mark(picture)


def _set_decimal_mark(picture: Picture) -> None:
    """Give ticks that are numbers the decimal mark of the language that is written now."""
    for ticks in (ticks for axis in picture.axes for ticks in (axis.xaxis, axis.yaxis)):
        pointed = ticks.get_major_formatter()
        if spoken() != "en" and not isinstance(pointed, FixedFormatter):
            vars(pointed)["format_ticks"] = partial(_with_comma, pointed.format_ticks)


def _with_comma(pointed: Callable[[Any], list[str]], places: Any) -> list[str]:
    return [text.replace(".", ",") for text in pointed(places)]


def panels(picture: Picture, titles: Sequence[str], across: str) -> list[Axes]:
    """Return axes below each other, a small title above each, with one horizontal axis named ``across``.

    Names and units of the vertical axes are in the titles, as long names collide beside the axes.
    """
    axes: list[Axes] = list(picture.subplots(len(titles), 1, sharex=True, squeeze=False)[:, 0])
    for axis, title in zip(axes, titles, strict=True):
        axis.set_title(label(title), loc="left", fontsize=9)
    axes[-1].set_xlabel(label(across))
    return axes


def draw(axis: Axes, x: ArrayLike, y: ArrayLike, name: str = "", **look: Any) -> Line2D:
    """Draw a line, with gaps where numbers are not finite; ``name``, a label, is for the legend."""
    [line] = axis.plot(x, y, label=label(name) or None, **look)
    return line


def fit(axis: Axes, margin: float = 0.01) -> None:
    """Set the limits of both axes to those of the lines with a margin; see ``limits``."""
    axis.margins(x=margin)
    values = [np.ravel(np.asarray(line.get_ydata(), float)) for line in axis.lines]
    axis.set_ylim(*limits(np.concatenate([np.zeros(0), *values]), 0.06))


def legend(place: Axes | Figure, lines: Sequence[Line2D], **options: Any) -> None:
    """Name lines that have names. Without their texts, matplotlib would leave out those that begin with ``_``."""
    named = [line for line in lines if not str(line.get_label()).startswith("_child")]
    if named:
        place.legend(named, [str(line.get_label()) for line in named], **options)


def legend_below(picture: Picture, lines: Sequence[Line2D]) -> None:
    """Name lines below the axes, in two columns, or in one where names are long."""
    longest = max((len(unicode_label(str(line.get_label()))) for line in lines), default=0)
    columns = 2 if longest <= LETTERS * picture.get_figwidth() else 1
    legend(picture, lines, loc="outside lower center", ncols=columns)


class Note(ValueRecord, frozen=True):
    """A name, a label, for a point of the drawing, shape (2,), in a colour."""

    text: str
    at: Array
    colour: str


def write(axis: Axes, note: Note, offset: Sequence[float] = (0.0, 0.0), size: float = SIZE) -> Annotation:
    """Write a name on a light ground, its middle at an offset from its point [points], and return the text."""
    place, ground = (float(note.at[0]), float(note.at[1])), {"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none"}
    text = axis.annotate(
        label(note.text), place, (offset[0], offset[1]), textcoords="offset points", annotation_clip=False,
        color=note.colour, fontsize=size, ha="center", va="center", bbox={**ground, "alpha": 0.7},
    )  # fmt: skip
    text.set_in_layout(False)
    return text


def write_above(axis: Axes, marks: Iterable[tuple[float, str]]) -> None:
    """Write short texts above places of the horizontal axis; texts that would touch are one, at the first place."""
    look: dict[str, Any] = {"fontsize": 7, "color": MARK, "ha": "center", "va": "bottom"}
    apart, last = axis.get_window_extent().width * BESIDE, -np.inf
    written = list[Any]()
    for x, text in sorted(mark for mark in marks if mark[1]):
        pixel = axis.transData.transform((x, axis.get_ylim()[1]))[0]
        if pixel - last < apart:
            written[-1].set_text(f"{written[-1].get_text()}, {text}")
        else:
            place: Any = (x, 1.0)
            written.append(axis.annotate(text, place, (0, 2), axis.get_xaxis_transform(), "offset points", **look))
        last = pixel


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


def label(text: str) -> str:
    """Return a label for matplotlib.

    A character that its font lacks becomes one mark; a formula that it cannot read is written by its characters.
    """
    known = _characters()
    drawn = "".join(c if ord(c) in known or c == "\n" else "\N{REPLACEMENT CHARACTER}" for c in text)
    return drawn if "$" not in drawn or _is_readable(drawn) else plain(unicode_label(drawn))


def _is_readable(drawn: str) -> bool:
    from matplotlib.mathtext import MathTextParser

    try:
        MathTextParser("path").parse(drawn)
    except (ValueError, RecursionError):  # no TeX, or nested too deeply
        return False
    return True


@cache
def _characters() -> frozenset[int]:
    from matplotlib.font_manager import findfont, get_font

    return frozenset(get_font(findfont("DejaVu Sans")).get_charmap())


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

FEW_TICKS = 12
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
    title = result.content.title or result.name if titled else ""
    with drawing(WIDTH, HEAD + HEIGHT * len(names), plain(title)) as picture:
        for axis, name, colour in zip(panels(picture, titles, across), names, cycle(COLOURS), strict=False):
            _quantity(axis, result, name, along.values / scale, colour)
            _draw_published(axis, result, name, along.name, scale)
            fit(axis, 0.05 if run.numbered else 0.01)
            legend(axis, axis.lines, loc="best")
            if along.name == ROW and len(run) <= FEW_TICKS:
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
    axis.xaxis.set_minor_formatter("")
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


ERRORS = {"misprint": "a misprint", "model_error": "a model error"}
"""Verdicts on published values that are wrong, in words."""


def _draw_published(axis: Axes, result: Result, quantity: str, along: str, scale: float) -> None:
    """Draw published values over a curve: circles where they hold, crosses and dashes where they are wrong.

    Formulas are dashes between rows that are joined, and marks at separate rows.
    """
    own, labelled = shown(result[quantity], result.presentation)[0], set[str]()
    for entry in result.content.expect:
        formula = entry.published_formula is not None and entry.at == "all"
        if entry.quantity != quantity or (points := _published(result, entry, along)) is None:
            continue
        wrong = entry.verdict in ERRATA
        name = said("printed formula") if formula else said("published")
        name += f", {said(ERRORS[entry.verdict])}" if wrong else ""
        joined = formula and not result.trajectory.numbered
        look = {"linestyle": "--"} if joined else {"linestyle": "", "marker": "x" if wrong else "o"}
        look |= {"color": WRONG if wrong else "#000000", "markerfacecolor": "none"}
        x, y = np.broadcast_arrays(*points)
        draw(axis, x / scale, y / own, "" if name in labelled else name, linewidth=1.0, markersize=6.0, **look)
        labelled.add(name)


def _published(result: Result, entry: Expectation, along: str) -> tuple[Array, ArrayLike] | None:
    """Return places and published values [SI]: one row, or all rows of a formula; ``None`` where none can be drawn.

    Those are values at places that the run does not reach, over the whole run, and extremes that friction leaves open.
    """
    if isinstance(entry.at, str) and result.quantities.open_rows(entry.quantity).any():
        return None  # the extreme is that of one of many shares, and check refuses it
    if entry.published_formula is not None and entry.at == "all":
        return result[along].values, result.quantities.figure(entry.published_formula)
    if entry.published is None or (isinstance(entry.at, str) and (entry.at == "all" or is_figure(entry.at))):
        return None
    with suppress(NotReached):  # as the notes say
        row = result.lookup.at(entry.at, entry.quantity)
        return row[along].values, in_si(entry.published, row[entry.quantity].unit)
    return None

"""Pictures by matplotlib: their style, texts, limits and files. The same numbers give the same bytes."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from matplotlib.ticker import FixedFormatter, Formatter
from numpy.typing import ArrayLike

from pinarm.arrays import Array
from pinarm.language import spoken
from pinarm.records import ValueRecord
from pinarm.use.show.labels import plain, unicode_label

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


class _Comma(Formatter):
    """Numbers of another formatter, with a decimal comma."""

    def __init__(self, pointed: Formatter) -> None:
        self.pointed = pointed

    def __call__(self, x: float, pos: int | None = None) -> str:
        return str(self.pointed(x, pos)).replace(".", ",")

    def set_locs(self, locs: Any) -> None:
        self.pointed.set_locs(locs)

    def get_offset(self) -> str:
        return str(self.pointed.get_offset())


def _set_decimal_mark(picture: Picture) -> None:
    """Give ticks that are numbers the decimal mark of the language that is written now."""
    for ticks in (ticks for axis in picture.axes for ticks in (axis.xaxis, axis.yaxis)):
        pointed = ticks.get_major_formatter()
        if spoken() != "en" and not isinstance(pointed, FixedFormatter):
            ticks.set_major_formatter(_Comma(pointed))


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
    """Draw a line with gaps where numbers are not ``drawable``; ``name``, a label, is for the legend."""
    [line] = axis.plot(drawable(x), drawable(y), label=label(name) or None, **look)
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


def drawable(values: ArrayLike) -> Array:
    """Return values with gaps, NaN, where they are infinite."""
    values = np.asarray(values, float)
    return np.where(np.isfinite(values), values, np.nan)


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

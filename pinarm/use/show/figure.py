"""Charts drawn by matplotlib: for files, reports and notebooks. The same chart gives the same bytes."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from contextlib import AbstractContextManager, suppress
from functools import cache
from typing import Any

import numpy as np

from pinarm.use.show.chart import Chart, Line, Note, Panel, limits
from pinarm.use.show.labels import plain, text_width, unicode_label

# matplotlib refuses to be imported where this variable names no backend. Figures here have canvases of their own.
_backend = os.environ.pop("MPLBACKEND", None)
import matplotlib  # noqa: E402

if _backend is not None:
    os.environ["MPLBACKEND"] = _backend
    with suppress(ValueError):
        matplotlib.rcParams["backend"] = _backend

from matplotlib.axes import Axes  # noqa: E402
from matplotlib.backend_bases import RendererBase  # noqa: E402
from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402
from matplotlib.text import Annotation  # noqa: E402
from matplotlib.ticker import MaxNLocator  # noqa: E402

INK = "#24292f"
"""Colour of axes and texts."""

STYLE: dict[Any, Any] = {
    **{name: value for name, value in matplotlib.rcParamsDefault.items() if "backend" not in name},
    "font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.alpha": 0.3, "grid.linewidth": 0.5, "lines.linewidth": 1.5,
    "text.usetex": False, "axes.formatter.useoffset": False, "svg.fonttype": "none",
    "svg.hashsalt": "pinarm", "figure.constrained_layout.use": True, "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.08, "xtick.color": INK, "ytick.color": INK, "text.color": INK,
    "axes.labelcolor": INK, "axes.edgecolor": INK,
    "legend.fontsize": 8, "legend.edgecolor": "none", "legend.framealpha": 0.7,
}  # fmt: skip
"""Settings of all pictures; those of the user's matplotlibrc have no effect. Texts of SVG stay texts."""

MARK = "#6a737d"
"""Colour of vertical lines."""

EQUAL_TICKS = 6
"""Ticks at most of the horizontal axis where a unit is as long on both axes: it may be short."""

SCREEN, PRINT = 100, 200
"""Pixels per inch of an ordinary screen, and of the files that are written."""

UNDATED: dict[str, dict[str, None]] = {
    "png": {"Software": None}, "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "svg": dict.fromkeys(("Creator", "Date", "Format", "Type")),
}  # fmt: skip
"""Metadata that files leave out, so that the same picture gives the same bytes."""

MOUNT = ((0.0, 0.0), (-0.8, -1.2), (0.8, -1.2), (0.0, 0.0))
"""Support of a joint on the ground, in the size of its mark."""

SAMPLE = 34.0
"""Width of a line, and the gaps around it, before its name in a legend [points]."""

HALO = 2.5
"""Width of the white outline around names in a drawing [points]."""


class Picture(Figure):
    """A figure that a notebook shows without pyplot and its settings."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return it as PNG, sharp on fine screens, and the width and height to show it in."""
        width, height = (round(SCREEN * inches) for inches in self.get_size_inches())
        return self.encoded("png", 2 * SCREEN), {"width": width, "height": height}

    def savefig(self, fname: Any, **options: Any) -> None:
        """Write it to a file; see matplotlib. PNG has 200 pixels per inch where ``dpi`` does not say otherwise."""
        with style():
            super().savefig(fname, **{"dpi": PRINT, **options})

    def encoded(self, form: str, dpi: int = PRINT) -> bytes:
        """Return the bytes of a file: ``svg``, ``png`` with so many pixels per inch, or ``pdf``."""
        stream = io.BytesIO()
        self.savefig(stream, format=form, dpi=dpi, metadata=UNDATED[form])
        return stream.getvalue()


class HaloText(Annotation):
    """A text with a white outline. SVG keeps it as a text: path effects of matplotlib alone would make it a path."""

    def draw(self, renderer: RendererBase) -> None:
        """Draw the outline, then the text."""
        from matplotlib.patheffects import AbstractPathEffect, Stroke

        outline: list[AbstractPathEffect] = [Stroke(linewidth=HALO, foreground="white")]
        for effects in (outline, []):
            self.set_path_effects(effects)
            super().draw(renderer)


def style() -> AbstractContextManager[None]:
    """Return the context in which figures are made, filled and written."""
    return matplotlib.rc_context(STYLE)


def new(width: float, height: float) -> Picture:
    """Return an empty picture of a size [inch]; fill it within ``style()``."""
    with style():
        picture = Picture(figsize=(width, height))
        FigureCanvasAgg(picture)
    return picture


def figure(chart: Chart) -> Picture:
    """Return a chart as a figure."""
    picture = new(chart.width, chart.height)
    with style():
        axes = picture.subplots(len(chart.panels), 1, sharex=True, squeeze=False)[:, 0]
        for panel, axis in zip(chart.panels, axes, strict=True):
            _panel(axis, panel, last=axis is axes[-1])
        named = [[line for line, given in zip(axis.lines, panel.lines, strict=True) if given.label]
                 for panel, axis in zip(chart.panels, axes, strict=True)]  # fmt: skip
        if chart.legend == "inside":
            for axis, lines in zip(axes, named, strict=True):
                _legend(axis, lines, loc="best")
        else:
            _legend(picture, named[0], loc="outside lower center", ncols=_columns(named[0], chart.width))
        picture.suptitle(label(chart.title), fontsize=10)
    return picture


def _legend(place: Axes | Figure, lines: Sequence[Line2D], **options: Any) -> None:
    """Name lines; without their texts, matplotlib would leave out names that begin with an underscore."""
    if lines:
        place.legend(lines, [str(line.get_label()) for line in lines], **options)


def _columns(lines: Sequence[Line2D], width: float) -> int:
    """Return the columns of a legend below the panels: two, or one where its names are long."""
    widest = max((text_width(str(line.get_label()), 8.0) for line in lines), default=0.0)
    return 2 if 2.0 * (widest + SAMPLE) <= 72.0 * width else 1


def svg(chart: Chart) -> str:
    """Return a chart as an SVG element of a page."""
    text = figure(chart).encoded("svg").decode()
    return text[text.index("<svg") :]


def _panel(axis: Axes, panel: Panel, *, last: bool) -> None:
    for line in panel.lines:
        _line(axis, line)
    for note in panel.notes:
        _note(axis, note)
    if panel.marks:
        _marks(axis, panel)
    if panel.equal:
        axis.set_xlim(*panel.extent()[0])
        axis.set_ylim(*panel.extent()[1])
        axis.set_aspect("equal", adjustable="box")
        if panel.framed:
            axis.xaxis.set_major_locator(MaxNLocator(EQUAL_TICKS))
    elif panel.logarithmic:
        _logarithmic(axis, panel)
    else:
        axis.margins(x=panel.margin)
        axis.set_ylim(*panel.extent()[1])
    axis.grid(visible=panel.grid)
    if panel.title:
        axis.set_title(label(panel.title), loc="left", fontsize=9)
    if last:
        axis.set_xlabel(label(panel.across))
    axis.set_ylabel(label(panel.up))
    if panel.ticks:
        axis.set_xticks(list(panel.ticks))
    if not panel.framed:
        axis.set_axis_off()


def _logarithmic(axis: Axes, panel: Panel) -> None:
    """Set scales: frequencies get plain numbers, phases below them ticks at parts of a turn."""
    for name in ("x", "y"):
        if name in panel.logarithmic:
            getattr(axis, f"set_{name}scale")("log")
    axis.xaxis.set_major_formatter("{x:g}")
    if "°" in panel.up and "y" not in panel.logarithmic:
        axis.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 1.5, 3, 4.5, 9, 10]))
    axis.grid(visible=True, which="minor", alpha=0.12)
    axis.margins(x=0.0)


def _marks(axis: Axes, panel: Panel) -> None:
    """Draw vertical lines, and their texts above the panel."""
    places = [place for place, _ in panel.marks]
    axis.vlines(places, 0.0, 1.0, MARK, "--", linewidth=0.9, zorder=0, transform=axis.get_xaxis_transform())
    for place, text in panel.marks:
        axis.annotate(text, (place, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2), fontsize=7, color=MARK,
                      textcoords="offset points", ha="center", va="bottom")  # fmt: skip


def _line(axis: Axes, line: Line) -> None:
    marker: Any = MOUNT if line.marker == "mount" else line.marker
    axis.plot(
        line.x, line.y, color=line.colour, linewidth=line.width, linestyle=line.style or "none", marker=marker,
        markersize=line.size, markerfacecolor=line.fill or line.colour,
        label=label(line.label) or None, solid_capstyle="round",
    )  # fmt: skip


def _note(axis: Axes, note: Note) -> None:
    name = HaloText(
        label(note.text), (note.x, note.y), (note.dx, note.dy), textcoords="offset points", color=note.colour,
        fontsize=note.size, ha="center", va="center", annotation_clip=False,
    )  # fmt: skip
    name.set_in_layout(False)
    axis.add_artist(name)


def label(text: str) -> str:
    """Return a label of a chart for matplotlib.

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


def limit(axis: Axes, low: float, high: float) -> None:
    """Draw values as constant where they differ by rounding only."""
    flat = limits(np.array([low, high]))
    if flat != (low, high):
        axis.set_ylim(*flat)

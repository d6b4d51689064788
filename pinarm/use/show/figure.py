"""Charts as figures of matplotlib: for notebooks, for PNG and PDF, and to go on working with."""

from __future__ import annotations

import io
from functools import cache
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pinarm.errors import InputError
from pinarm.use.show.chart import Chart, Line, Note, Panel, limits

STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.alpha": 0.3, "grid.linewidth": 0.5, "lines.linewidth": 1.5,
    "text.usetex": False, "axes.formatter.useoffset": False, "svg.fonttype": "none",
    "svg.hashsalt": "pinarm", "figure.constrained_layout.use": True,
}  # fmt: skip

SCREEN, PRINT = 100, 200
"""Pixels per inch of an ordinary screen, and of the files that are written."""

UNDATED: dict[str, dict[str, None]] = {
    "png": {"Software": None}, "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "svg": dict.fromkeys(("Creator", "Date", "Format", "Type")),
}  # fmt: skip
"""What files do not tell, so that the same picture gives the same bytes."""

MOUNT = ((0.0, 0.0), (-0.8, -1.2), (0.8, -1.2), (0.0, 0.0))
"""What a joint stands on that does not move, in the size of its mark."""


class Picture(Figure):
    """A figure that a notebook shows, which otherwise asks for pyplot and its settings."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return it as PNG, sharp on fine screens, and the width and height to show it in."""
        width, height = (round(SCREEN * inches) for inches in self.get_size_inches())
        stream = io.BytesIO()
        self.savefig(stream, format="png", dpi=2 * SCREEN, metadata={"Software": None})
        return stream.getvalue(), {"width": width, "height": height}

    def savefig(self, fname: Any, **options: Any) -> None:
        """Write it to a file; see matplotlib. PNG has 200 pixels per inch where ``dpi`` does not say otherwise."""
        with matplotlib.rc_context(STYLE):
            super().savefig(fname, **{"dpi": PRINT, **options})


def new(width: float, height: float) -> Picture:
    """Return an empty picture of a size [inch]; what is drawn in it needs ``STYLE``."""
    with matplotlib.rc_context(STYLE):
        made = Picture(figsize=(width, height))
        FigureCanvasAgg(made)
    return made


def figure(chart: Chart) -> Picture:
    """Return a chart as a figure.

    Raises:
        InputError: A label is no TeX that matplotlib knows.
    """
    made = new(chart.width, chart.height)
    with matplotlib.rc_context(STYLE):
        axes = made.subplots(len(chart.panels), 1, sharex=True, squeeze=False)[:, 0]
        for panel, axis in zip(chart.panels, axes, strict=True):
            _panel(axis, panel, last=axis is axes[-1])
            if chart.legend == "inside" and any(line.label for line in panel.lines):
                axis.legend(fontsize=8, frameon=False, loc="best")
        if chart.legend == "below" and any(line.label for line in chart.panels[0].lines):
            made.legend(fontsize=8, frameon=False, loc="outside lower center", ncols=2)
        made.suptitle(label(chart.title), fontsize=10)
    return made


def _panel(axis: Axes, panel: Panel, *, last: bool) -> None:
    for line in panel.lines:
        _line(axis, line)
    for note in panel.notes:
        _note(axis, note)
    if panel.equal:
        axis.set_xlim(*panel.extent()[0])
        axis.set_ylim(*panel.extent()[1])
        axis.set_aspect("equal", adjustable="box")
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


def _line(axis: Axes, line: Line) -> None:
    marker: Any = MOUNT if line.marker == "mount" else line.marker
    axis.plot(
        line.x, line.y, color=line.colour, linewidth=line.width, linestyle=line.style or "none", marker=marker,
        markersize=line.size, markerfacecolor=line.fill or line.colour, alpha=line.opacity,
        label=label(line.label) or None, solid_capstyle="round",
    )  # fmt: skip


def _note(axis: Axes, note: Note) -> None:
    from matplotlib.patheffects import withStroke

    axis.annotate(
        label(note.text), (note.x, note.y), (note.dx, note.dy), textcoords="offset points", color=note.colour,
        fontsize=note.size, ha="center", va="center", annotation_clip=False,
        path_effects=[withStroke(linewidth=2.5, foreground="white")],
    ).set_in_layout(False)  # fmt: skip


def label(text: str) -> str:
    """Return a label of a chart as matplotlib draws it; what its font has not is drawn as one mark.

    Raises:
        InputError: A formula in it is no TeX that matplotlib knows.
    """
    known = _characters()
    drawn = "".join(c if ord(c) in known or c == "\n" else "\N{REPLACEMENT CHARACTER}" for c in text)
    if "$" in drawn:
        _check(drawn)
    return drawn


def _check(drawn: str) -> None:
    from matplotlib.mathtext import MathTextParser

    try:
        MathTextParser("path").parse(drawn)
    except ValueError as error:
        problem = str(error).strip().splitlines()[-1]
        raise InputError(f"the label '{drawn}' is no formula: {problem}", expected=r"TeX such as \dot\psi") from None


@cache
def _characters() -> frozenset[int]:
    from matplotlib.font_manager import findfont, get_font

    return frozenset(get_font(findfont("DejaVu Sans")).get_charmap())


def limit(axis: Axes, low: float, high: float) -> None:
    """Draw values as constant that are so but for rounding."""
    import numpy as np

    flat = limits(np.array([low, high]))
    if flat != (low, high):
        axis.set_ylim(*flat)

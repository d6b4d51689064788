"""Plots of a sweep: curves over what was varied, a map over two numbers, or how often which value came out."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.use.study.sweep.axes import Axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinarm.use.show.figure import Picture
    from pinarm.use.show.plot import PictureFormat
    from pinarm.use.study.sweep.sweep import Sweep

FAMILY = 6
"""Curves in one picture; a longer family is drawn as a map."""
PICTURES = 24
"""Columns that are drawn of themselves."""

Draw = Callable[["Axes", "Sweep", Series], None]


def plot(sweep: Sweep, series: Series) -> Picture:
    """Return a picture of one column of a sweep.

    Over one list or grid it is a curve, over two a family of curves or, where both are long, a map. Of cases that were
    drawn by chance, or that vary in more ways, it is a histogram with the median and the middle 90 %.
    """
    from pinarm.use.show.figure import label, new, style
    from pinarm.use.show.labels import plain

    figure = new(7.0, 4.2)
    with style():
        axis = figure.subplots()
        _kind(sweep)(axis, sweep, series)
        failed = f" ({len(sweep.errors)} of {len(sweep)} cases failed)" if sweep.errors else ""
        figure.suptitle(label(plain(f"{sweep.title or sweep.name}{failed}")))
    return figure


def _kind(sweep: Sweep) -> Draw:
    axes = sweep.cases.axes
    simple = all(len(axis.columns) == 1 and not axis.drawn for axis in axes)
    if simple and len(axes) == 1:
        return _family
    if simple and len(axes) == 2:
        numeric = all(axis.columns[0].is_numeric for axis in axes)
        return _map if numeric and min(map(len, axes)) > FAMILY else _family
    return _histogram


def _family(axis: Axes, sweep: Sweep, series: Series) -> None:
    """Draw curves over the longer axis, one for each value of the other."""
    from pinarm.use.show.chart import COLOURS, drawable
    from pinarm.use.show.figure import label, limit
    from pinarm.use.show.labels import axis_label, plain, shown

    along, other, values = _grid(sweep, series)
    scale, measured = shown(series, sweep.presentation)
    x, lost, values = _ticks(axis.xaxis, along), np.isnan(values).any(axis=0), drawable(values / scale)
    for k, row in enumerate(values):
        name = _value(other, k) if other else None
        few = "o" if len(x) <= 60 else None
        axis.plot(
            x,
            row,
            color=COLOURS[k % len(COLOURS)],
            marker=few,
            markersize=3,
            label=label(plain(name)) if name else None,
        )
    axis.vlines(x[lost], 0.0, 1.0, color="0.85", linewidth=3, zorder=0, transform=axis.get_xaxis_transform())
    axis.set_xlabel(_named(along))
    axis.set_ylabel(label(axis_label(series.name, measured, sweep.presentation)))
    if np.isfinite(values).any():
        limit(axis, float(np.nanmin(values)), float(np.nanmax(values)))
    if other:
        axis.legend(title=label(plain(other.columns[0].path)), fontsize=8, title_fontsize=8)


def _map(axis: Axes, sweep: Sweep, series: Series) -> None:
    """Draw the values over two numbers, a cell for each case; those that failed stay grey."""
    from pinarm.use.show.chart import drawable
    from pinarm.use.show.figure import label
    from pinarm.use.show.labels import axis_label, shown

    along, other, values = _grid(sweep, series)
    assert other is not None
    scale, measured = shown(series, sweep.presentation)
    x, y = _ticks(axis.xaxis, along), _ticks(axis.yaxis, other)
    columns, rows = np.argsort(x), np.argsort(y)
    x, y, values = x[columns], y[rows], drawable(values[np.ix_(rows, columns)] / scale)
    mesh = axis.pcolormesh(x, y, np.ma.masked_invalid(values), shading="nearest", cmap="viridis", rasterized=True)
    if np.isfinite(values).all() and np.ptp(values) > 0.0:
        axis.clabel(axis.contour(x, y, values, colors="white", linewidths=0.6), fontsize=7)
    axis.set_facecolor("0.85")
    axis.grid(visible=False)
    axis.set_xlabel(_named(along))
    axis.set_ylabel(_named(other))
    axis.figure.colorbar(mesh, ax=axis, label=label(axis_label(series.name, measured, sweep.presentation)))


def _histogram(axis: Axes, sweep: Sweep, series: Series) -> None:
    """Draw how often which value came out."""
    from pinarm.use.show.chart import COLOURS, drawable
    from pinarm.use.show.figure import label
    from pinarm.use.show.labels import axis_label, shown

    scale, measured = shown(series, sweep.presentation)
    values = drawable(series.values / scale)
    values = values[np.isfinite(values)]
    axis.set_xlabel(label(axis_label(series.name, measured, sweep.presentation)))
    axis.set_ylabel("cases")
    if not len(values):
        return
    axis.hist(values, bins="auto", color=COLOURS[5], edgecolor="white", linewidth=0.5)
    for share, style, name in ((0.05, ":", "middle 90 %"), (0.5, "-", "median"), (0.95, ":", None)):
        axis.axvline(float(np.quantile(values, share)), color=COLOURS[1], linestyle=style, label=name)
    axis.legend(fontsize=8, frameon=False)


def _grid(sweep: Sweep, series: Series) -> tuple[Axis, Axis | None, Array]:
    """Return the longer axis, the other, and the values of a column, shape (other, longer)."""
    axes = sweep.cases.axes
    if len(axes) == 1:
        return axes[0], None, series.values[None, :]
    values = series.values.reshape(len(axes[0]), len(axes[1]))
    words = [not axis.columns[0].is_numeric for axis in axes]
    if words[1] or (len(axes[0]) > len(axes[1]) and not words[0]):
        return axes[0], axes[1], values.T
    return axes[1], axes[0], values


def _ticks(direction: Any, axis: Axis) -> Array:
    """Return the places of an axis's values; words stand side by side."""
    from pinarm.use.show.chart import drawable
    from pinarm.use.show.figure import label
    from pinarm.use.show.labels import plain

    column = axis.columns[0]
    if column.is_numeric:
        return drawable(np.array(column.values, float))
    direction.set_ticks(range(len(axis)), [label(plain(str(value))) for value in column.values])
    return np.arange(len(axis), dtype=float)


def _value(axis: Axis, row: int) -> str:
    column = axis.columns[0]
    return f"{column.values[row]:g} {column.unit}".rstrip() if column.is_numeric else str(column.values[row])


def _named(axis: Axis) -> str:
    from pinarm.use.show.figure import label
    from pinarm.use.show.labels import axis_label

    column = axis.columns[0]
    return label(axis_label(column.path, unit(column.unit or "1")))


def save_plots(sweep: Sweep, folder: Path, form: PictureFormat, dpi: int) -> list[Path]:
    """Write a picture for every result into ``plots/``; return the files."""
    folder = folder / "plots"
    folder.mkdir(exist_ok=True)
    files = []
    for number, series in enumerate(sweep.results()[:PICTURES], 1):
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", series.name).strip("_")[:40]
        files.append(folder / f"{number:02d}_{name}.{form}")
        files[-1].write_bytes(plot(sweep, series).encoded(form, dpi))
    return files

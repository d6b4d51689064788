"""Plots of a sweep: curves over what was varied, a map over two numbers, or how often which value came out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.input.units import HERTZ, unit
from pinarm.input.yaml.document import argument_of
from pinarm.language import decimals, in_language, said
from pinarm.use.show.labels import axis_label, name_label, plain, shown
from pinarm.use.show.picture import COLOURS, STYLES, Picture, draw, drawing, label, legend, limits
from pinarm.use.show.picture_files import file_name
from pinarm.use.study.sweep.axes import Axis
from pinarm.use.study.sweep.branches import MEASURE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinarm.use.study.sweep.table import Sweep

FAMILY = 6
"""Curves in one picture; a longer family is drawn as a map."""
ROOT_LOCUS = "root_locus"
"""Picture of all eigenvalues."""

PICTURES = 24
"""Columns that are drawn of themselves."""

Draw = Callable[["Axes", "Sweep", Series], None]


@in_language
def plot(sweep: Sweep, series: Series) -> Picture:
    """Return a picture of one column of a sweep.

    Over one list or grid it is a curve, over two a family of curves or, where both are long, a map. Of cases that were
    drawn by chance, or that vary in more ways, it is a histogram with the median and the middle 90 %.
    """
    counts = {"failed": len(sweep.errors), "count": len(sweep)}
    failed = said(" ({failed} of {count} cases failed)", **counts) if sweep.errors else ""
    with drawing(7.0, 4.2, plain(f"{sweep.title or sweep.name}{failed}")) as picture:
        _kind(sweep, series)(picture.subplots(), sweep, series)
    return picture


def _kind(sweep: Sweep, series: Series) -> Draw:
    axes = sweep.cases.axes
    if series.name == ROOT_LOCUS:
        return _root_locus
    if len(axes) == 1 and axes[0].columns[0].is_numeric and not axes[0].drawn and _branches_of(sweep, series.name):
        return _branches
    simple = all(len(axis.columns) == 1 and not axis.drawn for axis in axes)
    if simple and len(axes) == 1:
        return _family
    if simple and len(axes) == 2:
        numeric = all(axis.columns[0].is_numeric for axis in axes)
        return _map if numeric and min(map(len, axes)) > FAMILY else _family
    return _histogram


def _branches_of(sweep: Sweep, name: str) -> dict[str, Series]:
    """Return all branches of the measure of a mode that a name such as ``mode.1.damping`` tells: mode -> its column."""
    match = MEASURE.fullmatch(name)
    matches = {series.name: MEASURE.fullmatch(series.name) for series in sweep.results()} if match else {}
    return {own[1]: sweep[text] for text, own in matches.items() if match and own and own[2] == match[2]}


def _branches(axis: Axes, sweep: Sweep, series: Series) -> None:
    """Draw a measure of all modes over a number; over a speed, with the lines of once and twice the speed."""
    along, column = sweep.cases.axes[0], sweep.cases.table()[0]
    x, order = _ticks(axis.xaxis, along), np.argsort(column.values, kind="stable")
    for k, (mode, branch) in enumerate(_branches_of(sweep, series.name).items()):
        scale, measured = shown(branch, sweep.presentation)
        axis.plot(x[order], (branch.values / scale)[order], **_look(k), label=said("mode {number}", number=mode))
    if series.name.endswith("frequency") and column.unit and column.unit.dimension == HERTZ.dimension:
        _speed_lines(axis, x, column.values * column.unit.factor / (2.0 * np.pi))
    axis.set_xlabel(_named(along, sweep))
    axis.set_ylabel(label(axis_label(said(series.name.rpartition(".")[2].replace("_", " ")), measured)))
    if series.name.endswith((".damping", ".growth")):
        axis.axhline(0.0, color="0.4", linewidth=0.9, linestyle="--", zorder=0)
    axis.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _speed_lines(axis: Axes, x: Array, turns: Array) -> None:
    """Draw the frequencies of a rotor's turns, once and twice, as far as the modes go: where these cross, it shakes."""
    low, high = axis.get_ylim()
    ends = np.argsort(x)[[0, -1]]
    for times, style in ((1, "--"), (2, ":")):
        name = said("{times} × speed", times=times)
        axis.plot(
            x[ends], times * np.abs(turns[ends]), color="0.4", linewidth=1.0, linestyle=style, label=name, zorder=0
        )
    axis.set_ylim(min(low, 0.0), high)


def _root_locus(axis: Axes, sweep: Sweep, series: Series) -> None:
    """Draw the eigenvalues of all branches in the complex plane, from a ring at the lowest value to a dot."""
    order = np.argsort(sweep.cases.table()[0].values, kind="stable")
    for k, (mode, growth) in enumerate(_branches_of(sweep, "mode.1.growth").items()):
        real, look = growth.values[order], _look(k)
        imaginary = 2.0 * np.pi * sweep[f"mode.{mode}.damped_frequency"].values[order]
        for sign in (1.0, -1.0):
            axis.plot(real, sign * imaginary, **look, label=said("mode {number}", number=mode) if sign > 0.0 else None)
            for end, fill in ((0, "white"), (-1, look["color"])):
                axis.plot(real[end], sign * imaginary[end], "o", color=look["color"], markerfacecolor=fill)
    axis.axvline(0.0, color="0.4", linewidth=0.9, linestyle="--", zorder=0)
    axis.set_xlabel(said("real part [1/s]"))
    axis.set_ylabel(said("imaginary part [rad/s]"))
    ends = (_value(sweep.cases.axes[0], int(order[end])) for end in (0, -1))
    title = "\n".join(f"{mark} {value}" for mark, value in zip("○●", ends, strict=True))
    axis.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), title=title, title_fontsize=8)


def _look(k: int) -> dict[str, Any]:
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": STYLES[k // len(COLOURS) % len(STYLES)]}


def _family(axis: Axes, sweep: Sweep, series: Series) -> None:
    """Draw curves over the longer axis, one for each value of the other."""
    along, other, values = _grid(sweep, series)
    scale, measured = shown(series, sweep.presentation)
    x, lost, values = _ticks(axis.xaxis, along), np.isnan(values).any(axis=0), values / scale
    look = {"marker": "o" if len(x) <= 60 else "", "markersize": 3}
    for k, row in enumerate(values):
        draw(axis, x, row, plain(_value(other, k)) if other else "", color=COLOURS[k % len(COLOURS)], **look)
    axis.vlines(x[lost], 0.0, 1.0, color="0.85", linewidth=3, zorder=0, transform=axis.get_xaxis_transform())
    axis.set_xlabel(_named(along, sweep))
    axis.set_ylabel(label(axis_label(series.name, measured, sweep.presentation)))
    axis.set_ylim(*limits(values, 0.05))
    if other:
        legend(axis, axis.lines, title=_named(other, sweep, measured=False), title_fontsize=8)


def _map(axis: Axes, sweep: Sweep, series: Series) -> None:
    along, other, values = _grid(sweep, series)
    assert other is not None
    scale, measured = shown(series, sweep.presentation)
    x, y = _ticks(axis.xaxis, along), _ticks(axis.yaxis, other)
    columns, rows = np.argsort(x), np.argsort(y)
    x, y, values = x[columns], y[rows], values[np.ix_(rows, columns)] / scale
    mesh = axis.pcolormesh(x, y, np.ma.masked_invalid(values), shading="nearest", cmap="viridis", rasterized=True)
    if np.isfinite(values).all() and np.ptp(values) > 0.0:
        axis.clabel(axis.contour(x, y, values, colors="white", linewidths=0.6), fontsize=7)
    axis.set_facecolor("0.85")
    axis.grid(visible=False)
    axis.set_xlabel(_named(along, sweep))
    axis.set_ylabel(_named(other, sweep))
    axis.figure.colorbar(mesh, ax=axis, label=label(axis_label(series.name, measured, sweep.presentation)))


def _histogram(axis: Axes, sweep: Sweep, series: Series) -> None:
    scale, measured = shown(series, sweep.presentation)
    values = series.values[np.isfinite(series.values)] / scale
    axis.set_xlabel(label(axis_label(series.name, measured, sweep.presentation)))
    axis.set_ylabel(said("cases"))
    if not len(values):
        return
    axis.hist(values, bins="auto", color=COLOURS[5], edgecolor="white", linewidth=0.5)
    for share, style, name in ((0.05, ":", said("middle 90 %")), (0.5, "-", said("median")), (0.95, ":", None)):
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
    column = axis.columns[0]
    if column.is_numeric:
        return np.array(column.values, float)
    direction.set_ticks(range(len(axis)), [label(plain(str(value))) for value in column.values])
    return np.arange(len(axis), dtype=float)


def _value(axis: Axis, row: int) -> str:
    column = axis.columns[0]
    return decimals(f"{column.values[row]:g} {column.unit}".rstrip()) if column.is_numeric else str(column.values[row])


def _named(axis: Axis, sweep: Sweep, *, measured: bool = True) -> str:
    """Return the label of what varies: that of the scenario for the path or the argument, or the argument's name."""
    column, how = axis.columns[0], sweep.presentation
    name = column.path if column.path in how.labels else argument_of(column.path) or column.path
    return label(axis_label(name, unit(column.unit or "1"), how) if measured else name_label(name, how))


def pictured(sweep: Sweep) -> list[Series]:
    """Return a column for each picture: all branches of a measure of modes are in one, their eigenvalues in another."""
    columns = dict[str, Series]()
    for series in sweep.results():
        match = MEASURE.fullmatch(series.name) if len(sweep.cases.axes) == 1 else None
        columns.setdefault(match[2] if match else f"{series.name} ", series)
    locus = {"growth", "damped_frequency"} <= columns.keys()
    return [*columns.values(), *([Series(ROOT_LOCUS, None, np.zeros(0))] if locus else [])]


def pictures(sweep: Sweep) -> Iterator[tuple[str, Picture]]:
    """Yield a picture of every result by the name of its file."""
    for number, series in enumerate(pictured(sweep)[:PICTURES], 1):
        yield f"{number:02d}_{file_name(series.name).strip('_')}", plot(sweep, series)

"""Tables, advice and plots of a trade-off."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from pinarm.use.show.terminal import aligned
from pinarm.use.study.tradeoff import WANTED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinarm.use.show.picture import Picture
    from pinarm.use.study.tradeoff import Tradeoff

MARKERS = "os^Dv*"


def report(trade: Tradeoff) -> str:
    """Return the tables of settings and variants, and what is recommended, as text."""
    lines = [trade.scenario.content.title or trade.scenario.name]
    if trade.reference:
        lines += [*aligned(settings(trade)), *advice(trade)]
    if trade.variants:
        lines += [*aligned(variant_rows(trade)), *remarks(trade)]
    return "\n".join(lines)


def settings(trade: Tradeoff) -> list[list[str]]:
    """Return a heading and the error and cost of every setting that was tried."""
    assert trade.reference
    rows = [["setting", "error", "largest in", "evaluations", "time [ms]"]]
    for point in trade.points:
        worst = max(point.errors, key=lambda name: point.errors[name])
        error = f"{point.error:.1e}" if point.error > trade.reference.bound else f"< {trade.reference.bound:.0e}"
        cells = (
            [error, worst[:24]]
            if math.isfinite(point.error)
            else ["other events" if point.evaluations else "failed", ""]
        )
        rows.append([point.setting, *cells, f"{point.evaluations}", f"{1e3 * point.seconds:.1f}"])
    return rows


def advice(trade: Tradeoff) -> list[str]:
    """Return what errors were measured against, and the cheapest setting for every wanted error, with a margin."""
    assert trade.reference
    return [
        f"reference: {trade.reference.words}; known to {trade.reference.bound:.1e}",
        *(
            f"for {wanted:g}: {point.setting}; every finer one too" if point else f"for {wanted:g}: no setting tried"
            for wanted, point in trade.recommended().items()
        ),
    ]


def variant_rows(trade: Tradeoff) -> list[list[str]]:
    """Return a heading and the errors of the outputs of every simplified model."""
    exact = trade.variants[0].result
    parameter = exact.trajectory.parameter if exact else ""
    rows = [["variant", "output", "error", "unit", "relative", f"at {parameter}", "time [ms]"]]
    for variant in trade.variants[1:]:
        for k, (name, error) in enumerate(variant.errors.items() if variant.result else ()):
            unit = str(variant.result[name].unit or "?") if variant.result else ""
            price = f"{1e3 * variant.seconds:.1f}" if k == 0 else ""
            numbers = [f"{error:.3g}", unit, f"{variant.relative[name]:.1e}", f"{variant.where[name]:.6g}", price]
            rows.append([variant.name if k == 0 else "", name[:32], *numbers])
    return rows


def remarks(trade: Tradeoff) -> list[str]:
    """Return what the errors of variants are relative to, and which variants failed or have other events."""
    exact = f"exact model: {1e3 * trade.variants[0].seconds:.1f} ms; relative to its largest value"
    simpler = trade.variants[1:]
    failed = [f"{variant.name}: failed: {variant.failure}" for variant in simpler if variant.result is None]
    parted = [
        f"{variant.name}: compared only in rows that both models have: {variant.course}"
        for variant in simpler
        if variant.course
    ]
    return [exact, *failed, *parted]


def work_precision(trade: Tradeoff) -> Picture:
    """Return the errors of all settings over their evaluations and over their time, a curve for each method.

    Recommended settings are ringed; in the grey band below, errors are those of the reference.
    """
    from pinarm.use.show.labels import plain
    from pinarm.use.show.picture import WIDTH, drawing

    assert trade.reference
    with drawing(WIDTH, 3.6, plain(trade.scenario.content.title or trade.scenario.name)) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        _curves(left, trade, "evaluations", 1.0)
        _curves(right, trade, "seconds", 1e3)
        left.set(xlabel="evaluations of the acceleration", ylabel="largest relative error of any output")
        right.set(xlabel="time [ms]")
        left.plot([], [], "o", markersize=10, fillstyle="none", color="black", label="recommended")
        left.legend(frameon=False, loc="best")
    return figure


def _curves(axis: Axes, trade: Tradeoff, cost: str, scale: float) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    from pinarm.use.show.picture import COLOURS

    assert trade.reference
    floor = max(trade.reference.bound, 1e-16)
    methods = list(dict.fromkeys(point.method for point in trade.points))
    for k, method in enumerate(methods):
        known = [point for point in trade.points if point.method == method and np.isfinite(point.error)]
        x, y = [scale * getattr(point, cost) for point in known], [point.error for point in known]
        axis.loglog(x, y, marker=MARKERS[k % len(MARKERS)], markersize=4, color=COLOURS[k % len(COLOURS)], label=method)
    for wanted, point in trade.recommended().items():
        axis.axhline(wanted, color="0.6", linewidth=0.8, linestyle=":")
        if point:
            axis.plot(scale * getattr(point, cost), point.error, "o", markersize=10, fillstyle="none", color="black")
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.axhspan(min(floor, axis.get_ylim()[0]), floor, color="0.9", zorder=0)
    axis.set_ylim(top=max(axis.get_ylim()[1], WANTED[0]))


def outputs(trade: Tradeoff) -> Picture:
    """Return the outputs of all variants over the run, that of the exact model in black."""
    from pinarm.use.show.labels import axis_label, plain, shown
    from pinarm.use.show.picture import COLOURS, HEAD, HEIGHT, WIDTH, draw, drawing, fit, legend, panels

    names, how = list(dict.fromkeys(trade.scenario.content.outputs)), trade.scenario.content.presentation
    known = [(k, variant.name, variant.result) for k, variant in enumerate(trade.variants) if variant.result]
    last = known[-1][2]
    along, measured = shown(last.parameter, how)
    titles = [axis_label(name, shown(last[name], how)[1], how) for name in names]
    title = plain(trade.scenario.content.title or trade.scenario.name)
    with drawing(WIDTH, HEAD + HEIGHT * len(names), title) as picture:
        axes = panels(picture, titles, axis_label(last.parameter.name, measured, how))
        for axis, name in zip(axes, names, strict=True):
            for k, called, result in known:
                x, y = result.trajectory.grid.t / along, result[name].values / shown(result[name], how)[0]
                look = {"color": COLOURS[(k - 1) % len(COLOURS)], "linestyle": "--"} if k else {"color": "#000000"}
                draw(axis, x, y, plain(called) if name == names[0] else "", **look)
            fit(axis)
        legend(axes[0], axes[0].lines, loc="best")
    return picture

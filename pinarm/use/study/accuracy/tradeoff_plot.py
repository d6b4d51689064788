"""Plots of a trade-off: error against work, and the outputs of simplified models over those of the exact one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinarm.use.study.accuracy.setting_errors import WANTED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinarm.use.show.plot import Picture
    from pinarm.use.study.accuracy.tradeoff import Tradeoff

MARKERS = "os^Dv*"


def work_precision(trade: Tradeoff) -> Picture:
    """Return the errors of all settings over their evaluations and over their time, a curve for each method.

    Recommended settings are ringed; in the grey band below, errors are those of the reference.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from pinarm.use.show.plot import STYLE, WIDTH, Picture, plain

    assert trade.reference
    with matplotlib.rc_context(STYLE):
        figure = Picture(figsize=(WIDTH, 3.6))
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2, sharey=True)
        _curves(left, trade, "evaluations", 1.0)
        _curves(right, trade, "seconds", 1e3)
        left.set(xlabel="evaluations of the acceleration", ylabel="largest relative error of any output")
        right.set(xlabel="time [ms]")
        left.legend(frameon=False, loc="best")
        figure.suptitle(plain(trade.scenario.content.title or trade.scenario.name))
    return figure


def _curves(axis: Axes, trade: Tradeoff, cost: str, scale: float) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    from pinarm.use.show.plot import COLOURS

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
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from pinarm.use.show.plot import COLOURS, HEAD, HEIGHT, STYLE, WIDTH, Picture, axis_label, plain, shown

    names = list(dict.fromkeys(trade.scenario.content.outputs))
    with matplotlib.rc_context(STYLE):
        figure = Picture(figsize=(WIDTH, HEAD + HEIGHT * len(names)))
        FigureCanvasAgg(figure)
        axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for k, variant in enumerate(trade.variants):
            if variant.result is None:
                continue
            run, look = variant.result.trajectory, {"color": COLOURS[(k - 1) % len(COLOURS)], "linestyle": "--"}
            along, measured = shown(variant.result.parameter)
            for name, axis in zip(names, axes, strict=True):
                scale, unit = shown(variant.result[name])
                values = variant.result[name].values / scale
                axis.plot(run.grid.t / along, values, label=plain(variant.name), **(look if k else {"color": "black"}))
                axis.set_title(axis_label(name, unit), loc="left", fontsize=9)
        axes[0].legend(frameon=False, loc="best", fontsize=8)
        axes[-1].set_xlabel(axis_label(run.parameter, measured))
        axes[-1].margins(x=0.01)
        figure.suptitle(plain(trade.scenario.content.title or trade.scenario.name))
    return figure


def plots(trade: Tradeoff) -> dict[str, Picture]:
    """Return the figures ``settings`` and ``variants``, whichever there is something to draw for."""
    drawn = {"settings": work_precision} if trade.reference else {}
    drawn |= {"variants": outputs} if trade.variants else {}
    return {name: draw(trade) for name, draw in drawn.items()}

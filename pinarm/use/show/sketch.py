"""The mechanism as a stick figure where a run starts and where it ends, faintly in between; for print."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.use.show.plot import COLOURS, STYLE, Picture, plain, shown, symbol
from pinarm.use.show.replay.framing import framing, upwards
from pinarm.use.show.replay.overlays import BodyPoint, Connection, pairs
from pinarm.use.show.replay.sticks import cuboid, reach, sticks
from pinarm.use.show.replay.tracks import nodes_of, placed

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

BETWEEN = 4
"""Positions between start and end."""

FINE = 600
"""Rows by which paths are drawn."""

SIZE = 4.4
"""Width and height [inch]."""

COIL = np.array([0.0, 0.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 0.0, 0.0])
"""A spring: how far its points stand beside its axis, in its half width."""

MOUNT = ((0.0, 0.0), (-0.8, -1.2), (0.8, -1.2), (0.0, 0.0))
"""What a joint stands on that does not move, in the size of its mark."""

EVEN = 1e-9
"""Part of an axis that may stand out of the picture for the axis still to lie in it."""

WRAP = 46
"""Letters of a line of the title."""


@dataclass(frozen=True)
class Sticks:
    """What is drawn of a mechanism.

    Attributes:
        lines: Polylines that are fixed to bodies: a body, and points in it [m], shape (k, 3).
        pins: Bodies on joints that turn.
        rails: Bodies on joints that slide: a body, and where its joint would be at zero: the parent, and the point in
            it [m], shape (3,).
        mounts: Points of the world that a planar mechanism stands on [m], shape (3,).
        tips: Points that carry nothing further; their paths are drawn.
        pairs: Springs, cylinders, rods and loop joints.
        axes: Right and up in the picture, in world axes, shape (2, 3).
    """

    lines: list[tuple[int, Array]]
    pins: list[int]
    rails: list[tuple[int, BodyPoint]]
    mounts: list[Array]
    tips: list[BodyPoint]
    pairs: list[Connection]
    axes: Array

    def flat(self, place: Array, node: int, points: Array) -> Array:
        """Return points of a body in the picture, shape (2, k), from placements of shape (njoints, 4, 4)."""
        return np.asarray(self.axes @ (points @ place[node, :3, :3].T + place[node, :3, 3]).T)


def sketch(result: Result) -> Picture:
    """Return a drawing of the mechanism at the start and the end of a run, with the paths of its ends.

    Rows that stand for themselves, such as equilibria, are drawn alike. A planar mechanism is seen along its axes, any
    other as its replay shows it.
    """
    run = result.trajectory
    drawn, model = _sticks(run), run.mechanism.model
    rows = np.unique(np.linspace(0, len(run) - 1, BETWEEN + 2).round().astype(np.intp))
    places = dict(zip(rows.tolist(), placed(model, run.q[rows]), strict=True))
    drawn_rows = rows.tolist() if run.numbered else [0, len(run) - 1]
    with matplotlib.rc_context({**STYLE, "axes.grid": False}):
        figure = Picture(figsize=(SIZE, SIZE))
        FigureCanvasAgg(figure)
        axis = figure.subplots()
        if not run.numbered:
            for tip, paths in itertools.product(drawn.tips, [placed(model, run.q, FINE)]):
                axis.plot(*(drawn.axes @ tip.path(paths).T), color="0.6", linewidth=0.7, linestyle=":")
        for row in places.keys() - set(drawn_rows):
            _draw(axis, drawn, places[row], "0.8", 1.0)
        for k, row in enumerate(drawn_rows):
            _draw(axis, drawn, places[row], COLOURS[k], 2.2, _where(result, row))
        for mount in drawn.mounts:
            axis.plot(*drawn.axes @ mount, marker=MOUNT, color="0.35", markersize=14, zorder=1)
        _frame(axis, drawn)
        figure.legend(fontsize=8, frameon=False, loc="outside lower center", ncols=2)
        figure.suptitle(plain("\n".join(textwrap.wrap(result.content.title or result.name, WRAP))))
    return figure


def _sticks(run: Trajectory) -> Sticks:
    model = run.mechanism.model
    nodes, places, joined = nodes_of(model, run.q), placed(model, run.q), pairs(run)
    lines, tips = [], []
    known = {(node.parent, tuple(node.placement.translation)) for node in nodes}
    known |= {(end.node, tuple(end.place)) for pair in joined for end in pair.ends}
    for node in (k for k in range(1, len(nodes)) if nodes[k].carries):
        points = reach(model, nodes, node)
        ends = points[points.any(axis=1)]
        lines += [(node, np.array([np.zeros(3), end])) for end in ends] or list(_box(model.inertias[node], node))
        tips += [BodyPoint(node, end) for end in ends if (node, tuple(end)) not in known]
    seen = framing(model, nodes, list(sticks(model, nodes, range(len(nodes)))), places, [])
    eye = seen.eye if seen.normal is None else seen.normal
    up = upwards(eye, seen.up)
    own = [k for k, node in enumerate(nodes) if k and node.carries and (not node.parent or nodes[node.parent].carries)]
    pins = [k for k in own if nodes[k].kind == "turn"]
    rails = [(k, BodyPoint(nodes[k].parent, np.asarray(nodes[k].placement.translation))) for k in own
             if nodes[k].kind == "slide"]  # fmt: skip
    mounts = [np.asarray(nodes[k].placement.translation) for k in pins if not nodes[k].parent]
    mounts += [end.place for pair in joined if pair.kind in ("loop", "spring") for end in pair.ends if not end.node]
    axes = np.array([np.cross(up, eye), up])
    return Sticks(lines, pins, rails, [] if seen.normal is None else mounts, tips, joined, axes)


def _box(inertia: pin.Inertia, node: int) -> Iterator[tuple[int, Array]]:
    """Yield the edges of the box of an inertia, for a body that is all in one place."""
    if inertia.mass > 0.0:
        edges, axes = cuboid(inertia)
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        for a in range(8):
            for b in (a | bit for bit in (1, 2, 4) if not a & bit):
                yield node, inertia.lever + (corners[[a, b]] * edges) @ axes.T


def _draw(axis: Axes, drawn: Sticks, place: Array, colour: str, width: float, label: str | None = None) -> None:
    """Draw one position."""
    for node, points in drawn.lines:
        axis.plot(*drawn.flat(place, node, points), color=colour, linewidth=width, solid_capstyle="round")
    for pair in drawn.pairs:
        _join(axis, pair, [drawn.flat(place, end.node, end.place[None])[:, 0] for end in pair.ends], colour, width)
    mark: dict[str, Any] = {"color": colour, "markerfacecolor": "white", "markersize": 2.2 * width, "linestyle": "-."}
    for node, zero in drawn.rails:
        ends = [drawn.flat(place, zero.node, zero.place[None]), drawn.flat(place, node, np.zeros((1, 3)))]
        axis.plot(*np.hstack(ends), marker="s", markevery=[1], linewidth=0.4 * width, **mark)
    for node in drawn.pins:
        axis.plot(*drawn.flat(place, node, np.zeros((1, 3))), marker="o", **mark)
    axis.plot([], [], color=colour, linewidth=width, label=label)


def _join(axis: Axes, pair: Connection, ends: list[Array], colour: str, width: float) -> None:
    """Draw what joins two points: a spring as a coil, a cylinder thick and light, a loop joint as its pin."""
    one, two = ends
    along, share = two - one, np.linspace(0.0, 1.0, len(COIL))
    if pair.kind == "loop":
        axis.plot(*one, marker="o", color=colour, markerfacecolor="white", markersize=2.2 * width)
        return
    beside = 0.06 * np.array([-along[1], along[0]])[:, None] * COIL if pair.kind == "spring" else 0.0
    wide, alpha = (2.5 * width, 0.4) if pair.kind == "cylinder" else (0.6 * width, 1.0)
    axis.plot(*(one[:, None] + along[:, None] * share + beside), color=colour, linewidth=wide, alpha=alpha)


def _frame(axis: Axes, drawn: Sticks) -> None:
    """Give both directions the same scale, and name them where they are axes of the world."""
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(0.1)
    names = ["xyz"[k] for direction in drawn.axes for k in range(3) if direction[k] > 1.0 - EVEN]
    if len(names) == 2:
        axis.set(xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]")
    else:
        axis.set_axis_off()


def _where(result: Result, row: int) -> str:
    """Return what the legend calls a position."""
    run = result.trajectory
    scale, measured = shown(result.parameter, result.presentation)
    value = f"{run.grid.t[row] / scale:.4g}".replace("-", "−")
    if run.numbered:
        return f"row {value}"
    unit = {"1": "", "°": "°"}.get(str(measured or "1"), f" {measured}")
    return f"{'end' if row else 'start'}: {symbol(run.parameter)} = {plain(value + unit)}"

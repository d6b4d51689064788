"""A picture of boxes, their joint, rods and cables at several rows: how a body turns is not seen of a stick."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from pinarm.arrays import Array
from pinarm.engine.quantities.reactions import loop_axis, tree_axis
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import normals
from pinarm.use.facade import Result
from pinarm.use.mechanism import Mechanism
from pinarm.use.show.bodies import Shape, connections, placed, visuals
from pinarm.use.show.drawings import sketch
from pinarm.use.show.picture import COLOURS, drawing

SIZE = 4.4
"""Width and height [inch]."""

ROWS = 5
"""Positions that are drawn, the first and the last in colour."""

TICKS = 5
"""Numbers at an axis, about."""

MARGIN = 0.18
"""How far lines and planes of joints go on beyond the motion, relative to the width of the picture."""

ABOVE = 10
"""Where joints are drawn: above the bodies."""

PLANES = ("planar", "point_on_plane")
"""Loop joints whose axis is the normal of a plane."""

_SIDES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def solids(result: Result) -> str:
    """Return the picture as SVG; that of a mechanism without boxes, such as a drawing, is its sketch."""
    run = result.trajectory
    boxes = [shape for shape in visuals(run.mechanism).shapes if shape.node and shape.kind == "box"]
    if not boxes:
        return sketch(result).svg()
    strings = [pair for pair in connections(run.mechanism, run.dynamics.forces) if pair.kind in ("rod", "cable")]
    rows = np.unique(np.linspace(0, len(run) - 1, ROWS).round().astype(int))
    with drawing(SIZE, SIZE, result.content.title) as figure:
        figure.set_layout_engine("none")
        axis = figure.add_axes((0.0, 0.03, 0.92, 0.9), projection="3d", proj_type="ortho")
        axis.computed_zorder = False
        points = []
        for k, places in enumerate(placed(run.mechanism.model, run.q[rows])):
            colour = COLOURS[0] if k == 0 else COLOURS[1] if k == len(rows) - 1 else "0.7"
            polygons = [polygon for box in boxes for polygon in _in_world(box, places)]
            axis.add_collection3d(Poly3DCollection(
                polygons, facecolor=colour, edgecolor=colour, linewidth=0.6, alpha=0.25 if k else 0.4,
                zorder=1 if colour == "0.7" else 2,
            ))  # fmt: skip
            points.append(np.vstack(polygons))
            for string in strings:
                axis.plot(
                    *np.vstack([end.path(places[None]) for end in string.ends]).T, color=colour, linewidth=1.0, zorder=3
                )
        _frame(axis, np.vstack(points))
        _draw_joints(axis, run.mechanism, placed(run.mechanism.model, run.q))
    return figure.encoded("svg").decode()


def _in_world(box: Shape, places: Array) -> Iterator[Array]:
    """Yield the sides of a box in the world [m], shape (4, 3) each, from placements of the bodies, (njoints, 4, 4)."""
    place = places[box.node] @ box.placement.homogeneous
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(box.size) / 2
    yield from (corners[list(side)] @ place[:3, :3].T + place[:3, 3] for side in _SIDES)


def _frame(axis: Axes, points: Array) -> None:
    """Give all directions the same scale, and name them."""
    low, high = np.minimum(points.min(axis=0), 0.0), np.maximum(points.max(axis=0), 0.0)
    middle, half = (low + high) / 2, (high - low).max() / 2
    for limit, centre in zip((axis.set_xlim, axis.set_ylim, axis.set_zlim), middle, strict=True):
        limit(centre - half, centre + half)
    axis.set_box_aspect((1, 1, 1))
    axis.view_init(elev=22, azim=-60)
    axis.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axis.tick_params(labelsize=7)
    axis.locator_params(nbins=TICKS)


def _draw_joints(axis: Axes, mechanism: Mechanism, places: Array) -> None:
    """Draw where the joint of the example is at the start, and its line or plane as far as the body moves along it."""
    margin = MARGIN * np.ptp(axis.get_xlim())
    for way, direction, flat in _joints(mechanism, places):
        axis.plot(*way[0][:, None], "o", color="black", markersize=3.5, zorder=ABOVE)
        if direction is not None and flat:
            low, high = zip(*(_ends(way, along, margin) for along in normals(direction)), strict=True)
            corners = [way[0] + a + b for a, b in ((low[0], low[1]), (high[0], low[1]), high, (low[0], high[1]))]
            plane = Poly3DCollection([corners], facecolor="0.5", edgecolor="black", linewidth=0.6, alpha=0.12, zorder=0)
            axis.add_collection3d(plane)
        elif direction is not None:
            ends = way[0] + np.array(_ends(way, direction, margin))
            axis.plot(*ends.T, "-.", color="black", linewidth=0.9, zorder=ABOVE)


def _ends(way: Array, direction: Array, margin: float) -> tuple[Array, Array]:
    """Return how far from its start a way reaches along a direction, and a margin beyond [m], shape (3,) each."""
    along = (way - way[0]) @ direction
    return (along.min() - margin) * direction, (along.max() + margin) * direction


def _joints(mechanism: Mechanism, places: Array) -> Iterator[tuple[Array, Array | None, bool]]:
    """Yield the ways of the origins of joints [m], shape (rows, 3), their axes, and whether these are normals."""
    model = mechanism.model
    for loop in mechanism.constraints:
        if isinstance(loop, LoopJoint):
            first, second = model.frames[loop.first], model.frames[loop.second]
            turn, own = places[0, first.parentJoint, :3, :3] @ first.placement.rotation, loop_axis(loop)
            place = places[:, second.parentJoint]
            way = place[:, :3, :3] @ second.placement.translation + place[:, :3, 3]
            yield way, None if own is None else turn @ (own / np.linalg.norm(own)), loop.kind in PLANES
    if model.njoints == 2:  # one joint of the tree, and what it carries
        own = tree_axis(model, 1)
        yield places[:, 1, :3, 3], None if own is None else places[0, 1, :3, :3] @ own, False

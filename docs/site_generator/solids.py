"""A picture of boxes, rods and cables at several rows of a run: how a body turns is not seen of a stick."""

from __future__ import annotations

import io
from collections.abc import Iterator

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from pinarm.arrays import Array
from pinarm.use.result.result import Result
from pinarm.use.show.chart import COLOURS
from pinarm.use.show.figure import STYLE, UNDATED, new
from pinarm.use.show.replay.overlays import pairs
from pinarm.use.show.replay.shapes import Shape, visuals
from pinarm.use.show.replay.tracks import placed
from pinarm.use.show.sketch import sketch
from pinarm.use.show.svg import svg

SIZE = 4.4
"""Width and height [inch]."""

ROWS = 5
"""Positions that are drawn, the first and the last in colour."""

_SIDES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def solids(result: Result) -> str:
    """Return the picture as SVG; that of a mechanism without boxes, such as a drawing, is its sketch."""
    run = result.trajectory
    boxes = [shape for shape in visuals(run.mechanism).shapes if shape.node and shape.kind == "box"]
    if not boxes:
        return svg(sketch(result))
    strings = [pair for pair in pairs(run.mechanism, run.dynamics.forces) if pair.kind in ("rod", "cable")]
    rows = np.unique(np.linspace(0, len(run) - 1, ROWS).round().astype(int))
    with matplotlib.rc_context(STYLE):
        figure = new(SIZE, SIZE)
        figure.set_layout_engine("none")
        axis = figure.add_axes((0.0, 0.03, 0.92, 0.9), projection="3d", proj_type="ortho")
        points = []
        for k, places in enumerate(placed(run.mechanism.model, run.q[rows])):
            colour = COLOURS[0] if k == 0 else COLOURS[1] if k == len(rows) - 1 else "0.7"
            polygons = [polygon for box in boxes for polygon in _in_world(box, places)]
            axis.add_collection3d(Poly3DCollection(
                polygons, facecolor=colour, edgecolor=colour, linewidth=0.6, alpha=0.25 if k else 0.4
            ))  # fmt: skip
            points.append(np.vstack(polygons))
            for string in strings:
                axis.plot(*np.vstack([end.path(places[None]) for end in string.ends]).T, color=colour, linewidth=1.0)
        _frame(axis, np.vstack(points))
        figure.suptitle(result.content.title, fontsize=10)
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata=UNDATED["svg"])
    return stream.getvalue()


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

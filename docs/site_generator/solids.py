"""A picture of the shapes of a model at several rows of a run, in the colours of the stick figure."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from pinarm.arrays import Array
from pinarm.use.result.result import Result
from pinarm.use.show.plot import COLOURS, STYLE, Picture, plain
from pinarm.use.show.replay.shapes import Shape, visuals
from pinarm.use.show.replay.tracks import placed

ROWS = 5
"""Positions that are drawn, the first and the last in colour."""

CORNERS = 24
"""Of the polygon that stands for a circle."""

_SIDES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def solids(result: Result) -> Picture | None:
    """Return the picture; ``None`` where the model has no boxes and cylinders, as that of a drawing."""
    run = result.trajectory
    shapes = [shape for shape in visuals(run.mechanism).shapes if shape.node and shape.kind in ("box", "cylinder")]
    if not shapes:
        return None
    rows = np.unique(np.linspace(0, len(run) - 1, ROWS).round().astype(int))
    with matplotlib.rc_context({**STYLE, "figure.constrained_layout.use": False}):
        figure = Picture(figsize=(4.4, 4.4))
        FigureCanvasAgg(figure)
        axis = figure.add_axes((0.0, 0.03, 0.92, 0.9), projection="3d", proj_type="ortho")
        points = []
        for k, places in enumerate(placed(run.mechanism.model, run.q[rows])):
            colour = COLOURS[0] if k == 0 else COLOURS[1] if k == len(rows) - 1 else "0.7"
            polygons = [polygon for shape in shapes for polygon in _in_world(shape, places)]
            axis.add_collection3d(Poly3DCollection(
                polygons, facecolor=colour, edgecolor=colour, linewidth=0.6, alpha=0.25 if k else 0.4
            ))  # fmt: skip
            points.append(np.vstack(polygons))
        _frame(axis, np.vstack(points))
        figure.suptitle(plain(result.content.title), fontsize=10)
    return figure


def _polygons(shape: Shape) -> Iterator[Array]:
    """Yield the polygons of a box or a cylinder in its own axes [m], each of shape (k, 3)."""
    if shape.kind == "box":
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(shape.size) / 2
        yield from (corners[list(side)] for side in _SIDES)
        return
    radius, length = shape.size
    angles = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)
    ring = radius * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    half = np.array([0.0, 0.0, length / 2])
    top, bottom = ring + half, ring - half
    yield from (top, bottom)
    yield np.array([top[0], top[CORNERS // 2], bottom[CORNERS // 2], bottom[0]])  # a diameter: shows how it turns


def _in_world(shape: Shape, places: Array) -> Iterator[Array]:
    """Yield the polygons of a shape in the world, from placements of the bodies of shape (njoints, 4, 4)."""
    place = places[shape.node] @ shape.placement.homogeneous
    yield from (polygon @ place[:3, :3].T + place[:3, 3] for polygon in _polygons(shape))


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

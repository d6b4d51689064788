"""Triangle meshes: thinned where there are too many, packed into two bytes a coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinarm.arrays import Array
from pinarm.records import Record
from pinarm.use.show.replay.packing import Packing

Triangles = NDArray[np.int64]

MOST_TRIANGLES = 220_000
"""In one page: more would neither fit the size of a page nor the speed of a laptop's graphics."""

STEPS = 65535
"""Of a coordinate between the lowest and the highest vertex: 15 micrometres on one metre."""


class Mesh(Record, frozen=True):
    """Triangles of one colour.

    Attributes:
        vertices: Positions [m], shape (n, 3).
        triangles: Indices of the vertices of each, counter-clockwise seen from outside, shape (m, 3).
        colour: As the file says; ``None`` where it says none.
    """

    vertices: Array
    triangles: Triangles
    colour: tuple[float, float, float, float] | None = None

    @cached_property
    def low(self) -> Array:
        """Smallest coordinates, shape (3,)."""
        return np.asarray(self.vertices.min(axis=0))

    @cached_property
    def high(self) -> Array:
        """Largest coordinates, shape (3,)."""
        return np.asarray(self.vertices.max(axis=0))

    def pack(self, packing: Packing) -> dict[str, Any]:
        """Return the mesh for the page: vertices as 16-bit steps above ``low``, triangles as indices."""
        step = np.maximum(self.high - self.low, 1e-12) / STEPS
        steps = np.round((self.vertices - self.low) / step).astype(np.uint16)
        kind: type[np.uint16 | np.uint32] = np.uint16 if len(self.vertices) <= STEPS else np.uint32
        return {
            "low": self.low.tolist(),
            "step": step.tolist(),
            "vertices": packing.add(steps),
            "triangles": packing.add(self.triangles.astype(kind)),
        }


def thinned(meshes: Sequence[Mesh], size: float, most: int = MOST_TRIANGLES) -> list[Mesh]:
    """Return meshes with at most so many triangles in all, and no more loss than that takes.

    Vertices that share a cell of a grid become one, at their mean; triangles that collapse are dropped.

    Args:
        meshes: All the meshes of a page.
        size: Extent of the mechanism [m]: the first grid has a thousandth of it.
        most: How many triangles there may be.
    """
    kept, cell = list(meshes), size / 1000.0
    while sum(len(mesh.triangles) for mesh in kept) > most and cell < size:
        kept = [_clustered(mesh, cell) for mesh in meshes]
        cell *= 1.25
    return kept


def _clustered(mesh: Mesh, cell: float) -> Mesh:
    cells = np.floor((mesh.vertices - mesh.low) / cell).astype(np.int64)
    span = cells.max(axis=0) + 1
    _, places, counts = np.unique((cells[:, 0] * span[1] + cells[:, 1]) * span[2] + cells[:, 2],
                                  return_inverse=True, return_counts=True)  # fmt: skip
    means = np.stack([np.bincount(places, mesh.vertices[:, k]) / counts for k in range(3)], axis=1)
    corners = places[mesh.triangles]
    first = corners.argmin(axis=1)[:, None]  # the same triangle begins at the same corner, so that twins are found
    corners = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
    a, b, c = corners.T
    corners = np.unique(corners[(a != b) & (b != c) & (c != a)], axis=0)
    return Mesh(means, corners, mesh.colour) if len(corners) else Mesh(mesh.vertices, mesh.triangles[:0], mesh.colour)

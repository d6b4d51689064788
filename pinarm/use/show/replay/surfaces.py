"""STL and OBJ files: triangles without colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pinarm.arrays import Array

Triangles = NDArray[np.int64]

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(path: Path) -> tuple[Array, Triangles]:
    """Return the vertices, shape (n, 3), and triangles, shape (m, 3), of a binary or ASCII file.

    Raises:
        ValueError: It is neither.
    """
    raw = path.read_bytes()
    count = int.from_bytes(raw[80:84], "little")
    if len(raw) >= 84 and len(raw) == 84 + _FACET.itemsize * count:
        corners = np.frombuffer(raw, _FACET, count, 84)["corners"].reshape(-1, 3)
    elif raw.lstrip().startswith(b"solid"):
        words = [line.split() for line in raw.split(b"\n")]
        corners = np.array([line[1:4] for line in words if line[:1] == [b"vertex"]], np.float32).reshape(-1, 3)
    else:
        raise ValueError("it is neither binary nor ASCII STL")
    return joined(corners.astype(float), np.arange(len(corners)).reshape(-1, 3))


def read_obj(path: Path) -> tuple[Array, Triangles]:
    """Return the vertices, shape (n, 3), and triangles, shape (m, 3), of a file; polygons are cut into fans.

    Raises:
        ValueError: A line is damaged.
        IndexError: A face names a vertex that does not exist.
    """
    points: list[list[bytes]] = []
    fans: list[tuple[int, int, int]] = []
    for line in path.read_bytes().split(b"\n"):
        if line.startswith(b"v "):
            points.append(line.split()[1:4])
        elif line.startswith(b"f "):
            corners = [int(word.partition(b"/")[0]) for word in line.split()[1:]]
            corners = [k - 1 if k > 0 else len(points) + k for k in corners]
            fans += [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
    vertices, triangles = np.array(points, float).reshape(-1, 3), np.array(fans, np.int64).reshape(-1, 3)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise IndexError("a face names a vertex that does not exist")
    return joined(vertices, triangles)


def joined(vertices: Array, triangles: Triangles) -> tuple[Array, Triangles]:
    """Return a mesh whose vertices at one place are one, so that edges can be told from smooth surfaces."""
    used, places = np.unique(triangles, return_inverse=True)
    unique, same = np.unique(vertices[used].astype(np.float32), axis=0, return_inverse=True)
    return unique.astype(float), same.reshape(-1)[places].reshape(-1, 3).astype(np.int64)

"""STL and OBJ files: triangles without colours."""

from __future__ import annotations

import re
from array import array
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pinarm.arrays import Array

Triangles = NDArray[np.int64]

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


MOST_CORNERS = 6_000_000
"""Of the triangles of a file, and as many vertices: 100 MB of binary STL. It bounds memory to 1 GB, and time."""

_NUMBER = rb"[ \t]{1,20}(\S{1,40})"
_STL_VERTEX = re.compile(rb"\bvertex" + 3 * _NUMBER)
_OBJ_LINE = re.compile(rb"(?<=\n)([vf])[ \t]([^\n]*)")
MOST_LINE = 1_000_000
"""Bytes of a line: a face of a hundred thousand corners."""


def read_stl(path: Path) -> tuple[Array, Triangles]:
    """Return the vertices, shape (n, 3), and triangles, shape (m, 3), of a binary or ASCII file.

    Raises:
        ValueError: It is neither, or too large.
    """
    raw = path.read_bytes()
    count = int.from_bytes(raw[80:84], "little")
    if len(raw) >= 84 and len(raw) == 84 + _FACET.itemsize * count:
        corners = np.frombuffer(raw, _FACET, count, 84)["corners"].reshape(-1, 3)
    elif raw[:100].lstrip().startswith(b"solid"):
        numbers = array("f")
        for vertex in _STL_VERTEX.finditer(raw):
            numbers.extend(map(float, vertex.groups()))
            check_size(len(numbers) // 3)
        corners = np.array(numbers, np.float32).reshape(-1, 3)
    else:
        raise ValueError("it is neither binary nor ASCII STL")
    return joined(corners.astype(float), np.arange(len(corners)).reshape(-1, 3))


def check_size(corners: int) -> None:
    """Raise where a mesh has more corners, or vertices, than can be drawn.

    Raises:
        ValueError: It has.
    """
    if corners > MOST_CORNERS:
        raise ValueError(f"it has more than {MOST_CORNERS // 3} triangles")


def read_obj(path: Path) -> tuple[Array, Triangles]:
    """Return the vertices, shape (n, 3), and triangles, shape (m, 3), of a file; polygons are cut into fans.

    Raises:
        ValueError: A line is damaged, or the file too large.
        IndexError: A face names a vertex that does not exist.
    """
    points, fans = array("d"), array("q")
    for line in _OBJ_LINE.finditer(b"\n" + path.read_bytes()):
        if len(line[2]) > MOST_LINE:
            raise ValueError(f"a line has more than {MOST_LINE} bytes")
        words = line[2].split()
        if line[1] == b"v":
            x, y, z = map(float, words[:3])
            points.extend((x, y, z))
        else:
            corners = [int(word.partition(b"/")[0]) for word in words]
            corners = [k - 1 if k > 0 else len(points) // 3 + k for k in corners]
            for k in range(1, len(corners) - 1):
                fans.extend((corners[0], corners[k], corners[k + 1]))
        check_size(max(len(points) // 3, len(fans)))
    vertices, triangles = np.array(points).reshape(-1, 3), np.array(fans, np.int64).reshape(-1, 3)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise IndexError("a face names a vertex that does not exist")
    return joined(vertices, triangles)


def joined(vertices: Array, triangles: Triangles) -> tuple[Array, Triangles]:
    """Return a mesh whose vertices at one place are one, so that edges can be told from smooth surfaces."""
    used, places = np.unique(triangles, return_inverse=True)
    unique, same = np.unique(vertices[used].astype(np.float32), axis=0, return_inverse=True)
    return unique.astype(float), same.reshape(-1)[places].reshape(-1, 3).astype(np.int64)

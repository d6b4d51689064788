"""Triangle meshes, read from STL, OBJ and COLLADA files.

Of COLLADA, triangles and polygons of ``library_geometries`` are read, with the colours of their materials, placed by
the nodes of the scene, in the file's unit. The axis that the file calls up is not turned, as in RViz and Gazebo.
Textures, skins and lines are not read. Khronos, COLLADA 1.4 specification, sections 5 and 8. A hostile file is refused.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pinarm.arrays import Array
from pinarm.errors import InputError, PinarmError
from pinarm.input.xml_text import tree_of
from pinarm.records import Record

MOST_BYTES = 50_000_000
"""Bytes of a file."""

MOST_CORNERS = 3_000_000
"""Of the triangles of a file, and as many vertices: 50 MB of binary STL. It bounds memory to 1 GB, and time."""

MOST_NODES = 10_000
"""Nodes of a scene and surfaces in them, instances followed: a file of a few lines can name any number of them."""

Triangles = NDArray[np.int64]
Colour = tuple[float, float, float, float]

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_VERTEX = re.compile(rb"\bvertex" + 3 * rb"[ \t]{1,20}(\S{1,40})")
_OBJ_LINE = re.compile(rb"(?<=\n)([vf])[ \t]([^\n]*)")


class Mesh(Record, frozen=True):
    """Triangles of one colour.

    Attributes:
        vertices: Positions [m], shape (n, 3).
        triangles: Indices of the vertices of each, counter-clockwise seen from outside, shape (m, 3).
        colour: Red, green, blue, opacity, 0 to 1, as the file says; ``None`` where it says none.
    """

    vertices: Array
    triangles: Triangles
    colour: Colour | None = None

    @cached_property
    def low(self) -> Array:
        """Smallest coordinates, shape (3,)."""
        return np.asarray(self.vertices.min(axis=0))

    @cached_property
    def high(self) -> Array:
        """Largest coordinates, shape (3,)."""
        return np.asarray(self.vertices.max(axis=0))


def read_mesh(path: Path) -> list[Mesh]:
    """Return the meshes of an STL, OBJ or COLLADA file that may be read, one for each colour.

    Raises:
        InputError: It is none of those, or damaged.
    """
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"the mesh {path.name} is too large", expected=f"at most {MOST_BYTES} bytes")
    try:
        with np.errstate(all="ignore"):  # what is too large becomes infinite, which is refused below
            if path.suffix.lower() not in READERS:
                raise ValueError(f"{path.suffix} is not .stl, .obj or .dae")
            meshes = [mesh for mesh in READERS[path.suffix.lower()](path.read_bytes()) if len(mesh.triangles)]
    except RecursionError:
        raise InputError(f"the mesh {path.name} cannot be read: its nodes are too many") from None
    except (PinarmError, ValueError, KeyError, IndexError, TypeError, OverflowError) as error:
        reason = error.message if isinstance(error, PinarmError) else error
        raise InputError(f"the mesh {path.name} cannot be read: {reason}") from None
    if not meshes or not all(np.isfinite(mesh.vertices).all() for mesh in meshes):
        raise InputError(f"the mesh {path.name} has no triangles, or some that are not finite")
    return meshes


def _read_stl(raw: bytes) -> list[Mesh]:
    count = int.from_bytes(raw[80:84], "little")
    if len(raw) >= 84 and len(raw) == 84 + _FACET.itemsize * count:
        corners = np.frombuffer(raw, _FACET, count, 84)["corners"].reshape(-1, 3)
    elif raw[:100].lstrip().startswith(b"solid"):
        numbers = array("f")
        for vertex in _STL_VERTEX.finditer(raw):
            numbers.extend(map(float, vertex.groups()))
            _check_size(len(numbers) // 3)
        corners = np.array(numbers, np.float32).reshape(-1, 3)
    else:
        raise ValueError("it is neither binary nor ASCII STL")
    return [_joined(corners.astype(float), np.arange(len(corners)).reshape(-1, 3))]


def _read_obj(raw: bytes) -> list[Mesh]:
    points, fans = array("d"), array("q")
    for line in _OBJ_LINE.finditer(b"\n" + raw):
        words = line[2].split()
        if line[1] == b"v":
            x, y, z = map(float, words[:3])
            points.extend((x, y, z))
        else:
            corners = [int(word.partition(b"/")[0]) for word in words]
            corners = [k - 1 if k > 0 else len(points) // 3 + k for k in corners]
            for k in range(1, len(corners) - 1):
                fans.extend((corners[0], corners[k], corners[k + 1]))
        _check_size(max(len(points) // 3, len(fans)))
    vertices, triangles = np.array(points).reshape(-1, 3), np.array(fans, np.int64).reshape(-1, 3)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise IndexError("a face names a vertex that does not exist")
    return [_joined(vertices, triangles)]


def _check_size(corners: int) -> None:
    """Raise where a mesh has more corners, or vertices, than can be drawn."""
    if corners > MOST_CORNERS:
        raise ValueError(f"it has more than {MOST_CORNERS // 3} triangles")


def _joined(vertices: Array, triangles: Triangles, colour: Colour | None = None) -> Mesh:
    """Return a mesh whose vertices at one place are one, so that edges can be told from smooth surfaces."""
    used, places = np.unique(triangles, return_inverse=True)
    unique, same = np.unique(vertices[used].astype(np.float32), axis=0, return_inverse=True)
    return Mesh(unique.astype(float), same.reshape(-1)[places].reshape(-1, 3).astype(np.int64), colour)


class _Collada:
    """A COLLADA file, with its elements found by their ids."""

    def __init__(self, raw: bytes) -> None:
        self.root = tree_of(raw.decode("utf-8-sig"), "the mesh")
        self.ids = {element.get("id"): element for element in self.root.iter() if element.get("id")}
        self.visited = self.corners = 0
        self.surfaces: dict[int, tuple[Array, Triangles]] = {}

    def meshes(self) -> Iterator[Mesh]:
        """Yield the triangles of the file, apart for each material of each node."""
        unit = self.root.find("asset/unit")
        scale = float(unit.get("meter", "1")) if unit is not None else 1.0
        scene = self._named(self.root.find("scene/instance_visual_scene"))
        for node in scene.findall("node") if scene is not None else ():
            yield from self._node(node, np.diag([scale, scale, scale, 1.0]))

    def _named(self, element: Element | None, key: str = "url") -> Element | None:
        return self.ids.get(element.get(key, "").removeprefix("#")) if element is not None else None

    def _visit(self) -> None:
        self.visited += 1
        if self.visited > MOST_NODES:
            raise ValueError("its nodes are too many")

    def _node(self, node: Element, placement: Array) -> Iterator[Mesh]:
        self._visit()
        for element in node:
            if element.tag in _TRANSFORMS:
                placement = placement @ _TRANSFORMS[element.tag](_floats(element))
        for instance in node.findall("instance_geometry"):
            yield from self._geometry(instance, placement)
        shared = map(self._named, node.findall("instance_node"))
        for child in [*node.findall("node"), *(child for child in shared if child is not None)]:
            yield from self._node(child, placement)

    def _geometry(self, instance: Element, placement: Array) -> Iterator[Mesh]:
        self._visit()
        geometry = self._named(instance)
        mesh = geometry.find("mesh") if geometry is not None else None
        bound = {str(m.get("symbol")): m.get("target", "") for m in instance.iter("instance_material")}
        for part in mesh if mesh is not None else ():
            if part.tag not in ("triangles", "polylist", "polygons"):
                continue
            self._visit()
            symbol, (points, corners) = part.get("material", ""), self._surface(part)
            if np.linalg.det(placement[:3, :3]) < 0.0:  # a mirror image: what was outside stays outside
                corners = corners[:, ::-1]
            vertices = points @ placement[:3, :3].T + placement[:3, 3]
            yield _joined(vertices, corners, self._colour(bound.get(symbol, symbol)))

    def _surface(self, part: Element) -> tuple[Array, Triangles]:
        """Return the vertices and triangles of a part, of which a scene may have any number of copies."""
        if id(part) not in self.surfaces:
            self.surfaces[id(part)] = self._positions(part), _triangles(part)
        points, corners = self.surfaces[id(part)]
        self.corners += corners.size
        _check_size(self.corners)
        return points, corners

    def _positions(self, part: Element) -> Array:
        vertices = self._named(_input(part, "VERTEX"), "source")
        source = self._named(_input(vertices, "POSITION"), "source") if vertices is not None else None
        if source is None:
            raise ValueError("its triangles have no positions")
        accessor = source.find("technique_common/accessor")
        stride = int(accessor.get("stride", "3")) if accessor is not None else 3
        return _floats(source.find("float_array")).reshape(-1, stride)[:, :3]

    def _colour(self, name: str) -> Colour | None:
        material = self.ids.get(name.removeprefix("#"))
        effect = self._named(material.find("instance_effect")) if material is not None else None
        colour = effect.find(".//diffuse/color") if effect is not None else None
        if colour is None:
            return None
        r, g, b = np.clip(_floats(colour)[:3], 0.0, 1.0)
        return float(r), float(g), float(b), 1.0


def _floats(element: Element | None) -> Array:
    text = element.text if element is not None else None
    return np.array((text or "").split(), float)


def _input(part: Element, semantic: str) -> Element:
    for element in part.findall("input"):
        if element.get("semantic") == semantic:
            return element
    raise ValueError(f"its {part.tag} have no input {semantic}")


def _triangles(part: Element) -> Triangles:
    """Return the indices of positions, polygons cut into fans, shape (m, 3)."""
    stride = 1 + max(int(element.get("offset", "0")) for element in part.findall("input"))
    offset = int(_input(part, "VERTEX").get("offset", "0"))
    lists = [np.array((p.text or "").split(), np.int64).reshape(-1, stride)[:, offset] for p in part.findall("p")]
    corners = np.concatenate([*lists, np.zeros(0, np.int64)])
    if part.tag == "triangles":
        return corners.reshape(-1, 3)
    polylist = part.tag == "polylist"
    counts = list(map(int, (part.findtext("vcount") or "").split())) if polylist else list(map(len, lists))
    if min(counts, default=0) < 0 or sum(counts) > len(corners):
        raise ValueError("its polygons have fewer corners than they say")
    _check_size(3 * sum(max(n - 2, 0) for n in counts))
    starts = np.cumsum([0, *counts])[:-1]
    fans = [(s, s + k, s + k + 1) for s, n in zip(starts, counts, strict=True) for k in range(1, n - 1)]
    return corners[np.array(fans, np.int64).reshape(-1, 3)]


def _turn(numbers: Array) -> Array:
    return np.asarray(pin.exp3(np.radians(numbers[3]) * numbers[:3] / np.linalg.norm(numbers[:3])))


_TRANSFORMS: dict[str, Callable[[Array], Array]] = {
    "matrix": lambda numbers: numbers.reshape(4, 4),
    "translate": lambda numbers: pin.SE3(np.eye(3), numbers).homogeneous,
    "rotate": lambda numbers: pin.SE3(_turn(numbers), np.zeros(3)).homogeneous,
    "scale": lambda numbers: np.diag([*numbers, 1.0]),
}

READERS: dict[str, Callable[[bytes], Sequence[Mesh]]] = {
    ".stl": _read_stl,
    ".obj": _read_obj,
    ".dae": lambda raw: list(_Collada(raw).meshes()),
}
"""Ending of a mesh file -> its reader. They raise ValueError, KeyError, IndexError and the like over damaged files."""

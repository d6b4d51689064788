"""Readers of mesh files: STL, OBJ and COLLADA with the colours of its materials. A hostile file is refused.

Of COLLADA, triangles and polygons of ``library_geometries`` are read, placed by the nodes of the scene, in the file's
unit. The axis that the file calls up is not turned, as in RViz and Gazebo. Textures, skins and lines are not read.
Khronos, COLLADA 1.4 specification, sections 5 and 8.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from msgspec import Struct

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.use.show.replay.meshes import Mesh, Triangles

MOST_BYTES = 100_000_000
"""Bytes of a file."""

Element = ElementTree.Element
Colour = tuple[float, float, float, float]
Part = tuple[Array, Triangles, Colour | None]
"""Vertices, shape (n, 3), triangles, shape (m, 3), and their colour."""

MOST_NODES = 10_000
"""Nodes of a scene and surfaces in them, instances followed: a file of a few lines can name any number of them."""

DEEPEST = 50
"""Nodes in nodes, instances followed."""

MOST_ELEMENTS = 200_000
"""Elements of a file: each takes a hundred bytes of memory and more."""

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


MOST_CORNERS = 6_000_000
"""Of the triangles of a file, and as many vertices: 100 MB of binary STL. It bounds memory to 1 GB, and time."""

_NUMBER = rb"[ \t]{1,20}(\S{1,40})"
_STL_VERTEX = re.compile(rb"\bvertex" + 3 * _NUMBER)
_OBJ_LINE = re.compile(rb"(?<=\n)([vf])[ \t]([^\n]*)")
MOST_LINE = 1_000_000
"""Bytes of a line: a face of a hundred thousand corners."""


def read_mesh(path: Path) -> list[Mesh]:
    """Return the meshes of a file, one for each colour.

    Args:
        path: An STL, OBJ or COLLADA file that may be read.

    Raises:
        InputError: It is none of those, or damaged.
    """
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"the mesh {path.name} is too large", expected=f"at most {MOST_BYTES} bytes")
    try:
        with np.errstate(all="ignore"):  # what is too large becomes infinite, which is refused below
            meshes = [mesh for mesh in _read(path) if len(mesh.triangles)]
    except (ElementTree.ParseError, ValueError, KeyError, IndexError, TypeError, OverflowError) as error:
        raise InputError(f"the mesh {path.name} cannot be read: {error}") from None
    if not meshes or not all(np.isfinite(mesh.vertices).all() for mesh in meshes):
        raise InputError(f"the mesh {path.name} has no triangles, or some that are not finite")
    return meshes


def _read(path: Path) -> list[Mesh]:
    kind = path.suffix.lower()
    if kind == ".dae":
        return [Mesh(*part) for part in read_collada(path)]
    if kind not in (".stl", ".obj"):
        raise ValueError(f"{kind} is not .stl, .obj or .dae")
    return [Mesh(*(read_stl if kind == ".stl" else read_obj)(path))]


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


def read_collada(path: Path) -> list[Part]:
    """Return the triangles of a file, apart for each material of each node.

    Raises:
        ValueError: The file is damaged, or no XML.
    """
    raw = path.read_bytes()
    _survey(raw)
    return list(_File(ElementTree.fromstring(raw)).parts())


def _survey(raw: bytes) -> None:
    """Read a file in whatever encoding it has, and build nothing.

    Raises:
        ValueError: It is no XML, declares entities, or has too many elements.
    """
    parser, count = expat.ParserCreate(), 0

    def start(*_: object) -> None:
        nonlocal count
        count += 1
        if count > MOST_ELEMENTS:
            raise ValueError(f"it has more than {MOST_ELEMENTS} elements")

    def refuse(*_: object) -> None:
        raise ValueError("it declares entities")

    parser.StartElementHandler, parser.StartDoctypeDeclHandler = start, refuse
    try:
        parser.Parse(raw, True)
    except expat.ExpatError as error:
        raise ValueError(f"it is no XML: {error}") from None


class _File(Struct, eq=False, dict=True, weakref=True):
    """A file, with its elements found by their ids."""

    root: Element

    def __post_init__(self) -> None:
        for element in self.root.iter():
            element.tag = element.tag.rpartition("}")[2]
        self.ids = {element.get("id"): element for element in self.root.iter() if element.get("id")}
        self.visited = self.corners = 0
        self.surfaces: dict[int, tuple[Array, Triangles]] = {}

    def parts(self) -> Iterator[Part]:
        unit = self.root.find("asset/unit")
        scale = float(unit.get("meter", "1")) if unit is not None else 1.0
        scene = self._named(self.root.find("scene/instance_visual_scene"))
        for node in scene.findall("node") if scene is not None else ():
            yield from self._node(node, np.diag([scale, scale, scale, 1.0]))

    def _named(self, element: Element | None, key: str = "url") -> Element | None:
        return self.ids.get(element.get(key, "").removeprefix("#")) if element is not None else None

    def _visit(self, depth: int = 0) -> None:
        self.visited += 1
        if self.visited > MOST_NODES or depth > DEEPEST:
            raise ValueError("its nodes are too many, or nested too deeply")

    def _node(self, node: Element, outer: Array, depth: int = 0) -> Iterator[Part]:
        self._visit(depth)
        placement = outer
        for element in node:
            if element.tag in _TRANSFORMS:
                placement = placement @ _TRANSFORMS[element.tag](_floats(element))
        for instance in node.findall("instance_geometry"):
            yield from self._geometry(instance, placement)
        for child in node.findall("node"):
            yield from self._node(child, placement, depth + 1)
        for instance in node.findall("instance_node"):
            shared = self._named(instance)
            if shared is not None:
                yield from self._node(shared, placement, depth + 1)

    def _geometry(self, instance: Element, placement: Array) -> Iterator[Part]:
        self._visit()
        geometry = self._named(instance)
        mesh = geometry.find("mesh") if geometry is not None else None
        if mesh is None:
            return
        bound = {str(m.get("symbol")): m.get("target", "") for m in instance.iter("instance_material")}
        for part in mesh:
            if part.tag not in ("triangles", "polylist", "polygons"):
                continue
            self._visit()
            symbol = part.get("material", "")
            points, corners = self._surface(part)
            if np.linalg.det(placement[:3, :3]) < 0.0:  # a mirror image: what was outside stays outside
                corners = corners[:, ::-1]
            vertices = points @ placement[:3, :3].T + placement[:3, 3]
            yield *joined(vertices, corners), self._colour(bound.get(symbol, symbol))

    def _surface(self, part: Element) -> tuple[Array, Triangles]:
        """Return the vertices and triangles of a part, of which a scene may have any number of copies.

        Raises:
            ValueError: All of them have too many triangles.
        """
        if id(part) not in self.surfaces:
            self.surfaces[id(part)] = self._positions(part), _triangles(part)
        points, corners = self.surfaces[id(part)]
        self.corners += corners.size
        check_size(self.corners)
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
        """Return the diffuse colour of a material."""
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
    inputs = part.findall("input")
    stride = 1 + max(int(element.get("offset", "0")) for element in inputs)
    offset = int(_input(part, "VERTEX").get("offset", "0"))
    lists = [np.array((p.text or "").split(), np.int64).reshape(-1, stride)[:, offset] for p in part.findall("p")]
    if part.tag == "triangles":
        return np.concatenate([*lists, np.zeros(0, np.int64)]).reshape(-1, 3)
    counts = [len(corners) for corners in lists]
    if part.tag == "polylist":
        counts = np.array((part.findtext("vcount") or "").split(), np.int64).tolist()
    corners = np.concatenate([*lists, np.zeros(0, np.int64)])
    if min(counts, default=0) < 0 or sum(counts) > len(corners):
        raise ValueError("its polygons have fewer corners than they say")
    check_size(3 * sum(max(n - 2, 0) for n in counts))
    starts = np.cumsum([0, *counts])[:-1]
    fans = [(corners[s], corners[s + k], corners[s + k + 1]) for s, n in zip(starts, counts, strict=True)
            for k in range(1, n - 1)]  # fmt: skip
    return np.array(fans, np.int64).reshape(-1, 3)


def _translate(numbers: Array) -> Array:
    matrix = np.eye(4)
    matrix[:3, 3] = numbers
    return matrix


def _rotate(numbers: Array) -> Array:
    """Return Rodrigues' rotation about an axis by an angle in degrees."""
    axis, angle = numbers[:3] / np.linalg.norm(numbers[:3]), np.radians(numbers[3])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return matrix


_TRANSFORMS: dict[str, Callable[[Array], Array]] = {
    "matrix": lambda numbers: numbers.reshape(4, 4),
    "translate": _translate,
    "rotate": _rotate,
    "scale": lambda numbers: np.diag([*numbers, 1.0]),
}

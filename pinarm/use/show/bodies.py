"""Bodies of a moving picture: placements, points and connections fixed to them, solids and meshes of the model's file.

Each joint of the model has one node, the body that it carries, placed in its parent's node by the joint's coordinate. A
revolute or prismatic joint is given by its axis and its values: between two rows the page turns and slides it exactly,
over any number of turns. Other joints are given by their placements.

Meshes are read from STL, OBJ and COLLADA files. Of COLLADA, triangles and polygons of ``library_geometries`` are read,
with the colours of their materials, placed by the nodes of the scene, in the file's unit. The axis that the file calls
up is not turned, as in RViz and Gazebo. Textures, skins and lines are not read. Khronos, COLLADA 1.4 specification,
sections 5 and 8. A hostile file is refused.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pinarm.arrays import Array, distinct
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.model_source import Source
from pinarm.errors import InputError, ModelError, PinarmError
from pinarm.input.roots import contained_file, example_robot_data, root_of
from pinarm.input.units import decimal, is_decimal
from pinarm.input.xml_text import tree_of
from pinarm.input.yaml.schema import FARTHEST
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.kinematics import new_data
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import links_behind, screw_of
from pinarm.mechanics.loading.values import Part, placement_of
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.mechanics.coordinates import Constraint

SAMPLED = 100
"""Rows that give the extent of a motion."""

NodeKind = Literal["fixed", "turn", "slide", "pose"]

ConnectionKind = Literal["spring", "cylinder", "bushing", "rod", "cable", "loop", "slot"]

LOOPS: Mapping[str, ConnectionKind] = {"rod": "rod", "point_on_plane": "slot"}
"""Loop joints that have a mark of their own."""

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, 0 to 1."""

PALETTE: tuple[Colour, ...] = (
    (0.36, 0.55, 0.75, 1.0), (0.91, 0.62, 0.30, 1.0), (0.42, 0.68, 0.53, 1.0), (0.76, 0.50, 0.66, 1.0),
    (0.85, 0.76, 0.40, 1.0), (0.52, 0.74, 0.84, 1.0),
)  # fmt: skip
"""Colours of bodies for which none is given, in turn; Okabe and Ito's hues, softened."""

PLAIN: Colour = (0.74, 0.76, 0.79, 1.0)
"""Colour of meshes for which none is given."""

GROUND: Colour = (0.55, 0.57, 0.60, 1.0)

MOST_BYTES = 50_000_000
"""Bytes of a file."""

MOST_CORNERS = 3_000_000
"""Of the triangles of a file, and as many vertices: 50 MB of binary STL. It bounds memory to 1 GB, and time."""

MOST_NODES = 10_000
"""Nodes of a scene and surfaces in them, instances followed: a file of a few lines can name any number of them."""

Triangles = NDArray[np.int64]

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_VERTEX = re.compile(rb"\bvertex" + 3 * rb"[ \t]{1,20}(\S{1,40})")
_OBJ_LINE = re.compile(rb"(?<=\n)([vf])[ \t]([^\n]*)")

PACKAGE = "example-robot-data"

ShapeKind = Literal["box", "cylinder", "capsule", "sphere", "mesh"]

PRIMITIVES: Mapping[str, tuple[ShapeKind, int, tuple[str, ...]]] = {
    "box": ("box", 3, ("size",)), "cylinder": ("cylinder", 2, ("radius", "length")),
    "capsule": ("capsule", 2, ("radius", "length")), "sphere": ("sphere", 1, ("radius",)),
}  # fmt: skip
"""Solids of URDF: kind, number of measures, and the attributes that give them."""


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


class Node(ValueRecord, frozen=True):
    """The body that a joint carries. Node 0 is the world.

    Attributes:
        parent: Index of the node that it hangs from; -1 for the world itself.
        placement: Of the joint in that node.
        kind: What ``values`` are: angles about ``axis`` [rad], ways along it [m], or placements (x, y, z and a
            quaternion x, y, z, w).
        axis: In the joint's frame, shape (3,).
        values: Shape (rows,), or (rows, 7) for placements.
        carries: Whether it carries a link: of the simple joints that make up a floating one, only the last does.
    """

    parent: int
    placement: pin.SE3
    kind: NodeKind
    axis: Array
    values: Array
    carries: bool = True


class BodyPoint(ValueRecord, frozen=True):
    """A point that is fixed to a body: the body's node, and the place in it [m], shape (3,)."""

    node: int
    place: Array

    def plain(self) -> dict[str, Any]:
        return {"node": self.node, "point": np.asarray(self.place).tolist()}

    def path(self, places: Array) -> Array:
        """Return its positions in the world, shape (rows, 3), from placements of shape (rows, njoints, 4, 4)."""
        return np.asarray(places[:, self.node, :3, :3] @ self.place + places[:, self.node, :3, 3])


class Connection(ValueRecord, frozen=True):
    """A connection of two points.

    Its kind is a ``spring``, a ``cylinder`` (a damper, a constant force, or a strut, which pushes), a ``bushing``, a
    ``rod``, a straight part of a ``cable``, the mark of a ``loop`` joint, or the pin in a ``slot``.
    """

    kind: ConnectionKind
    ends: tuple[BodyPoint, BodyPoint]

    def lengths(self, places: Array) -> Array:
        """Return its lengths [m], shape (rows,), from placements of shape (rows, njoints, 4, 4)."""
        start, end = self.ends
        return np.asarray(np.linalg.norm(end.path(places) - start.path(places), axis=1))

    def plain(self, places: Array) -> dict[str, Any]:
        (start, end), lengths = self.ends, self.lengths(places)
        extremes = {"shortest": float(lengths.min()), "longest": float(lengths.max())}
        return {"kind": self.kind, "a": start.plain(), "b": end.plain(), **extremes}


class Shape(ValueRecord, frozen=True):
    """A solid that is fixed to a body.

    Attributes:
        node: The body.
        placement: In the body.
        kind: ``box`` (three edges), ``cylinder`` and ``capsule`` (radius, length along z), ``sphere`` (radius) or
            ``mesh`` (three factors).
        size: Its measures [m].
        colour: Its colour.
        mesh: The mesh of that kind.
    """

    node: int
    placement: pin.SE3
    kind: ShapeKind
    size: tuple[float, ...]
    colour: Colour
    mesh: Mesh | None = None

    def extent(self) -> Array:
        """Return the corners of a box around it, in the body's frame, shape (8, 3)."""
        if self.mesh is not None:
            ends = np.array([self.mesh.low, self.mesh.high]) * self.size
        else:
            high = np.array(self.size) / 2.0 if self.kind == "box" else np.full(3, self.size[0])
            if self.kind in ("cylinder", "capsule"):
                high[2] = self.size[1] / 2.0 + (self.size[0] if self.kind == "capsule" else 0.0)
            ends = np.array([-high, high])
        low, high = np.sort(ends, axis=0)
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        return np.asarray(corners @ self.placement.rotation.T + self.placement.translation)


def colour_of(node: int) -> Colour:
    """Return the colour of a body for which none is given."""
    return PALETTE[(node - 1) % len(PALETTE)] if node else GROUND


def nodes_of(model: pin.Model, q: Array) -> list[Node]:
    """Return the nodes of a model, by joint index, for configurations of shape (rows, nq)."""
    still, links = np.zeros(3), links_behind(model)
    nodes = [Node(-1, pin.SE3.Identity(), "fixed", still, np.zeros(0))]
    for index in range(1, model.njoints):
        joint, place = model.joints[index], (model.parents[index], model.jointPlacements[index])
        if (screw := screw_of(joint)) is None:
            nodes.append(Node(*place, "pose", still, _placements(model, index, q), bool(links[index])))
        else:
            values = np.ascontiguousarray(q[:, joint.idx_q])
            nodes.append(Node(*place, "turn" if screw[0] else "slide", screw[1], values, bool(links[index])))
    return nodes


def _placements(model: pin.Model, joint: int, q: Array) -> Array:
    data, back = new_data(model), model.jointPlacements[joint].inverse()
    rows = np.empty((len(q), 7))
    for row, state in zip(rows, q, strict=True):
        pin.forwardKinematics(model, data, state)
        row[:] = pin.SE3ToXYZQUAT(back * data.liMi[joint])
    return rows


def placed(model: pin.Model, q: Array, most: int = SAMPLED) -> Array:
    """Return the placements of all joints in the world at some of the rows, shape (samples, njoints, 4, 4)."""
    links = LinkPlacements.at(model, q[distinct(np.linspace(0, len(q) - 1, most).round().astype(np.intp))])
    placements = np.zeros((len(links.q), model.njoints, 4, 4))
    placements[..., :3, :3], placements[..., :3, 3], placements[..., 3, 3] = links.turns, links.places, 1.0
    return placements


def point_of(model: pin.Model, frame: int) -> BodyPoint:
    """Return the origin of a frame."""
    return BodyPoint(int(model.frames[frame].parentJoint), np.array(model.frames[frame].placement.translation))


def connections(mechanism: Mechanism, forces: Mapping[str, ForceElement]) -> list[Connection]:
    """Return springs, cylinders, bushings and cables among the forces, and loop joints."""
    elements: list[ForceElement | Constraint] = [*forces.values(), *mechanism.constraints]
    lines = list[Connection]()
    for kind, frames in map(_drawn_as, elements):
        points = [point_of(mechanism.model, frame) for frame in frames]
        lines += [Connection(kind, ends) for ends in pairwise(points)]
    return lines


def _drawn_as(element: ForceElement | Constraint) -> tuple[ConnectionKind, Sequence[int]]:
    """Return the kind and the frames of the connection that an element makes; no frames where it has no place."""
    if isinstance(element, LoopJoint):
        return LOOPS.get(element.kind, "loop"), (element.first, element.second)
    from pinarm.mechanics.forces.bushing import LinearBushing
    from pinarm.mechanics.forces.points import TautSpring, TwoPointSpring
    from pinarm.mechanics.loops.loop_joints import CableLoop

    if isinstance(element, TwoPointSpring):
        return "spring" if element.stiffness > 0.0 and element.force >= 0.0 else "cylinder", element.points
    if isinstance(element, LinearBushing):
        return "bushing", element.frames
    if isinstance(element, TautSpring | CableLoop):
        return "cable", element.path.frames
    return "rod", ()


class Visuals(ValueRecord, frozen=True):
    """Visuals of a model.

    Attributes:
        shapes: Solids that can be drawn.
        bare: Bodies without visuals, or with some that cannot be drawn.
        notes: Visuals that cannot be drawn, and why.
    """

    shapes: tuple[Shape, ...]
    bare: frozenset[int]
    notes: tuple[str, ...] = ()


def visuals(mechanism: Mechanism) -> Visuals:
    """Return the visuals of a model."""
    robot, model = tree_of(mechanism.xml), mechanism.model
    frames = {frame.name: frame for frame in model.frames if frame.type == pin.FrameType.BODY}
    palette = {str(material.get("name")): _colour(material) for material in robot.findall("material")}
    shapes, notes, missing = list[Shape](), list[str](), set[int]()
    meshes: dict[Path, list[Mesh]] = {}  # a leg's mesh serves four times
    for link in robot.findall("link"):
        for visual in link.findall("visual"):
            frame = frames[str(link.get("name"))]
            try:
                shapes += _visual(visual, frame, palette, mechanism.source, meshes)
            except (PinarmError, ValueError) as error:
                reason = error.message if isinstance(error, PinarmError) else str(error)
                notes.append(f"link {frame.name} is not drawn as its file says: {reason}")
                missing.add(int(frame.parentJoint))
    bare = set(range(model.njoints)) - {shape.node for shape in shapes} | missing
    return Visuals(tuple(shapes), frozenset(bare), tuple(dict.fromkeys(notes)))


def _colour(material: ElementTree.Element | None) -> Colour | None:
    """Return the colour of a material; none where its file has no four numbers."""
    element = material.find("color") if material is not None else None
    with suppress(InputError):
        r, g, b, a = np.clip(_numbers(element.get("rgba", "") if element is not None else "", 4), 0.0, 1.0)
        return float(r), float(g), float(b), float(a)
    return None


def _visual(
    visual: ElementTree.Element,
    frame: pin.Frame,
    palette: Mapping[str, Colour | None],
    source: Source,
    meshes: dict[Path, list[Mesh]],
) -> Iterator[Shape]:
    geometry = visual.find("geometry")
    if geometry is None or len(geometry) == 0:
        raise ModelError("a visual has no geometry")
    element, node, material = geometry[0], int(frame.parentJoint), visual.find("material")
    placement = frame.placement * placement_of(Part.of("a visual", visual.find("origin")))
    painted = _colour(material) or (palette.get(material.get("name", "")) if material is not None else None)
    if element.tag == "mesh":
        scale = tuple(float(x) for x in _numbers(element.get("scale", "1 1 1"), 3))
        for mesh in _meshes(element.get("filename", ""), source, meshes):
            yield Shape(node, placement, "mesh", scale, painted or mesh.colour or PLAIN, mesh)
    elif element.tag in PRIMITIVES:
        kind, count, keys = PRIMITIVES[element.tag]
        size = _numbers(" ".join(element.get(key, "") for key in keys), count)
        if not (size >= 0.0).all():
            measures = " x ".join(f"{x:g}" for x in size)
            raise InputError(f"a visual measures {measures}", expected="lengths that are not negative")
        yield Shape(node, placement, kind, tuple(size.tolist()), painted or colour_of(node))
    else:
        raise ModelError(f"<{element.tag}> is no shape", expected="box, cylinder, capsule, sphere or mesh")


def _meshes(name: str, source: Source, known: dict[Path, list[Mesh]]) -> list[Mesh]:
    """Return the meshes of a file, which must lie under the model's root, in a package, or in example-robot-data."""
    name = re.sub("^package:/+", "package://", name)
    robots = {PACKAGE: example_robot_data()} if name.startswith(f"package://{PACKAGE}/") else {}
    path = name if "://" in name else source.robot.parent.absolute() / name
    file = contained_file(path, root_of(source.robot), {**source.packages, **robots})
    if file not in known:
        known[file] = read_mesh(file)
    return known[file]


def _numbers(text: str, count: int) -> Array:
    numbers = np.array([decimal(part) if is_decimal(part) else np.nan for part in text.split()])
    if numbers.shape != (count,) or not (np.abs(numbers) <= FARTHEST).all():
        expected = f"{count} finite numbers, sizes of at most {FARTHEST:g}"
        raise InputError(f"'{text}' is not what a visual needs here", expected=expected)
    return numbers


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

    def _named(self, element: ElementTree.Element | None, key: str = "url") -> ElementTree.Element | None:
        return self.ids.get(element.get(key, "").removeprefix("#")) if element is not None else None

    def _visit(self) -> None:
        self.visited += 1
        if self.visited > MOST_NODES:
            raise ValueError("its nodes are too many")

    def _node(self, node: ElementTree.Element, placement: Array) -> Iterator[Mesh]:
        self._visit()
        for element in node:
            if element.tag in _TRANSFORMS:
                placement = placement @ _TRANSFORMS[element.tag](_floats(element))
        for instance in node.findall("instance_geometry"):
            yield from self._geometry(instance, placement)
        shared = map(self._named, node.findall("instance_node"))
        for child in [*node.findall("node"), *(child for child in shared if child is not None)]:
            yield from self._node(child, placement)

    def _geometry(self, instance: ElementTree.Element, placement: Array) -> Iterator[Mesh]:
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

    def _surface(self, part: ElementTree.Element) -> tuple[Array, Triangles]:
        """Return the vertices and triangles of a part, of which a scene may have any number of copies."""
        if id(part) not in self.surfaces:
            self.surfaces[id(part)] = self._positions(part), _triangles(part)
        points, corners = self.surfaces[id(part)]
        self.corners += corners.size
        _check_size(self.corners)
        return points, corners

    def _positions(self, part: ElementTree.Element) -> Array:
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


def _floats(element: ElementTree.Element | None) -> Array:
    text = element.text if element is not None else None
    return np.array((text or "").split(), float)


def _input(part: ElementTree.Element, semantic: str) -> ElementTree.Element:
    for element in part.findall("input"):
        if element.get("semantic") == semantic:
            return element
    raise ValueError(f"its {part.tag} have no input {semantic}")


def _triangles(part: ElementTree.Element) -> Triangles:
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

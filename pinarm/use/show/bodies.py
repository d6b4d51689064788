"""Bodies of a moving picture: placements, points and connections fixed to them, and the solids of the model's file.

Each joint of the model has one node, the body that it carries, placed in its parent's node by the joint's coordinate. A
revolute or prismatic joint is given by its axis and its values: between two rows the page turns and slides it exactly,
over any number of turns. Other joints are given by their placements.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

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
from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from pinarm.mechanics.coordinates import Constraint
    from pinarm.use.show.meshes import Mesh

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

PACKAGE = "example-robot-data"

ShapeKind = Literal["box", "cylinder", "capsule", "sphere", "mesh"]

PRIMITIVES: Mapping[str, tuple[ShapeKind, int, tuple[str, ...]]] = {
    "box": ("box", 3, ("size",)), "cylinder": ("cylinder", 2, ("radius", "length")),
    "capsule": ("capsule", 2, ("radius", "length")), "sphere": ("sphere", 1, ("radius",)),
}  # fmt: skip
"""Solids of URDF: kind, number of measures, and the attributes that give them."""


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
    from pinarm.use.show.meshes import read_mesh

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

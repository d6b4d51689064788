"""Visuals of a model's file: boxes, cylinders, capsules, spheres and meshes, each fixed to a body."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.model_source import Source
from pinarm.errors import InputError, ModelError, PinarmError
from pinarm.input.roots import contained_file, example_robot_data, root_of
from pinarm.input.units import decimal, is_decimal
from pinarm.input.yaml.schema import FARTHEST
from pinarm.mechanics.loading.values import Part, placement_of
from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from pinarm.use.show.meshes import Mesh

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, 0 to 1."""

PALETTE: tuple[Colour, ...] = (
    (0.36, 0.55, 0.75, 1.0),
    (0.91, 0.62, 0.30, 1.0),
    (0.42, 0.68, 0.53, 1.0),
    (0.76, 0.50, 0.66, 1.0),
    (0.85, 0.76, 0.40, 1.0),
    (0.52, 0.74, 0.84, 1.0),
)
"""Colours of bodies for which none is given, in turn; Okabe and Ito's hues, softened."""

PLAIN: Colour = (0.74, 0.76, 0.79, 1.0)
"""Colour of meshes for which none is given."""

GROUND: Colour = (0.55, 0.57, 0.60, 1.0)
"""Colour of the ground."""

PACKAGE = "example-robot-data"

Kind = Literal["box", "cylinder", "capsule", "sphere", "mesh"]

PRIMITIVES: Mapping[str, tuple[Kind, int, tuple[str, ...]]] = {
    "box": ("box", 3, ("size",)),
    "cylinder": ("cylinder", 2, ("radius", "length")),
    "capsule": ("capsule", 2, ("radius", "length")),
    "sphere": ("sphere", 1, ("radius",)),
}
"""Solids of URDF: kind, number of measures, and the attributes that give them."""


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
    kind: Kind
    size: tuple[float, ...]
    colour: Colour
    mesh: Mesh | None = None

    def extent(self) -> Array:
        """Return the corners of a box around it, in the body's frame, shape (8, 3)."""
        if self.mesh is not None:
            low, high = np.sort([self.mesh.low * self.size, self.mesh.high * self.size], axis=0)
        else:
            high = np.full(3, self.size[0]) if self.kind != "box" else np.array(self.size) / 2.0
            if self.kind in ("cylinder", "capsule"):
                high[2] = self.size[1] / 2.0 + (self.size[0] if self.kind == "capsule" else 0.0)
            low = -high
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        return np.asarray(corners @ self.placement.rotation.T + self.placement.translation)


def colour_of(node: int) -> Colour:
    """Return the colour of a body for which none is given."""
    return PALETTE[(node - 1) % len(PALETTE)] if node else GROUND


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
    robot, model = ElementTree.fromstring(mechanism.xml), mechanism.model
    shapes: list[Shape] = []
    notes: list[str] = []
    palette = {str(material.get("name")): _colour(material) for material in robot.findall("material")}
    missing: set[int] = set()
    meshes: dict[Path, list[Mesh]] = {}  # a leg's mesh serves four times
    for visual, frame in _visuals(robot, model):
        try:
            shapes += _visual(visual, frame, palette, mechanism.source, meshes)
        except (PinarmError, ValueError) as error:
            reason = error.message if isinstance(error, PinarmError) else str(error)
            notes.append(f"link {frame.name} is not drawn as its file says: {reason}")
            missing.add(int(frame.parentJoint))
    bare = set(range(model.njoints)) - {shape.node for shape in shapes} | missing
    return Visuals(tuple(shapes), frozenset(bare), tuple(dict.fromkeys(notes)))


def _visuals(robot: ElementTree.Element, model: pin.Model) -> Iterator[tuple[ElementTree.Element, pin.Frame]]:
    frames = {frame.name: frame for frame in model.frames if frame.type == pin.FrameType.BODY}
    for link in robot.findall("link"):
        for visual in link.findall("visual"):
            yield visual, frames[str(link.get("name"))]


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

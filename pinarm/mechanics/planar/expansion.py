"""A drawing as URDF text, which the reader of URDF loads like any other, and the joints that close its loops.

Every link has the axes of the world in the drawing, and its origin at the joint that carries it. Points are links
without mass, fixed to the first body that carries them under their own name, to the others as ``POINT_LINK``.

Pins and slots that close loops hold in the plane alone: a pin keeps two points on one line along z, a slot keeps one in
a plane normal to the drawing. So the mechanism is not hyperstatic for what a drawing does not say.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.mechanics.loops.lower_pairs import Pin, PointOnPlane, Prismatic
from pinarm.mechanics.planar.drawing import GROUND, PlanarDrawing, PlanarLink
from pinarm.mechanics.planar.linkage import DrawnJoint, Linkage, direction
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.mechanics.loops.kinds import Loop

Element = ElementTree.Element

Marks = dict[tuple[str, str], str]
"""Body and point -> name of the link without mass that stands for the point on the body."""

FAR = "1e9"
"""Limits of slides, which URDF asks for [m, N, m/s]: none that a machine reaches."""


class ExpandedDrawing(Record, frozen=True):
    """What a drawing says, in the terms of model files.

    Attributes:
        urdf: URDF text.
        loops: The joints that close loops, by name.
    """

    urdf: str
    loops: dict[str, Loop]


def expanded(drawing: PlanarDrawing) -> ExpandedDrawing:
    """Return a drawing as URDF text and loop joints.

    Raises:
        InputError: A link hangs on nothing, two are joined twice, or a mass has no place or no inertia.
    """
    linkage = Linkage.of(drawing)
    marks = _marks(drawing, linkage.closing)
    robot = ElementTree.Element("robot", name="planar")
    ElementTree.SubElement(robot, "link", name=GROUND)
    origins = {GROUND: np.zeros(2)}
    for edge in linkage.tree:
        place = origins[edge.second] = _place(drawing, edge.point)
        with within("links", edge.second):
            _add_link(robot, edge.second, drawing, place)
        _add_joint(robot, edge, place - origins[edge.first])
    for (body, point), mark in marks.items():
        ElementTree.SubElement(robot, "link", name=mark)
        joint = _joint(robot, f"{mark}_fixed", "fixed", body, mark)
        ElementTree.SubElement(joint, "origin", xyz=_text(_place(drawing, point) - origins[body]))
    ElementTree.indent(robot)
    return ExpandedDrawing(ElementTree.tostring(robot, encoding="unicode") + "\n", _loops(drawing, linkage, marks))


def _place(drawing: PlanarDrawing, point: str) -> Array:
    return np.array(drawing.points[point], float)


def _marks(drawing: PlanarDrawing, closing: Sequence[DrawnJoint]) -> Marks:
    """Return the names of all points on the bodies where they are needed."""
    wanted = [(body, point) for body, points in drawing.bodies.items() for point in points]
    wanted += [(name, link.centre) for name, link in drawing.links.items() if link.centre is not None]
    wanted += [(slot.on, slot.point) for slot in drawing.slots.values()]
    wanted += [(body, joint.point) for joint in closing for body in (joint.first, joint.second)]
    marks: Marks = {}
    for body, point in dict.fromkeys(wanted):
        marks[body, point] = f"{point}_{body}" if point in marks.values() else point
    return marks


def _add_link(robot: Element, name: str, drawing: PlanarDrawing, origin: Array) -> None:
    """Add a link with its mass; its moments about x and y, which no planar motion needs, are those of a thin plate."""
    link, body = ElementTree.SubElement(robot, "link", name=name), drawing.links[name]
    if not body.mass and not body.inertia:
        return
    centre, moment = _centre(drawing, body), _moment(drawing, name, body)
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_text(centre - origin))
    ElementTree.SubElement(inertial, "mass", value=repr(float(body.mass)))
    moments = {"ixx": moment / 2, "iyy": moment / 2, "izz": moment, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
    ElementTree.SubElement(inertial, "inertia", {key: repr(value) for key, value in moments.items()})


def _centre(drawing: PlanarDrawing, link: PlanarLink) -> Array:
    """Return where the centre of mass is in the drawing [m], shape (2,).

    Raises:
        InputError: The link has more than two points, and does not say it.
    """
    if link.centre is not None:
        return _place(drawing, link.centre)
    if len(link.points) > 2 and link.mass:
        raise InputError(f"the link has a mass and {len(link.points)} points, but no centre of mass",
                         expected="centre: the name of a point")  # fmt: skip
    return np.asarray(np.mean([_place(drawing, point) for point in link.points], axis=0))


def _moment(drawing: PlanarDrawing, name: str, link: PlanarLink) -> float:
    """Return the moment of inertia about the centre of mass [kg*m^2]: that of a rod where nothing is said.

    Raises:
        InputError: It is not said, and the link is neither a rod nor a body that slides on the ground.
    """
    if link.inertia is not None:
        return float(link.inertia)
    if len(link.points) == 2 and link.centre is None:
        ends = [_place(drawing, point) for point in link.points]
        return float(link.mass * np.sum((ends[1] - ends[0]) ** 2) / 12)
    if any(slider.link == name and slider.on == GROUND for slider in drawing.sliders.values()):
        return 0.0  # it does not turn
    raise InputError(
        "the link has a mass, but no moment of inertia",
        expected="two points and no centre, for a slender rod, or inertia: that about the centre of mass",
        hint="inertia: 0 for a point mass",
    )


def _add_joint(robot: Element, one: DrawnJoint, offset: Array) -> None:
    joint = _joint(robot, one.name, "continuous" if one.direction is None else "prismatic", one.first, one.second)
    ElementTree.SubElement(joint, "origin", xyz=_text(offset))
    if one.direction is None:
        ElementTree.SubElement(joint, "axis", xyz="0 0 1")
    else:
        ElementTree.SubElement(joint, "axis", xyz=_text(one.direction))
        ElementTree.SubElement(joint, "limit", lower=f"-{FAR}", upper=FAR, effort=FAR, velocity=FAR)


def _joint(robot: Element, name: str, kind: str, parent: str, child: str) -> Element:
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint


def _text(vector: Array) -> str:
    """Return a vector of the plane as text, with z = 0."""
    return " ".join(repr(float(part) + 0.0) for part in (*vector, 0.0))


def _loops(drawing: PlanarDrawing, linkage: Linkage, marks: Marks) -> dict[str, Loop]:
    loops: dict[str, Loop] = {}
    for joint in linkage.closing:
        between = marks[joint.first, joint.point], marks[joint.second, joint.point]
        if joint.direction is None:
            loops[joint.name] = Pin(between=between, axis="z")
        else:
            loops[joint.name] = Prismatic(between=between, axis=_spatial(joint.direction))
    for name, slot in drawing.slots.items():
        between = marks[slot.on, slot.point], marks[slot.link, slot.point]
        x, y = direction(drawing, slot.along)
        loops[name] = PointOnPlane(between=between, axis=_spatial(np.array([-y, x])))
    return loops


def _spatial(vector: Array) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), 0.0

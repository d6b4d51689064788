"""A drawing as URDF text, which the reader of URDF loads like any other, and the joints that close its loops.

Slides are part of the tree of joints wherever they form no circle by themselves, so that their ways are coordinates;
pins follow breadth first from the ground. The other pins and slides close loops, and hold in the plane alone: a pin
keeps two points on one line along z, a slot keeps one in a plane normal to the drawing. So the mechanism is not
hyperstatic for what a drawing does not say.

Every link has the axes of the world in the drawing, and its origin at the joint that carries it. Points are links
without mass, fixed to the first body that carries them under their own name, to the others as ``POINT_LINK``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.mechanics.loading.model_tree import inertia
from pinarm.mechanics.loading.urdf.writer import add_axis, add_joint, add_link
from pinarm.mechanics.loops.lower_pairs import Pin, PointOnPlane, Prismatic
from pinarm.mechanics.planar.drawing import GROUND, PlanarDrawing
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.mechanics.loops.kinds import Loop

Marks = dict[tuple[str, str], str]
"""Body and point -> name of the link without mass for the point on the body."""

FAR = "1e9"
"""Limits of slides, which URDF asks for [m, N, m/s]: none that a machine reaches."""


class ExpandedDrawing(Record, frozen=True):
    """A drawing as URDF text, and the joints that close its loops by name."""

    urdf: str
    loops: dict[str, Loop]


class DrawnJoint(Record, frozen=True):
    """A pin or a slide between two bodies.

    Attributes:
        first: The body that carries in the tree, or comes first in the file.
        point: Name of the point where it is in the drawing.
        direction: Direction of a slide, that of its coordinate, shape (3,); ``None`` for a pin.
    """

    name: str
    first: str
    second: str
    point: str
    direction: Array | None = None

    def reversed(self) -> DrawnJoint:
        """Return it with the bodies exchanged; the coordinate of a slide stays the same."""
        turned = None if self.direction is None else -self.direction
        return replace(self, first=self.second, second=self.first, direction=turned)


def expanded(drawing: PlanarDrawing) -> ExpandedDrawing:
    """Return a drawing as URDF text and loop joints."""
    tree, closing = joined(drawing)
    marks = _marks(drawing, closing)
    robot = ElementTree.Element("robot", name="planar")
    add_link(robot, GROUND)
    origins = {GROUND: np.zeros(3)}
    for joint in tree:
        place = origins[joint.second] = _place(drawing, joint.point)
        with within("links", joint.second):
            add_link(robot, joint.second, _body(drawing, joint.second, place))
        shift = pin.SE3(np.eye(3), place - origins[joint.first])
        kind = "continuous" if joint.direction is None else "prismatic"
        element = add_joint(robot, joint.name, kind, joint.first, joint.second, shift)
        add_axis(element, np.array([0.0, 0.0, 1.0]) if joint.direction is None else joint.direction)
        if joint.direction is not None:
            ElementTree.SubElement(element, "limit", lower=f"-{FAR}", upper=FAR, effort=FAR, velocity=FAR)
    for (body, point), mark in marks.items():
        add_link(robot, mark)
        shift = pin.SE3(np.eye(3), _place(drawing, point) - origins[body])
        add_joint(robot, f"{mark}_fixed", "fixed", body, mark, shift)
    ElementTree.indent(robot)
    return ExpandedDrawing(ElementTree.tostring(robot, encoding="unicode") + "\n", _loops(drawing, closing, marks))


def joined(drawing: PlanarDrawing) -> tuple[list[DrawnJoint], list[DrawnJoint]]:
    """Return the joints that carry links, from the ground outwards, and those that close loops."""
    _check_single(drawing)
    slides, pins = [*_slides(drawing)], [*_pins(drawing)]
    tree = _tree(slides, pins)
    for name in drawing.links.keys() - {joint.second for joint in tree}:
        with within("links", name):
            raise InputError(
                f"the link '{name}' hangs on nothing: no pins and slides lead from it to the ground",
                expected="a point that another link or the ground carries too, or a slide",
                hint="of a link that only slots hold: a block without mass on a slide, pinned to the link",
            )
    carried = {joint.name for joint in tree}
    return tree, [joint for joint in [*slides, *pins] if joint.name not in carried]


def _slides(drawing: PlanarDrawing) -> Iterator[DrawnJoint]:
    for name, slider in drawing.sliders.items():
        point = drawing.links[slider.link].points[0]
        yield DrawnJoint(name, slider.on, slider.link, point, _direction(drawing, slider.along))


def _pins(drawing: PlanarDrawing) -> Iterator[DrawnJoint]:
    """Yield the pins; where more than two bodies meet, the first carries all others."""
    for point in drawing.points:
        first, *others = drawing.carriers(point) or [GROUND]
        for other in others:
            yield DrawnJoint(point if len(others) == 1 else f"{point}_{other}", first, other, point)


def _check_single(drawing: PlanarDrawing) -> None:
    """Refuse two pins, two slides, or a pin and a slide, of the same two bodies: they would be one rigid body."""
    seen: dict[frozenset[str], str] = {}
    pairs = [(name, (slider.on, slider.link)) for name, slider in drawing.sliders.items()]
    pairs += [(point, pair) for point in drawing.points for pair in combinations(drawing.carriers(point), 2)]
    for name, (first, second) in pairs:
        if (before := seen.setdefault(frozenset((first, second)), name)) != name:
            with within("links", second if second != GROUND else first):
                raise InputError(
                    f"{first} and {second} are joined twice, by {before} and {name}: they are one body",
                    expected="one pin or slide between two bodies",
                    hint="one link in place of both",
                )


def _tree(slides: Sequence[DrawnJoint], pins: Sequence[DrawnJoint]) -> list[DrawnJoint]:
    """Return the joints that reach further links, from the ground on."""
    reached = {GROUND}
    sliding = _sliding(slides, GROUND, reached)
    tree, waiting = [*sliding], [(GROUND, sliding)]
    for body, slid in waiting:  # which grows while it is gone through: breadth first
        for joint in _outwards(pins, body, reached):
            sliding = _sliding(slides, joint.second, reached)
            tree += [joint, *sliding]
            waiting.append((joint.second, sliding))
        waiting += [(slide.second, []) for slide in slid]
    return tree


def _sliding(slides: Sequence[DrawnJoint], body: str, reached: set[str]) -> list[DrawnJoint]:
    """Return the slides that lead from a body to further ones, one after another."""
    bodies, chain = [body], list[DrawnJoint]()
    for carrier in bodies:
        for slide in _outwards(slides, carrier, reached):
            chain.append(slide)
            bodies.append(slide.second)
    return chain


def _outwards(joints: Sequence[DrawnJoint], body: str, reached: set[str]) -> Iterator[DrawnJoint]:
    """Yield the joints of a body with bodies that are not reached yet, and count these as reached."""
    for joint in joints:
        outward = joint if joint.first == body else joint.reversed()
        if outward.first == body and outward.second not in reached:
            reached.add(outward.second)
            yield outward


def _place(drawing: PlanarDrawing, point: str) -> Array:
    return np.array([*drawing.points[point], 0.0], float)


def _direction(drawing: PlanarDrawing, along: tuple[str, str]) -> Array:
    """Return the unit vector from the first of two points to the second, shape (3,)."""
    first, second = (_place(drawing, point) for point in along)
    way = second - first
    return np.asarray(way / np.hypot(way[0], way[1]))


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


def _body(drawing: PlanarDrawing, name: str, origin: Array) -> pin.Inertia | None:
    """Return the inertia of a link; its moments about x and y, which no planar motion needs, are of a thin plate."""
    link = drawing.links[name]
    if not link.mass and not link.inertia:
        return None
    ends = [_place(drawing, point) for point in link.points]
    if link.centre is None and len(ends) > 2 and link.mass:
        raise InputError(
            f"the link has a mass and {len(ends)} points, but no centre of mass", expected="centre: the name of a point"
        )
    centre = np.mean(ends, axis=0) if link.centre is None else _place(drawing, link.centre)
    if link.inertia is not None:
        moment = float(link.inertia)
    elif len(ends) == 2 and link.centre is None:  # a slender rod
        moment = float(link.mass * np.sum((ends[1] - ends[0]) ** 2) / 12)
    elif any(slider.link == name and slider.on == GROUND for slider in drawing.sliders.values()):
        moment = 0.0  # it does not turn
    else:
        raise InputError(
            "the link has a mass, but no moment of inertia",
            expected="two points and no centre, for a slender rod, or inertia: that about the centre of mass",
            hint="inertia: 0 for a point mass",
        )
    return inertia(link.mass, centre - origin, np.diag([moment / 2, moment / 2, moment]))


def _loops(drawing: PlanarDrawing, closing: Sequence[DrawnJoint], marks: Marks) -> dict[str, Loop]:
    loops: dict[str, Loop] = {}
    for joint in closing:
        between = marks[joint.first, joint.point], marks[joint.second, joint.point]
        if joint.direction is None:
            loops[joint.name] = Pin(between=between, axis="z")
        else:
            x, y, _ = joint.direction.tolist()
            loops[joint.name] = Prismatic(between=between, axis=(x, y, 0.0))
    for name, slot in drawing.slots.items():
        between = marks[slot.on, slot.point], marks[slot.link, slot.point]
        x, y, _ = _direction(drawing, slot.along).tolist()
        loops[name] = PointOnPlane(between=between, axis=(-y, x, 0.0))
    return loops

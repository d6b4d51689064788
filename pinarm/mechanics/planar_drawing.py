"""The drawing of a planar mechanism, in place of a model file: as URDF text, and the joints that close its loops.

Slides are part of the tree of joints wherever they form no circle by themselves, so that their ways are coordinates;
pins follow breadth first from the ground. The other pins and slides close loops, and hold in the plane alone: a pin
keeps two points on one line along z, a slot keeps one in a plane normal to the drawing. So the mechanism is not
hyperstatic for what a drawing does not say.

Every link has the axes of the world in the drawing, and its origin at the joint that carries it. Points are links
without mass, fixed to the first body that carries them under their own name, to the others as ``POINT_LINK``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Annotated
from xml.etree import ElementTree

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, choices, within
from pinarm.input.yaml.schema import Inertia, InputStruct, Mass, Position
from pinarm.mechanics.loading.model_tree import inertia
from pinarm.mechanics.loading.urdf_writer import add_axis, add_joint, add_link
from pinarm.mechanics.loops.lower_pairs import Pin, PointOnPlane, Prismatic
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.mechanics.loops.kinds import Loop

GROUND = "ground"
"""Name of the body that does not move."""

MOST = 250
"""Largest number of links, as of degrees of freedom of a model."""


class PlanarLink(InputStruct, frozen=True):
    """A rigid link of a drawing.

    Attributes:
        points: Names of the points that it carries. Where another link carries the same point, a pin joins the two.
        mass: [kg]. Between two points it is that of a slender uniform rod, ``I = m L^2/12``, unless ``centre`` or
            ``inertia`` says otherwise.
        centre: Name of the point where its centre of mass is in the drawing; the middle of two points where it is
            left out.
        inertia: Moment of inertia about the axis through the centre of mass, normal to the plane [kg*m^2]; 0 for a
            point mass.
    """

    points: list[str]
    mass: Mass = 0.0
    centre: str | None = None
    inertia: Inertia | None = None


class Slider(InputStruct, frozen=True):
    """A slide: a link moves along a straight line on another one, and does not turn against it.

    Its coordinate is the way of ``link`` on ``on`` [m], 0 in the drawing, positive from the first point of ``along`` to
    the second.

    Attributes:
        link: What slides.
        along: Two points whose line in the drawing is the direction.
        on: What it slides on: a link, such as ``carriage``, or ``ground``.
    """

    link: str
    along: tuple[str, str]
    on: str = GROUND


class Slot(InputStruct, frozen=True):
    """A pin in a straight slot: a point of a link moves along a line of another one, and the link turns freely.

    Attributes:
        link: The link with the pin, such as ``fork``.
        point: The pin, one of the points of ``link``, such as ``P``.
        along: Two points whose line in the drawing is the direction, such as ``[O, P]``; the slot runs through
            ``point``.
        on: The link with the slot, such as ``crank``, or ``ground``.
    """

    link: str
    point: str
    along: tuple[str, str]
    on: str = GROUND


class PlanarDrawing(InputStruct, frozen=True):
    """A planar mechanism in one position: points of the plane x-y, and what they belong to.

    The drawing is the position in which all joint coordinates are 0. A point that two bodies carry is a pin, a joint
    named after it, whose angle counts counter-clockwise from the drawing [rad]: of the body that is farther from the
    ground against the nearer one. Where more than two bodies meet in a point P, the first of them in the file carries
    the others, link L by the joint ``P_L``. Joints that close loops are found, and called by the same names; they are
    listed by ``explain``. A pin B among them has friction by its name, and the angle ``B.angle`` of the link that comes
    later in the file against the other one, for springs, dampers and drives; ``loop.B.force.x`` is the action of the
    link that comes first in the file on the other one. Every point is a point for outputs: ``point.P.position.x``.
    Gravity is 9.81 m/s^2 along -y unless ``gravity`` says otherwise. What acts out of the plane is carried by joints
    that close no loop: a drawing does not say more of it.

    Attributes:
        points: Name -> coordinates x and y in the drawing [m], such as ``{A: [40 mm, 80 mm]}``; or formulas of the
            ``parameters`` of the file: ``B: [l1*cos(alpha), l1*sin(alpha)]``.
        ground: Points that do not move.
        links: Moving links, by name.
        sliders: Slides, by name.
        slots: Pins in slots, by name, such as ``{s: {link: fork, point: P, along: [O, P], on: crank}}``.
    """

    points: dict[str, tuple[Position, Position]]
    ground: list[str]
    links: Annotated[dict[str, PlanarLink], msgspec.Meta(min_length=1)]
    sliders: dict[str, Slider] = {}
    slots: dict[str, Slot] = {}

    @property
    def bodies(self) -> dict[str, list[str]]:
        return {GROUND: self.ground, **{name: link.points for name, link in self.links.items()}}

    def carriers(self, point: str) -> list[str]:
        return [body for body, points in self.bodies.items() if point in points]

    def check(self) -> None:
        if len(self.links) > MOST:
            raise InputError(f"the drawing has {len(self.links)} links", expected=f"at most {MOST}")
        self._check_points("ground", points=self.ground)
        for name, link in self.links.items():
            with within("links", name):
                self._check_link(name, link)
        for name, slider in self.sliders.items():
            with within("sliders", name):
                self._check_slide(name, slider)
        for name, slot in self.slots.items():
            with within("slots", name):
                self._check_slide(name, slot)
                if slot.point not in self.bodies[slot.link]:
                    raise InputError(
                        f"the link '{slot.link}' does not carry the point '{slot.point}'",
                        expected=f"one of {', '.join(self.bodies[slot.link])}",
                    )

    def _check_link(self, name: str, link: PlanarLink) -> None:
        if name == GROUND or name in self.points:
            what = "of what does not move" if name == GROUND else "of a point"
            raise InputError(f"the link '{name}' has the name {what}", expected="a name of its own")
        if not link.points:
            with within("points"):
                raise InputError(f"the link '{name}' has no point", expected="points: names of the points it carries")
        self._check_points("points", points=link.points)
        if link.centre is not None:
            _check_known("centre", name=link.centre, what="point", known=self.points)
        for index, point in enumerate(link.points):
            for other in link.points[:index]:
                if self.points[point] == self.points[other]:
                    raise InputError(
                        f"the points {other} and {point} of the link '{name}' are at one place",
                        expected="points apart from each other",
                    )

    def _check_slide(self, name: str, slide: Slider | Slot) -> None:
        if name in self.points:
            raise InputError(f"the slide '{name}' has the name of a point", expected="a name of its own")
        _check_known("link", name=slide.link, what="link", known=self.links)
        _check_known("on", name=slide.on, what="link", known=self.bodies)
        self._check_points("along", points=slide.along)
        if slide.on == slide.link:
            raise InputError(f"the link '{slide.link}' slides on itself", expected="on: another link, or ground")
        first, second = slide.along
        if self.points[first] == self.points[second]:
            with within("along"):
                raise InputError(
                    f"the points {first} and {second} are at one place: their line has no direction",
                    expected="two points apart from each other",
                )

    def _check_points(self, *path: str, points: Iterable[str]) -> None:
        for index, point in enumerate(points):
            _check_known(*path, index, name=point, what="point", known=self.points)


def _check_known(*path: str | int, name: str, what: str, known: Iterable[str]) -> None:
    if name not in known:
        expected, hint = choices(name, known)
        with within(*path):
            raise InputError(f"the drawing has no {what} '{name}'", expected=expected, hint=hint)


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
    """Return the joints that carry links: breadth first along pins, with all slides from a body right behind it."""
    reached, slid = {GROUND}, dict[str, list[DrawnJoint]]()

    def sliding(body: str) -> list[DrawnJoint]:
        chain = slid[body] = [*_outwards(slides, body, reached)]
        for slide in chain:  # which grows while it is gone through
            chain += _outwards(slides, slide.second, reached)
        return chain

    tree, waiting = [*sliding(GROUND)], [GROUND]
    for body in waiting:
        for joint in _outwards(pins, body, reached):
            tree += [joint, *sliding(joint.second)]
            waiting.append(joint.second)
        waiting += [slide.second for slide in slid.get(body, ())]
    return tree


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

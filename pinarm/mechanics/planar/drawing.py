"""The drawing of a planar mechanism: the block ``planar`` of a mechanism file, in place of a model file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import msgspec

from pinarm.errors import InputError, choices, within
from pinarm.input.yaml.schema import Inertia, InputStruct, Mass, Position

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
        """The ground and the links, with the points that they carry."""
        return {GROUND: self.ground, **{name: link.points for name, link in self.links.items()}}

    def carriers(self, point: str) -> list[str]:
        """Return the bodies that carry a point, in the order of the file, the ground first."""
        return [body for body, points in self.bodies.items() if point in points]

    def check(self) -> None:
        """Refuse points and links that do not exist, and names that stand for two things."""
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
    """Refuse a name that the drawing does not have."""
    if name not in known:
        expected, hint = choices(name, known)
        with within(*path):
            raise InputError(f"the drawing has no {what} '{name}'", expected=expected, hint=hint)

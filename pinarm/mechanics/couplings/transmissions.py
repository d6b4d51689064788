"""Wrenches of couplings on their bodies: contact of teeth, threads and cams, strands of a belt, pure moments.

A multiplier lam is the effort at the second joint. In every motion v of the tree ``sum_k wrench_k . twist_k = lam G v``
with the row G of the coupling, as contact without friction does no work. Wrenches are given in the carrier, the body in
which both members have fixed axes.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import NamedTuple, TypeVar

import numpy as np

from pinarm.arrays import Array, magnitude
from pinarm.input.units import Unit, unit
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import crossed, moved
from pinarm.mechanics.joints import Joint
from pinarm.records import AbstractRecord, Record, replace

NEWTON, NEWTON_METRE = unit("N"), unit("N*m")

FixedT = TypeVar("FixedT", bound="FixedContact")


class Kink(NamedTuple):
    """Where wrenches that depend on a size, as a multiplier, change their slope: ``|size - at| wrench`` is among them.

    Attributes:
        at: The size there [N*m or N].
        wrenches: Joint index -> [f; m] at the world's origin, per size, shape (6,).
    """

    at: float
    wrenches: dict[int, Array]


class Part(NamedTuple):
    """A single force or moment of a transmission."""

    unit: Unit
    size: float
    keeps: bool = False

    def at(self, lam: Array) -> Array:
        """Return it at multipliers [N or N*m], shape (n,)."""
        return np.asarray(self.size * (magnitude(lam) if self.keeps else lam))


class Transmission(AbstractRecord, frozen=True):
    """Action of two members on one carrier on each other.

    Attributes:
        carrier: Index of the joint that moves the carrier; 0 for the ground.
        first: Index of the joint that moves the first member.
        second: Index of the joint that moves the second one.
        words: Transmitting parts, such as ``two strands, pretension 50 N``.
    """

    carrier: int
    first: int
    second: int
    words: str = ""

    @abstractmethod
    def place(self, q: Array) -> Array:
        """Return where the second member is acted on, in the carrier [m], shape (3,), or (n, 3) where it moves."""

    @abstractmethod
    def in_carrier(self, q: Array, lam: Array) -> dict[int, Array]:
        """Return wrenches of multipliers, shape (.., n): joint index -> [f; m] at the carrier's origin, (.., n, 6)."""

    @abstractmethod
    def parts(self) -> dict[str, Unit]:
        """Return the names of single forces, moments and measures, with their units."""

    @abstractmethod
    def part(self, name: str, q: Array, lam: Array) -> Array:
        """Return one of them at configurations, shape (n, nq), with multipliers, shape (n,), as an array (n,)."""

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        """Return where the wrenches at one configuration change their slope."""
        return []

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return the wrenches of multipliers at the world's origin, world axes: joint index -> [f; m], (.., n, 6)."""
        return {body: outwards(links, self.carrier, x) for body, x in self.in_carrier(links.q, lam).items()}

    def transmitted(self, links: LinkPlacements, lam: Array) -> tuple[Array, Array]:
        """Return where the second member is acted on [m], (n, 3), and [f; m] on it there, world axes, (n, 6)."""
        turn, place = links.turns[:, self.carrier], links.places[:, self.carrier]
        point = place + np.matvec(turn, self.place(links.q))
        return point, moved(self.wrenches(links, lam)[self.second], -point)


class FixedContact(Transmission, frozen=True, kw_only=True):
    """Wrenches that are constant in the carrier, linear in the multiplier but for kinks.

    On the second member acts ``lam wrench + sum_k |lam - at_k| fold_k``, on the first one the opposite, or
    ``lam back``; the carrier has what keeps their sum 0.

    Attributes:
        point: Where the force on the second member is said to act, in the carrier [m], shape (3,).
        wrench: On the second member, of a unit multiplier, [f; m] at the carrier's origin, shape (6,).
        folds: Multipliers at which the wrenches change their slope, with half of the change, shape (6,).
        back: On the first member, where it is not the opposite, shape (6,).
        surfaces: Of teeth in mesh: their force along the pitch surfaces changes sides with lam, the one across them
            presses members apart. Which flanks touch follows from the sign of lam; there is no backlash.
    """

    point: Array
    wrench: Array
    folds: tuple[tuple[float, Array], ...] = ()
    single: Mapping[str, Part] = {}
    back: Array | None = None
    surfaces: PitchSurfaces | None = None

    def place(self, q: Array) -> Array:
        return self.point

    def in_carrier(self, q: Array, lam: Array) -> dict[int, Array]:
        second = np.multiply.outer(lam, self.wrench)
        for at, fold in self.folds:
            second = second + np.multiply.outer(magnitude(lam - at), fold)
        if self.back is None:
            return {self.second: second, self.first: -second}
        first = np.multiply.outer(lam, self.back)
        return {self.second: second, self.first: first, self.carrier: -second - first}

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        folds = [(at, outwards(links, self.carrier, fold[None])[0]) for at, fold in self.folds]
        return [Kink(at, {self.second: fold, self.first: -fold}) for at, fold in folds]

    def scaled(self: FixedT, factor: float) -> FixedT:
        """Return the transmission of a size x that gives the multiplier ``factor x``; the factor is positive."""
        folds = tuple((at / factor, factor * fold) for at, fold in self.folds)
        return replace(self, wrench=factor * self.wrench, folds=folds)

    def parts(self) -> dict[str, Unit]:
        return {name: part.unit for name, part in self.single.items()}

    def part(self, name: str, q: Array, lam: Array) -> Array:
        return self.single[name].at(lam)


class PitchSurfaces(Record, frozen=True):
    """Rolling contact of two toothed members at their pitch point.

    Attributes:
        line: l, unit vector along the pitch line in the carrier, shape (3,).
        rates: Joint -> its part in ``l . (w1 - w2)``, the angular velocity of the first member against the second.
        radii: Pitch radii of the members [m]; infinite of a rack.
        curvatures: Of the pitch surfaces across the pitch line [1/m]: ``1/r`` of a cylinder, ``cos(delta)/r`` of a
            cone with the angle delta, 0 of a rack, negative of inner teeth.
        pressure_angle: alpha, in the section normal to the teeth [rad].
        helix_angle: beta, of the first member [rad].
    """

    line: Array
    rates: Mapping[Joint, float]
    radii: tuple[float, float]
    curvatures: tuple[float, float]
    pressure_angle: float
    helix_angle: float


class Strands(FixedContact, frozen=True, kw_only=True):
    """The two strands of a belt or chain, tensions F0 + D/2 and F0 - D/2; a strand that would be pushed is slack.

    D, the difference of the tensions, is proportional to the multiplier. With a slack strand the other one carries D:
    the sum of the tensions is ``|D - 2 F0| / 2 + |D + 2 F0| / 2``.

    Attributes:
        difference: Tension of strand 1 less that of strand 2, of a unit multiplier [1/m].
        pretension: F0, the tension of both without a multiplier [N].
        wrap: Angle by which the belt lies on that wheel on which it is less [rad].
    """

    difference: float
    pretension: float
    wrap: float

    def parts(self) -> dict[str, Unit]:
        return {"tight": NEWTON, "slack": NEWTON}

    def part(self, name: str, q: Array, lam: Array) -> Array:
        half = 0.5 * magnitude(self.difference * lam)
        left = self.pretension - half
        if name == "tight":
            return np.asarray(np.where(np.real(left) < 0.0, 2.0 * half, self.pretension + half))
        return np.asarray(np.where(np.real(left) < 0.0, 0.0, left))


def at_origin(point: Array, force: Array) -> Array:
    """Return [f; m] about the origin, shape (6,), of a force at a point."""
    return np.concatenate([force, np.cross(point, force)])


def outwards(links: LinkPlacements, carrier: int, wrench: Array) -> Array:
    """Return wrenches [f; m] at the world's origin from those in the frame of a joint, shape (.., n, 6)."""
    turn, place = links.turns[:, carrier], links.places[:, carrier]
    force, moment = np.matvec(turn, wrench[..., :3]), np.matvec(turn, wrench[..., 3:])
    return np.concatenate([force, moment + crossed(place, force)], axis=-1)

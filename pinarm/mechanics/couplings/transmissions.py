"""Wrenches of couplings on their bodies: contact of teeth and threads, strands of a belt, pure moments.

A multiplier lam is the effort at the second joint. In every motion v of the tree ``sum_k wrench_k . twist_k = lam G v``
with the row G of the coupling, as contact without friction does no work. The wrenches are constant in the carrier, the
body in which both members have fixed axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeVar

import numpy as np

from pinarm.arrays import Array, magnitude
from pinarm.input.units import Unit, unit
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.joints import Joint
from pinarm.records import Record, replace

NEWTON, NEWTON_METRE = unit("N"), unit("N*m")

TransmissionT = TypeVar("TransmissionT", bound="Transmission")


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


class Transmission(Record, frozen=True):
    """Wrenches of a multiplier on the bodies that it couples, linear in it but for kinks.

    On the second member acts ``lam wrench + sum_k |lam - at_k| fold_k``, on the first one the opposite, or
    ``lam back``; the carrier has what keeps their sum 0.

    Attributes:
        carrier: Index of the joint that moves the carrier; 0 for the ground.
        first: Index of the joint that moves the first member.
        second: Index of the joint that moves the second one.
        point: Where the force on the second member is said to act, in the carrier [m], shape (3,).
        wrench: On the second member, of a unit multiplier, [f; m] at the carrier's origin, shape (6,).
        folds: Multipliers at which the wrenches change their slope, with half of the change, shape (6,).
        back: On the first member, where it is not the opposite, shape (6,).
    """

    carrier: int
    first: int
    second: int
    point: Array
    wrench: Array
    words: str = ""
    folds: tuple[tuple[float, Array], ...] = ()
    single: Mapping[str, Part] = {}
    back: Array | None = None

    def wrenches(self, lam: Array) -> dict[int, Array]:
        """Return the wrenches of multipliers, shape (n,): joint index -> [f; m] at the carrier's origin, (n, 6)."""
        second = np.multiply.outer(lam, self.wrench)
        for at, fold in self.folds:
            second = second + np.multiply.outer(magnitude(lam - at), fold)
        if self.back is None:
            return {self.second: second, self.first: -second}
        first = np.multiply.outer(lam, self.back)
        return {self.second: second, self.first: first, self.carrier: -second - first}

    def on_links(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return the wrenches of multipliers at the world's origin, world axes: joint index -> [f; m], (n, 6)."""
        return {body: outwards(links, self.carrier, wrench) for body, wrench in self.wrenches(lam).items()}

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        folds = [(at, outwards(links, self.carrier, fold[None])[0]) for at, fold in self.folds]
        return [Kink(at, {self.second: fold, self.first: -fold}) for at, fold in folds]

    def scaled(self: TransmissionT, factor: float) -> TransmissionT:
        """Return the transmission of a size x that gives the multiplier ``factor x``; the factor is positive."""
        folds = tuple((at / factor, factor * fold) for at, fold in self.folds)
        return replace(self, wrench=factor * self.wrench, folds=folds)

    def parts(self) -> dict[str, Unit]:
        return {name: part.unit for name, part in self.single.items()}

    def part(self, name: str, lam: Array) -> Array:
        """Return one of them [N or N*m], shape (n,)."""
        part = self.single[name]
        return np.asarray(part.size * (magnitude(lam) if part.keeps else lam))


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


class ToothContact(Transmission, frozen=True, kw_only=True):
    """Teeth in mesh: a force along the pitch surfaces changes sides with lam, one across them presses members apart.

    Which flanks touch follows from the sign of lam; there is no backlash.
    """

    surfaces: PitchSurfaces


class ThreadContact(Transmission, frozen=True, kw_only=True):
    """A thread but for its friction: a force F along the axis of the screw, and the moment ``h F`` about it.

    Attributes:
        about: Moment on the second member of a unit multiplier, about a point of the axis [m], shape (3,).
        pitch: h, way of the second joint per angle of the first [m].
    """

    about: Array
    pitch: float


class Strands(Transmission, frozen=True, kw_only=True):
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

    @classmethod
    def between(
        cls, members: tuple[int, int, int], point: Array, pulls: Array, difference: float, pretension: float,
        wrap: float,
    ) -> Strands:  # fmt: skip
        """Return strands of carrier and wheels; ``pulls`` are their wrenches on the second wheel at unit tension."""
        slack, share = 2.0 * pretension / abs(difference), 0.25 * abs(difference) * pulls.sum(axis=0)
        along, words = 0.5 * difference * (pulls[0] - pulls[1]), f"two strands, pretension {pretension:.6g} N"
        return cls(
            *members, point, along, words, ((slack, share), (-slack, share)),
            difference=difference, pretension=pretension, wrap=wrap,
        )  # fmt: skip

    def parts(self) -> dict[str, Unit]:
        return {"tight": NEWTON, "slack": NEWTON}

    def part(self, name: str, lam: Array) -> Array:
        half = 0.5 * magnitude(self.difference * lam)
        left = self.pretension - half
        if name == "tight":
            return np.asarray(np.where(np.real(left) < 0.0, 2.0 * half, self.pretension + half))
        return np.asarray(np.where(np.real(left) < 0.0, 0.0, left))


def at_origin(point: Array, force: Array) -> Array:
    """Return [f; m] about the origin, shape (6,), of a force at a point."""
    return np.concatenate([force, np.cross(point, force)])


def outwards(links: LinkPlacements, carrier: int, wrench: Array) -> Array:
    """Return wrenches [f; m] at the world's origin from those in the frame of a joint, shape (n, 6)."""
    turn, place = links.turns[:, carrier], links.places[:, carrier]
    force, moment = np.matvec(turn, wrench[..., :3]), np.matvec(turn, wrench[..., 3:])
    return np.concatenate([force, moment + crossed(place, force)], axis=-1)

"""What holds a coupling, as wrenches on its bodies: teeth, threads, the strands of a belt, or pure moments.

A multiplier lam is the effort at the second joint. The wrenches are those bodies' share, ``sum_k wrench_k . twist_k``
being lam times the row of the coupling in every motion of the tree, as contact without friction does no work. They are
constant in the carrier, the body in which both members have fixed axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from pinarm.arrays import Array, magnitude
from pinarm.input.units import Unit, unit
from pinarm.mechanics.joints import Joint
from pinarm.records import Record

NEWTON, NEWTON_METRE = unit("N"), unit("N*m")


class Transmission(Protocol):
    """How a coupling transmits its multiplier."""

    @property
    def carrier(self) -> int:
        """Index of the joint that moves the carrier; 0 for the ground."""
        ...

    @property
    def second(self) -> int:
        """Index of the joint that moves the second member."""
        ...

    @property
    def first(self) -> int:
        """Index of the joint that moves the first member."""
        ...

    @property
    def point(self) -> Array:
        """Where the force on the second member is said to act, in the carrier [m], shape (3,)."""
        ...

    def wrenches(self, lam: Array) -> dict[int, Array]:
        """Return what multipliers, shape (n,), do to bodies: joint index -> [f; m] at the carrier's origin, (n, 6)."""
        ...

    @property
    def kinks(self) -> list[tuple[float, Array]]:
        """Multipliers at which the wrenches, linear between, change their slope, and K, shape (6,), of each.

        ``|lam - at| K`` is a part of the wrench on the second member, its opposite of that on the first.
        """
        ...

    def parts(self) -> dict[str, Unit]:
        """Return the names of its single forces and moments, with their units."""
        ...

    def part(self, name: str, lam: Array) -> Array:
        """Return one of them [N or N*m], shape (n,)."""
        ...

    def __str__(self) -> str:
        """Return it in words."""
        ...


def _at_origin(point: Array, force: Array) -> Array:
    """Return [f; m] about the origin of forces, shape (n, 3), at a point, shape (3,)."""
    return np.concatenate([force, np.cross(point, force)], axis=-1)


class PitchSurfaces(Record, frozen=True):
    """How two members with teeth roll on each other at their pitch point.

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


class ToothContact(Record, frozen=True):
    """Teeth in mesh. The force on the second member at the pitch point is ``lam along + |lam| apart``.

    Which flanks touch follows from the sign of lam; there is no backlash.

    Attributes:
        carrier: Index of the joint that moves the carrier.
        first: Index of the joint that moves the first member.
        second: Index of the joint that moves the second one.
        point: The pitch point in the carrier [m], shape (3,).
        along: Force of a unit multiplier that changes sides with it, along the pitch surfaces [1/m or 1], shape (3,).
        apart: Force of a unit multiplier that always presses the members apart, shape (3,).
        components: Name -> its value for a unit multiplier, and whether it keeps its sign.
        words: Kind of mesh, with its radii and angles.
        surfaces: On which the members roll on each other.
    """

    carrier: int
    first: int
    second: int
    point: Array
    along: Array
    apart: Array
    components: dict[str, tuple[float, bool]]
    words: str
    surfaces: PitchSurfaces

    def wrenches(self, lam: Array) -> dict[int, Array]:
        force = np.multiply.outer(lam, self.along) + np.multiply.outer(magnitude(lam), self.apart)
        wrench = _at_origin(self.point, force)
        return {self.second: wrench, self.first: -wrench}

    @property
    def kinks(self) -> list[tuple[float, Array]]:
        return [(0.0, _at_origin(self.point, self.apart))]

    def parts(self) -> dict[str, Unit]:
        return dict.fromkeys(self.components, NEWTON)

    def part(self, name: str, lam: Array) -> Array:
        size, keeps = self.components[name]
        return np.asarray(size * (magnitude(lam) if keeps else lam))

    def __str__(self) -> str:
        return self.words


class ThreadContact(Record, frozen=True):
    """A thread but for its friction: a force F along the axis of the screw, and the moment ``h F`` about it.

    Attributes:
        carrier: Index of the joint that moves the carrier.
        first: Index of the joint that moves the member that turns.
        second: Index of the joint that moves the member that slides.
        point: A point of the screw's axis in the carrier [m], shape (3,).
        along: Force on the second member of a unit multiplier: the direction in which it slides, shape (3,).
        about: Moment on the second member of a unit multiplier [m], shape (3,).
        pitch: h, way of the second joint per angle of the first [m].
    """

    carrier: int
    first: int
    second: int
    point: Array
    along: Array
    about: Array
    pitch: float

    def wrenches(self, lam: Array) -> dict[int, Array]:
        unit_wrench = _at_origin(self.point, self.along)
        unit_wrench[3:] += self.about
        wrench = np.multiply.outer(lam, unit_wrench)
        return {self.second: wrench, self.first: -wrench}

    @property
    def kinks(self) -> list[tuple[float, Array]]:
        """Nothing: its wrenches are linear."""
        return []

    def parts(self) -> dict[str, Unit]:
        return {"axial": NEWTON, "torque": NEWTON_METRE}

    def part(self, name: str, lam: Array) -> Array:
        """Return the force along the second joint [N], or the moment about the first one's axis [N*m], shape (n,)."""
        return np.asarray(lam if name == "axial" else self.pitch * lam)

    def __str__(self) -> str:
        return f"thread, lead {2e3 * np.pi * self.pitch:.6g} mm"


class Strands(Record, frozen=True):
    """The two strands of a belt or chain, tensions F0 + D/2 and F0 - D/2; a strand that would be pushed is slack.

    D, the difference of the tensions, is proportional to the multiplier. With a slack strand the other one carries D.

    Attributes:
        carrier: Index of the joint that moves the carrier.
        first: Index of the joint that moves the first wheel.
        second: Index of the joint that moves the second one.
        point: Middle of the second wheel in the carrier [m], shape (3,).
        pulls: Wrenches on the second wheel of unit tensions [f; m] at the carrier's origin, shape (2, 6).
        difference: Tension of strand 1 less that of strand 2, of a unit multiplier [1/m].
        pretension: F0, the tension of both without a multiplier [N].
        wrap: Angle by which the belt lies on that wheel on which it is less [rad].
    """

    carrier: int
    first: int
    second: int
    point: Array
    pulls: Array
    difference: float
    pretension: float
    wrap: float

    def tensions(self, lam: Array) -> Array:
        """Return the tensions of the strands [N], shape (n, 2)."""
        apart = self.difference * lam
        one = np.maximum(self.pretension + apart / 2.0, np.maximum(apart, 0.0))
        return np.stack([one, one - apart], axis=-1)

    def wrenches(self, lam: Array) -> dict[int, Array]:
        wrench = self.tensions(lam) @ self.pulls
        return {self.second: wrench, self.first: -wrench}

    @property
    def kinks(self) -> list[tuple[float, Array]]:
        """Where a strand becomes slack: the sum of the tensions is ``|D - 2 F0| / 2 + |D + 2 F0| / 2``."""
        slack, share = 2.0 * self.pretension / abs(self.difference), abs(self.difference) / 4.0
        return [(sign * slack, share * self.pulls.sum(axis=0)) for sign in (1.0, -1.0)]

    def parts(self) -> dict[str, Unit]:
        return {"tight": NEWTON, "slack": NEWTON}

    def part(self, name: str, lam: Array) -> Array:
        tensions = self.tensions(lam)
        return np.asarray(tensions.max(axis=1) if name == "tight" else tensions.min(axis=1))

    def __str__(self) -> str:
        return f"two strands, pretension {self.pretension:.6g} N"


class PureMoments(Record, frozen=True):
    """Moments only, as of planets evenly spaced between coaxial wheels: their forces cancel on every member.

    Attributes:
        carrier: Index of the joint that moves the carrier.
        first: Index of the joint that moves the first member.
        second: Index of the joint that moves the second one.
        point: Origin of the second joint in the carrier [m], shape (3,).
        moments: Moments of a unit multiplier on the second member, the first and the carrier, shape (3, 3).
        planets: Number of planets.
    """

    carrier: int
    first: int
    second: int
    point: Array
    moments: Array
    planets: int

    def wrenches(self, lam: Array) -> dict[int, Array]:
        bodies, couples = (self.second, self.first, self.carrier), np.zeros((3, 6))
        couples[:, 3:] = self.moments
        return {body: np.multiply.outer(lam, couple) for body, couple in zip(bodies, couples, strict=True)}

    @property
    def kinks(self) -> list[tuple[float, Array]]:
        """Nothing: its wrenches are linear."""
        return []

    def parts(self) -> dict[str, Unit]:
        """Return nothing: the moment is the effort."""
        return {}

    def part(self, name: str, lam: Array) -> Array:
        """Raise: there is none."""
        raise KeyError(name)

    def __str__(self) -> str:
        return f"moments only, shared by {self.planets} evenly spaced planets"

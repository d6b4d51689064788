"""What acts between the two links of a joint by itself: springs, dampers and friction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.records import AbstractRecord


class SpringDamper(AbstractRecord, ForceElement, frozen=True):
    """Linear springs and dampers at joints: ``load = -stiffness (q - rest) - damping v``.

    Potential energy ``stiffness (q - rest)^2 / 2``, dissipated power ``damping v^2``, summed over the joints.

    Attributes:
        q: Indices in q, shape (k,).
        v: Indices in v, shape (k,).
        stiffness: [N*m/rad or N/m], shape (k,).
        damping: [N*m*s/rad or N*s/m], shape (k,).
        rest: Coordinate at which the spring is free [rad or m], shape (k,).
    """

    q: Indices
    v: Indices
    stiffness: Array
    damping: Array
    rest: Array

    @classmethod
    def sum(cls, elements: Sequence[SpringDamper]) -> SpringDamper:
        """Return the element whose load is the sum of theirs; its energy differs by a constant."""
        size = max((int(element.v.max(initial=-1)) for element in elements), default=-1) + 1
        sums, places = np.zeros((3, size)), np.zeros(size, np.intp)
        for element in elements:
            sums[:, element.v] += [element.stiffness, element.damping, element.stiffness * element.rest]
            places[element.v] = element.q
        kept = np.flatnonzero(sums[:2].any(axis=0))
        stiffness, damping, pull = sums[:, kept]
        rest = np.divide(pull, stiffness, out=np.zeros(len(kept)), where=stiffness > 0.0)
        return cls(places[kept], kept, stiffness, damping, rest)

    @classmethod
    def together(cls, elements: Sequence[SpringDamper]) -> SpringDamper:
        """Return the element whose energy and power are the sums of theirs; a joint may stand in it several times."""
        parts = zip(*((each.q, each.v, each.stiffness, each.damping, each.rest) for each in elements), strict=True)
        return cls(*map(np.concatenate, parts))

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        places, rates = self._places
        load = self.stiffness * (q[..., places] - self.rest)
        if self._damped:
            load += self.damping * v[..., rates]
        tau[..., rates] -= load

    def within(self, kept_q: Indices, kept_v: Indices) -> SpringDamper:
        """Return the springs and dampers at the joints of a part; the energy of the others is left out."""
        mine = np.isin(self.v, kept_v)
        numbers = (numbers[mine] for numbers in (self.stiffness, self.damping, self.rest))
        places = np.searchsorted(kept_q, self.q[mine]), np.searchsorted(kept_v, self.v[mine])
        return SpringDamper(*places, *numbers)

    @cached_property
    def _damped(self) -> bool:
        return bool(self.damping.any())

    @cached_property
    def _places(self) -> tuple[slice | Indices, slice | Indices]:
        """The indices, as slices where they follow one another: these are read without a copy."""
        return _following(self.q), _following(self.v)

    def potential_energy(self, q: Array) -> Array:
        moved = q[..., self._places[0]] - self.rest
        return np.asarray(0.5 * np.vecdot(self.stiffness * moved, moved))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        rates = v[..., self._places[1]]
        return np.asarray(np.vecdot(self.damping * rates, rates))

    @property
    def conservative(self) -> bool:
        return not self.damping.any()


class BallSpring(AbstractRecord, ForceElement, frozen=True):
    """Spring of a ball joint to its zero: ``load = -stiffness w``, with the rotation vector w, ``R = exp([w])``.

    Potential energy ``stiffness |w|^2 / 2``. It jumps at half a turn, where the shortest way back changes sides.

    Attributes:
        q: Index in q of the joint's quaternion (x, y, z, w).
        v: Index in v of its angular velocity, child's axes.
        stiffness: [N*m/rad].
    """

    q: int
    v: int
    stiffness: float

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v : self.v + 3] -= self.stiffness * self._rotation(q)

    def potential_energy(self, q: Array) -> Array:
        return np.asarray(0.5 * self.stiffness * (self._rotation(q) ** 2).sum(axis=-1))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        return np.zeros(v.shape[:-1])

    @property
    def conservative(self) -> bool:
        """Whether it is: a spring alone."""
        return True

    def _rotation(self, q: Array) -> Array:
        """Return the rotation vectors, shape (..., 3); ``w = 2 atan(n / c) u`` for the quaternion (n u, c)."""
        vector, c = q[..., self.q : self.q + 3], q[..., self.q + 3 : self.q + 4]
        n, sign = np.sqrt((vector * vector).sum(axis=-1, keepdims=True)), np.where(c < 0.0, -1.0, 1.0)
        half = np.arctan2(n, sign * c) if np.isrealobj(q) else np.arctan(n / (sign * c))  # of a complex step
        return np.asarray(vector * sign * 2.0 * half / np.where(n == 0.0, 1.0, n))


class DryFriction(AbstractRecord, ForceElement, frozen=True):
    """Coulomb friction at joints, regularised: ``load = -friction tanh(v / creep)``.

    Right within 1e-4 of its bound where ``|v| > 5 creep``. A joint that ought to stick creeps with
    ``v = creep atanh(load / friction)`` instead. Small values of creep make forward problems stiff.

    Attributes:
        v: Indices in v, shape (k,).
        friction: Largest load [N*m or N], shape (k,).
        creep: [rad/s or m/s], shape (k,).
    """

    v: Indices
    friction: Array
    creep: Array

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v] -= self.friction * np.tanh(v[..., self.v] / self.creep)

    def potential_energy(self, q: Array) -> Array:
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        rates = v[..., self.v]
        return np.asarray((self.friction * np.tanh(rates / self.creep) * rates).sum(axis=-1))


def _following(indices: Indices) -> slice | Indices:
    """Return the slice of indices that follow one another, otherwise these."""
    if not len(indices):
        return indices
    first, last = int(indices[0]), int(indices[-1]) + 1
    return slice(first, last) if np.array_equal(indices, np.arange(first, last)) else indices


def summed(forces: Iterable[ForceElement]) -> tuple[ForceElement, ...]:
    """Return elements with the same load in all, the springs and dampers at joints as one."""
    springs, others = _springs(forces)
    return (SpringDamper.sum(springs), *others) if springs else others


def energetic(forces: Iterable[ForceElement]) -> tuple[ForceElement, ...]:
    """Return elements with the same energy and power in all, the springs and dampers at joints as one."""
    springs, others = _springs(forces)
    return (SpringDamper.together(springs), *others) if springs else others


def _springs(forces: Iterable[ForceElement]) -> tuple[list[SpringDamper], tuple[ForceElement, ...]]:
    """Return the springs and dampers at joints, and the other elements."""
    known = tuple(forces)
    springs = [force for force in known if isinstance(force, SpringDamper)]
    return springs, tuple(force for force in known if not isinstance(force, SpringDamper))

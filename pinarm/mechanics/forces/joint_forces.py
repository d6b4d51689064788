"""Springs, dampers and regularised friction at joints of the tree, several in one element."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.records import AbstractRecord

CREEP = 1e-3
"""Velocity below which regularised friction gives way [rad/s or m/s], where a file gives none."""


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

    def within(self, kept_q: Indices, kept_v: Indices) -> SpringDamper:
        """Return the springs and dampers at the joints of a part of the mechanism; the energy of others is left out."""
        mine = np.isin(self.v, kept_v)
        numbers = (numbers[mine] for numbers in (self.stiffness, self.damping, self.rest))
        places = np.searchsorted(kept_q, self.q[mine]), np.searchsorted(kept_v, self.v[mine])
        return SpringDamper(*places, *numbers)

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        load = self.stiffness * (q[..., self.q] - self.rest)
        if self._damped:
            load += self.damping * v[..., self.v]
        tau[..., self.v] -= load

    @cached_property
    def _damped(self) -> bool:
        return bool(self.damping.any())

    def potential_energy(self, q: Array) -> Array:
        moved = q[..., self.q] - self.rest
        return np.asarray(0.5 * (self.stiffness * moved * moved).sum(axis=-1))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        rates = v[..., self.v]
        return np.asarray((self.damping * rates * rates).sum(axis=-1))

    @property
    def conservative(self) -> bool:
        return not self._damped


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
        tau[..., self.v : self.v + 3] -= self.stiffness * self._rotation(q)

    def potential_energy(self, q: Array) -> Array:
        return np.asarray(0.5 * self.stiffness * (self._rotation(q) ** 2).sum(axis=-1))

    @property
    def conservative(self) -> bool:
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
        tau[..., self.v] -= self.friction * np.tanh(v[..., self.v] / self.creep)

"""Inverse dynamics of one state after another, as controllers need it: the efforts that give drives accelerations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.coordinate_partition import CoordinatePartition
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.joints import Joint
from pinarm.mechanics.laws.motion_law import MotionLaw


def demanded(dynamics: Dynamics, t: float, q: Array, v: Array, a: Array) -> Array:
    """Return ``M a + nle - loads`` of one state, shape (nv,)."""
    efforts = np.asarray(pin.rnea(dynamics.model, dynamics.data, q, v, a))
    return efforts - dynamics.loads(t, q, v) if dynamics.forces else efforts


@dataclass(frozen=True, eq=False)
class InverseOfTree:
    """Inverse dynamics of an open chain whose joints are all driven: ``M a + nle - loads``.

    Attributes:
        dynamics: The equation of motion.
        order: Indices in v of the drives, shape (nv,).
    """

    dynamics: Dynamics
    order: Array

    def __call__(self, t: Array | float, q: Array, v: Array, a: Array) -> Array:
        whole = np.empty_like(v)
        whole[..., self.order] = a
        if q.ndim > 1:
            return np.asarray(self.dynamics.inverse(t, q, v, whole)[:, self.order])
        return np.asarray(demanded(self.dynamics, t, q, v, whole)[self.order])  # type: ignore[arg-type]


class InverseByState(ABC):
    """Inverse dynamics that is solved for one state after another.

    Attributes:
        count: Number k of drives.
    """

    count: int

    def __call__(self, t: Array | float, q: Array, v: Array, a: Array) -> Array:
        """Return the efforts of the drives, shape (..., k)."""
        if q.ndim == 1:
            return self.efforts(float(t), q, v, a)
        times = np.broadcast_to(np.asarray(t, float), len(q)).tolist()
        return np.array([self.efforts(*state) for state in zip(times, q, v, a, strict=True)]).reshape(
            len(q), self.count
        )

    @abstractmethod
    def efforts(self, t: float, q: Array, v: Array, a: Array) -> Array:
        """Return the efforts that give the drives accelerations a, shape (k,), in one state."""


@dataclass(frozen=True, eq=False)
class InverseOfCouplings(InverseByState):
    """Inverse dynamics of a tree with couplings, ``v = T u`` of its independent velocities u, the drives among them.

    What is not driven has no effort: ``T_p^T (M T u' + nle - loads) = 0``.

    Attributes:
        dynamics: The equation of motion.
        basis: T, shape (nv, nu), the drives first.
        count: Number of drives.
    """

    dynamics: Dynamics
    basis: Array
    count: int

    def efforts(self, t: float, q: Array, v: Array, a: Array) -> Array:
        """Return the efforts that give the drives accelerations a; see ``InverseByState``."""
        driven, passive = self.basis[:, : self.count], self.basis[:, self.count :]
        whole = driven @ a
        demand = demanded(self.dynamics, t, q, v, whole)
        if passive.shape[1]:
            moved = mass_matrix(self.dynamics.model, q) @ passive
            demand = demand - moved @ np.linalg.solve(passive.T @ moved, passive.T @ demand)
        return np.asarray(demand @ driven)


def inverse_of_couplings(dynamics: Dynamics, closure: Closure, joints: Sequence[Joint]) -> InverseOfCouplings | None:
    """Return the inverse dynamics of a tree with linear couplings; ``None`` of other mechanisms, and dependent drives.

    Args:
        dynamics: The equation of motion.
        closure: The constraints.
        joints: Those that are driven.
    """
    couplings = [one for one in closure.constraints if isinstance(one, Coupling)]
    if not couplings or len(couplings) < len(closure.constraints) or closure.redundant:
        return None
    drives: Indices = np.array([joint.v for joint in joints], dtype=np.intp)
    rows, names = np.array([one.coordinate.weights for one in couplings]), [one.name for one in couplings]
    partition = CoordinatePartition.of(closure.model, rows, names, drives.tolist())
    if not np.isin(drives, partition.free_v).all():
        return None
    others = np.setdiff1d(partition.free_v, drives)
    places = np.searchsorted(partition.free_v, np.concatenate([drives, others]))
    return InverseOfCouplings(dynamics, partition.basis[:, places], len(drives))


@dataclass(frozen=True, eq=False)
class InverseOfLoops(InverseByState):
    """Inverse dynamics where other joints follow: ``M a + nle = loads + G^T lam``, see ``dynamics.equation``.

    Attributes:
        dynamics: The equation of motion.
        rows: G: the constraints, coordinates that follow laws, and at the end the drives.
        laws: Of these coordinates.
        count: Number of drives.
    """

    dynamics: Dynamics
    rows: Closure
    laws: tuple[MotionLaw, ...]
    count: int

    def efforts(self, t: float, q: Array, v: Array, a: Array) -> Array:
        """Return the efforts that give the drives accelerations a; see ``InverseByState``."""
        state, wanted = self.rows.state(q, v), [law.on(t, t)(np.array([t]))[2][0] for law in self.laws]
        right = -self.rows.drift(state)
        right[len(right) - self.count - len(wanted) :] += [*wanted, *a]
        split, mass = self.rows.split(self.rows.rows(state)), mass_matrix(self.dynamics.model, q)
        force = -self.dynamics.inverse(t, q[None], v[None], np.zeros((1, len(v))))[0]
        moved = solve(split, mass, force, right)
        return split.multipliers(mass @ moved - force)[-self.count :]

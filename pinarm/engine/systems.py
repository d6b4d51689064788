"""What a time integration integrates: all coordinates of a tree, or those that linear constraints leave free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.assembly import Imposed
from pinarm.engine.dynamics import Dynamics
from pinarm.engine.integrators import Acceleration, Flat, Manifold
from pinarm.engine.reduction import Reduction
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.motion import Grid

CONTRADICTION = 1e-9
"""Difference between an initial value and what the laws say that typed digits explain [rad, m, rad/s or m/s]."""


class System(Protocol):
    """The state of an integration and how it belongs to that of the mechanism."""

    @property
    def manifold(self) -> Manifold:
        """Space of the integrated configurations."""
        ...

    def begin(self, q: Array, v: Array, start: float, end: float) -> tuple[Array, Array]:
        """Return the integrated state that belongs to a state of the mechanism at the start of a stretch."""
        ...

    def acceleration(self, dynamics: Dynamics, start: float, end: float) -> Acceleration:
        """Return the acceleration of the integrated state on a stretch of time without jumps."""
        ...

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Return q, v, a and tau of the mechanism at the rows of a grid, from the integrated states there."""
        ...


@dataclass(frozen=True)
class FreeSystem:
    """All coordinates are integrated; no drive acts.

    Attributes:
        manifold: The mechanism's space of configurations.
    """

    manifold: Manifold

    def begin(self, q: Array, v: Array, start: float, end: float) -> tuple[Array, Array]:
        """Return the state itself."""
        return q, v

    def acceleration(self, dynamics: Dynamics, start: float, end: float) -> Acceleration:
        """Return that of the free tree."""
        return dynamics.on(start, end).acceleration()

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Return the states with the accelerations of the equation of motion."""
        a = np.concatenate([part.forward(grid.t[rows], q[rows], v[rows]) for rows, part in parts(dynamics, grid)])
        return q, v, a, np.zeros_like(v)


@dataclass(frozen=True, eq=False)
class ReducedSystem:
    """Some coordinates follow laws; the others are integrated, and the efforts of the drives come out.

    Attributes:
        imposed: The prescribed coordinates and their laws.
        reduction: What they leave free.
        manifold: Space of the free coordinates.
        given: Indices in v of the joints that were given an initial value.
    """

    imposed: Imposed
    reduction: Reduction
    manifold: Manifold
    given: tuple[int, ...]

    def begin(self, q: Array, v: Array, start: float, end: float) -> tuple[Array, Array]:
        """Return the free part of the state.

        Raises:
            InputError: The laws contradict an initial value that was given.
        """
        reduction, (w, dw, _) = self.reduction, self.imposed.on(start, end)(start)
        free_q, free_v = q[reduction.free_q], v[reduction.free_v]
        whole = reduction.configuration(free_q, w), reduction.velocity(free_v, dw)
        for index in self.given:
            place = reduction.scalar_q[index]
            if abs(whole[0][place] - q[place]) + abs(whole[1][index] - v[index]) > CONTRADICTION:
                raise InputError(
                    f"the initial values contradict the laws of {', '.join(self.imposed.names)}",
                    expected="initial values of what the laws leave free",
                )
        return free_q, free_v

    def acceleration(self, dynamics: Dynamics, start: float, end: float) -> Acceleration:
        """Return that of the free coordinates."""
        return self.reduction.acceleration(dynamics.on(start, end), self.imposed.on(start, end))

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Return the whole motion, and the efforts by inverse dynamics."""
        targets = np.array([grid.evaluate(law) for law in self.imposed.laws])  # (k, 3, n)
        whole_q = np.array([self.reduction.configuration(q[i], targets[:, 0, i]) for i in range(len(q))])
        whole_v = v @ self.reduction.basis.T + targets[:, 1].T @ self.reduction.particular.T
        rates = np.empty_like(v)
        for start, end, rows in grid.stretches():
            acceleration = self.acceleration(dynamics, start, end)
            for i in range(rows.start, rows.stop):
                rates[i] = acceleration(grid.t[i], q[i], v[i])
        a = rates @ self.reduction.basis.T + targets[:, 2].T @ self.reduction.particular.T
        tau = np.concatenate(
            [part.inverse(grid.t[rows], whole_q[rows], whole_v[rows], a[rows]) for rows, part in parts(dynamics, grid)]
        )
        return whole_q, whole_v, a, tau


@dataclass(frozen=True)
class FreePart:
    """The free coordinates of a mechanism that has quaternions among them.

    Attributes:
        whole: Space of the whole mechanism.
        reduction: What is free.
        neutral: A configuration to fill up with, shape (nq,).
        nq: Numbers in the free part of q.
        nv: Numbers in the free part of v.
    """

    whole: Manifold
    reduction: Reduction
    neutral: Array
    nq: int
    nv: int

    def velocity(self, q: Array, v: Array) -> Array:
        """Return the rate of the free part."""
        whole_q, whole_v = self.neutral.copy(), np.zeros(self.whole.nv)
        whole_q[self.reduction.free_q], whole_v[self.reduction.free_v] = q, v
        return self.whole.velocity(whole_q, whole_v)[self.reduction.free_q]

    def project(self, q: Array) -> Array:
        """Return the free part with its quaternions at unit length."""
        whole = np.broadcast_to(self.neutral, (*q.shape[:-1], self.whole.nq)).copy()
        whole[..., self.reduction.free_q] = q
        return self.whole.project(whole)[..., self.reduction.free_q]


def system_of(dynamics: Dynamics, imposed: Imposed, given: tuple[int, ...] = ()) -> System:
    """Return what has to be integrated while the imposed coordinates follow their laws.

    Args:
        dynamics: The equation of motion.
        imposed: Coordinates with laws, none for free motion.
        given: Indices in v of the joints that were given an initial value: they stay free if they can.

    Raises:
        InputError: They cannot be prescribed independently.
    """
    linear: Sequence[LinearCoordinate] = [c for c in imposed.coordinates if isinstance(c, LinearCoordinate)]
    if not linear:
        return FreeSystem(dynamics.manifold)
    rows = np.array([coordinate.weights for coordinate in linear])
    reduction = Reduction.of(dynamics.model, rows, imposed.names, given)
    nq, nv = len(reduction.free_q), len(reduction.free_v)
    if dynamics.model.nq == dynamics.model.nv:
        return ReducedSystem(imposed, reduction, Flat(nq, nv), given)
    neutral = np.asarray(pin.neutral(dynamics.model))
    return ReducedSystem(imposed, reduction, FreePart(dynamics.manifold, reduction, neutral, nq, nv), given)


def parts(dynamics: Dynamics, grid: Grid) -> list[tuple[slice, Dynamics]]:
    """Return the rows of every stretch of a grid, each with the dynamics that holds there."""
    return [(rows, dynamics.on(start, end)) for start, end, rows in grid.stretches()]

"""Linear couplings and prescribed joint coordinates: they are eliminated, the independent coordinates integrated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.coordinate_partition import CoordinatePartition
from pinarm.engine.dynamics.dynamics import Dynamics, parts
from pinarm.engine.integration.integrator import Acceleration, Accelerations, Interval, Manifold
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems.system import CompletedStates, Initial
from pinarm.errors import InputError
from pinarm.mechanics.laws.motion_law import Grid

CONTRADICTION = 1e-9
"""Difference between an initial value and what the laws say that typed digits explain [rad, m, rad/s or m/s]."""


@dataclass(frozen=True, eq=False)
class PartitionedSystem:
    """Linear couplings hold and some coordinates follow laws; what is left is integrated.

    Attributes:
        prescribed: The sums that couplings keep constant, then the prescribed coordinates, with their laws.
        reduction: What they leave free.
        manifold: Space of the free coordinates.
        closure: The couplings.
    """

    prescribed: PrescribedCoordinates
    reduction: CoordinatePartition
    manifold: Manifold
    closure: Closure

    def begin(self, initial: Initial, start: float, end: float) -> tuple[Array, Array]:
        """Return the free part of the state.

        Raises:
            InputError: The laws contradict an initial value that was given.
        """
        reduction, (w, dw, _) = self.reduction, self.prescribed.on(start, end)(start)
        free_q, free_v = initial.q[reduction.free_q], initial.v[reduction.free_v]
        q, v = reduction.configuration(free_q, w), reduction.velocity(free_v, dw)
        for index in {*initial.positions, *initial.velocities}:
            place = reduction.scalar_q[index]
            if abs(q[place] - initial.q[place]) + abs(v[index] - initial.v[index]) > CONTRADICTION:
                raise InputError(
                    f"the initial values contradict the laws of {', '.join(self.prescribed.names)}",
                    expected="initial values of what the laws leave free",
                )
        return free_q, free_v

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        """Return the motion of the free coordinates."""
        together = self._accelerations(dynamics, start, end)
        return Interval(start, end, self._acceleration(dynamics, start, end), batch=together)

    def _acceleration(self, dynamics: Dynamics, start: float, end: float) -> Acceleration:
        return self.reduction.acceleration(dynamics.on(start, end), self.prescribed.on(start, end))

    def _accelerations(self, dynamics: Dynamics, start: float, end: float) -> Accelerations:
        return self.reduction.accelerations(dynamics.on(start, end), self.prescribed.along(start, end))

    def part(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the free part of states."""
        return q[..., self.reduction.free_q], v[..., self.reduction.free_v]

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the states with the coupled and the prescribed coordinates in them."""
        targets = [self.prescribed.on(instant, instant)(instant) for instant in t]
        w, dw = np.array([w for w, _, _ in targets]), np.array([dw for _, dw, _ in targets])
        return self.reduction.configuration(q, w), self.reduction.velocity(v, dw)

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the whole motion, and the efforts by inverse dynamics."""
        reduction, targets = self.reduction, np.array([grid.evaluate(law) for law in self.prescribed.laws])  # (k, 3, n)
        whole_q, whole_v = reduction.configuration(q, targets[:, 0].T), reduction.velocity(v, targets[:, 1].T)
        rates = np.empty_like(v)
        for start, end, rows in grid.intervals():
            rates[rows] = self._accelerations(dynamics, start, end)(grid.t[rows], q[rows], v[rows])
        a = rates @ reduction.basis.T + targets[:, 2].T @ reduction.particular.T
        demand = np.concatenate(
            [part.inverse(grid.t[rows], whole_q[rows], whole_v[rows], a[rows]) for rows, part in parts(dynamics, grid)]
        )
        efforts = demand @ reduction.particular  # W^T efforts = demand, and W P = 1
        m = self.closure.size
        return CompletedStates(
            whole_q, whole_v, a, efforts[:, m:] @ reduction.rows[m:], Multipliers.known(efforts[:, :m], m)
        )


@dataclass(frozen=True)
class FreeCoordinates:
    """The free coordinates of a mechanism that has quaternions among them.

    Attributes:
        whole: Space of the whole mechanism.
        reduction: What is free.
        neutral: A configuration to fill up with, shape (nq,).
        nq: Numbers in the free part of q.
        nv: Numbers in the free part of v.
    """

    whole: Manifold
    reduction: CoordinatePartition
    neutral: Array
    nq: int
    nv: int

    def velocity(self, q: Array, v: Array) -> Array:
        """Return the rate of the free part."""
        whole_q = np.broadcast_to(self.neutral, (*q.shape[:-1], self.whole.nq)).copy()
        whole_v = np.zeros((*v.shape[:-1], self.whole.nv))
        whole_q[..., self.reduction.free_q], whole_v[..., self.reduction.free_v] = q, v
        return self.whole.velocity(whole_q, whole_v)[..., self.reduction.free_q]

    def project(self, q: Array) -> Array:
        """Return the free part with its quaternions at unit length."""
        whole = np.broadcast_to(self.neutral, (*q.shape[:-1], self.whole.nq)).copy()
        whole[..., self.reduction.free_q] = q
        return self.whole.project(whole)[..., self.reduction.free_q]

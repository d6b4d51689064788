"""What is integrated with the integrals of continuous controllers: they stand behind the velocities, ``[v, x]``.

The integrator sees ``q' = velocity(q, v)``, ``v' = a(t, q, v, x)`` and ``x' = rates(t, q, v, x)``: integrals have the
same error control as the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.control.efforts import PresentEfforts
from pinarm.engine.control.memory import ControlMemory
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.integrator import Acceleration, Interval, Manifold, Projection
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.closure import Closure
    from pinarm.engine.motion.systems import CompletedStates, Initial, System
    from pinarm.mechanics.laws.motion_law import Grid

CONTROL = "control"
"""Name of the force element of controllers in dynamics of runs; no force has it: ``problems.actuation.controls``."""


@dataclass(frozen=True)
class WithIntegrals:
    """A configuration space with integrals behind the velocities.

    Attributes:
        inner: The space of the motion.
        count: Number of integrals.
    """

    inner: Manifold
    count: int

    @property
    def nq(self) -> int:
        """Number of coordinates in q."""
        return self.inner.nq

    @property
    def nv(self) -> int:
        """Number of velocities and integrals."""
        return self.inner.nv + self.count

    def velocity(self, q: Array, v: Array) -> Array:
        """Return the time derivative of q."""
        return self.inner.velocity(q, v[..., : self.inner.nv])

    def project(self, q: Array) -> Array:
        """Return q projected onto the manifold."""
        return self.inner.project(q)


@dataclass(frozen=True, eq=False)
class ControlledSystem:
    """A system with the integrals of continuous controllers; it tells these to the memory that loads read.

    Attributes:
        inner: What is integrated without them.
        memory: The controllers' memory.
    """

    inner: System
    memory: ControlMemory

    @property
    def manifold(self) -> Manifold:
        """Space of the integrated configurations."""
        return WithIntegrals(self.inner.manifold, self.memory.integrals[-1].stop)

    @property
    def closure(self) -> Closure:
        """Constraints with multipliers; see ``System``."""
        return self.inner.closure

    def begin(self, initial: Initial, start: float, end: float) -> tuple[Array, Array]:
        """Return the state that belongs to the initial one, with the integrals that are remembered."""
        return self.with_integrals(*self.inner.begin(initial, start, end))

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        """Return the motion on an interval without jumps."""
        bound, inner = dynamics.on(start, end), self.inner.interval(dynamics, start, end)
        efforts = bound.forces[CONTROL]
        assert isinstance(efforts, PresentEfforts)
        of_step = (lambda t: self._acceleration(inner.of_step(t), efforts)) if inner.acceleration_of_step else None
        return replace(
            inner, acceleration=self._acceleration(inner.acceleration, efforts), acceleration_of_step=of_step,
            settle=self._settle(inner.settle) if inner.settle else None, batch=None, compiled=None,
        )  # fmt: skip

    def _acceleration(self, inner: Acceleration, efforts: PresentEfforts) -> Acceleration:
        memory, nv, whole = self.memory, self.inner.manifold.nv, self.inner.whole

        def acceleration(t: float, q: Array, v: Array) -> Array:
            memory.integral = v[nv:].copy()
            (at,), (moving,) = whole(np.array([t]), q[None], v[None, :nv])
            return np.concatenate([inner(t, q, v[:nv]), efforts.integral_rates(t, at, moving)])

        return acceleration

    def _settle(self, inner: Projection) -> Callable[[float, Array, Array], tuple[Array, Array]]:
        nv = self.inner.manifold.nv

        def settle(t: float, q: Array, v: Array) -> tuple[Array, Array]:
            closed, rates = inner(t, q, v[:nv])
            return closed, np.concatenate([rates, v[nv:]])

        return settle

    def with_integrals(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return states of the mechanism with the integrals that are remembered."""
        integral = np.broadcast_to(self.memory.integral, (*v.shape[:-1], self.memory.integral.shape[-1]))
        return q, np.concatenate([v, integral], axis=-1)

    def integrals(self, v: Array) -> Array:
        """Return the integrals in integrated states, shape (..., m)."""
        return v[..., self.inner.manifold.nv :]

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the mechanism's states; loads that are evaluated next have the integrals of these."""
        self.memory.integral, self.memory.instants = self.integrals(v).copy(), t
        return self.inner.whole(t, q, v[..., : self.inner.manifold.nv])

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the motion of the mechanism at the rows of a grid."""
        return self.inner.complete(dynamics, grid, q, v[:, : self.inner.manifold.nv])

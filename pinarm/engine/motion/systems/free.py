"""A tree that moves freely: its own coordinates are integrated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics, parts
from pinarm.engine.integration.integrator import Interval, Manifold
from pinarm.engine.motion.systems.system import CompletedStates, Initial
from pinarm.mechanics.laws.motion_law import Grid


@dataclass(frozen=True)
class FreeSystem:
    """All coordinates are integrated; no drive acts.

    Attributes:
        manifold: The mechanism's space of configurations.
        closure: No constraints.
    """

    manifold: Manifold
    closure: Closure

    def begin(self, initial: Initial, start: float, end: float) -> tuple[Array, Array]:
        """Return the state itself."""
        return initial.q, initial.v

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        """Return the motion of the free tree."""
        here = dynamics.on(start, end)
        return Interval(
            start, end, here.acceleration(), energy=dynamics.conserved, batch=here.accelerations(),
            unchecked_batch=here.unchecked(),
        )  # fmt: skip

    def part(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the state itself."""
        return q, v

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the states themselves."""
        return q, v

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the states with the accelerations of the equation of motion."""
        a = np.concatenate([part.forward(grid.t[rows], q[rows], v[rows]) for rows, part in parts(dynamics, grid)])
        return CompletedStates(q, v, a, np.zeros_like(v), Multipliers.zero(len(q), 0))

"""A tree that moves freely: its own coordinates are integrated."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics, parts
from pinarm.engine.integration.integrator import Interval, Manifold
from pinarm.engine.motion.systems.system import CompletedStates, Initial, KeptIntervals
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.kernel.library import Flow
    from pinarm.engine.kernel.tree import CompiledTree


class FreeSystem(Record, KeptIntervals, frozen=True):
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

    def _prepared(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        here = dynamics.on(start, end)
        compiled, remark = self._compiled(here, start)
        return Interval(start, end, here.acceleration(), batch=here.accelerations(), compiled=compiled, remark=remark)

    def _compiled(self, dynamics: Dynamics, t: float) -> tuple[Flow | None, str]:
        """Return the motion in compiled code where Pinocchio agrees at t [s], and what is to be said where not."""
        from pinarm.engine.kernel.tree import AGREEMENT, DISAGREES, disagreement

        flow = self._tree.flow(dynamics.steady, dynamics.changing) if self._tree else None
        if flow is None:
            return None, ""
        apart = disagreement(dynamics.model, flow, dynamics.acceleration(), t)
        return (flow, "") if apart <= AGREEMENT else (None, DISAGREES.format(apart))

    @cached_property
    def _tree(self) -> CompiledTree | None:
        """The tree in compiled code."""
        from pinarm.engine.kernel.tree import CompiledTree

        return CompiledTree.of(self.closure.model)

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

"""Trees with linear couplings: all coordinates are integrated, in compiled code where it knows the loads.

The accelerations satisfy ``W a = 0`` to rounding, and Runge-Kutta methods keep sums of coordinates as exactly: what is
integrated stays on the couplings. States are taken from its independent part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.integrator import Accelerations, Interval, Manifold
from pinarm.engine.kernel.library import Flow
from pinarm.engine.motion.systems.partitioned import PartitionedSystem
from pinarm.engine.motion.systems.system import CompletedStates, Initial, KeptIntervals
from pinarm.mechanics.laws.motion_law import Grid


@dataclass(frozen=True)
class CoupledSystem(KeptIntervals):
    """All coordinates of a tree with couplings are integrated; no coordinate follows a law.

    Attributes:
        inner: The independent coordinates.
        manifold: Space of all.
    """

    inner: PartitionedSystem
    manifold: Manifold

    @property
    def closure(self) -> Closure:
        """The couplings."""
        return self.inner.closure

    def begin(self, initial: Initial, start: float, end: float) -> tuple[Array, Array]:
        """Return the state of the mechanism that belongs to the initial one."""
        q, v = self.inner.begin(initial, start, end)
        return self._filled(q, v)

    def _prepared(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        inner, part, basis = self.inner.interval(dynamics, start, end), self._independent, self.inner.reduction.basis

        def acceleration(t: float, q: Array, v: Array) -> Array:
            return np.asarray(basis @ inner.acceleration(t, *part(q, v)))

        flow, remark = self._compiled(dynamics.on(start, end), acceleration, start)
        return Interval(start, end, acceleration, batch=self._batch(inner.batch), compiled=flow, remark=remark)

    def _batch(self, inner: Accelerations | None) -> Accelerations | None:
        basis = self.inner.reduction.basis
        return None if inner is None else lambda t, q, v: inner(t, *self._independent(q, v)) @ basis.T

    def _compiled(
        self, dynamics: Dynamics, acceleration: Callable[..., Array], t: float
    ) -> tuple[Flow | None, str]:  # fmt: skip
        """Return the motion in compiled code where Pinocchio agrees, and what is to be said where it does not."""
        from pinarm.engine.kernel.tree import AGREEMENT, DISAGREES, disagreement
        from pinarm.engine.motion.systems.compiled.compiled_couplings import coupled_flow

        rows = self.inner.reduction.rows
        flow = coupled_flow(dynamics.model, rows, dynamics.steady, dynamics.changing)
        if flow is None:
            return None, ""
        apart = disagreement(dynamics.model, flow, acceleration, t, self._onto)
        return (flow, "") if apart <= AGREEMENT else (None, DISAGREES.format(apart))

    def _onto(self, q: Array, v: Array) -> tuple[Array, Array]:
        return self._filled(*self._independent(q, v))

    def _independent(self, q: Array, v: Array) -> tuple[Array, Array]:
        reduction = self.inner.reduction
        return q[..., reduction.free_q], v[..., reduction.free_v]

    def _filled(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return states from their independent part."""
        w, dw, _ = self._sums
        return self.inner.reduction.configuration(q, w), self.inner.reduction.velocity(v, dw)

    @cached_property
    def _sums(self) -> tuple[Array, Array, Array]:
        """What couplings keep constant, and its rates, 0; shape (k,) each."""
        return self.inner.prescribed.on(0.0, 0.0)(0.0)

    def part(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the states themselves."""
        return q, v

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the states, exactly on the couplings: linear in their independent part."""
        matrix, constant = self._completion
        return q @ matrix + constant, v @ matrix

    @cached_property
    def _completion(self) -> tuple[Array, Array]:
        """From all coordinates to those that the independent ones determine: a matrix, shape (nv, nv), and a sum."""
        reduction, (w, _, _) = self.inner.reduction, self._sums
        matrix = np.zeros((len(reduction.basis), len(reduction.basis)))
        matrix[reduction.free_v] = reduction.basis.T
        return matrix, reduction.particular @ w

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the whole motion; see ``PartitionedSystem.complete``."""
        return self.inner.complete(dynamics, grid, *self._independent(q, v))

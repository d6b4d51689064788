"""Trees, free or with linear couplings and joints that follow laws: bound coordinates are eliminated.

All coordinates are integrated; accelerations are those of the independent part of a state, and states are completed
from it. Couplings are rows in compiled code, as those of loops are, whose sums Runge-Kutta methods keep to rounding. A
joint that follows a law has an armature there that outweighs the tree.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics, parts
from pinarm.engine.integration.integrator import Interval, Manifold
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems import KEPT, CompletedStates, Initial
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.dynamics.coordinate_partition import CoordinatePartition
    from pinarm.engine.integration.integrator import Acceleration
    from pinarm.engine.kernel.library import Flow
    from pinarm.engine.kernel.tree import CompiledTree
    from pinarm.mechanics.couplings.coupling import Coupling

CONTRADICTION = 1e-9
"""Difference between an initial value and what the laws say that typed digits explain [rad, m, rad/s or m/s]."""


class TreeSystem(Record, frozen=True):
    """A tree of which linear sums of coordinates may be coupled, or follow laws.

    Attributes:
        sums: What couplings keep constant, then the coordinates that follow laws.
        reduction: What these leave free; ``None`` where all is.
    """

    manifold: Manifold
    closure: Closure
    sums: PrescribedCoordinates
    reduction: CoordinatePartition | None = None

    @classmethod
    def of(
        cls, closure: Closure, manifold: Manifold, prescribed: PrescribedCoordinates, initial: Initial
    ) -> TreeSystem:
        """Return the system of a tree with its couplings and laws; joints with initial values stay free if they can."""
        couplings: list[Coupling] = [*closure.constraints]  # type: ignore[list-item]
        tied = [coupling.name for coupling in couplings], [coupling.coordinate for coupling in couplings]
        held = PrescribedCoordinates((), (), ()).holding(*tied, [coupling.constant for coupling in couplings])
        sums = held.with_others(prescribed.names, prescribed.coordinates, prescribed.laws)
        if not sums.names:
            return cls(manifold, closure, sums)
        from pinarm.engine.dynamics.coordinate_partition import CoordinatePartition

        given = tuple(sorted({*initial.positions, *initial.velocities}))
        rows = np.array(
            [coordinate.weights for coordinate in sums.coordinates if isinstance(coordinate, LinearCoordinate)]
        )
        return cls(manifold, closure, sums, CoordinatePartition.of(closure.model, rows, sums.names, given))

    def begin(self, initial: Initial, start: float, end: float) -> tuple[Array, Array]:
        if self.reduction is None:
            return initial.q, initial.v
        w, dw, _ = self.sums.on(start, end)(start)
        q, v = self.reduction.completed(initial.q, initial.v, w, dw)
        for index in {*initial.positions, *initial.velocities}:
            place = self.reduction.scalar_q[index]
            if abs(q[place] - initial.q[place]) + abs(v[index] - initial.v[index]) > CONTRADICTION:
                raise InputError(
                    f"the initial values contradict the laws of {', '.join(self.sums.names)}",
                    expected="initial values of what the laws leave free",
                )
        return q, v

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        return self._interval(dynamics, start, end)

    @cached_property
    def _interval(self) -> Callable[[Dynamics, float, float], Interval]:
        def interval(dynamics: Dynamics, start: float, end: float) -> Interval:
            acceleration = self._acceleration(dynamics, start, end)
            flow, remark = self._compiled(dynamics.on(start, end), acceleration, start, end)
            return Interval(start, end, acceleration, compiled=flow, remark=remark)

        return lru_cache(maxsize=KEPT)(interval)

    def _acceleration(self, dynamics: Dynamics, start: float, end: float) -> Acceleration:
        here = dynamics.on(start, end)
        if self.reduction is None:
            return here.acceleration()
        return self.reduction.acceleration(here, self.sums.on(start, end))

    def _compiled(
        self, dynamics: Dynamics, acceleration: Acceleration, start: float, end: float
    ) -> tuple[Flow | None, str]:
        """Return the motion in compiled code where Pinocchio agrees, and what is to be said where it does not."""
        from pinarm.engine.kernel.tree import AGREEMENT, DISAGREES, disagreement

        flow, sums = self._flow(dynamics, start, end), self.sums.on(start, end)
        if flow is None:
            return None, ""

        def onto(q: Array, v: Array) -> tuple[Array, Array]:
            w, dw, _ = sums(start)
            return self.reduction.completed(q, v, w, dw) if self.reduction else (q, v)

        apart = disagreement(dynamics.model, flow, acceleration, start, onto)
        return (flow, "") if apart <= AGREEMENT else (None, DISAGREES.format(apart))

    def _flow(self, dynamics: Dynamics, start: float, end: float) -> Flow | None:
        """Return the motion in compiled code; ``None`` where it does not know the joints, the loads or the laws."""
        from pinarm.engine.kernel.tree import Followed

        if self.closure.size:
            if self._followed or dynamics.model.nq > dynamics.model.nv:
                return None
            from pinarm.engine.motion.systems.compiled_loops import coupled_flow

            return coupled_flow(self.closure, dynamics.steady, dynamics.changing)
        if self._tree is None or self.reduction is None:
            return self._tree.flow(dynamics.steady, dynamics.changing) if self._tree else None
        places, laws = self.reduction.scalar_q, self.sums.joint_laws.items()
        guided = [Followed(v, int(places[v]), law.on(start, end)) for v, law in laws]
        return self._tree.flow(dynamics.steady, dynamics.changing, guided)

    @property
    def _followed(self) -> bool:
        return len(self.sums.names) > len(self.closure.constraints)

    @cached_property
    def _tree(self) -> CompiledTree | None:
        """The tree in compiled code, with driven joints held to laws; ``None`` where sums of joints follow one."""
        from pinarm.engine.dynamics.coordinate_partition import heavy
        from pinarm.engine.kernel.tree import CompiledTree

        driven = tuple(self.sums.joint_laws)
        known = len(driven) == len(self.sums.names)
        return CompiledTree.of(heavy(self.closure.model, driven)) if known else None

    def acting(self, dynamics: Dynamics) -> Dynamics:
        return dynamics

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return states, shapes (..., n, nq) and (..., n, nv), with what is coupled or follows laws, at n times t."""
        if self.reduction is None:
            return q, v
        w, dw = self._sums_at(t)
        return self.reduction.completed(q, v, w, dw)

    def _sums_at(self, t: Array) -> tuple[Array, Array]:
        """Return the sums and their rates at n instants, shape (n, k), or (k,) where they are constant."""
        if not self._followed:
            return self._constant
        sums = [self.sums.on(instant, instant)(instant) for instant in t.tolist()]
        return np.array([w for w, _, _ in sums]), np.array([dw for _, dw, _ in sums])

    @cached_property
    def _constant(self) -> tuple[Array, Array]:
        w, dw, _ = self.sums.on(0.0, 0.0)(0.0)
        return w, dw

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the motion at the rows of a grid: of independent coordinates, then efforts by inverse dynamics."""
        reduction = self.reduction
        if reduction is None:
            a = np.concatenate([part.forward(grid.t[rows], q[rows], v[rows]) for rows, part in parts(dynamics, grid)])
            return CompletedStates(q, v, a, np.zeros_like(v), np.zeros((len(q), 0)))
        w, dw, _ = np.array([grid.evaluate(law) for law in self.sums.laws]).transpose(1, 2, 0)
        q, v = reduction.completed(q, v, w, dw)
        a, demand = np.empty_like(v), np.empty_like(v)
        for (start, end, rows), (_, local) in zip(grid.intervals(), parts(dynamics, grid), strict=True):
            accelerations = reduction.accelerations(local, self.sums.along(start, end))
            a[rows] = accelerations(grid.t[rows], q[rows], v[rows])
            demand[rows] = local.inverse(grid.t[rows], q[rows], v[rows], a[rows])
        efforts, m = demand @ reduction.particular, self.closure.size  # W^T efforts = demand, and W P = 1
        return CompletedStates(q, v, a, efforts[:, m:] @ reduction.rows[m:], efforts[:, :m])

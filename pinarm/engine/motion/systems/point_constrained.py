"""Loops that are closed by points: integrated by Pinocchio's own constrained dynamics."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.pinocchio_constraints import PointConstraints
from pinarm.engine.integration.integrator import Interval, Manifold
from pinarm.engine.motion.systems.constrained import ConstrainedSystem
from pinarm.engine.motion.systems.point_motion import PointMotion
from pinarm.engine.motion.systems.system import KEPT, CompletedStates, Initial
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.dynamics.many_points import ManyPointConstraints
    from pinarm.engine.kernel.library import Flow
    from pinarm.engine.kernel.loops import LoadedLoops


class PointSystem(Record, frozen=True):
    """The whole state of a mechanism whose loops are closed by points.

    Attributes:
        general: The same system by its rows: it begins and completes the motion.
        points: The loops as points.
    """

    general: ConstrainedSystem
    points: PointConstraints | ManyPointConstraints

    @property
    def manifold(self) -> Manifold:
        """Return the space of configurations."""
        return self.general.manifold

    @property
    def closure(self) -> Closure:
        """Return the constraints."""
        return self.general.closure

    def begin(self, initial: Initial, start: float, end: float) -> tuple[Array, Array]:
        """Return the closed state nearest to the initial one."""
        return self.general.begin(initial, start, end)

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        """Return the motion on an interval without jumps."""
        motion = self._motion(dynamics, start, end)
        compiled, remark = self._compiled(dynamics, start, end, motion)
        return Interval(
            start, end, motion.acceleration, motion.settle, motion.floor, motion.since, compiled=compiled,
            remark=remark, outlook=motion.outlook,
        )  # fmt: skip

    def _motion(self, dynamics: Dynamics, start: float, end: float) -> PointMotion:
        general = self.general
        return PointMotion(self.points, general.rows, dynamics.on(start, end), general.prescribed.on(start, end))

    def _compiled(
        self, dynamics: Dynamics, start: float, end: float, motion: PointMotion
    ) -> tuple[Flow | None, str]:  # fmt: skip
        """Return the motion in compiled code where Pinocchio agrees, and what is to be said where it does not."""
        from pinarm.engine.motion.systems.compiled.compiled_points import PointFlow

        loops, remark = self._judged(dynamics, start, end)
        return PointFlow.of(loops, motion) if loops else None, remark

    @cached_property
    def _judged(self) -> Callable[[Dynamics, float, float], tuple[LoadedLoops | None, str]]:
        """Pinocchio's judgement of the loops in compiled code, kept for the next run: no run changes it."""
        from pinarm.engine.motion.systems.compiled.compiled_points import judged_loops

        def judged(dynamics: Dynamics, start: float, end: float) -> tuple[LoadedLoops | None, str]:
            general, motion = self.general, self._motion(dynamics, start, end)
            return judged_loops(dynamics.on(start, end), motion, general.near, general.prescribed.laws, (start, end))

        return lru_cache(maxsize=KEPT)(judged)

    def part(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the state itself."""
        return q, v

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the states themselves."""
        return q, v

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the motion, closed at every row, with accelerations and multipliers."""
        return self.general.complete(dynamics, grid, q, v)

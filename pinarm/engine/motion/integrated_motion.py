"""A motion that has been integrated over time, as states at any instants."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.friction.columns import friction_columns
from pinarm.engine.motion.outcome import Outcome, SolvedMotion
from pinarm.engine.motion.segmented.end_stops import Bound
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.motion.segmented.segments import SegmentedMotion
from pinarm.engine.motion.standstill import at_rest, directions, lossy, row_paces
from pinarm.engine.motion.systems import CompletedStates
from pinarm.engine.motion.trajectory import EventRecord, Trajectory
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.mechanics.coordinates import driven_along
from pinarm.mechanics.joints import effort_unit
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.control.controls import Controls
    from pinarm.engine.mechanism import Mechanism


class IntegratedMotion(SolvedMotion, Record, frozen=True):
    """A motion that has been integrated over time.

    ``pace`` is what rounding of velocities and accelerations is judged against, shape (2, nv); ``None`` where no
    direction is asked for, or it is not known yet.
    """

    mechanism: Mechanism
    hybrid: HybridSystem
    motion: SegmentedMotion
    pace: Array | None = None

    def outcome(self, grid: Grid) -> Outcome:
        rows = self.at(grid)
        if not lossy(self.mechanism):
            return self._outcome(rows)
        known = replace(self, pace=row_paces(self.mechanism, rows.v, rows.a).max(axis=0))
        others = tuple(map(known._directed, rows.others))
        return replace(self._outcome(replace(known._directed(rows), others=others)), motion=known)

    def _outcome(self, rows: Trajectory) -> Outcome:
        events, decisions = tuple(self.motion.events), tuple(self.motion.decisions.values())
        return Outcome(rows, self, events=events, decisions=decisions)

    def at(self, grid: Grid) -> Trajectory:
        """Return the states at the rows of a grid; accelerations are those of the equation of motion there."""
        motion = self.motion.complete(grid)
        others = tuple(self.table(grid, other) for other in motion.others)
        return replace(self.table(grid, motion), others=others)

    def table(self, grid: Grid, motion: CompletedStates) -> Trajectory:
        """Return completed states as a table, with what controllers did and with events."""
        rows = replace(states(self.mechanism, self.hybrid, grid, motion), dynamics=self.motion.dynamics)
        if self.hybrid.controls:
            rows = self._controlled(rows, self.hybrid.controls)
        columns = {**rows.columns, **event_columns(self.hybrid.watches, self.motion.events, len(grid.t))}
        return self._directed(replace(rows, columns=columns))

    def _controlled(self, rows: Trajectory, controls: Controls) -> Trajectory:
        """Return states with the efforts of the controllers as those of drives, and their columns."""
        from pinarm.engine.motion.segmented.recorded_control import control_rows, without_control

        efforts, columns = control_rows(self.motion, rows.grid, rows.q, rows.v)
        return replace(
            driven_by(controls, rows),
            tau=rows.tau + efforts,
            columns={**rows.columns, **columns},
            dynamics=without_control(self.motion.dynamics),
        )

    def _directed(self, rows: Trajectory) -> Trajectory:
        """Return states with the directions of the joints, where drives have losses."""
        if self.pace is None:
            return rows
        v, a, inside = rows.v, rows.a, np.zeros_like(rows.v)
        still = np.flatnonzero(at_rest(v, a, self.pace)[:, lossy(self.mechanism)].any(axis=1))
        if len(still):
            inside[still] = self.motion.complete(rows.grid.some(still).moved_inside()).v
        return replace(rows, directions=directions(v, a, self.pace, rows.grid.sides(), inside))

    def positions(self, t: Array) -> Array:
        return self.motion.positions(t)

    def steps(self) -> Array:
        return np.concatenate([segment.solution.steps.until for segment in self.motion.segments])

    def jumps(self) -> Array:
        if not self.hybrid.controls:
            return np.empty(0)
        from pinarm.engine.motion.segmented.recorded_control import record_of

        return np.array(record_of(self.motion).controls.times)


def states(mechanism: Mechanism, hybrid: HybridSystem, grid: Grid, motion: CompletedStates) -> Trajectory:
    """Return completed states as a table."""
    pushed = np.zeros_like(motion.tau) if motion.pushed is None else motion.pushed
    stopped = {bound.joint for bound in hybrid.bounds if isinstance(bound, Bound)}
    pushes = push_columns(mechanism, [name for name, joint in mechanism.joints.items() if joint.v in stopped], pushed)
    return Trajectory(
        mechanism, "t", unit("s"), grid, motion.q, motion.v, motion.a, motion.tau, motion.lam,
        hybrid.closed_system.closure, hybrid.dynamics,
        driven=driven_along(hybrid.prescribed.coordinates, mechanism.model.nv), drives=tuple(hybrid.prescribed.names),
        columns={**friction_columns(mechanism.frictions, motion.friction), **pushes}, opened=motion.opened,
        endless=motion.endless,
    )  # fmt: skip


def push_columns(mechanism: Mechanism, stopped: Iterable[str], pushed: Array) -> dict[str, Series]:
    """Return the columns ``joint.J.stop`` from the pushes of end stops along joints [N*m or N], shape (n, nv)."""
    joints = {f"joint.{name}.stop": mechanism.joints[name] for name in stopped}
    return {name: Series(name, effort_unit(joint.unit), pushed[:, joint.v]) for name, joint in joints.items()}


def driven_by(controls: Controls, rows: Trajectory) -> Trajectory:
    """Return rows whose drives are also those that controllers command."""
    driven = np.zeros(rows.v.shape[-1], dtype=bool) if rows.driven is None else rows.driven.copy()
    driven[list(controls.joints)] = True
    names = [name for name, joint in rows.mechanism.joints.items() if joint.v in controls.joints]
    return replace(rows, driven=driven, drives=(*rows.drives, *names))


def event_columns(names: Iterable[str], events: Sequence[EventRecord], rows: int) -> dict[str, Series]:
    """Return when each event first took place, and how often, as columns that are the same in all rows."""
    columns = {}
    for name in names:
        times = [event.t for event in events if event.name == name]
        first, count = np.full(rows, times[0] if times else np.nan), np.full(rows, float(len(times)))
        columns[f"event.{name}.time"] = Series(f"event.{name}.time", unit("s"), first)
        columns[f"event.{name}.count"] = Series(f"event.{name}.count", unit("1"), count)
    return columns

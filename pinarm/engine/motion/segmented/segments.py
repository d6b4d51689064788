"""A motion from end to end: smooth segments, with an impact or a change of contact where one meets the next."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct, field

from pinarm.arrays import Array, Indices, distinct
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.motion.outcome import Decision
from pinarm.engine.motion.systems import CompletedStates, System
from pinarm.engine.motion.trajectory import EventRecord
from pinarm.errors import IntegrationError
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Solution
    from pinarm.engine.motion.segmented.holding import Holding


SMALL = 0.1
"""Size over that which errors are relative to, below which a motion is integrated again: its errors are then more than
ten times as large as the tolerance says."""

OFFSET, FINEST = 0.01, 1e-14
"""Displacement over that which errors are relative to, below which a motion about coordinates far from 0 is integrated
again with a tolerance that is finer by as much; and the finest one, where rounding of the coordinates is as large."""

BLIND = 1e-3
"""Error of a step over the displacement from which on steps are chosen without regard to the motion."""

UNSEEN = "it may let go unseen"
"""Words of a note on contacts whose end may have been missed."""

REST = 1e-15
"""Size of a motion in SI that rounding of the accelerations explains: the mechanism is at rest."""


class MotionSegment(Record, frozen=True):
    """A part of a motion during which the same constraints hold.

    ``holding`` includes stops that touch and move only with those that are rested on.
    """

    holding: Holding
    system: System
    solution: Solution

    @cached_property
    def shares(self) -> bool:
        """Whether several stops hold one motion at its beginning."""
        return self.holding.shares_at(self.states(self.solution.steps.t[:1])[0])

    def states(self, t: Array) -> tuple[Array, Array]:
        """Return the states of the mechanism at times t [s], shape (n,): q of shape (n, nq) and v of shape (n, nv)."""
        return self.system.whole(t, *self.solution.states(t))

    def complete(self, dynamics: Dynamics, grid: Grid) -> CompletedStates:
        states = self.system.complete(dynamics, grid, *self.solution.states(grid.t))
        return self.holding.told(self.holding.shared(states) if self.shares else states)


class Work(Struct):
    """Cost of all segments together; errors of steps add up to that of the state at the end, ``state_error``."""

    steps: int = 0
    evaluations: int = 0
    rejected: int = 0
    floored: int = 0
    state_error: float = 0.0


class SegmentedMotion(Record, frozen=True):
    """An integrated motion: segments and events in order of time, and of what is decided the least certain."""

    dynamics: Dynamics
    segments: list[MotionSegment] = field(default_factory=list)
    events: list[EventRecord] = field(default_factory=list)
    decisions: dict[str, Decision] = field(default_factory=dict)
    work: Work = field(default_factory=Work)

    @property
    def end(self) -> float:
        return self.segments[-1].solution.end

    @property
    def seams(self) -> list[float]:
        return [segment.solution.end for segment in self.segments[:-1]]

    @property
    def size(self) -> float:
        return max(segment.solution.size for segment in self.segments)

    @property
    def displacement(self) -> float:
        """Largest change of a coordinate in a segment, or velocity, that was integrated, in SI."""
        return max(segment.solution.displacement for segment in self.segments)

    @property
    def rounding(self) -> dict[str, float]:
        """The sum of errors of steps over the displacement, where rounding keeps it above what the tolerance says.

        A finer tolerance then makes no error smaller. Empty elsewhere, and at rest.
        """
        size, moved, total = self.size, self.displacement, 0.0
        for solution in (segment.solution for segment in self.segments):
            scale, tolerance = solution.intervals[0].size, solution.method.tolerance
            fine = tolerance <= FINEST or tolerance * (scale + size) > BLIND * moved
            if size < SMALL * scale or (moved < OFFSET * (scale + size) and fine):
                total += tolerance * (scale + size) * len(solution.steps)
        return {"rounding": total / moved} if moved > REST and total else {}

    def require_progress(self, until: float = 0.0, most: int = 1_000_000) -> None:
        """Raise where there are more than ``most`` segments; ``until`` is the last instant of the run [s]."""
        if len(self.segments) > most:
            raise IntegrationError(
                f"the run has more than {most} impacts, switches and other changes of contact: it has come to "
                f"t = {self.end:.9g} s of {until:.9g} s",
                expected="no more than accuracy.max_events",
                hint="a shorter time, a restitution below 1, a wider hysteresis, no friction or controller that "
                "switches back as soon as it has switched, or a larger accuracy.max_events: each takes milliseconds",
                partial=self,
                t=self.end,
            )

    def add(self, segment: MotionSegment) -> None:
        self.segments.append(segment)
        work, solution, count = self.work, segment.solution, segment.solution.count
        steps = len(solution.steps)
        work.steps += steps
        work.evaluations += count.evaluations
        work.rejected += count.rejected
        work.floored += count.floored
        work.state_error += steps * solution.method.step_error(solution, steps - 1) if steps else 0.0

    def consider(self, decision: Decision) -> None:
        known = self.decisions.get(decision.what)
        if known is None or decision.doubt > known.doubt:
            self.decisions[decision.what] = decision

    def parts(self, t: Array) -> Iterator[tuple[MotionSegment, Indices]]:
        """Yield the segments that instants lie in, shape (n,), each with their places."""
        owners = np.searchsorted(np.array(self.seams), t)
        for number in distinct(owners).tolist():
            yield self.segments[number], np.flatnonzero(owners == number)

    def complete(self, grid: Grid) -> CompletedStates:
        """Return the motion at the rows of a grid whose intervals do not reach over seams."""
        filled = np.flatnonzero(np.diff(grid.rows))
        middles = 0.5 * (np.array(grid.cuts[1:]) + np.array(grid.cuts[:-1]))[filled]
        return CompletedStates.joined(
            [segment.complete(self.dynamics, grid.part(*filled[own[[0, -1]]])) for segment, own in self.parts(middles)]
        )

    def positions(self, t: Array) -> Array:
        positions = np.empty((len(t), self.dynamics.model.nq))
        for segment, here in self.parts(t):
            positions[here] = segment.states(t[here])[0]
        return positions

    def cost(self) -> dict[str, float]:
        work = self.work
        cost = {
            "steps": float(work.steps),
            "evaluations": float(work.evaluations),
            "rejected steps": float(work.rejected),
        }
        return {**cost, "steps at the noise floor": float(work.floored)} if work.floored else cost

    def remarks(self) -> list[str]:
        remarks = (interval.remark for segment in self.segments for interval in segment.solution.intervals)
        return list(dict.fromkeys(filter(None, [*remarks, self._unseen])))

    @property
    def _unseen(self) -> str:
        parts = [part for segment in self.segments for part in segment.solution.unresolved]
        if not parts:
            return ""
        longest = max(high - low for low, high in parts)
        return (
            "what rests on a stop, or is held by friction, a cable or a cam, is looked at on parts of up to "
            f"{longest:.2g} s from t = {parts[0][0]:.6g} to {parts[-1][1]:.6g} s, where its loads vary faster: {UNSEEN}"
        )

    def diagnose(self) -> list[str]:
        """Return doubts about the choice of the integrator."""
        solutions = [segment.solution for segment in self.segments]
        methods = {id(solution.method): solution.method for solution in solutions}
        return [
            note
            for key, method in methods.items()
            for note in method.diagnose([solution for solution in solutions if id(solution.method) == key])
        ]

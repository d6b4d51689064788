"""Motions of variants of a system, or from several initial states, integrated together in compiled code.

Each motion has its own time and step length, and takes the steps that it takes alone, many of them in one call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.integrator import Interval, Manifold
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.integration.runge_kutta import (
    FASTEST,
    SHORTEST,
    first_step,
)
from pinarm.engine.integration.solution import Solution
from pinarm.records import Record

ROOM, FEWEST, MOST = 16384, 8, 512
"""Steps that all motions together may take in one call of the library each, and bounds of those of a single motion."""


class Motions(Record, frozen=True):
    """Motions that are under way.

    Attributes:
        number: Numbers of the motions, ascending, shape (m,).
        t: Present times [s], shape (m,).
        h: Next steps [s], shape (m,).
        ceiling: Largest factors by which these may grow, shape (m,).
        y: Present states [q, v], shape (m, nq + nv).
        slope: Their slopes [q', v'], shape (m, nq + nv).
    """

    number: Indices
    t: Array
    h: Array
    ceiling: Array
    y: Array
    slope: Array

    def some(self, which: Flags) -> Motions:
        """Return some of the motions."""
        return self if which.all() else Motions(*(getattr(self, name)[which] for name in self.__struct_fields__))


class Ensemble(Record, frozen=True):
    """The steps of b motions, and their states in between.

    Attributes:
        solution: The steps of all motions, those of each one after the other.
        motion: The motion of each step, ascending, shape (steps,).
        arrived: Which motions have come to their ends, shape (b,).
        failures: Number of a motion that has not -> reason.
    """

    solution: Solution
    motion: Indices
    arrived: Flags
    failures: dict[int, str]

    @cached_property
    def counts(self) -> Indices:
        """Number of steps of each motion, shape (b,)."""
        return np.bincount(self.motion, minlength=len(self.arrived))

    @cached_property
    def firsts(self) -> Indices:
        """The first step of each motion, shape (b,)."""
        return np.cumsum(self.counts) - self.counts

    @property
    def sizes(self) -> Array:
        """Largest coordinate or velocity of each motion at the starts of its steps, in SI, shape (b,)."""
        sizes = np.zeros(len(self.arrived))
        np.maximum.at(sizes, self.motion, np.abs(self.solution.steps.y).max(axis=1, initial=0.0))
        return sizes

    @property
    def displacements(self) -> Array:
        """Largest change of a coordinate, or velocity, of each motion at the starts of its steps, in SI, shape (b,)."""
        change, nq = self.solution.steps.y.copy(), self.solution.manifold.nq
        change[:, :nq] -= self.solution.steps.y[self.firsts[self.motion], :nq]
        found = np.zeros(len(self.arrived))
        np.maximum.at(found, self.motion, np.abs(change).max(axis=1, initial=0.0))
        return found

    def located(self, motions: Indices, t: Array) -> Indices:
        """Return the steps of some motions in which instants are, of all or of each, shape (n,) or (n, m): (n, m)."""
        found = np.empty((len(t), len(motions)), dtype=np.intp)
        columns, starts = np.broadcast_to(t.reshape(len(t), -1), found.shape), self.solution.steps.t
        spans = zip(self.firsts[motions].tolist(), self.counts[motions].tolist(), strict=True)
        for column, (first, count) in enumerate(spans):
            found[:, column] = starts[first : first + count].searchsorted(columns[:, column], side="right")
        return np.clip(found - 1, 0, np.maximum(self.counts[motions] - 1, 0)) + self.firsts[motions]

    def states_in(self, step: Indices, t: Array) -> tuple[Array, Array]:
        """Return the states at instants in steps, both of shape (..): q of shape (.., nq) and v of shape (.., nv)."""
        q, v = self.solution.states_in(step.ravel(), t.ravel())
        return q.reshape(*step.shape, -1), v.reshape(*step.shape, -1)

    def with_others(self, motions: Indices, others: Ensemble) -> Ensemble:
        """Return these variants with others in the place of some of the motions, if they have come to their ends.

        Args:
            motions: Which motions they are of, shape (m,).
            others: The others.
        """
        better, intervals = others.arrived[others.motion], list(self.solution.intervals)
        for number, interval, arrived in zip(motions.tolist(), others.solution.intervals, others.arrived, strict=True):
            intervals[number] = interval if arrived else intervals[number]
        kept = ~np.isin(self.motion, motions[others.arrived])
        chunks = list[Chunk]()
        taken = (self.motion, self.solution.steps, kept), (motions[others.motion], others.solution.steps, better)
        for motion, steps, which in taken:
            own = motion[which]
            chunks.append((own, own, steps.times[which], steps.y[which], steps.slopes[which]))
        arrived = self.arrived.copy()
        method, manifold = self.solution.method, self.solution.manifold
        return _ensemble(Solution(method, manifold, intervals), chunks, arrived, self.failures)


def integrate_variants(
    intervals: Sequence[Interval], manifold: Manifold, y: Array, method: Adaptive, max_steps: int
) -> Ensemble:
    """Integrate motions of variants, each with the steps that ``driver.integrate`` takes of it.

    Args:
        intervals: The interval of each motion, compiled.
        manifold: The configuration space of all of them.
        y: Initial states [q, v], shape (b, nq + nv).
        method: The embedded pair.
        max_steps: Largest number of steps of a motion, rejected ones included.
    """
    integration = _Integration(method, manifold, intervals, max_steps, len(y))
    active = integration.begun(np.arange(len(y)), y.copy(), np.zeros(len(y)))
    return integration.ensemble(integration.followed(active, integration.take).number)


Chunk = tuple[Indices, Indices, Array, Array, Array]
"""Motions, intervals, times, states and slopes of some steps."""


def _ensemble(solution: Solution, chunks: Sequence[Chunk], arrived: Flags, failures: dict[int, str]) -> Ensemble:
    """Return motions, given their steps in order of time."""
    if not chunks:
        return Ensemble(solution, np.empty(0, np.intp), arrived, failures)
    motion, interval, times, y, slopes = (np.concatenate(x) for x in zip(*chunks, strict=True))
    order = np.argsort(motion, kind="stable")
    solution.steps.extend(times[order], y[order], slopes[order], interval[order], np.zeros((len(order), 3), np.intp))
    return Ensemble(solution, motion[order], arrived, failures)


@dataclass(eq=False)
class _Integration:
    """The integration of b motions; ``interval`` is the index of the present interval of each."""

    method: Adaptive
    manifold: Manifold
    intervals: Sequence[Interval]
    max_steps: int
    count: int
    chunks: list[Chunk] = field(default_factory=list)
    failures: dict[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.tries, self.interval = np.zeros(self.count, np.intp), np.arange(self.count)

    def of_each(self, name: str, number: Indices) -> Array:
        """Return a number of the present intervals of motions, shape (m,)."""
        values: Array = np.array([getattr(interval, name) for interval in self.intervals])
        return np.asarray(values[self.interval[number]])

    def ensemble(self, arrived: Indices) -> Ensemble:
        """Return the motions, of which some have come to their ends."""
        flags = np.zeros(self.count, dtype=bool)
        flags[arrived] = True
        return _ensemble(Solution(self.method, self.manifold, self.intervals), self.chunks, flags, self.failures)

    def begun(self, number: Indices, y: Array, h: Array) -> Motions:
        """Return motions at the starts of their intervals; h are the steps proposed before, or 0."""
        time, tableau = (self.of_each("start", number), self.of_each("end", number)), self.method.tableau
        rates = partial(self._slopes, number)
        active = Motions(number, time[0], h, np.full(len(h), FASTEST), y, rates(time[0], y))
        if not h.any():
            size = self.of_each("size", number)[:, None]
            first = first_step(time, y, active.slope, rates, self.method.tolerance, tableau.error_order, size)
            active = Motions(number, time[0], first, active.ceiling, y, active.slope)
        infinite = ~(np.isfinite(active.slope).all(axis=1) & np.isfinite(active.h))
        return self.without(active, infinite, "the acceleration is not finite")

    def _slopes(self, number: Indices, t: Array, y: Array) -> Array:
        """Return the slopes of states at the starts of motions; q are projected onto the manifold in place."""
        index, start = self.interval[number], self.of_each("start", number)
        if (index == index[0]).all():
            return self.intervals[int(index[0])].slopes(self.manifold, start, t, y)
        slopes = np.empty_like(y)
        for row, k in enumerate(index.tolist()):
            here = slice(row, row + 1)
            slopes[here] = self.intervals[k].slopes(self.manifold, start[here], t[here], y[here])
        return slopes

    def followed(self, active: Motions, step: Callable[[Motions], Motions]) -> Motions:
        """Let motions take steps to the ends of their intervals; return those that come there."""
        arrived = [active.some(np.zeros(len(active.number), dtype=bool))]
        while len(active.number):
            active = step(active)
            start, end = self.of_each("start", active.number), self.of_each("end", active.number)
            there = active.t >= end
            arrived.append(active.some(there))
            active, length = active.some(~there), (end - start)[~there]
            short = active.h < SHORTEST * np.spacing(np.maximum(np.abs(active.t), length))
            active = self.without(active, short, "the acceleration grows without bound or is not finite")
            many = self.tries[active.number] >= self.max_steps
            active = self.without(active, many, f"it has taken {self.max_steps} steps")
        found = [np.concatenate(x) for x in zip(*map(_fields, arrived), strict=True)]
        order = np.argsort(found[0])
        return Motions(*(x[order] for x in found))

    def without(self, active: Motions, failed: Flags, why: str) -> Motions:
        """Return the motions that have not failed, and record why the others have."""
        for number, t in zip(active.number[failed].tolist(), active.t[failed].tolist(), strict=True):
            self.failures[number] = f"the integration cannot go on at t = {t:.9g} s: {why}"
        return active.some(~failed)

    def record(self, number: Indices, times: Array, y: Array, slopes: Array) -> None:
        """Record accepted steps."""
        self.chunks.append((number, self.interval[number], times, y, slopes))

    def take(self, active: Motions) -> Motions:
        """Take steps of each motion in compiled code, as many as there is room for; return the motions behind them."""
        from pinarm.engine.integration.compiled_steps import StepRoom, controls_of, elements, take_many

        number, tableau, m = active.number, self.method.tableau, len(active.number)
        room = min(max(ROOM // m, FEWEST), MOST)
        places = StepRoom(active.y.copy(), room, tableau.stages + 1, 2)
        places.slopes[:, 0, 0], courses = active.slope, places.courses
        values = active.t, active.h, active.ceiling, self.of_each("start", number), self.of_each("end", number)
        for name, numbers in zip(("t", "h", "ceiling", "start", "end"), values, strict=True):
            courses[name] = numbers
        courses["tries"] = self.max_steps - self.tries[number]
        controls = controls_of(self.method.tolerance, self.of_each("size", number))
        flows = [self.intervals[k].compiled for k in self.interval[number].tolist()]
        take_many(tableau, zip(flows, elements(controls), elements(courses), strict=True))
        written = courses["written"]
        taken = np.arange(room) < written[:, None]
        times, states, slopes = places.times[:, taken].T, places.states[taken], places.slopes[:, :-1][taken]
        self.record(number[taken.nonzero()[0]], times, states, slopes)
        self.tries[number] += written + courses["rejected"]
        t, h, ceiling = (courses[name].copy() for name in ("t", "h", "ceiling"))
        return Motions(number, t, h, ceiling, places.y, places.slopes[np.arange(m), written, 0])


def _fields(motions: Motions) -> tuple[Array, ...]:
    return tuple(getattr(motions, name) for name in motions.__struct_fields__)

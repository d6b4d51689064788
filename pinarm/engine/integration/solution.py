"""The solution of an integration: the table of accepted steps, and the states at any time by dense output."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from msgspec import Struct, field

from pinarm.arrays import Array, Indices
from pinarm.engine.integration.integrator import Count, Interval, Manifold
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.integration.methods import Method
    from pinarm.engine.integration.turns import Turn

LEAST = 16
"""Rows for which a table has storage at least, once it grows."""

Column = np.ndarray[tuple[Any, ...], np.dtype[Any]]
"""An array whose rows are numbers of any kind."""


class _Columns(Struct, eq=False):
    """Columns that grow by rows; full storage is doubled, so that the cost of a row does not grow."""

    count: int = 0
    _storage: list[Column] = []

    def add(self, *rows: Column) -> None:
        """Add rows to every column, the same number to each."""
        end = self.count + len(rows[0])
        if not self._storage:
            self._storage, self.count = [x.copy() for x in rows], end
            return
        if end > len(self._storage[0]):
            self._storage = [self._larger(k, end, x) for k, x in enumerate(rows)]
        for stored, x in zip(self._storage, rows, strict=True):
            stored[self.count : end] = x
        self.count = end

    def _larger(self, k: int, end: int, rows: Column) -> Column:
        larger = np.empty((max(2 * self.count, end, LEAST), *rows.shape[1:]), rows.dtype)
        larger[: self.count] = self._storage[k][: self.count]
        return larger

    def column(self, k: int) -> Column:
        """Return the rows of a column, in place; none before any have been added."""
        return self._storage[k][: self.count] if self._storage else np.empty((0, 0))


class Step(NamedTuple):
    """An accepted step, with the data of its dense output.

    Attributes:
        t: Start [s].
        h: Length [s].
        until: End [s]: ``t + h`` to rounding, or earlier where an event ended the step.
        y: State [q, v] at the start, shape (nq + nv,).
        slopes: Slopes [q', v'] at the method's stages, shape (s, nq + nv).
        interval: Index of its interval.
    """

    t: float
    h: float
    until: float
    y: Array
    slopes: Array
    interval: int


class StepTable(Struct, eq=False):
    """The accepted steps of a motion, in order of time.

    Every column is an array in place, valid until further steps are added.
    """

    _columns: _Columns = field(default_factory=_Columns)

    def __len__(self) -> int:
        return self._columns.count

    def __getitem__(self, index: int) -> Step:
        t, h, until = self.times[index].tolist()
        return Step(t, h, until, self.y[index], self.slopes[index], int(self.interval[index]))

    def __iter__(self) -> Iterator[Step]:
        return (self[k] for k in range(len(self)))

    @property
    def times(self) -> Array:
        """Starts, lengths and ends [s], see ``Step``, shape (n, 3)."""
        times = self._columns.column(0)
        return times if len(times) else np.empty((0, 3))

    @property
    def t(self) -> Array:
        """Starts [s], shape (n,)."""
        return self.times[:, 0]

    @property
    def h(self) -> Array:
        """Lengths [s], shape (n,)."""
        return self.times[:, 1]

    @property
    def until(self) -> Array:
        """Ends [s], shape (n,)."""
        return self.times[:, 2]

    @property
    def y(self) -> Array:
        """States [q, v] at the starts, shape (n, nq + nv)."""
        return self._columns.column(1)

    @property
    def slopes(self) -> Array:
        """Slopes [q', v'] at the method's stages, shape (n, s, nq + nv)."""
        return self._columns.column(2)

    @property
    def interval(self) -> Indices:
        """Indices of their intervals, shape (n,)."""
        return self._columns.column(3).astype(np.intp, copy=False)

    @property
    def work(self) -> Indices:
        """Evaluations, rejected and floored steps up to the end of each step, shape (n, 3)."""
        return self._columns.column(4)

    def extend(self, times: Array, y: Array, slopes: Array, interval: int | Indices, work: Indices) -> None:
        """Add n steps; the arguments are rows of the columns, the interval may be that of all."""
        numbers = (np.asarray(x, np.float64) for x in (times, y, slopes))
        intervals = np.broadcast_to(np.asarray(interval, np.intp), len(times))
        self._columns.add(*numbers, intervals, np.asarray(work, np.intp))

    def some(self, index: Indices) -> StepTable:
        """Return some of the steps, to be read only: in place where they follow one another."""
        first, last = int(index[0]), int(index[-1])
        rows = slice(first, last + 1) if last - first + 1 == len(index) else index
        return StepTable(_Columns(len(index), [self._columns.column(k)[rows] for k in range(5)]))

    def end_at(self, index: int, until: float) -> None:
        """Let a step end at an instant [s]."""
        self.until[index] = until

    def truncate(self, count: int) -> None:
        """Keep the first steps only."""
        self._columns.count = min(count, len(self))


class DenseOutput(Record, frozen=True):
    """The dense output of n steps: a polynomial over each, or one over each of the equal parts that a step has.

    With x from 0 to 1 over a part it is ``base + x (r_0 + (1 - x) (r_1 + x (r_2 + (1 - x) (...))))``.

    Attributes:
        base: States [q, v] at the starts of all parts, shape (p, nq + nv).
        terms: Terms r of their polynomials, shape (p, d, nq + nv).
        counts: Number of parts of each step, shape (n,).
    """

    base: Array
    terms: Array
    counts: Indices

    @classmethod
    def whole(cls, base: Array, terms: Array) -> DenseOutput:
        """Return that of n steps which have one polynomial each."""
        return cls(base, terms, np.ones(len(base), dtype=np.intp))


class InterpolatedSteps(Struct, eq=False):
    """The dense output of those steps of a motion that have been asked for."""

    _firsts: Indices = field(default_factory=lambda: np.empty(0, np.intp))
    """First part of every step; -1 where its output is not known."""
    _counts: Indices = field(default_factory=lambda: np.empty(0, np.intp))
    """Number of its parts."""
    _parts: _Columns = field(default_factory=_Columns)
    """States at the starts of the parts, and terms; see ``DenseOutput``."""

    def missing(self, index: Indices, count: int) -> Indices:
        """Return which of the steps of given indices have no known output, ascending, of ``count`` steps in all."""
        if len(self._firsts) < count:
            more = (0, max(count, 2 * len(self._firsts)) - len(self._firsts))
            self._firsts, self._counts = np.pad(self._firsts, more, constant_values=-1), np.pad(self._counts, more)
        unknown = index[self._firsts[index] < 0]
        return np.bincount(unknown).nonzero()[0] if len(unknown) else unknown

    def add(self, index: Indices, output: DenseOutput) -> None:
        """Add the output of the steps of given indices."""
        self._firsts[index] = self._parts.count + output.counts.cumsum() - output.counts
        self._counts[index] = output.counts
        self._parts.add(output.base, output.terms)

    @property
    def indices(self) -> list[int]:
        """Indices of the steps whose output is known, ascending."""
        indices: list[int] = (self._firsts >= 0).nonzero()[0].tolist()
        return indices

    def states(self, index: Indices, x: Array) -> Array:
        """Return states before their projection onto the manifold, shape (m, nq + nv), in steps with known output.

        Args:
            index: Step of each, shape (m,).
            x: ``(t - start) / h`` of each in its step, shape (m,).
        """
        count = self._counts[index]
        part = np.clip((x * count).astype(np.intp), 0, count - 1)
        place, x = self._firsts[index] + part, x * count - part
        base, terms = self._parts.column(0)[place], self._parts.column(1)[place]
        factors = np.empty(terms.shape[:2])  # x, x (1 - x), x (1 - x) x, ...
        factors[:, ::2], factors[:, 1::2] = x[:, None], 1.0 - x[:, None]
        y = np.vecmat(np.multiply.accumulate(factors, axis=1), terms)
        return np.asarray(
            np.where(x[:, None] == 0.0, base, base + y)
        )  # the terms of a step that failed may be infinite

    def truncate(self, count: int) -> None:
        """Forget the output of all but the first steps."""
        self._firsts[count:] = -1


class Crossing(ValueRecord, frozen=True):
    """A zero crossing of a watched value.

    Attributes:
        watch: Index of the watch.
        t: Instant [s].
        q: Configuration at t, shape (nq,).
        v: Velocity at t, shape (nv,).
    """

    watch: int
    t: float
    q: Array
    v: Array


class Solution(Struct, eq=False, dict=True, weakref=True):
    """The result of an integration: its steps, and by dense output the state at any time between.

    Attributes:
        method: The method.
        manifold: The configuration space.
        intervals: The integrated intervals.
        steps: Accepted steps, in order of time.
        crossings: Zero crossings of the watched values, in order of time.
        count: Cost.
        final: State [q, v] at the end, projected onto the constraints, shape (nq + nv,); ``None`` where an event or a
            failure ended the integration.
        unresolved: Parts of steps in which a watched value varies with loads faster than it is looked at [s].
        begun_with: Error of the state at its start, relative to ``size + |y|``.
        nearest: Index of a watch -> the turn at which it is the least certain whether its value comes to 0.
    """

    method: Method
    manifold: Manifold
    intervals: Sequence[Interval]
    steps: StepTable = field(default_factory=StepTable)
    crossings: list[Crossing] = []
    count: Count = field(default_factory=Count)
    final: Array | None = None
    unresolved: list[tuple[float, float]] = []
    begun_with: float = 0.0
    nearest: dict[int, Turn] = {}
    _interpolated: InterpolatedSteps = field(default_factory=InterpolatedSteps)

    @property
    def end(self) -> float:
        """Last time reached [s]."""
        return float(self.steps.until[-1]) if self.steps else self.intervals[0].start

    @property
    def size(self) -> float:
        """Largest coordinate or velocity at the ends of its steps, in SI; 0 without steps."""
        return float(np.abs(self.steps.y).max(initial=0.0))

    @property
    def displacement(self) -> float:
        """Largest change of a coordinate, or velocity, at the ends of its steps, in SI; 0 without steps."""
        states = self.steps.y.copy()
        states[:, : self.manifold.nq] -= states[:1, : self.manifold.nq].copy()
        return float(np.abs(states).max(initial=0.0))

    @property
    def last(self) -> Array:
        """State [q, v] at the last time reached, shape (nq + nv,)."""
        return np.hstack(self.states(np.array([self.end])))[0] if self.final is None else self.final

    def states(self, t: Array) -> tuple[Array, Array]:
        """Return the states at times t [s], shape (n,): q of shape (n, nq) and v of shape (n, nv)."""
        index = self.steps.t.searchsorted(t, side="right") - 1
        return self.states_in(np.maximum(index, 0), t)

    def states_in(self, index: Indices, t: Array) -> tuple[Array, Array]:
        """Return the states at many times, each from the step of the given index, both of shape (n,)."""
        if not len(index):
            return np.empty((0, self.manifold.nq)), np.empty((0, self.manifold.nv))
        start, y = self.steps.t[index], self.steps.y[index]
        inside = (t != start).nonzero()[0]  # at the start of a step its state is known
        if len(inside):
            within = index[inside]
            self._interpolate(within)
            y[inside] = self._interpolated.states(within, (t - start)[inside] / self.steps.h[within])
        return self.manifold.project(y[:, : self.manifold.nq]), y[:, self.manifold.nq :]

    def outlook(self, index: int) -> tuple[bool, int]:
        """Return the prospect of the step of an index, see ``Interval.outlook``; ``(False, 0)`` where unknown."""
        known = self.intervals[self.steps.interval[index]].outlook
        return known(float(self.steps.t[index])) if known else (False, 0)

    def truncate(self, count: int) -> None:
        """Keep the first steps, and their cost; without any, the cost of those that go is kept."""
        self.steps.truncate(count)
        self._interpolated.truncate(count)
        if count:
            self.count.evaluations, self.count.rejected, self.count.floored = self.steps.work[-1].tolist()

    @property
    def interpolated_steps(self) -> list[int]:
        """Indices of the steps whose dense output has been computed, ascending."""
        return self._interpolated.indices

    def _interpolate(self, index: Indices) -> None:
        """Compute the dense output of those steps that have none yet, interval by interval."""
        missing = self._interpolated.missing(index, len(self.steps))
        if not len(missing):
            return
        intervals = self.steps.interval[missing]
        order = intervals.argsort(kind="stable")
        ends = np.diff(intervals[order]).nonzero()[0] + 1
        for start, end in pairwise([0, *ends.tolist(), len(missing)]):
            some = missing[order[start:end]]
            interval = self.intervals[self.steps.interval[some[0]]]
            self._interpolated.add(some, self.method.dense_output(interval, self.manifold, self.steps.some(some)))

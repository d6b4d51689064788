"""The accepted steps of a motion as one table, and the dense output of those that have been interpolated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from msgspec import Struct, field

from pinarm.arrays import Array, Indices
from pinarm.engine.integration.dense_output import DenseOutput, divided_at, interpolated
from pinarm.records import Record

LEAST = 16
"""Rows for which a table has storage at least, once it grows."""

Column = np.ndarray[tuple[Any, ...], np.dtype[Any]]
"""An array whose rows are numbers of any kind."""


class Step(Record, frozen=True):
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


class _Columns(Struct, eq=False):
    """Columns that grow by rows; storage that is full is doubled, so that a row costs the same always.

    Attributes:
        count: Number of rows.
    """

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
        """Return the rows of a column, in place; before any have been added, none."""
        return self._storage[k][: self.count] if self._storage else np.empty((0, 0))


class StepTable(Struct, eq=False):
    """The accepted steps of a motion, in order of time.

    Every column is an array in place, valid until further steps are added.
    """

    _columns: _Columns = field(default_factory=_Columns)

    @classmethod
    def of(cls, steps: Sequence[Step]) -> StepTable:
        """Return a table of steps."""
        table = cls()
        for step in steps:
            table.append(step)
        return table

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

    def append(self, step: Step) -> None:
        """Add a step."""
        times = np.array([[step.t, step.h, step.until]])
        self.extend(times, step.y[None], step.slopes[None], step.interval)

    def extend(self, times: Array, y: Array, slopes: Array, interval: int) -> None:
        """Add n steps of one interval.

        Args:
            times: Starts, lengths and ends [s], shape (n, 3).
            y: States at the starts, shape (n, nq + nv).
            slopes: Slopes at the stages, shape (n, s, nq + nv).
            interval: Index of the interval.
        """
        numbers = (np.asarray(x, np.float64) for x in (times, y, slopes))
        self._columns.add(*numbers, np.full(len(times), interval, np.intp))

    def some(self, index: Indices) -> StepTable:
        """Return some of the steps, ascending, to be read only: in place where they follow one another."""
        first, last = int(index[0]), int(index[-1])
        rows = slice(first, last + 1) if last - first + 1 == len(index) else index
        return StepTable(_Columns(len(index), [self._columns.column(k)[rows] for k in range(4)]))

    def end_at(self, index: int, until: float) -> None:
        """Let a step end at an instant [s]."""
        self.until[index] = until

    def truncate(self, count: int) -> None:
        """Keep the first steps only."""
        self._columns.count = min(count, len(self))


class InterpolatedSteps(Struct, eq=False):
    """The dense output of those steps of a motion that have been asked for."""

    _places: Indices = field(default_factory=lambda: np.empty(0, np.intp))
    """Place of the output of every step; -1 where it has not been asked for."""
    _counts: _Columns = field(default_factory=_Columns)
    """First part of the output of each, and number of its parts."""
    _parts: _Columns = field(default_factory=_Columns)
    """States at the starts of the parts, and terms; see ``DenseOutput``."""

    def missing(self, index: Indices, count: int) -> Indices:
        """Return which of the steps of given indices have no known output, ascending, of ``count`` steps in all."""
        if len(self._places) < count:
            places = np.full(max(count, 2 * len(self._places)), -1)
            places[: len(self._places)] = self._places
            self._places = places
        unknown = index[self._places[index] < 0]
        return np.bincount(unknown).nonzero()[0] if len(unknown) else unknown

    def add(self, index: Indices, output: DenseOutput) -> None:
        """Add the output of the steps of given indices."""
        self._places[index] = self._counts.count + np.arange(len(index))
        first = self._parts.count + output.counts.cumsum() - output.counts
        self._counts.add(first, output.counts)
        self._parts.add(output.base, output.terms)

    @property
    def indices(self) -> list[int]:
        """Indices of the steps whose output is known, ascending."""
        indices: list[int] = (self._places >= 0).nonzero()[0].tolist()
        return indices

    def states(self, index: Indices, x: Array) -> Array:
        """Return states within steps whose output is known; see ``DenseOutput.states``."""
        place = self._places[index]
        part = self._counts.column(0)[place]
        if self._parts.count > self._counts.count:
            part, x = divided_at(part, self._counts.column(1)[place], x)
        return interpolated(self._parts.column(0)[part], self._parts.column(1)[part], x)

    def truncate(self, count: int) -> None:
        """Forget the output of all but the first steps."""
        self._places[count:] = -1

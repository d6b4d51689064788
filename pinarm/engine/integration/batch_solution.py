"""The result of integrating many motions: their steps, and their states at any time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.integrator import (
    Count,
    Crossing,
    EmbeddedPair,
    Interval,
    Manifold,
    Solution,
)
from pinarm.engine.integration.steps import Step, StepTable
from pinarm.errors import IntegrationError

ROWS = 16384
"""Number of states that are evaluated from the dense output at once."""


@dataclass(frozen=True, eq=False)
class BatchStep:
    """One step of each of m motions.

    Attributes:
        number: Numbers of the motions, ascending, shape (m,).
        t: Starts of the steps [s], shape (m,).
        h: Lengths [s], shape (m,).
        until: Ends [s], shape (m,); see ``Step``; equal to ``t`` for a rejected step.
        y: States [q, v] at the starts, shape (nq + nv, m).
        slopes: Slopes [q', v'] at the method's stages, shape (s + 1, nq + nv, m).
        interval: Index of the interval.
    """

    number: Indices
    t: Array
    h: Array
    until: Array
    y: Array
    slopes: Array
    interval: int

    def subset(self, which: Flags | Indices) -> BatchStep:
        """Return the steps of some of the motions."""
        t, h, until = self.t[which], self.h[which], self.until[which]
        return BatchStep(self.number[which], t, h, until, self.y[:, which], self.slopes[..., which], self.interval)

    def step(self, number: int) -> Step | None:
        """Return the step of a motion; ``None`` where it took none."""
        column = int(np.searchsorted(self.number, number))
        if column == len(self.number) or self.number[column] != number or self.until[column] == self.t[column]:
            return None
        t, h, until = (float(x[column]) for x in (self.t, self.h, self.until))
        return Step(t, h, until, self.y[:, column].copy(), self.slopes[..., column].copy(), self.interval)


@dataclass(eq=False)
class ActiveMotions:
    """The motions that are still within an interval; the last axis of every array runs over them.

    Attributes:
        number: Numbers of the motions, ascending, shape (m,).
        t: Present times [s], shape (m,).
        h: Next steps [s], shape (m,).
        ceiling: Largest factors by which these may grow, shape (m,).
        y: Present states [q, v], shape (nq + nv, m).
        slope: Their slopes [q', v'], shape (nq + nv, m).
    """

    number: Indices
    t: Array
    h: Array
    ceiling: Array
    y: Array
    slope: Array

    def subset(self, which: Flags) -> ActiveMotions:
        """Return some of the motions."""
        if which.all():
            return self
        return ActiveMotions(*(getattr(self, each.name)[..., which] for each in fields(self)))


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Motions from b initial states.

    Attributes:
        method: The method.
        manifold: The configuration space.
        intervals: The integrated intervals.
        ends: Last times reached [s], shape (b,); -inf where no step was taken.
        last: States at these times, shape (nq + nv, b).
        evaluations: Number of accelerations computed for each motion, shape (b,).
        rejected: Number of rejected steps of each motion, shape (b,).
        crossings: Zero crossings of the watched values of each motion, in order of time.
        steps: Steps, in the order in which they were taken.
        failures: Number of a motion that did not reach its end -> reason.
    """

    method: EmbeddedPair
    manifold: Manifold
    intervals: Sequence[Interval]
    ends: Array
    last: Array
    evaluations: Indices
    rejected: Indices
    crossings: Sequence[list[Crossing]]
    steps: list[BatchStep] = field(default_factory=list)
    failures: dict[int, str] = field(default_factory=dict)

    def solution(self, number: int) -> Solution:
        """Return one motion.

        Raises:
            IntegrationError: The motion did not reach its end; ``partial`` holds it up to its last step.
        """
        steps = [step for taken in self.steps if (step := taken.step(number))]
        count = Count(int(self.evaluations[number]), int(self.rejected[number]))
        solution = Solution(
            self.method, self.manifold, self.intervals, StepTable.of(steps), self.crossings[number], count
        )
        if number in self.failures:
            raise IntegrationError(self.failures[number], hint=self.method.remedy, partial=solution, t=solution.end)
        return solution

    @property
    def sizes(self) -> Array:
        """Largest coordinate or velocity of each motion at the ends of its steps, in SI, shape (b,)."""
        sizes = np.zeros(len(self.ends))
        for taken in self.steps:
            sizes[taken.number] = np.maximum(sizes[taken.number], np.abs(taken.y).max(axis=0, initial=0.0))
        return sizes

    @property
    def displacements(self) -> Array:
        """Largest change of a coordinate from the start, or velocity, of each motion at the ends of its steps, (b,)."""
        start, found = np.full_like(self.last, np.nan), np.zeros(len(self.ends))
        for taken in self.steps:
            own = start[:, taken.number]
            own[: self.manifold.nq] = np.where(np.isnan(own), taken.y, own)[: self.manifold.nq]
            own[self.manifold.nq :] = 0.0
            start[:, taken.number] = own
            found[taken.number] = np.maximum(found[taken.number], np.abs(taken.y - own).max(axis=0, initial=0.0))
        return found

    def states(self, t: Array) -> tuple[Array, Array]:
        """Return the states of all motions at the same times.

        Args:
            t: Times [s], ascending, shape (n,).

        Returns:
            q of shape (b, n, nq) and v of shape (b, n, nv), NaN beyond the end of a motion.
        """
        nq, reached = self.manifold.nq, self.reached(t)
        y = np.full((*reached.shape, len(self.last)), np.nan)
        motion, instant = np.nonzero(t == self.ends[:, None])
        y[motion, instant] = self.last[:, motion].T
        for taken in self.steps:
            self._evaluate(taken, t, y)
        y[reached, :nq] = self.manifold.project(y[reached, :nq])
        return y[..., :nq], y[..., nq:]

    def reached(self, t: Array) -> Flags:
        """Return which motions have states at which times, shape (b, n)."""
        return np.asarray(t <= self.ends[:, None])

    def _evaluate(self, taken: BatchStep, t: Array, y: Array) -> None:
        """Write the states at those times t that lie within the steps, their ends excluded, into y (b, n, nq + nv)."""
        first, beyond = np.searchsorted(t, taken.t), np.searchsorted(t, taken.until)
        if (first >= beyond).all():
            return
        row, instant = _ranges(first, beyond)
        y[taken.number[row], instant] = taken.y[:, row].T
        x = (t[instant] - taken.t[row]) / taken.h[row]
        inside = x > 0.0
        row, instant, x = row[inside], instant[inside], x[inside]
        needed, where = np.unique(row, return_inverse=True)
        if not len(needed):
            return
        steps = taken.subset(needed)
        base, slopes, interval = steps.y.T, steps.slopes.transpose(2, 0, 1), self.intervals[taken.interval]
        output = self.method.output_of(interval, self.manifold, steps.t, steps.h, base, slopes)
        for begin in range(0, len(row), ROWS):
            part = slice(begin, begin + ROWS)
            y[steps.number[where[part]], instant[part]] = output.states(where[part], x[part])


def _ranges(first: Indices, beyond: Indices) -> tuple[Indices, Indices]:
    """Return the concatenated ranges ``first[i] .. beyond[i] - 1``: the index i of each number, and the number."""
    length = np.maximum(beyond - first, 0)
    row = np.repeat(np.arange(len(first)), length)
    return row, np.arange(len(row)) + (first - np.cumsum(length) + length)[row]

"""What the integration of many motions gives: their steps as they were taken, and their states at any time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.integrator import (
    Count,
    Crossing,
    EmbeddedPair,
    Interval,
    Manifold,
    Solution,
    Step,
    interpolated,
)
from pinarm.engine.integration.methods.explicit import terms_of
from pinarm.errors import IntegrationError

ROWS = 16384
"""Number of states that are taken from the dense output together."""


@dataclass(frozen=True, eq=False)
class Round:
    """Steps that were taken together, of some motions one each.

    Attributes:
        number: Which motions they are of, ascending, shape (m,).
        t: Their starts [s], shape (m,).
        h: Their lengths [s], shape (m,).
        until: Where they end [s], shape (m,); see ``Step``.
        y: States [q, v] at the starts, shape (nq + nv, m).
        slopes: Slopes at the method's stages, shape (s + 1, nq + nv, m).
        interval: Index of the interval that they belong to.
    """

    number: Indices
    t: Array
    h: Array
    until: Array
    y: Array
    slopes: Array
    interval: int

    def only(self, which: Flags | Indices) -> Round:
        """Return some of them."""
        t, h, until = self.t[which], self.h[which], self.until[which]
        return Round(self.number[which], t, h, until, self.y[:, which], self.slopes[..., which], self.interval)

    def step(self, number: int) -> Step | None:
        """Return that of a motion; ``None`` where it took none."""
        place = int(np.searchsorted(self.number, number))
        if place == len(self.number) or self.number[place] != number or self.until[place] == self.t[place]:
            return None
        t, h, until = (float(x[place]) for x in (self.t, self.h, self.until))
        return Step(t, h, until, self.y[:, place].copy(), self.slopes[..., place].copy(), self.interval)


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Motions from b initial states.

    Attributes:
        method: The method.
        manifold: The space of configurations.
        intervals: The intervals that were integrated.
        ends: The last times reached [s], shape (b,); -inf where no step was taken.
        last: States there, shape (nq + nv, b).
        evaluations: Number of accelerations computed for each, shape (b,).
        rejected: Number of steps that were tried and refused, shape (b,).
        crossings: What was watched for, in order of time, motion by motion.
        rounds: Steps, in the order in which they were taken.
        failures: Why motions could not be followed to their end, by their number.
    """

    method: EmbeddedPair
    manifold: Manifold
    intervals: Sequence[Interval]
    ends: Array
    last: Array
    evaluations: Indices
    rejected: Indices
    crossings: Sequence[list[Crossing]]
    rounds: list[Round] = field(default_factory=list)
    failures: dict[int, str] = field(default_factory=dict)

    def solution(self, number: int) -> Solution:
        """Return one motion.

        Raises:
            IntegrationError: It could not be followed to its end; ``partial`` holds it until then.
        """
        steps = [step for one in self.rounds if (step := one.step(number))]
        count = Count(int(self.evaluations[number]), int(self.rejected[number]))
        solution = Solution(self.method, self.manifold, self.intervals, steps, self.crossings[number], count)
        if number in self.failures:
            raise IntegrationError(self.failures[number], hint=self.method.remedy, partial=solution, t=solution.end)
        return solution

    def states(self, t: Array) -> tuple[Array, Array]:
        """Return the states of all motions at the same times.

        Args:
            t: Times [s], ascending, shape (n,).

        Returns:
            q of shape (b, n, nq) and v of shape (b, n, nv), not a number beyond the end of a motion.
        """
        nq, reached = self.manifold.nq, self.reached(t)
        y = np.full((*reached.shape, len(self.last)), np.nan)
        motion, instant = np.nonzero(t == self.ends[:, None])
        y[motion, instant] = self.last[:, motion].T
        for one in self.rounds:
            self._tell(one, t, y)
        y[reached, :nq] = self.manifold.project(y[reached, :nq])
        return y[..., :nq], y[..., nq:]

    def reached(self, t: Array) -> Flags:
        """Return which motions are told at which times, shape (b, n)."""
        return np.asarray(t <= self.ends[:, None])

    def _tell(self, one: Round, t: Array, y: Array) -> None:
        """Write the states at those times t that fall into the steps of a round, their ends excluded."""
        first, beyond = np.searchsorted(t, one.t), np.searchsorted(t, one.until)
        if (first >= beyond).all():
            return
        row, instant = _ranges(first, beyond)
        y[one.number[row], instant] = one.y[:, row].T
        x = (t[instant] - one.t[row]) / one.h[row]
        inside = x > 0.0
        row, instant, x = row[inside], instant[inside], x[inside]
        held, where = np.unique(row, return_inverse=True)
        if not len(held):
            return
        few = one.only(held)
        base, known, interval = few.y.T, few.slopes.transpose(2, 0, 1), self.intervals[one.interval]
        terms = terms_of(self.method.tableau, interval, self.manifold, few.t, few.h, base, known)
        for begin in range(0, len(row), ROWS):
            part = slice(begin, begin + ROWS)
            here = where[part]
            y[few.number[here], instant[part]] = interpolated(base[here], terms[here], x[part])


def _ranges(first: Indices, beyond: Indices) -> tuple[Indices, Indices]:
    """Return all numbers from ``first`` to below ``beyond``, range by range: whose each is, and itself."""
    length = np.maximum(beyond - first, 0)
    row = np.repeat(np.arange(len(first)), length)
    return row, np.arange(len(row)) + (first - np.cumsum(length) + length)[row]

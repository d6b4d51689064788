"""Many motions that have been integrated one by one, as one table of steps whose states are evaluated together."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.solution import Solution
from pinarm.records import Record


class Ensemble(Record, frozen=True):
    """The steps of b motions, each in an interval of its own, and their states in between.

    Attributes:
        solution: The steps of all motions, those of each one after the other.
        motion: The motion of each step, ascending, shape (steps,).
        arrived: Which motions have come to their ends, shape (b,).
    """

    solution: Solution
    motion: Indices
    arrived: Flags

    @classmethod
    def joined(cls, solutions: Sequence[Solution], arrived: Flags) -> Ensemble:
        """Return motions that have been integrated."""
        motion = np.arange(len(solutions)).repeat([len(one.steps) for one in solutions])
        intervals = [one.intervals[0] for one in solutions]
        whole, stepped = Solution(solutions[0].method, solutions[0].manifold, intervals), [x.steps for x in solutions]
        if len(motion):
            columns = (np.concatenate([getattr(x, of) for x in stepped if len(x)]) for of in ("times", "y", "slopes"))
            times, y, slopes = columns
            whole.steps.extend(times, y, slopes, motion, np.zeros((len(motion), 3), np.intp))
        return cls(whole, motion, arrived)

    @cached_property
    def counts(self) -> Indices:
        """Number of steps of each motion, shape (b,)."""
        return np.bincount(self.motion, minlength=len(self.arrived))

    @cached_property
    def firsts(self) -> Indices:
        """The first step of each motion, shape (b,)."""
        return np.cumsum(self.counts) - self.counts

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

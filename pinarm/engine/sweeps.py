"""Newton's method at many instants at once, on mechanisms whose joints turn or slide.

From a solved row of the table, the rows ahead are predicted by its velocity and acceleration and corrected together, as
far ahead as this surely stays on the branch: the prediction is near, every correction is much smaller than the one
before, and the determinant of J keeps its sign and a good part of its size. The next sweep begins where one ends. What
is singular, or out of reach, no sweep accepts: such rows are left to the continuation row by row.

The equations are those of ``engine.following``. Arrays have the rows of the table along their last axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.assembly import CLOSED
from pinarm.engine.closure import Closure
from pinarm.engine.elimination import Elimination, pivots
from pinarm.engine.imposed import Imposed
from pinarm.engine.measures import MeasuredAll, Measures

SHORTEST, LONGEST = 4, 2048
"""Smallest number of rows that is tried, and largest number of rows in a sweep: arrays of more would not stay in the
processor's cache."""

NEAR, WANTED = 0.1, 1e-3
"""Largest correction of a prediction that is accepted, and the one that the length of sweeps aims at [rad or m]."""

CONTRACTION = 0.25
"""Largest ratio of a correction to the one before: Newton's method on its way to the only solution nearby."""

ENOUGH = 1e-9
"""Correction that is the last: Newton's method doubles the digits."""

ITERATIONS = 5

REGULAR = 1e-3
"""Smallest ratio of singular values of J from which a sweep begins, far above the one that counts as singular."""

INDEPENDENT = 1e-6
"""Smallest pivot, of rows of length 1, of a row that says something new."""

KEPT = 0.1
"""Part of itself that a pivot keeps through sweeps in one order, and likewise their product, the determinant."""


@dataclass(frozen=True, eq=False)
class Solved:
    """Rows of the table that a sweep has solved, from its first one on; there may be none.

    Attributes:
        q: Configurations, shape (nv, n).
        v: Velocities, shape (nv, n).
        a: Accelerations, shape (nv, n).
        transmission: T, with ``v = T w'``, shape (k, nv, n).
    """

    q: Array
    v: Array
    a: Array
    transmission: Array

    def __len__(self) -> int:
        return int(self.q.shape[1])

    def until(self, n: int) -> Solved:
        """Return the first n rows."""
        return Solved(self.q[:, :n], self.v[:, :n], self.a[:, :n], self.transmission[:, :, :n])


class Sweep:
    """Sweeps over the rows of one table.

    Args:
        nv: Number of joints.
        measures: What the constraints measure, then what the imposed coordinates do.
        own: Number of rows of the constraints.
        k: Number of imposed coordinates.
    """

    def __init__(self, nv: int, measures: Measures, own: int, k: int) -> None:
        self.nv, self.measures, self.own, self.k = nv, measures, own, k
        self._order: list[tuple[int, int]] = []
        self._reference: list[Array] = []
        self._length = LONGEST

    @classmethod
    def of(cls, closure: Closure, imposed: Imposed) -> Sweep | None:
        """Return the sweeps of a mechanism; ``None`` where something cannot be had at many configurations."""
        measures = Measures.of(closure.model, (*closure.constraints, *imposed.coordinates))
        return cls(closure.model.nv, measures, closure.size, len(imposed.names)) if measures else None

    def ahead(self, t: Array, w: Array, q: Array, v: Array, a: Array) -> Solved:
        """Return the rows up to the last one that is surely on the branch of the first.

        Args:
            t: Instants, of which the first is solved, shape (n,).
            w: Imposed coordinates with their derivatives, shape (k, 3, n).
            q: Configuration at the first instant, shape (nv,).
            v: Velocity there, shape (nv,).
            a: Acceleration there, shape (nv,).
        """
        h, w = t[: self._length] - t[0], w[:, :, : self._length]
        with np.errstate(all="ignore"):  # beyond the branch anything may come out: it is not accepted
            if not self._begun(q):
                return self._nothing()
            predicted = q[:, None] + h * v[:, None] + (0.5 * h * h) * a[:, None]
            solution, correction, good = self._newton(predicted, w[:, 0])
            measured = self.measures.at(solution)
            found, kept = self._rates(solution, measured, w[:, 1], w[:, 2])
            n = self._leading(kept, good & self._closed(measured, w[:, 0]))
            self._length = _next_length(n, correction)
        return found.until(n)

    def rates(self, q: Array, dw: Array, ddw: Array) -> Solved:
        """Return velocities and accelerations of the rows up to the last one that surely is regular.

        Args:
            q: Closed configurations, shape (nv, n).
            dw: Velocities of the imposed coordinates, shape (k, n).
            ddw: Their accelerations, shape (k, n).
        """
        with np.errstate(all="ignore"):
            if not self._begun(q[:, 0]):
                return self._nothing()
            found, kept = self._rates(q, self.measures.at(q), dw, ddw)
            return found.until(self._leading(kept, kept))

    def _nothing(self) -> Solved:
        q, v, a = np.zeros((3, self.nv, 0))
        return Solved(q, v, a, np.zeros((self.k, self.nv, 0)))

    def _begun(self, q: Array) -> bool:
        """Choose the order of the pivots at a configuration, unless there is one; tell whether it is regular."""
        if not self._order:
            measured = self.measures.at(q[:, None])
            rows = measured.rows(range(self.own + self.k))
            dense = np.zeros((self.own + self.k, self.nv))
            for row, entries in rows.items():
                for column, entry in entries.items():
                    dense[row, column] = entry[0]
            values = np.linalg.svd(dense, compute_uv=False)
            if len(dense) < self.nv or not values[self.nv - 1] >= REGULAR * values[0]:
                return False
            self._order = pivots(dense, INDEPENDENT)
            self._reference = list(Elimination.of(rows, self._order).pivots)
        return len(self._order) == self.nv

    def _newton(self, q: Array, w: Array) -> tuple[Array, Array, Flags]:
        """Return the solutions near predictions, how far they were from them, and which came as they should."""
        chosen = [row for row, _ in self._order]
        first = last = np.full(q.shape[1], np.inf)
        good = np.ones(q.shape[1], dtype=bool)
        for iteration in range(ITERATIONS):
            measured = self.measures.at(q)
            gap, wanted = measured.gap(), dict.fromkeys(range(self.own), 0.0) | dict(enumerate(w, self.own))
            step = Elimination.of(measured.rows(chosen), self._order).solve({i: wanted[i] - gap[i] for i in chosen})
            size = np.abs(np.array(np.broadcast_arrays(*step.values()))).max(axis=0)
            for column, x in step.items():
                q[column] += x
            good &= (size <= NEAR) if iteration == 0 else (size <= CONTRACTION * last) | (size < ENOUGH)
            first = size if iteration == 0 else first
            last = size
            if size[good].max(initial=0.0) < ENOUGH:
                break
        return q, first, np.asarray(good & (last < ENOUGH))

    def _closed(self, measured: MeasuredAll, w: Array) -> Flags:
        """Return at which configurations all rows are closed, those without pivots too."""
        gap, closed = measured.gap(), np.ones(w.shape[1], dtype=bool)
        for x in gap[: self.own]:
            closed &= np.abs(x) <= CLOSED
        for x, wanted in zip(gap[self.own :], w, strict=True):
            closed &= np.abs(wanted - x) <= CLOSED * (1.0 + np.abs(wanted))
        return closed

    def _rates(self, q: Array, measured: MeasuredAll, dw: Array, ddw: Array) -> tuple[Solved, Flags]:
        """Return velocities and accelerations, and where the pivots are still good."""
        chosen = [row for row, _ in self._order]
        elimination = Elimination.of(measured.rows(chosen), self._order)
        transmission = np.zeros((self.k, *q.shape))
        for i in range(self.k):
            for column, x in elimination.solve({self.own + i: np.ones(1)}).items():
                transmission[i, column] = x
        v = (transmission * dw[:, None]).sum(axis=0)
        right = {row: -x for row, x in measured.drift(chosen, v).items()}
        for i, x in enumerate(ddw, self.own):
            right[i] = x + right[i] if i in right else x
        a = np.zeros_like(q)
        for column, x in elimination.solve(right).items():
            a[column] = x
        kept, product = np.ones(q.shape[1], dtype=bool), np.ones(1)
        for pivot, reference in zip(elimination.pivots, self._reference, strict=True):
            share = pivot / reference
            product = product * share
            kept &= (share > KEPT) & (product > KEPT)
        return Solved(q, v, a, transmission), kept

    def _leading(self, kept: Flags, good: Flags) -> int:
        """Return the number of rows before the first that is not good; forget the order where pivots got small."""
        if not kept.all():
            self._order = []
        good = good & kept
        return len(good) if good.all() else int(good.argmin())


def _next_length(n: int, correction: Array) -> int:
    """Return how many rows to try at once, from how many were good; errors of predictions grow as the cube of time."""
    last = float(correction[n - 1]) if n else np.inf
    return int(np.clip(n * np.clip(np.cbrt(WANTED / max(last, 1e-300)), 0.5, 2.0), SHORTEST, LONGEST))

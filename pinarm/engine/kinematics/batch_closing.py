"""Newton's method on constraints and prescribed coordinates at many states at once, of one mechanism or of variants.

As many rows of J as unknowns are chosen at one regular configuration by pivots; other rows repeat them. Each state is
solved by LU factors of these rows, independently of the states beside it. Arrays have the states, and variants, along
their leading axes: q has the shape (n, nv), of variants (n, k, nv). Mechanisms with ball joints are not solved so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import EvaluatedRows
from pinarm.engine.constraints.nullspace import independent_rows
from pinarm.engine.kinematics.newton import CLOSED, CONTRACTION
from pinarm.engine.kinematics.singular import ENOUGH, on_branch
from pinarm.records import Record

REGULAR = 1e-4
"""Smallest ratio of singular values of J at which rows are chosen that serve other configurations, too."""

ROUNDING = 1e-15
"""Correction that would change nothing any more [rad or m]."""


NEAR, ITERATIONS = 0.1, 5
"""Largest correction of a prediction that is accepted [rad or m], and most corrections."""


class Solution(NamedTuple):
    """Solutions near given configurations.

    Attributes:
        q: The configurations, shape (.., nv).
        correction: Size of the first correction, shape (..).
        steady: Where every correction was much smaller than the one before.
        done: Where the corrections vanish, or are no numbers.
    """

    q: Array
    correction: Array
    steady: Flags
    done: Flags


class Rates(NamedTuple):
    """Velocities and accelerations, shape (.., nv), and how regular the chosen rows are.

    Attributes:
        v: Velocities.
        a: Accelerations.
        size: Largest entry of J^-1, shape (..).
        sense: Sign of the determinant of J, shape (..): another one is beyond a singular position.
    """

    v: Array
    a: Array
    size: Array
    sense: Array


class Corrected(NamedTuple):
    """Solutions near predictions.

    Attributes:
        q: Configurations, shape (n, nv).
        rates: Their velocities and accelerations.
        correction: Size of the first correction, shape (n,).
        near: Where the chosen rows are closed, surely on the branch of the prediction, shape (n,).
        closed: Where all rows are closed, shape (n,).
    """

    q: Array
    rates: Rates
    correction: Array
    near: Flags
    closed: Flags


class BatchClosing(Record, frozen=True):
    """Independent rows of J.

    Attributes:
        rows: The constraints, then the prescribed coordinates.
        own: Number m of rows of the constraints.
        kept: Chosen rows, ascending.
        size: Largest entry of J^-1 where they were chosen.
        sense: Sign of the determinant of J there.
    """

    rows: Closure
    own: int
    kept: list[int]
    size: float
    sense: float

    @classmethod
    def of(cls, rows: Closure, own: int, matrix: Array) -> BatchClosing | None:
        """Return the rows chosen where all rows are a matrix, shape (m + k, nv); ``None`` at a singular position."""
        values, nv = np.linalg.svd(matrix, compute_uv=False), matrix.shape[1]
        if len(values) < nv or values[-1] < REGULAR * values[0]:
            return None
        kept = independent_rows(matrix, nv, rows.reach)
        size = float(np.abs(np.linalg.inv(matrix[kept])).max(initial=0.0))
        return cls(rows, own, kept, size, float(np.linalg.slogdet(matrix[kept])[0]))

    def at(self, q: Array) -> EvaluatedRows:
        """Return all rows, evaluated."""
        return self.rows.constraint_rows.at(q)

    def missing(self, measured: EvaluatedRows, w: Array) -> Array:
        """Return ``(-phi(q), w - w(q))`` [m or rad], shape (.., m + k)."""
        missing = -measured.gaps
        missing[..., self.own :] += w
        return missing

    def allowed(self, w: Array) -> Array:
        """Return the gaps that are rounding, shape (.., m + k); of rows that repeat the chosen ones, of the file."""
        slack, wanted = self.rows.slack.copy(), np.zeros((*w.shape[:-1], self.rows.size))
        slack[self.kept], wanted[..., self.own :] = 0.0, np.abs(w)
        return np.asarray(CLOSED * (np.maximum(self.rows.measure, self.rows.reach) + wanted) + slack)

    def closed(self, measured: EvaluatedRows, w: Array) -> Flags:
        """Return where all rows are closed to ``allowed``."""
        return np.asarray((np.abs(self.missing(measured, w)) <= self.allowed(w)).all(axis=-1))

    def solve(self, q: Array, w: Array, steps: int) -> Solution:
        """Return the solutions near configurations.

        A state that is solved moves no more, so that it does not depend on the states beside it.

        Args:
            q: Configurations, shape (.., nv).
            w: Wanted values of the prescribed coordinates, shape (.., k).
            steps: Most steps.
        """
        size, first = np.full(w.shape[:-1], np.inf), np.zeros(0)
        steady, done = np.ones(w.shape[:-1], dtype=bool), np.zeros(w.shape[:-1], dtype=bool)
        for iteration in range(steps):
            measured = self.at(q)
            step = _solved(self._matrices(measured), self.missing(measured, w)[..., self.kept])
            size, before = np.abs(step).max(axis=-1), size
            steady &= (size <= CONTRACTION * before) | (size < ENOUGH)
            q = np.where(done[..., None], q, q + step)
            left = size * (size / before) ** 2 if iteration else size  # the next one: errors are squared at every step
            first = first if iteration else size
            done |= ~((size >= ENOUGH) & (left >= ROUNDING))
            if done.all():
                break
        return Solution(q, first, steady, done)

    def corrected(self, predicted: Array, slope: Array, h: Array, laws: Array) -> Corrected:
        """Return the solutions near predictions.

        Args:
            predicted: Configurations, shape (n, nv).
            slope: Predicted velocities, shape (n, nv).
            h: Times of the predictions [s], shape (n,).
            laws: Prescribed coordinates and their two derivatives, shape (3, n, k).
        """
        solution = self.solve(predicted, laws[0], ITERATIONS)
        measured = self.at(solution.q)
        rates = self.rates(measured, laws[1], laws[2])
        near = solution.done & solution.steady & (solution.correction <= NEAR)
        near &= on_branch(h[:, None] * (rates.v - slope), solution.correction)
        return Corrected(solution.q, rates, solution.correction, near, self.closed(measured, laws[0]))

    def rates(self, measured: EvaluatedRows, dw: Array, ddw: Array) -> Rates:
        """Return v with ``J v = (0, dw)`` and a with ``J a = (0, ddw) - J' v``; dw and ddw of shape (.., k)."""
        matrices = self._matrices(measured)
        sense = np.linalg.slogdet(matrices)[0]
        matrices[sense == 0.0] = np.nan
        inverse = np.linalg.inv(matrices)
        right = np.zeros((*dw.shape[:-1], self.rows.size))
        right[..., self.own :] = dw
        v = np.matvec(inverse, right[..., self.kept])
        right[..., self.own :] = ddw
        a = np.matvec(inverse, (right - measured.drifts(v))[..., self.kept])
        return Rates(v, a, np.abs(inverse).max(axis=(-2, -1), initial=0.0), sense)

    def _matrices(self, measured: EvaluatedRows) -> Array:
        """Return the chosen rows, shape (.., nv, nv)."""
        some = measured.some(np.array(self.kept, dtype=np.intp), np.arange(self.rows.model.nv))
        return np.ascontiguousarray(np.moveaxis(some, (0, 1), (-2, -1)))


def _solved(matrices: Array, right: Array) -> Array:
    """Return x with ``J x = right``, shape (.., nv); no numbers where J is exactly singular."""
    matrices[np.linalg.det(matrices) == 0.0] = np.nan
    return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])

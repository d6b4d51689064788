"""Newton's method at many instants at once, on mechanisms without ball joints.

From a solved row of the table, the rows ahead are predicted by its velocity and the last accelerations, and corrected
together, as far ahead as this surely stays on the branch: the prediction is near, every correction is much smaller than
the one before, the velocity is that of a smooth motion, and the determinant of J keeps its sign and a good part of its
size. The next sweep begins where one ends. What is singular, or out of reach, no sweep accepts: such rows are left to
the continuation row by row.

Arrays have the rows of the table along their last axis.
"""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import EvaluatedRows
from pinarm.engine.constraints.orthogonal_rows import REGULAR, DeterminingRows
from pinarm.engine.kinematics.branch_test import ENOUGH, on_branch
from pinarm.engine.kinematics.newton import CLOSED, CONTRACTION
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates

SHORTEST = 4
"""Smallest number of rows that is tried at once."""

NEAR, WANTED = 0.1, 1e-2
"""Largest correction of a prediction that is accepted, and the one that the length of sweeps aims at [rad or m]."""

NOTHING: tuple[Array, ...] = (np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0)))
"""No rows of q, v and a."""

KNOWN = 3
"""Accelerations that a prediction is made of: of the rows before, as many as there are since the laws last jumped."""

ITERATIONS = 5

ROUNDING = 1e-15
"""Correction that would change nothing any more [rad or m]."""

BLOCK = 2048
"""Number of rows that are tried at once at most."""

SIZES = (1e-4, 1e4)
"""Lengths of mechanisms that are solved in metres [m]."""


class BatchContinuation:
    """Sweeps over the rows of one table.

    Args:
        rows: The constraints, and the prescribed coordinates.
        own: Number m of rows of the constraints.
    """

    def __init__(self, rows: Closure, own: int) -> None:
        self.nv, self.rows, self.own = rows.model.nv, rows, own
        self._chosen: DeterminingRows | None = None
        self._length = BLOCK

    @classmethod
    def of(cls, closure: Closure, prescribed: PrescribedCoordinates) -> BatchContinuation | None:
        """Return the sweeps of a mechanism; ``None`` where configurations are not numbers, as of ball joints.

        Nor for the very small or large, which only ``NewtonSolver`` measures in a unit of their own.
        """
        if not SIZES[0] < closure.extent < SIZES[1] or closure.model.nq > closure.model.nv:
            return None
        return cls(closure.with_guides(prescribed.names, prescribed.coordinates), closure.size)

    def ahead(self, t: Array, w: Array, q: Array, v: Array, before: Array, a: Array) -> tuple[Array, ...]:
        """Return q, v and a, shape (m, nv), at as many of the instants after the first as surely are on its branch.

        Args:
            t: Instants, of which the first is solved, shape (n,).
            w: Prescribed coordinates and their two derivatives, shape (3, n, k).
            q: Configuration at the first instant, shape (nv,).
            v: Velocity there, shape (nv,).
            before: The last instants up to the first one, at most ``KNOWN``, shape (p,).
            a: Accelerations there, shape (p, nv).
        """
        h, wanted = t[: self._length] - t[0], np.ascontiguousarray(w[:, : self._length].transpose(0, 2, 1))
        with np.errstate(all="ignore"):  # beyond the branch anything may come out: it is not accepted
            predicted, slope = _predicted(h, q, v, before, a)
            chosen = self._chosen_at(q)
            if chosen is None:
                return NOTHING
            found, correction, good = self._newton(chosen, predicted, wanted[0])
            measured = self._evaluated(found)
            dq, ddq, served = self._rates(chosen, measured, wanted[1], wanted[2])
            good &= self._closed(chosen, measured, wanted[0]) & on_branch(h * (dq - slope), correction)
            n = self._leading(served, good)
            self._length = _next_length(n, correction, 2 + len(a))
        return found[:, 1:n].T, dq[:, 1:n].T, ddq[:, 1:n].T

    def rates(self, q: Array, dw: Array, ddw: Array) -> tuple[Array, ...]:
        """Return v and a, shape (m, nv), at as many of the first configurations as surely are regular.

        Args:
            q: Closed configurations, shape (n, nv).
            dw: Velocities of the prescribed coordinates, shape (k,).
            ddw: Their accelerations, shape (k,).
        """
        block = np.ascontiguousarray(q[:BLOCK].T)
        with np.errstate(all="ignore"):
            chosen = self._chosen_at(q[0])
            if chosen is None:
                return NOTHING[1:]
            targets = (np.repeat(x[:, None], block.shape[1], axis=1) for x in (dw, ddw))
            v, a, served = self._rates(chosen, self._evaluated(block), *targets)
            n = self._leading(served, np.ones(block.shape[1], dtype=bool))
        return v[:, :n].T, a[:, :n].T

    def _evaluated(self, q: Array) -> EvaluatedRows:
        return self.rows.constraint_rows.at(np.ascontiguousarray(q.T))

    def _chosen_at(self, q: Array) -> DeterminingRows | None:
        """Return the rows that determine the motion: the last ones, or else those of a regular configuration."""
        if self._chosen is None:
            matrix = self.rows.rows(self.rows.state(q))
            values = np.linalg.svd(matrix, compute_uv=False)
            if len(values) == self.nv and values[-1] >= REGULAR * values[0]:
                self._chosen = DeterminingRows.of(matrix, self.rows.groups, self.rows.reach)
        return self._chosen

    def _newton(self, chosen: DeterminingRows, q: Array, w: Array) -> tuple[Array, Array, Flags]:
        """Return the solutions near predictions, how far they were from them, and which of them are to be trusted.

        Args:
            chosen: Rows that determine the motion.
            q: Predictions, shape (nv, n); they become the solutions.
            w: Wanted values of the prescribed coordinates, shape (k, n).
        """
        n = q.shape[1]
        first, last, left, good = np.zeros(n), np.full(n, np.inf), np.full(n, np.inf), np.ones(n, dtype=bool)
        for iteration in range(ITERATIONS):
            measured = self._evaluated(q)
            step = chosen.at(measured).solve(self._missing(measured, w))
            q, size = q + step, np.abs(step).max(axis=0)
            if iteration == 0:
                first, left, good = size, size, size <= NEAR
            else:
                good &= (size <= CONTRACTION * last) | (size < ENOUGH)
                left = size * (size / last) ** 2  # the next one, as the error is squared from step to step
            last, left = size, np.where(size < ENOUGH, 0.0, left)
            if left[good].max(initial=0.0) < ROUNDING:
                break
        return q, first, good & (left < ROUNDING)

    def _missing(self, measured: EvaluatedRows, w: Array) -> Array:
        """Return what is missing in all rows [m or rad], shape (m, n)."""
        missing = -measured.gaps.T
        missing[self.own :] += w
        return missing

    def _closed(self, chosen: DeterminingRows, measured: EvaluatedRows, w: Array) -> Flags:
        """Return where all rows are closed, shape (n,): those that repeat the chosen ones, but for a slack."""
        slack, wanted = self.rows.slack.copy(), np.zeros((len(self.rows.slack), w.shape[1]))
        slack[chosen.every] = 0.0
        wanted[self.own :] = np.abs(w)
        return np.asarray((np.abs(self._missing(measured, w)) <= CLOSED * (1.0 + wanted) + slack[:, None]).all(axis=0))

    def _rates(
        self, chosen: DeterminingRows, measured: EvaluatedRows, dw: Array, ddw: Array
    ) -> tuple[Array, Array, Flags]:
        """Return v and a, each of shape (nv, n), and where the chosen rows still determine the motion, shape (n,)."""
        solver, right = chosen.at(measured), np.zeros((self.rows.size, dw.shape[1]))
        right[self.own :] = dw
        v = solver.solve(right)
        right[self.own :] = ddw
        return v, solver.solve(right - measured.drifts(v.T).T), solver.served

    def _leading(self, served: Flags, good: Flags) -> int:
        """Return how many rows precede the first one that is not good; forget chosen rows that serve no longer."""
        if not served.all():
            self._chosen = None
        good = good & served
        return len(good) if good.all() else int(good.argmin())


def _predicted(h: Array, q: Array, v: Array, t: Array, a: Array) -> tuple[Array, Array]:
    """Return configurations and velocities ahead, shape (nv, n), by the polynomial through the last accelerations.

    Args:
        h: Times from the last instant [s], shape (n,).
        q: Configuration there, shape (nv,).
        v: Velocity there, shape (nv,).
        t: The last instants, ascending, at most three, shape (p,).
        a: Accelerations there, shape (p, nv).
    """
    derivatives = [a[-1]]
    if len(a) > 1:
        slopes, steps = np.diff(a, axis=0) / np.diff(t)[:, None], np.diff(t)
        derivatives.append(slopes[-1])
        if len(a) > 2:
            bend = (slopes[1] - slopes[0]) / (t[2] - t[0])
            derivatives = [a[-1], slopes[1] + steps[1] * bend, 2.0 * bend]
    position, velocity = np.zeros((2, len(q), len(h)))
    for order, derivative in reversed([*enumerate(derivatives, 2)]):  # Horner's scheme, from the highest power down
        position = h / order * (derivative[:, None] + position)
        velocity = h / (order - 1) * (derivative[:, None] + velocity)
    return q[:, None] + h * (v[:, None] + position), v[:, None] + velocity


def _next_length(n: int, correction: Array, order: int) -> int:
    """Return how many rows to try next, n having been good; errors of predictions grow with a power of time."""
    last = float(correction[n - 1]) if n else np.inf
    growth = min(max((WANTED / max(last, 1e-300)) ** (1.0 / order), 0.5), 2.0)
    return min(max(int(n * growth), SHORTEST), BLOCK)

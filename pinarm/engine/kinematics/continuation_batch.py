"""Newton's method at many instants at once, on mechanisms whose joints turn or slide.

From a solved row of the table, the rows ahead are predicted by its velocity and the last accelerations, and corrected
together, as far ahead as this surely stays on the branch: the prediction is near, every correction is much smaller than
the one before, the velocity is that of a smooth motion, and the determinant of J keeps its sign and a good part of its
size. The next sweep begins where one ends. What is singular, or out of reach, no sweep accepts: such rows are left to
the continuation row by row.

The equations are those of ``engine.following``. Arrays have the rows of the table along their last axis.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.batch_jacobians import BLOCK, BatchJacobians, EvaluatedJacobians
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspaces.elimination import Elimination, Order, dense
from pinarm.engine.constraints.nullspaces.nullspace import singular_values
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

REGULAR = 1e-4
"""Smallest ratio of singular values of J from which sweeps begin: while the determinant keeps a tenth of itself, it
stays well above ``SINGULAR``."""


SIZES = (1e-4, 1e4)
"""Lengths of mechanisms that are solved in metres [m]."""


class BatchContinuation:
    """Sweeps over the rows of one table.

    Args:
        measures: What the constraints measure, then what the prescribed coordinates do.
        rows: The constraints, and these coordinates.
        own: Number m of rows of the constraints.
    """

    def __init__(self, measures: BatchJacobians, rows: Closure, own: int) -> None:
        self.nv, self.measures, self.own = rows.model.nv, measures, own
        self.reach, self.slack = rows.reach, rows.slack
        self._order: Order | None = None
        self._length = BLOCK

    @classmethod
    def of(cls, closure: Closure, prescribed: PrescribedCoordinates) -> BatchContinuation | None:
        """Return the sweeps of a mechanism; ``None`` where something cannot be had at many configurations.

        Nor for the very small or large, which only ``NewtonSolver`` measures in a unit of their own.
        """
        if not SIZES[0] < closure.extent < SIZES[1]:
            return None
        rows = closure.with_guides(prescribed.names, prescribed.coordinates)
        return cls(rows.batch_jacobians, rows, closure.size) if rows.batch_jacobians else None

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
            order = self._order_at(q)
            if order is None:
                return NOTHING
            found, correction, good = self._newton(order, predicted, wanted[0])
            measured = self.measures.at(found)
            dq, ddq, served = self._rates(order, measured, wanted[1], wanted[2], len(h))
            good &= self._closed(order, measured, wanted[0]) & on_branch(h * (dq - slope), correction)
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
            order = self._order_at(q[0])
            if order is None:
                return NOTHING[1:]
            measured, n = self.measures.at(block), block.shape[1]
            v, a, served = self._rates(order, measured, dw[:, None], ddw[:, None], n)
            n = self._leading(served, np.ones(n, dtype=bool))
        return v[:, :n].T, a[:, :n].T

    def _order_at(self, q: Array) -> Order | None:
        """Return the order of the pivots: the last one, or else one for a configuration if that is regular enough."""
        if self._order is None:
            shape = self.measures.size, self.nv
            matrix = dense(self.measures.at(q[:, None]).rows(range(shape[0])), shape)
            values = singular_values(matrix)
            if len(values) == self.nv and values[-1] >= REGULAR * values[0]:
                order = Order.of(matrix, self.nv, self.reach)
                self._order = order if len(order.rows) == self.nv else None
        return self._order

    def _newton(self, order: Order, q: Array, w: Array) -> tuple[Array, Array, Flags]:
        """Return the solutions near predictions, how far they were from them, and which of them are to be trusted.

        Args:
            order: Order of the pivots.
            q: Predictions, shape (nv, n); they become the solutions.
            w: Wanted values of the prescribed coordinates, shape (k, n).
        """
        wanted, n, needed = [0.0] * self.own + list(w), q.shape[1], set(order.rows)
        first, last, left, good = np.zeros(n), np.full(n, np.inf), np.full(n, np.inf), np.ones(n, dtype=bool)
        for iteration in range(ITERATIONS):
            measured = self.measures.at(q)
            gap, elimination = measured.gap(), Elimination.of(measured.rows(needed), order)
            size = np.zeros(n)
            for column, step in elimination.solve({row: wanted[row] - gap[row] for row in order.rows}).items():
                q[column] += step
                size = np.maximum(size, np.abs(step))
            if iteration == 0:
                first, left, good = size, size, size <= NEAR
            else:
                good &= (size <= CONTRACTION * last) | (size < ENOUGH)
                left = size * (size / last) ** 2  # the next one, as the error is squared from step to step
            last, left = size, np.where(size < ENOUGH, 0.0, left)
            if left[good].max(initial=0.0) < ROUNDING:
                break
        return q, first, good & (left < ROUNDING)

    def _closed(self, order: Order, measured: EvaluatedJacobians, w: Array) -> Flags:
        """Return where all rows are closed, shape (n,): those without pivots, which repeat others, but for a slack."""
        gap, closed, exact = measured.gap(), np.ones(w.shape[1], dtype=bool), set(order.rows)
        for row, x in enumerate(gap[: self.own]):
            closed &= np.abs(x) <= CLOSED + (0.0 if row in exact else self.slack[row])
        for x, wanted in zip(gap[self.own :], w, strict=True):
            closed &= np.abs(wanted - x) <= CLOSED * (1.0 + np.abs(wanted))
        return closed

    def _rates(
        self, order: Order, measured: EvaluatedJacobians, dw: Array, ddw: Array, n: int
    ) -> tuple[Array, Array, Flags]:
        """Return v and a, each of shape (nv, n), and where the order of the pivots still serves, shape (n,) or (1,)."""
        needed = set(order.rows)
        elimination = Elimination.of(measured.rows(needed), order)
        v = self._stacked(elimination.solve(dict(enumerate(dw, self.own))), n)
        right = {row: -x for row, x in measured.drift(needed, v).items()}
        for row, x in enumerate(ddw, self.own):
            right[row] = x + right[row] if row in right else x
        return v, self._stacked(elimination.solve(right), n), elimination.sound() & elimination.continued()

    def _stacked(self, columns: Mapping[int, Array], n: int) -> Array:
        """Return an array of shape (nv, n) from its rows, 0 where they are absent."""
        stacked = np.zeros((self.nv, n))
        for column, x in columns.items():
            stacked[column] = x
        return stacked

    def _leading(self, served: Flags, good: Flags) -> int:
        """Return how many rows come before the first that is not good; forget the order where it no longer serves."""
        if not served.all():
            self._order = None
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

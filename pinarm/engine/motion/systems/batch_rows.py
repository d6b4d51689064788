"""Rows of the table of a constrained motion, solved many at a time where one order of elimination serves them.

The equations are those of ``systems.constrained``. Arrays have the rows of the table first, in ``BatchJacobians`` last.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.batch_jacobians import BatchJacobians, EvaluatedJacobians
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspaces.elimination import dense
from pinarm.engine.constraints.nullspaces.nullspace import MANY
from pinarm.engine.constraints.nullspaces.nullspace_batch import BatchNullspace, regular_order
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.records import Record

CLOSED = 1e-13
"""Gap at which a state counts as closed [m or rad]; one step more ends at rounding."""

ROUNDED = 1e-15
"""Gap that is rounding, relative to the extent: close to singular positions less than that is still felt."""

TURNED = 1e-15
"""What rounding of an angle of many turns leaves open, over the angle."""

ITERATIONS = 12
"""Steps of Newton's method at most, which close a state that is nearly closed in two or three."""

FEWEST = 100
"""Number of instants from which on it pays to solve these together, however many the loops are."""

Solved = tuple[Flags, Sequence[Array]]
"""Which rows have been solved, shape (n,), and of these q, v, a, the efforts, and the multipliers of the constraints,
NaN where they are not known: shapes (s, nq), (s, nv), (s, nv), (s, k) and (s, m)."""


class BatchRows(Record, frozen=True):
    """Rows under the constraints of a mechanism, some of whose coordinates follow laws.

    Attributes:
        measures: What the constraints measure, then what the prescribed coordinates do.
        own: Number of rows of the constraints.
        reach: Length that every row can have, shape (m,); see ``Closure.reach``.
        slack: What every row may leave open where it repeats others, shape (m,).
    """

    measures: BatchJacobians
    own: int
    reach: Array
    slack: Array

    @classmethod
    def of(cls, rows: Closure, own: int) -> BatchRows | None:
        """Return the rows of a closure; ``None`` where something cannot be had at many configurations."""
        return cls(rows.batch_jacobians, own, rows.reach, rows.slack) if rows.batch_jacobians else None

    def solve(self, dynamics: Dynamics, t: Array, w: Array, q: Array, v: Array) -> Solved | None:
        """Return the closed states nearest to given ones, with accelerations and the efforts of prescribed coordinates.

        Args:
            dynamics: The equation of motion.
            t: Instants [s], shape (n,); of few, each alone costs less.
            w: Prescribed coordinates and their two derivatives, shape (3, k, n).
            q: Configurations, shape (n, nv).
            v: Velocities, shape (n, nv).

        Returns:
            The rows that the order of elimination serves that suits the first one; ``None`` where it has none.
        """
        if len(q) < FEWEST or q.shape[1] > MANY:  # their mass matrices are dense
            return None
        every, measured, still = range(self.measures.size), self.measures.at(q.T), np.zeros_like(v)
        rows = measured.rows(every)
        order = regular_order(dense(rows, (len(every), q.shape[1])), self.reach)
        if order is None:
            return None
        freedom = BatchNullspace.of(rows, order, q.T.shape, self.reach)
        q, solved = self._closed(measured, freedom, dynamics.mass_matrices(q), w[0], q)
        measured, mass = self.measures.at(q.T), dynamics.mass_matrices(q)
        freedom = BatchNullspace.of(measured.rows(every), order, q.T.shape, self.reach)
        v = freedom.solve(mass, np.einsum("nij,nj->ni", mass, v), dict(enumerate(w[1], self.own)))
        right = {row: -x for row, x in measured.drift(every, v.T).items()}
        right |= {row: x + right.get(row, 0.0) for row, x in enumerate(w[2], self.own)}
        a = freedom.solve(mass, -dynamics.inverse(t, q, v, still), right)
        lam = np.zeros((len(q), len(every)))
        for row, multipliers in freedom.elimination.multipliers(dynamics.inverse(t, q, v, a)).items():
            lam[:, row] = multipliers
        if not freedom.alone(measured.rows(every), self.reach):
            lam[:, : self.own] = np.nan
        solved &= freedom.served
        found = q, v, a, lam[:, self.own :], lam[:, : self.own]
        return (solved, [x[solved] for x in found]) if solved[0] else None

    def _closed(
        self, measured: EvaluatedJacobians, freedom: BatchNullspace, mass: Array, w: Array, q: Array
    ) -> tuple[Array, Flags]:
        """Return the closed configurations nearest to given ones, and which of them are closed.

        The distance is measured by the masses. Newton's method with the rows and the masses of the given
        configurations, which are nearly closed. Rows that repeat others follow these, and may leave the slack open.
        """
        still, slack = np.zeros_like(q), self.slack[:, None].copy()
        slack[list(freedom.elimination.order.rows)] = 0.0
        for _ in range(ITERATIONS):
            gap = self._gap(measured, w)
            limit = CLOSED * (1.0 + np.abs(w).max(axis=0, initial=0.0)) + TURNED * np.abs(q).max(axis=1)
            closed = (np.abs(gap) - slack).max(axis=0) <= limit
            q = q + freedom.solve(mass, still, dict(enumerate(gap)))
            if closed[freedom.served].all():
                break
            measured = self.measures.at(q.T)
        return q, closed & freedom.served

    def _gap(self, measured: EvaluatedJacobians, w: Array) -> Array:
        """Return what is missing in every row [m or rad], shape (m, n)."""
        gap = -np.array([np.broadcast_to(x, w.shape[1]) for x in measured.gap()])
        gap[self.own :] += w
        return gap

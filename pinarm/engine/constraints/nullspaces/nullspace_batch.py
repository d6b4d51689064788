"""What constraints determine and what they leave free, at many configurations that are eliminated in one order.

G being the rows of the constraints, the free motions have a basis T with ``G T = 0``, orthonormal. Elimination tells
dependent joints from independent ones; one of these at velocity 1, the others at rest, is a free motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.batch_jacobians import BLOCK, BatchJacobians
from pinarm.engine.constraints.nullspaces.dense_nullspace import solved_positive
from pinarm.engine.constraints.nullspaces.elimination import Elimination, Order, Row, dense
from pinarm.engine.constraints.nullspaces.nullspace import VANISHED, split_rows
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.constraints.closure import Closure

REGULAR = 1e-4
"""Smallest ratio of singular values of G, its rows of length 1, at which other configurations are eliminated alike."""

ELIMINATED = 1e-12
"""What the rows that were eliminated may leave of motions of length 1, relative to the length that they can have. Along
a chain of loops rounding grows from one to the next, where the order of the pivots is that of another position."""


def free_motions(closure: Closure, q: Array) -> Iterator[tuple[Indices, Array]]:
    """Yield the free motions at configurations, shape (n, nq): of those together that one order of pivots serves.

    Yields:
        Places of some configurations, and T there, shape (f, places, nv).
    """
    n, nv = len(q), closure.model.nv
    if not closure.size:
        yield np.arange(n), np.broadcast_to(np.eye(nv)[:, None], (nv, n, nv))
        return
    measures = closure.batch_jacobians
    for start in range(0, n, BLOCK):
        left = np.arange(start, min(start + BLOCK, n))
        while len(left):
            freedom = _freedom(measures, closure.reach, np.ascontiguousarray(q[left].T)) if measures else None
            if freedom and freedom.served[0]:
                served, free = freedom.served, freedom.motions[:, freedom.served]
            else:
                rows = closure.rows(closure.state(q[left[0]]))
                served, free = np.arange(len(left)) == 0, closure.split(rows).free.T[:, None]
            yield left[served], free
            left = left[~served]


def _freedom(measures: BatchJacobians, reach: Array, q: Array) -> BatchNullspace | None:
    """Return the freedom of configurations, shape (nv, n), by the order of the first one; ``None`` if there is none."""
    rows = measures.at(q).rows(range(measures.size))
    order = regular_order(dense(rows, (measures.size, len(q))), reach)
    return BatchNullspace.of(rows, order, q.shape, reach) if order else None


def regular_order(matrix: Array, reach: Array) -> Order | None:
    """Return the order of elimination of G at a configuration, shape (m, nv); ``None`` close to singular ones.

    Also where nothing is to be eliminated; ``reach`` as in ``Closure.reach``.
    """
    split = split_rows(matrix, reach)
    return Order.of(matrix, split.rank, reach) if split.rank and split.regularity >= REGULAR else None


class BatchNullspace(Record, frozen=True):
    """The rows of G taken apart at n configurations; see ``nullspace.RowDecomposition`` for a single one.

    Attributes:
        elimination: Of those rows that determine what all of them do.
        motions: T, shape (f, n, nv).
        served: Where the order of the pivots serves; what is said of others is not to be used, shape (n,).
    """

    elimination: Elimination
    motions: Array
    served: Flags

    @classmethod
    def of(cls, rows: Mapping[int, Row], order: Order, shape: tuple[int, ...], reach: Array) -> BatchNullspace:
        """Return the freedom that rows leave.

        Args:
            rows: G at the configurations, redundant rows too.
            order: Order of the pivots.
            shape: Of the velocities: (nv, n).
            reach: Length that each row can have, shape (m,); see ``Closure.reach``.
        """
        nv, n = shape
        with np.errstate(all="ignore"):  # where the order does not serve
            elimination = Elimination.of(rows, order)
            independent = [column for column in range(nv) if column not in order.columns]
            motions = np.zeros((len(independent), n, nv))
            for motion, column in zip(motions, independent, strict=True):
                for j, x in elimination.solve({}, {column: np.ones(1)}).items():
                    motion[:, j] = x
            served = elimination.sound() & np.isfinite(motions).all(axis=(0, 2))
            motions = _orthonormal(np.where(served[:, None], motions, 0.0))
        for row, entries in rows.items():
            left = sum((x * motions[:, :, j] for j, x in entries.items()), np.zeros(1))
            least = ELIMINATED if row in order.rows else VANISHED
            served &= (np.abs(left) <= least * reach[row]).all(axis=0)
        return cls(elimination, motions, served)

    def alone(self, rows: Mapping[int, Row], reach: Array) -> bool:
        """Return whether all rows that were not eliminated are 0, so that they share no multipliers with the others."""
        others = rows.keys() - set(self.elimination.order.rows)
        return not any((np.abs(x) > VANISHED * reach[row]).any() for row in others for x in rows[row].values())

    def solve(self, mass: Array, force: Array, right: Mapping[int, Array]) -> Array:
        """Return the x that minimises ``x^T M x / 2 - force . x`` while ``G x = right``, shape (n, nv).

        The solve of ``engine.dynamics.equation``, by elimination.

        Args:
            mass: M, shape (n, nv, nv).
            force: Shape (n, nv).
            right: Row -> right-hand side, shape (n,) or (1,); 0 where it is absent.
        """
        x = np.zeros_like(force)
        with np.errstate(all="ignore"):  # where the order does not serve
            for j, column in self.elimination.solve(right).items():
                x[:, j] = column
        if not len(self.motions):
            return x
        moved = np.einsum("nij,fnj->fni", mass, self.motions)
        reduced = np.einsum("fni,gni->nfg", self.motions, moved)
        reduced[~self.served] = np.eye(len(moved))
        wanted = np.einsum("fni,ni->nf", self.motions, force - np.einsum("nij,nj->ni", mass, x))
        speeds = solved_positive(reduced, wanted[:, :, None])[:, :, 0]
        return np.asarray(x + np.einsum("nf,fni->ni", speeds, self.motions))


def _orthonormal(motions: Array) -> Array:
    """Return motions of length 1, at right angles to each other, with the same span; shape (f, n, nv) each.

    By the modified method of Gram and Schmidt: motions of joints that others leave at rest stay as they are.
    """
    found = motions.copy()
    for k, motion in enumerate(found):
        motion /= np.linalg.norm(motion, axis=1, keepdims=True)
        found[k + 1 :] -= np.einsum("fni,ni->fn", found[k + 1 :], motion)[..., None] * motion
    return found

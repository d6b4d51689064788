"""Gaussian elimination of many small systems of equations at once, in one order of pivots.

The systems ``A x = b`` are those of n configurations of one mechanism. A coefficient is an array over all of them, and
one that is absent is 0 in all: what is not there costs nothing, so that loops which do not touch are solved as if each
were alone. Which rows and columns to use, and in which order, is decided at one configuration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.nullspaces.nullspace import VANISHED
from pinarm.records import Record

Row = Mapping[int, Array]
"""A row of A: column -> coefficient, shape (n,), or (1,) where it is the same in all configurations."""

KEPT = 0.1
"""Part of itself that a pivot, or the determinant, keeps in systems that are like the one of the order."""


class Order(Record, frozen=True):
    """Pairs of a row and a column that determine as many unknowns as the rows can; redundant rows are in none.

    Attributes:
        rows: Row of every pivot, in the order of elimination.
        columns: Its column.
        pivots: Its value at the configuration at which the order was chosen.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    pivots: tuple[float, ...]

    @classmethod
    def of(cls, matrix: Array, rank: int, reach: Array | float = 1.0) -> Order:
        """Return the order of complete pivoting on rows of length 1.

        Args:
            matrix: A at one configuration, shape (m, nv).
            rank: Number of pivots.
            reach: Length that each row can have, shape (m,); see ``Closure.reach``.
        """
        length = np.sqrt((matrix * matrix).sum(axis=1))
        counts = length > VANISHED * reach
        length = np.where(counts, length, 1.0)
        left, found = matrix * (counts / length)[:, None], []
        for _ in range(rank):
            row, column = divmod(int(np.abs(left).argmax()), matrix.shape[1])
            pivot = float(left[row, column])
            found.append((row, column, pivot * float(length[row])))
            left -= np.outer(left[:, column] / pivot, left[row])
            left[row] = 0.0
        rows, columns, pivots = zip(*found, strict=True) if found else ((), (), ())
        return cls(rows, columns, pivots)


def dense(rows: Mapping[int, Row], shape: tuple[int, int]) -> Array:
    """Return the matrix of the first configuration, rows that are absent being 0."""
    matrix = np.zeros(shape)
    for i, row in rows.items():
        for j, coefficient in row.items():
            matrix[i, j] = coefficient[0]
    return matrix


class Elimination(Record, frozen=True):
    """Systems of equations taken apart.

    Attributes:
        order: The order of the pivots.
        pivots: Their values, shape (n,) or (1,) each.
        upper: What is left of their rows beside the pivot.
        lower: Place of a pivot, place of a later one, and how often the first one's row was taken from the second's.
    """

    order: Order
    pivots: Sequence[Array]
    upper: Sequence[Row]
    lower: Sequence[tuple[int, int, Array]]

    @classmethod
    def of(cls, rows: Mapping[int, Row], order: Order) -> Elimination:
        """Return the elimination of the rows that the order names."""
        left = [dict(rows[row]) for row in order.rows]
        pivots, lower = [], []
        for k, column in enumerate(order.columns):
            pivot = left[k].pop(column)
            pivots.append(pivot)
            for later in range(k + 1, len(left)):
                if column in left[later]:
                    share = left[later].pop(column) / pivot
                    lower.append((k, later, share))
                    for other, coefficient in left[k].items():
                        left[later][other] = _less(left[later].get(other), share * coefficient)
        return cls(order, pivots, left, lower)

    def solve(self, right: Mapping[int, Array], free: Mapping[int, Array] | None = None) -> dict[int, Array]:
        """Return x by columns, shape (n,) or (1,) each; columns that are absent are 0.

        Args:
            right: Row -> b, shape (n,) or (1,); rows that are absent are 0.
            free: Column without a pivot -> x, likewise.
        """
        b = {k: right[row] for k, row in enumerate(self.order.rows) if row in right}
        for k, later, share in self.lower:
            if k in b:
                b[later] = _less(b.get(later), share * b[k])
        x = dict(free or {})
        for k in reversed(range(len(self.pivots))):
            total = b.get(k)
            for column, coefficient in self.upper[k].items():
                if column in x:
                    total = _less(total, coefficient * x[column])
            if total is not None:
                x[self.order.columns[k]] = total / self.pivots[k]
        return x

    def multipliers(self, force: Array) -> dict[int, Array]:
        """Return lam by rows with ``A^T lam = force`` in the columns of the pivots, shape (n,) each.

        Args:
            force: Shape (n, nv).
        """
        left = {column: force[:, column] for column in self.order.columns}
        found = []
        for column, pivot, row in zip(self.order.columns, self.pivots, self.upper, strict=True):
            found.append(share := left[column] / pivot)
            for other, coefficient in row.items():
                if other in left:
                    left[other] = left[other] - coefficient * share
        for k, later, share in reversed(self.lower):
            found[k] = found[k] - share * found[later]
        return dict(zip(self.order.rows, found, strict=True))

    def sound(self) -> Flags:
        """Return in which systems every pivot has kept its size, so that rounding stays small, shape (n,) or (1,)."""
        good = np.ones(1, dtype=bool)
        for pivot, first in zip(self.pivots, self.order.pivots, strict=True):
            good = good & (np.abs(pivot) > KEPT * abs(first))
        return good

    def continued(self) -> Flags:
        """Return in which systems the determinant has kept its sign and its size, shape (n,) or (1,)."""
        product = np.ones(1)
        for pivot, first in zip(self.pivots, self.order.pivots, strict=True):
            product = product * (pivot / first)
        return np.asarray(product > KEPT)


def _less(total: Array | None, part: Array) -> Array:
    """Return ``total - part``, where no total means 0."""
    return -part if total is None else total - part

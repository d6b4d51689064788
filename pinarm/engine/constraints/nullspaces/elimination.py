"""Gaussian elimination of many small systems of equations at once, in one order of pivots.

The systems ``A x = b`` are those of n configurations of one mechanism. A coefficient is an array over all of them, and
one that is absent is 0 in all: what is not there costs nothing, so that loops which do not touch are solved as if each
were alone. Which rows and columns to use, and in which order, is decided at one configuration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from heapq import heappop, heappush

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.nullspaces.nullspace import VANISHED, split_rows
from pinarm.records import Record

Row = Mapping[int, Array]
"""A row of A: column -> coefficient, shape (n,), or (1,) where it is the same in all configurations."""

REGULAR = 1e-4
"""Smallest ratio of singular values of G, its rows of length 1, at which other configurations are eliminated alike."""

KEPT, SHRUNK = 0.1, 0.8
"""Part of itself that a pivot, or the determinant, keeps in systems that are like the one of the order. Pivots keeping
more than ``SHRUNK`` of it do not count in the determinant, of which ten of them leave a tenth."""


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
            rank: Number of pivots; fewer are found where all that is left is 0.
            reach: Length that each row can have, shape (m,); see ``Closure.reach``.
        """
        length = np.sqrt((matrix * matrix).sum(axis=1))
        counts = length > VANISHED * reach
        length = np.where(counts, length, 1.0)
        left = _Remainder(matrix * (counts / length)[:, None])
        found = [pair for pair in (left.eliminated() for _ in range(rank)) if pair]
        pivots = tuple(pivot * float(length[row]) for row, _, pivot in found)
        return cls(tuple(row for row, *_ in found), tuple(column for _, column, _ in found), pivots)


class _Remainder:
    """What is left of a matrix while rows are eliminated; what is 0 is absent.

    The largest entry of every row stands in a heap, once more whenever the row changes; ``largest`` tells which of
    these is true of the row as it is.
    """

    def __init__(self, matrix: Array) -> None:
        self.rows: dict[int, dict[int, float]] = {i: {} for i in range(len(matrix))}
        self.holding: dict[int, set[int]] = {j: set() for j in range(matrix.shape[1])}
        for i, j in np.argwhere(matrix).tolist():
            self.rows[i][j] = float(matrix[i, j])
            self.holding[j].add(i)
        self.largest: dict[int, tuple[float, int, int]] = {}
        self.heap: list[tuple[float, int, int]] = []
        for i in self.rows:
            self._measure(i)

    def eliminated(self) -> tuple[int, int, float] | None:
        """Return row, column and value of the largest entry, and take the row from the others that have the column.

        Nothing where all that is left is 0.
        """
        while self.heap and self.largest.get(self.heap[0][1]) != self.heap[0]:
            heappop(self.heap)
        if not self.heap or not self.heap[0][0]:
            return None
        _, row, column = heappop(self.heap)
        taken = self.rows.pop(row)
        del self.largest[row]
        for j in taken:
            self.holding[j].discard(row)
        pivot = taken.pop(column)
        for other in self.holding.pop(column):
            left = self.rows[other]
            share = left.pop(column) / pivot
            for j, coefficient in taken.items():
                left[j] = left.get(j, 0.0) - share * coefficient
                self.holding[j].add(other)
            self._measure(other)
        return row, column, pivot

    def _measure(self, i: int) -> None:
        """Put the largest entry of a row into the heap; of equal ones the first."""
        size, column = max(((abs(x), -j) for j, x in self.rows[i].items()), default=(0.0, 0))
        self.largest[i] = -size, i, -column
        heappush(self.heap, self.largest[i])


def regular_order(matrix: Array, reach: Array) -> Order | None:
    """Return the order of elimination of G at a configuration, shape (m, nv); ``None`` close to singular ones.

    Also where nothing is to be eliminated; ``reach`` as in ``Closure.reach``.
    """
    split = split_rows(matrix, reach)
    return Order.of(matrix, split.rank, reach) if split.rank and split.regularity >= REGULAR else None


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
        holding: dict[int, set[int]] = {}
        for k, row in enumerate(left):
            for column in row:
                holding.setdefault(column, set()).add(k)
        pivots, lower = [], []
        for k, column in enumerate(order.columns):
            pivot = left[k].pop(column)
            pivots.append(pivot)
            for later in sorted(each for each in holding[column] if each > k):
                share = left[later].pop(column) / pivot
                lower.append((k, later, share))
                for other, coefficient in left[k].items():
                    left[later][other] = _less(left[later].get(other), share * coefficient)
                    holding[other].add(later)
        return cls(order, pivots, left, lower)

    def solve(self, right: Mapping[int, Array]) -> dict[int, Array]:
        """Return x by columns, shape (n,) or (1,) each; columns that are absent are 0.

        Args:
            right: Row -> b, shape (n,) or (1,); rows that are absent are 0.
        """
        b = {k: right[row] for k, row in enumerate(self.order.rows) if row in right}
        for k, later, share in self.lower:
            if k in b:
                b[later] = _less(b.get(later), share * b[k])
        x = dict[int, Array]()
        for k in reversed(range(len(self.pivots))):
            total = b.get(k)
            for column, coefficient in self.upper[k].items():
                if column in x:
                    total = _less(total, coefficient * x[column])
            if total is not None:
                x[self.order.columns[k]] = total / self.pivots[k]
        return x

    def sound(self) -> Flags:
        """Return in which systems every pivot has kept its size, so that rounding stays small, shape (n,) or (1,)."""
        good = np.ones(1, dtype=bool)
        for pivot, first in zip(self.pivots, self.order.pivots, strict=True):
            good = good & (np.abs(pivot) > KEPT * abs(first))
        return good

    def continued(self) -> Flags:
        """Return in which systems the determinant has kept its sign and its size, shape (n,) or (1,).

        Of its size counts what pivots that have shrunk have lost: those of many loops change a little all at once.
        """
        product = np.ones(1)
        for pivot, first in zip(self.pivots, self.order.pivots, strict=True):
            ratio = pivot / first
            product = product * np.where(np.abs(ratio) > SHRUNK, np.sign(ratio), ratio)
        return np.asarray(product > KEPT)


def _less(total: Array | None, part: Array) -> Array:
    """Return ``total - part``, where no total means 0."""
    return -part if total is None else total - part

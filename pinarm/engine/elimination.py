"""Gaussian elimination of many small systems of equations at once, in one order of pivots.

The systems ``A x = b`` are those of n configurations of one mechanism. An entry of A is an array over all of them, and
one that is absent is 0 in all: what is not there costs nothing, so that loops which do not touch are solved as if they
were alone. Which rows and columns to use, and in which order, is decided once, at one configuration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array

Entries = Mapping[int, Array]
"""A row of A: column -> coefficient, shape (n,), or (1,) where it is the same in all configurations."""


def pivots(rows: Array, least: float) -> list[tuple[int, int]]:
    """Return pairs of a row and a column that determine as many unknowns as the rows do.

    By complete pivoting on rows of length 1. There may be more rows than unknowns: those that say nothing new are not
    among the pairs.

    Args:
        rows: A at one configuration, shape (m, nv).
        least: Smallest pivot that counts.
    """
    length = np.sqrt((rows * rows).sum(axis=1, keepdims=True))
    left = rows / np.where(length > 0.0, length, 1.0)
    found = []
    for _ in range(min(rows.shape)):
        row, column = divmod(int(np.abs(left).argmax()), rows.shape[1])
        if abs(left[row, column]) < least:
            break
        found.append((row, column))
        left -= np.outer(left[:, column] / left[row, column], left[row])
        left[row] = 0.0
    return found


@dataclass(frozen=True, eq=False)
class Elimination:
    """Systems of equations taken apart: ``A = L U`` in the order of the pivots.

    Attributes:
        order: Row and column of every pivot.
        pivots: Their values, shape (n,) or (1,) each.
        upper: Row of U of every pivot, without it.
        lower: Place of a pivot, of a later row, and how often the one is to be taken from the other, in the order in
            which it is done.
    """

    order: Sequence[tuple[int, int]]
    pivots: Sequence[Array]
    upper: Sequence[Entries]
    lower: Sequence[tuple[int, int, Array]]

    @classmethod
    def of(cls, rows: Mapping[int, Entries], order: Sequence[tuple[int, int]]) -> Elimination:
        """Return the elimination of the systems with the given rows; rows without a pivot are not read."""
        left = [dict(rows[row]) for row, _ in order]
        values, lower = [], []
        for k, (_, column) in enumerate(order):
            pivot = left[k].pop(column)
            values.append(pivot)
            for later in range(k + 1, len(order)):
                if column in left[later]:
                    share = left[later].pop(column) / pivot
                    lower.append((k, later, share))
                    for other, entry in left[k].items():
                        taken = share * entry
                        left[later][other] = left[later][other] - taken if other in left[later] else -taken
        return cls(order, values, left, lower)

    def solve(self, right: Mapping[int, Array]) -> dict[int, Array]:
        """Return x by its columns, shape (n,) or (1,) each; columns that are absent are 0.

        Args:
            right: Row -> b, shape (n,) or (1,); rows that are absent are 0.
        """
        b = {k: right[row] for k, (row, _) in enumerate(self.order) if row in right}
        for k, later, share in self.lower:
            if k in b:
                taken = share * b[k]
                b[later] = b[later] - taken if later in b else -taken
        x: dict[int, Array] = {}
        for k in range(len(self.order) - 1, -1, -1):
            known = [entry * x[column] for column, entry in self.upper[k].items() if column in x]
            if k in b or known:
                total = b.get(k, 0.0)
                for part in known:
                    total = total - part
                x[self.order[k][1]] = np.asarray(total / self.pivots[k])
        return x

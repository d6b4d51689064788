"""The constraint rows G taken apart: range, null space, rank and redundant rows, of few joints and of many."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.nullspaces.dense_nullspace import (
    ACTS,
    MANY,
    RANK,
    UNCLOSED,
    VANISHED,
    SplitRows,
    solved,
)
from pinarm.engine.constraints.nullspaces.separate_rows import (
    parts_apart,
    sparse_parts_apart,
    sparse_split_apart,
    split_apart,
)
from pinarm.records import Record

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = [
    "ACTS",
    "MANY",
    "RANK",
    "UNCLOSED",
    "VANISHED",
    "RowDecompositions",
    "SplitRows",
    "singular_values",
    "solved",
    "split_rows",
]


def split_rows(rows: Array, reach: Array | float = 1.0) -> SplitRows:
    """Return the parts of the rows G, shape (m, nv); ``reach`` as in ``RowDecompositions.of``."""
    if len(rows) and rows.shape[1] > MANY:
        from scipy.sparse import csr_array

        return sparse_split_apart(csr_array(rows), reach)
    return split_apart(rows, reach)


def singular_values(matrix: Array) -> Array:
    """Return the singular values of a matrix, shape (m, nv), descending.

    Of many columns those between the largest and the smallest that is not 0 are given as the largest, and those below
    ``RANK`` of the largest as 0.
    """
    if matrix.shape[1] <= MANY:
        return np.asarray(np.linalg.svd(matrix, compute_uv=False))
    from scipy.sparse import csr_array

    from pinarm.engine.constraints.nullspaces.sparse_nullspace import extreme_values

    return extreme_values(csr_array(matrix))


class RowDecompositions(Record, frozen=True):
    """The rows of G taken apart at n configurations, those with the same rank together.

    Attributes:
        parts: Places of some of the configurations, and what is theirs.
        shape: Of G, (n, m, nv).
    """

    parts: Sequence[tuple[Indices, SplitRows]]
    shape: tuple[int, ...]

    @classmethod
    def of(cls, rows: Array, reach: Array | float = 1.0) -> RowDecompositions:
        """Return the parts of rows.

        Args:
            rows: G, shape (n, m, nv).
            reach: Length that each row can have, shape (m,); see ``Closure.reach``.
        """
        return cls(_alike(rows, reach), rows.shape)

    @classmethod
    def of_many_joints(cls, rows: Sequence[csr_array], reach: Array) -> RowDecompositions:
        """Return the parts of rows of many joints, n matrices G of shape (m, nv); see ``of``."""
        return cls(sparse_parts_apart(rows, reach), (len(rows), *rows[0].shape))

    def multipliers(self, force: Array) -> Array:
        """Return what ``RowDecomposition.multipliers`` does, shape (n, m)."""
        return self.each(self.shape[1], lambda split, some: split.multipliers(some), force)

    @property
    def rank(self) -> int:
        """Number of independent rows, where there are fewest."""
        return min(split.rank for _, split in self.parts)

    def stresses_on(self, functions: Array) -> Array:
        """Return what ``SplitRows.stresses_on`` does, functions of shape (n, m, k), as an array of shape (n, m, s).

        Where there are fewer than at another configuration, 0 stands for the others.
        """
        found = [(some, split.stresses_on(functions[some])) for some, split in self.parts]
        stresses = np.zeros((*self.shape[:2], max(some.shape[-1] for _, some in found)))
        for some, columns in found:
            stresses[some, :, : columns.shape[-1]] = columns
        return stresses

    def each(self, width: int, function: Callable[..., Array], *given: Any) -> Array:
        """Return a function of the decomposition and of rows of arrays at all configurations, shape (n, width)."""
        values = np.empty((self.shape[0], width))
        for rows, split in self.parts:
            values[rows] = function(split, *(x[rows] for x in given))
        return values


def _alike(rows: Array, reach: Array | float) -> Sequence[tuple[Indices, SplitRows]]:
    """Return the parts of G at configurations, shape (n, m, nv), those with the same rank together."""
    m, nv = rows.shape[-2:]
    if m and nv > MANY:
        from scipy.sparse import csr_array

        return sparse_parts_apart(list(map(csr_array, rows)), reach)
    return parts_apart(rows, reach)

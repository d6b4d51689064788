"""The extreme singular values of many regular rows G, from the eigenvalues of ``G G^T``, whose rows are mostly short.

Rows of loops along a chain, or side by side, share velocities with few others: ``G G^T`` then has few entries beside
its diagonal, and to count its eigenvalues beyond a bound takes little time. Squares lose the digits of small singular
values: rows that are not regular are left to the singular value decomposition.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.kernel.library import library, pointer
from pinarm.engine.kernel.structures import SkylineStructure
from pinarm.records import Record

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ROUNDING = 1e-16
"""Part of the largest entry of all rows below which a row is 0, as those that hold a plane linkage in its plane."""

SEVERAL = 32
"""Number of rows from which on this is tried."""

REGULAR = 1e-3
"""Singular value, relative to the largest, above which its square has digits enough: rounding leaves 1e-9 of it."""

ACCURATE = 1e-11
"""Relative accuracy of the squares."""

WIDE = 0.005
"""Sum of the squared lengths of rows of ``G G^T``, over the third power of their number, above which all singular
values of G take no longer."""


class SquaredRows(Record, frozen=True):
    """``G G^T`` of n matrices G with m rows, by rows from their first entry up to the diagonal.

    Attributes:
        first: Column of the first entry of every row, shape (m,).
        entries: All rows, one behind the other, shape (n, e).
    """

    first: Indices
    entries: Array

    @classmethod
    def of(cls, rows: Array) -> SquaredRows | None:
        """Return those of matrices of shape (n, m, nv); ``None`` where rows are not short."""
        squares = rows @ rows.swapaxes(1, 2)
        first = (squares != 0.0).any(axis=0).argmax(axis=1)
        if not _are_short(first):
            return None
        return cls(first, np.ascontiguousarray(squares[:, *_places(first)]))

    @classmethod
    def of_sparse(cls, rows: csr_array) -> SquaredRows | None:
        """Return that of one matrix of shape (m, nv); ``None`` where rows are not short."""
        squares = (rows @ rows.T).tocoo()
        row, column = squares.coords
        first = np.arange(rows.shape[0])
        np.minimum.at(first, row, column)
        if not _are_short(first):
            return None
        entries, lower = np.zeros((1, int(_lengths(first).sum()))), column <= row
        entries[0, _origins(first)[row[lower]] + column[lower]] = squares.data[lower]
        return cls(first, entries)

    def extremes(self, compiled: ctypes.PyDLL) -> tuple[Array, Flags]:
        """Return the largest and the smallest eigenvalue of each, shape (n, 2), and of which they are known, (n,)."""
        found, known = np.ones((len(self.entries), 2)), np.zeros(len(self.entries), dtype=bool)
        origins, factor = _origins(self.first), np.empty(self.entries.shape[1])
        diagonals = self.entries[:, origins + np.arange(len(origins))]
        traces = diagonals.sum(axis=1)
        for k in np.flatnonzero((diagonals > 0.0).all(axis=1) & np.isfinite(traces)).tolist():
            arrays = self.first, origins, self.entries[k], factor
            matrix = ctypes.byref(SkylineStructure(len(origins), *map(pointer, arrays)))
            largest = _eigenvalue(compiled, matrix, 0, diagonals[k].max(), traces[k])
            least = REGULAR**2 * largest
            if compiled.skyline_factorise(matrix, ctypes.c_double(-least)):
                continue
            smallest = _eigenvalue(compiled, matrix, len(origins) - 1, least, diagonals[k].min())
            found[k], known[k] = (largest, smallest), True
        return found, known


def regular_values(rows: Array) -> tuple[Array, Flags]:
    """Return the extreme singular values of matrices none of whose rows is 0, and of which they are known, shape (n,).

    Args:
        rows: G, shape (n, m, nv).

    Returns:
        The largest at all places but the last of m, and there the smallest, shape (n, m): others are not known.
    """
    n, m, nv = rows.shape
    compiled = library() if SEVERAL <= m <= nv else None
    squares = SquaredRows.of(rows) if compiled else None
    if compiled is None or squares is None:
        return np.empty((n, min(m, nv))), np.zeros(n, dtype=bool)
    extremes, known = squares.extremes(compiled)
    return _spread(extremes, m), known


def regular_values_of_sparse(rows: csr_array) -> Array | None:
    """Return the same of one matrix of shape (m, nv), rows of which may be 0, shape (min(m, nv),), or ``None``."""
    sizes = np.zeros(rows.shape[0])
    np.maximum.at(sizes, rows.tocoo().coords[0], np.abs(rows.data))
    some = np.flatnonzero(sizes > ROUNDING * sizes.max(initial=0.0))
    compiled = library() if SEVERAL <= len(some) <= rows.shape[1] else None
    squares = SquaredRows.of_sparse(rows[some]) if compiled else None
    if compiled is None or squares is None:
        return None
    extremes, known = squares.extremes(compiled)
    found = np.zeros(min(rows.shape))
    found[: len(some)] = _spread(extremes, len(some))[0]
    return found if known[0] else None


def _spread(squares: Array, m: int) -> Array:
    """Return m values from the squares of the extreme ones, shape (n, 2)."""
    largest, smallest = np.sqrt(squares.T)
    found = np.repeat(largest[:, None], m, axis=1)
    found[:, -1] = smallest
    return found


def _eigenvalue(compiled: ctypes.PyDLL, matrix: Any, above: int, low: float, high: float) -> float:
    """Return the eigenvalue with so many others above it, between two bounds that may be met to rounding."""
    compiled.skyline_eigenvalue.restype = ctypes.c_double
    bracket = (ctypes.c_double(x) for x in (low * (1.0 - ACCURATE), high * (1.0 + ACCURATE), ACCURATE))
    return float(compiled.skyline_eigenvalue(matrix, ctypes.c_ssize_t(above), *bracket))


def _are_short(first: Indices) -> bool:
    """Tell whether rows are so short that counting eigenvalues pays."""
    return bool((_lengths(first).astype(float) ** 2).sum() < WIDE * float(len(first)) ** 3)


def _lengths(first: Indices) -> Indices:
    return np.arange(len(first)) - first + 1


def _origins(first: Indices) -> Indices:
    """Return where column 0 of every row would stand, shape (m,): entry (i, j) is at ``origin[i] + j``."""
    return np.cumsum(_lengths(first)) - np.arange(len(first)) - 1


def _places(first: Indices) -> tuple[Indices, Indices]:
    """Return rows and columns of the entries in their order, shape (e,) each."""
    row = np.repeat(np.arange(len(first)), _lengths(first))
    return row, np.arange(len(row)) - _origins(first)[row]

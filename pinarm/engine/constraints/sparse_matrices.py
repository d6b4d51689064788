"""G at several configurations, as an array or, of many joints, as sparse matrices, and its products."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from pinarm.arrays import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Matrices: TypeAlias = "Array | list[csr_array]"
"""G at n configurations, shape (n, .., m, nv), or n matrices of shape (m, nv)."""


def first_rows(matrices: Matrices, m: int) -> Matrices:
    """Return the first m rows of each."""
    if isinstance(matrices, list):
        return [rows[:m] for rows in matrices]
    return matrices[..., :m, :]


def times(matrices: Matrices, v: Array) -> Array:
    """Return G v, shape (n, .., nv) to (n, .., m)."""
    if isinstance(matrices, list):
        return np.array([rows @ x for rows, x in zip(matrices, v, strict=True)])
    return np.asarray(np.matvec(matrices, v))


def sizes(matrices: Matrices) -> Matrices:
    """Return the absolute values of the entries."""
    return [abs(rows) for rows in matrices] if isinstance(matrices, list) else np.abs(matrices)


def transposed_times(matrices: Matrices, lam: Array) -> Array:
    """Return G^T lam, shape (n, .., m) to (n, .., nv)."""
    if isinstance(matrices, list):
        return np.array([rows.T @ x for rows, x in zip(matrices, lam, strict=True)])
    return np.asarray(np.vecmat(lam, matrices))

"""Constraint rows G that are independent beyond doubt, taken apart without singular values."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.nullspaces.refinement import refined
from pinarm.records import Record

SEVERAL = 16
"""Number of rows from which on this is tried: of 20 it takes 0.4 of the time of singular values, of 5 as long."""


class IndependentRows(Record, frozen=True):
    """The rows of G at n configurations at which all of them are independent, but for those that are 0 at all.

    Of r rows that are not 0, with D that gives them the length 1: ``(D G)^T = Q R``. See ``RowDecomposition``, which
    tells the same by singular values, and cuts them at the rank.

    Source: Golub, Van Loan, Matrix Computations, fourth edition (2013), section 5.6.

    Attributes:
        scale: Diagonal of D, shape (n, m).
        acting: Which rows are not 0, shape (m,).
        inverse: R^-1, shape (n, r, r).
        right: Q, shape (n, nv, r).
        free: T, a basis of the motions that the rows allow, ``G T = 0``, shape (n, nv, nv - r).
        rows: G itself, shape (n, m, nv).
    """

    scale: Array
    acting: Flags
    inverse: Array
    right: Array
    free: Array
    rows: Array

    @classmethod
    def of(cls, rows: Array, scaled: Array, scale: Array, acting: Flags, least: float) -> tuple[IndependentRows, Flags]:
        """Return the parts of rows, and at which of the configurations they are known to be independent, shape (k,).

        Args:
            rows: G, shape (k, m, nv).
            scaled: Those of ``D G`` that are not 0, shape (k, r, nv), r <= nv.
            scale: Diagonal of D, shape (k, m).
            acting: Which rows are not 0, shape (m,).
            least: Smallest singular value of ``D G``, relative to the largest, above which rows are independent. Its
                bound ``1 / (|R| |R^-1|)`` in Frobenius' norm is up to r times smaller.
        """
        q, r = np.linalg.qr(scaled.swapaxes(1, 2), mode="complete")
        rank = scaled.shape[1]
        r = r[:, :rank]
        pivots = np.abs(r.diagonal(axis1=1, axis2=2))
        sure = pivots.min(axis=1) > least * pivots.max(axis=1)
        inverse = inverse_of_triangular(r[_selection(sure)])
        certain = least * _size(r[_selection(sure)]) * _size(inverse) < 1.0
        inverse = inverse[_selection(certain)]
        sure[sure] = certain
        some = _selection(sure)
        q = q[some]
        return cls(scale[some], acting, inverse, q[..., :rank], q[..., rank:], rows[some]), sure

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return int(self.right.shape[-1])

    @property
    def regularity(self) -> float:
        """Smallest singular value of the independent rows, relative to the largest; the least of all configurations."""
        values = np.linalg.svd(self.inverse, compute_uv=False)
        return float((values[:, -1] / values[:, 0]).min())

    @cached_property
    def stresses(self) -> Array:
        """A basis of the multipliers that do nothing, those of rows that are 0, shape (n, m, m - r)."""
        basis = np.eye(len(self.acting))[:, ~self.acting]
        return np.broadcast_to(basis, (len(self.scale), *basis.shape))

    def stresses_on(self, functions: Array) -> Array:
        """Return all, see ``stresses``: they are few."""
        return self.stresses

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right``, shape (n, nv)."""
        return np.asarray(np.matvec(self.right, np.vecmat((self.scale * right)[:, self.acting], self.inverse)))

    def reached(self, right: Array) -> Array:
        """Return the part of a right-hand side that some x gives, shape (n, m)."""
        return right * self.acting

    def multipliers(self, force: Array) -> Array:
        """Return lam with ``G^T lam = force`` in the sense of least squares, shape (n, m)."""
        return refined(self._multipliers, self.rows, self.free, force)

    def _multipliers(self, force: Array) -> Array:
        found = np.zeros_like(self.scale)
        found[:, self.acting] = np.matvec(self.inverse, np.vecmat(force, self.right))
        return found * self.scale


def inverse_of_triangular(matrix: Array) -> Array:
    """Return the inverses of upper triangular matrices, shape (n, r, r).

    By halves: those of the diagonal blocks A and C, and ``-A^-1 B C^-1`` for the block B beside them.

    Source: Higham, Accuracy and Stability of Numerical Algorithms, second edition (2002), section 14.2.
    """
    half = matrix.shape[-1] // 2
    if half < SEVERAL:
        return np.asarray(np.linalg.inv(matrix))
    found = np.zeros_like(matrix)
    first = found[:, :half, :half] = inverse_of_triangular(matrix[:, :half, :half])
    last = found[:, half:, half:] = inverse_of_triangular(matrix[:, half:, half:])
    found[:, :half, half:] = -first @ (matrix[:, :half, half:] @ last)
    return found


def _selection(flags: Flags) -> Flags | slice:
    """Return what selects the flagged elements, without a copy of them where these are all."""
    return slice(None) if flags.all() else flags


def _size(matrix: Array) -> Array:
    """Return Frobenius' norm of matrices, shape (n, r, r) to (n,)."""
    return np.asarray(np.sqrt(np.einsum("nij,nij->n", matrix, matrix)))

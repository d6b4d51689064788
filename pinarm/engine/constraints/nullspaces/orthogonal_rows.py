"""Matrices with few rows at many states, made orthogonal by the Gram-Schmidt process: ``A^T = Q R``.

Every number of a state follows from that state alone, by the same operations: no pivot is chosen by looking at others,
so that it does not matter which states stand beside it. Arrays have the states along their last axes (..). (Golub, Van
Loan, *Matrix Computations*, section 5.2.8; a second pass makes Q orthogonal to rounding: Giraud, Langou, Rozloznik,
*The loss of orthogonality in the Gram-Schmidt orthogonalization process*, 2005.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array

PASSES = 2
"""Times that each row is made orthogonal to those before it."""


@dataclass(frozen=True, eq=False)
class OrthogonalRows:
    """Independent rows A at many states, ``A^T = Q R``; numbers are not finite where they are dependent.

    Attributes:
        basis: Q^T, an orthonormal basis of what the rows span, shape (r, c, ..).
        shares: R, upper triangular, shape (r, r, ..).
    """

    basis: Array
    shares: Array

    @classmethod
    def of(cls, rows: Array) -> OrthogonalRows:
        """Return the factors of rows, shape (r, c, ..)."""
        r, basis = len(rows), rows.copy()
        shares = np.zeros((r, r, *rows.shape[2:]))
        for i in range(r):
            for _ in range(PASSES if i else 0):
                for j in range(i):
                    share = along(basis[j], basis[i])
                    shares[j, i] += share
                    basis[i] -= share * basis[j]
            shares[i, i] = np.sqrt(along(basis[i], basis[i]))
            basis[i] /= shares[i, i]
        return cls(basis, shares)

    @property
    def width(self) -> int:
        """Number c of columns."""
        return int(self.basis.shape[1])

    def shortest(self, right: Array) -> Array:
        """Return the shortest x with ``A x = right``, ``x = Q R^-T right``: shape (r, ..) to (c, ..)."""
        x, parts = np.zeros((self.width, *right.shape[1:])), list[Array]()
        for i, row in enumerate(self.basis):
            part = right[i]
            for j in range(i):
                part = part - self.shares[j, i] * parts[j]
            parts.append(part / self.shares[i, i])
            x += parts[i] * row
        return x

    def components(self, x: Array) -> Array:
        """Return ``Q^T x``: shape (c, ..) to (r, ..)."""
        found = np.empty((len(self.basis), *x.shape[1:]))
        for part, row in zip(found, self.basis, strict=True):
            part[...] = along(row, x)
        return found

    def complement(self) -> Array:
        """Return an orthonormal basis of the x with ``A x = 0``, shape (c - r, c, ..).

        Of the unit vectors that one is projected whose rest is longest, one after the other.
        """
        r, c, *states = self.basis.shape
        found = [*self.basis]
        left = np.ones((c, *states))
        for row in found:
            left -= row * row
        for _ in range(c - r):
            x = np.zeros((c, *states))
            np.put_along_axis(x, left.argmax(axis=0)[None], 1.0, axis=0)
            for _ in range(PASSES):
                for row in found:
                    x -= along(row, x) * row
            x /= np.sqrt(along(x, x))
            found.append(x)
            left -= x * x
        return np.array(found[r:]).reshape(c - r, c, *states)


def singular_values(rows: Array) -> Array:
    """Return the singular values of matrices at many states, shape (r, c, ..), descending, shape (.., min(r, c)).

    Of two rows, the longer one being p and the other q + r p / |p| with q at right angles to p: the sum and the
    difference of the values are ``sqrt((|p| +- |q|)^2 + r^2)``, and their product is ``|p| |q|``. As by LAPACK, errors
    are rounding of the largest, of entries between 1e-150 and 1e150; where one is no number, neither are the values.
    """
    if len(rows) != 2 or rows.shape[1] < 2:
        return np.asarray(np.linalg.svd(np.moveaxis(rows, (0, 1), (-2, -1)), compute_uv=False))
    squares = along(rows[0], rows[0]), along(rows[1], rows[1])
    ordered = squares[0] >= squares[1]
    first, other = np.where(ordered, rows, rows[::-1])
    most = np.where(ordered, *squares)
    share = along(first, other) / np.where(most > 0.0, most, 1.0)
    rest = other - share * first
    p, q, r = np.sqrt(most), np.sqrt(along(rest, rest)), share * np.sqrt(most)
    largest = 0.5 * (np.hypot(p + q, r) + np.hypot(p - q, r))
    return np.stack([largest, p * q / np.where(largest > 0.0, largest, 1.0)], axis=-1)


def along(x: Array, y: Array) -> Array:
    """Return ``x . y`` of vectors along the first axis, shape (c, ..) to (..)."""
    total = x[0] * y[0]
    for one, other in zip(x[1:], y[1:], strict=True):
        total += one * other
    return np.asarray(total)

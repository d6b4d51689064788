"""Matrices with few rows at many states, made orthogonal by the Gram-Schmidt process: ``A^T = Q R``.

Every number of a state follows from that state alone, by the same operations: no pivot is chosen by looking at others,
so that it does not matter which states stand beside it. Arrays have the states along their last axes (..). (Golub, Van
Loan, *Matrix Computations*, section 5.2.8; a second pass makes Q orthogonal to rounding: Giraud, Langou, Rozloznik,
*The loss of orthogonality in the Gram-Schmidt orthogonalization process*, 2005.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.nullspace import VANISHED
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint_rows import EvaluatedRows

REGULAR = 1e-4
"""Smallest ratio of singular values of J at which other configurations are solved by the same independent rows."""

KEPT, SHRUNK = 0.1, 0.8
"""Part of itself that what a row adds, or the determinant, keeps at configurations like the one at which rows are
chosen. Rows keeping more than ``SHRUNK`` of it do not count in the determinant, of which ten of them leave a tenth."""

PASSES = 2
"""Times that each row is made orthogonal to those before it."""


class OrthogonalRows(Record, frozen=True):
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
    def added(self) -> Array:
        """What each row adds to those before it, the diagonal of R, shape (r, ..)."""
        return np.array([self.shares[i, i] for i in range(len(self.shares))])

    @property
    def senses(self) -> Array:
        """Signs of the determinants of as many rows as columns, shape (..)."""
        return np.asarray(np.sign(np.linalg.det(np.moveaxis(self.basis, (0, 1), (-2, -1)))))

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


class DeterminingRows(Record, frozen=True):
    """As many rows of J as there are coordinates, which determine these, chosen at one configuration.

    Parts of the mechanism that no row ties to each other are kept apart.

    Attributes:
        rows: Rows of every part, each of shape (r,).
        columns: Velocities of every part, each of shape (r,).
        shares: What each row added to those before it at that configuration, each of shape (r,).
        senses: Sign of the determinant of each part there.
    """

    rows: tuple[Indices, ...]
    columns: tuple[Indices, ...]
    shares: tuple[Array, ...]
    senses: tuple[float, ...]

    @classmethod
    def of(cls, matrix: Array, groups: Indices, reach: Array) -> DeterminingRows | None:
        """Return rows of J, shape (m, nv), at a regular configuration; ``None`` where a part has too few.

        Args:
            matrix: J.
            groups: A number for every velocity, the same in a part, shape (nv,); see ``Closure.groups``.
            reach: Length that each row can have, shape (m,); see ``Closure.reach``.
        """
        rows, columns, factors = list[Indices](), list[Indices](), list[OrthogonalRows]()
        for group in sorted(set(groups.tolist())):
            own = np.flatnonzero(groups == group)
            tied = np.flatnonzero((np.abs(matrix[:, own]) > VANISHED * reach[:, None]).any(axis=1))
            if len(tied) < len(own):
                return None
            rows.append(tied[independent_rows(matrix[np.ix_(tied, own)], len(own))])
            columns.append(own)
            factors.append(OrthogonalRows.of(matrix[np.ix_(rows[-1], own)][..., None]))
        shares, senses = tuple(each.added[:, 0] for each in factors), tuple(float(each.senses[0]) for each in factors)
        return cls(tuple(rows), tuple(columns), shares, senses)

    @property
    def every(self) -> Indices:
        """All of the rows."""
        return np.concatenate([np.zeros(0, np.intp), *self.rows])

    def at(self, measured: EvaluatedRows) -> DeterminedMotion:
        """Return J taken apart at configurations, shape (n,)."""
        parts = zip(self.rows, self.columns, strict=True)
        return DeterminedMotion(self, [OrthogonalRows.of(measured.some(*part)) for part in parts])


class DeterminedMotion(Record, frozen=True):
    """The equations ``J x = right`` at n configurations, taken apart.

    Attributes:
        chosen: The rows J.
        parts: What they are in each part.
    """

    chosen: DeterminingRows
    parts: Sequence[OrthogonalRows]

    def solve(self, right: Array) -> Array:
        """Return x, shape (nv, n), for right-hand sides of all rows, shape (m, n)."""
        x = np.empty((sum(map(len, self.chosen.columns)), right.shape[1]))
        for rows, columns, part in zip(self.chosen.rows, self.chosen.columns, self.parts, strict=True):
            x[columns] = part.shortest(right[rows])
        return x

    @property
    def served(self) -> Flags:
        """Where the determinant of every part keeps its sign and a good part of its size, shape (n,).

        Of its size counts what rows that add less than at the first configuration have lost.
        """
        served = np.ones(1, dtype=bool)
        for part, first, sense in zip(self.parts, self.chosen.shares, self.chosen.senses, strict=True):
            ratio = part.added / first[:, None]
            lost = np.where(ratio > SHRUNK, 1.0, ratio).prod(axis=0)
            served = served & (ratio > KEPT).all(axis=0) & (lost > KEPT) & (part.senses == sense)
        return served


def independent_rows(matrix: Array, rank: int, reach: Array | float = 1.0) -> list[int]:
    """Return as many rows of a matrix, shape (m, c), as its rank, ascending, which all others follow from.

    One after the other that row of length 1 of which most is left beside those before it: the Gram-Schmidt process with
    pivots. Rows below ``VANISHED`` of their reach count as 0.
    """
    lengths = np.sqrt(np.vecdot(matrix, matrix))
    counts = lengths > VANISHED * reach
    left = matrix * (counts / np.where(counts, lengths, 1.0))[:, None]
    chosen = list[int]()
    for _ in range(rank):
        sizes = np.vecdot(left, left)
        chosen.append(row := int(sizes.argmax()))
        direction = left[row] / np.sqrt(sizes[row])
        left -= np.outer(left @ direction, direction)
        left[row] = 0.0
    return sorted(chosen)


def along(x: Array, y: Array) -> Array:
    """Return ``x . y`` of vectors along the first axis, shape (c, ..) to (..)."""
    total = x[0] * y[0]
    for one, other in zip(x[1:], y[1:], strict=True):
        total += one * other
    return np.asarray(total)

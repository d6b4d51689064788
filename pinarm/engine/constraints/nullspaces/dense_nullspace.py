"""The constraint rows G decomposed by singular values: range, null space, rank and redundant rows."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Protocol

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.nullspaces.refinement import refined
from pinarm.records import Record

MANY = 100
"""Velocities from which on G is taken apart as a sparse matrix, which then takes as long as singular values; these take
8,000 times as long for 20 times as many."""

UNCLOSED = 1e-9
"""What redundant rows may leave open, of the extent of the mechanism or in rad: a file with 10 digits says no more. The
loop is then closed in the sense of least squares, and the result says by how much it is not."""

VANISHED = 4e-9
"""Length of a row of G, relative to the length that it can have, below which it is 0: axes or hinges that are off by
``UNCLOSED`` leave as much of the rows that hold a plane linkage in its plane, or a shaft in its second bearing."""

SHORT = 1e-2
"""Length of a row of G, relative to the length that it can have, below which it is not brought to the length 1, but
multiplied by 100 over that length: the rounding of a row that repeats others and passes through 0 would be blown up,
until it told those others what to do. A row that stands alone is 40 times above ``RANK`` where it is ``VANISHED``."""

RANK = 1e-7
"""Singular value of G, its rows of length 1 or less, relative to the largest, below which rows count as dependent. What
``UNCLOSED`` makes of redundant rows stays well below it, so that it changes no rank and is not divided by."""

ROUNDING = 1e-16
"""Part of the largest entry of all rows below which a row is 0, as those that hold a plane linkage in its plane."""

ACTS = 1e-7
"""Part of a self-stress of length 1 that acts on a component: what rounding of the file tilts it by stays below."""


class SplitRows(Protocol):
    """The rows of G taken apart, at one or at several configurations: see ``RowDecomposition``."""

    @property
    def free(self) -> Array:
        """T, a basis of the motions that the rows allow, ``G T = 0``, shape (.., nv, nv - r)."""
        ...

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        ...

    @property
    def regularity(self) -> float:
        """Smallest singular value of the independent rows, relative to the largest; of a single configuration."""
        ...

    def stresses_on(self, functions: Array) -> Array:
        """Return multipliers that do nothing, ``G^T lam = 0``, each of length 1, shape (.., m, s).

        Some that add to given functions of the multipliers, shape (.., m, k), all that any can add to them: of few rows
        a basis of all, whatever the functions.
        """
        ...

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (.., nv)."""
        ...

    def reached(self, right: Array) -> Array:
        """Return the part of a right-hand side that some x gives, shape (.., m)."""
        ...

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, shape (.., m)."""
        ...


class RowDecomposition(Record, frozen=True):
    """The rows of G taken apart: what they determine, what they leave free, and which of them are redundant.

    With D the scaling that gives rows the length 1: ``D G = U S V^T``, cut at the rank r. All arrays, given ones too,
    may have a leading axis (..): one for each of several configurations at which the rank is the same.

    Attributes:
        scale: Diagonal of D, shape (.., m).
        left: U, shape (.., m, r).
        values: S, descending, shape (.., r).
        right: V^T, shape (.., r, nv).
        free: T, a basis of the motions that the rows allow, ``G T = 0``, shape (.., nv, nv - r).
        rows: G itself, shape (.., m, nv).
    """

    scale: Array
    left: Array
    values: Array
    right: Array
    free: Array
    rows: Array

    @classmethod
    def of(cls, rows: Array, reach: Array | float = 1.0) -> RowDecomposition:
        """Return the parts of the rows G, shape (m, nv); ``reach`` as in ``RowDecompositions.of``."""
        ((_, split),) = _singular_parts(rows[None], *_scaled(rows[None], reach))
        return cls(split.scale[0], split.left[0], split.values[0], split.right[0], split.free[0], rows)

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return int(self.values.shape[-1])

    @property
    def regularity(self) -> float:
        """Smallest singular value of the independent rows, relative to the largest; of a single configuration."""
        return float(self.values[-1] / self.values[0]) if len(self.values) else 0.0

    @cached_property
    def stresses(self) -> Array:
        """A basis of the multipliers that do nothing, ``G^T lam = 0``, each of length 1, shape (.., m, m - r)."""
        beyond = np.linalg.svd(self.left)[0][..., self.values.shape[-1] :]
        return of_length_1(self.scale[..., None] * beyond)

    def stresses_on(self, functions: Array) -> Array:
        """Return all, see ``stresses``: they are few."""
        return self.stresses

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (.., nv)."""
        return np.asarray(np.vecmat(np.vecmat(self.scale * right, self.left) / self.values, self.right))

    def reached(self, right: Array) -> Array:
        """Return the part of a right-hand side that some x gives, ``D^-1 U U^T D right``, shape (.., m).

        The rest is that of redundant rows which contradict the others.
        """
        return np.asarray(np.matvec(self.left, np.vecmat(self.scale * right, self.left)) / self.scale)

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, shape (.., m)."""
        if self.scale.shape == self.values.shape:
            return refined(self._of_independent, self.rows, self.free, force)
        q, r = np.linalg.qr(self.rows @ self.right.swapaxes(-1, -2))
        r = r.swapaxes(-1, -2)
        return refined(lambda left: np.matvec(q, solved(r, np.matvec(self.right, left))), self.rows, self.free, force)

    def _of_independent(self, force: Array) -> Array:
        return np.asarray(self.scale * np.matvec(self.left, np.matvec(self.right, force) / self.values))


def dense_parts(rows: Array, reach: Array | float) -> list[tuple[Indices, SplitRows]]:
    """Return the parts of G at n configurations, shape (n, m, nv), those with the same rank together."""
    return [*_singular_parts(rows, *_scaled(rows, reach))]


def _scaled(rows: Array, reach: Array | float) -> tuple[Array, Flags, Array]:
    """Return the diagonal of D, shape (n, m), which rows of G are not 0 everywhere, and these of D G."""
    length = np.sqrt(np.vecdot(rows, rows))
    counts = length > VANISHED * reach
    scale = 1.0 / np.where(counts, np.maximum(length, SHORT * reach), 1.0)
    acting = counts.any(axis=0)  # the others are 0, as are those that hold a plane linkage in its plane
    return scale, acting, rows[:, acting] * (counts * scale)[:, acting, None]


def _singular_parts(rows: Array, scale: Array, acting: Flags, scaled: Array) -> list[tuple[Indices, RowDecomposition]]:
    """Return the parts by one singular value decomposition for each configuration."""
    *states, m, nv = rows.shape
    if not m:
        nothing = (np.ones((*states, 0)), np.zeros((*states, 0, 0)), np.zeros((*states, 0)), np.zeros((*states, 0, nv)))
        free = np.broadcast_to(np.eye(nv), (*states, nv, nv))
        return [(np.arange(len(rows)), RowDecomposition(*nothing, free, rows))]
    some, s, vt = np.linalg.svd(scaled, full_matrices=acting.sum() < nv)
    left = np.zeros((len(rows), m, some.shape[2]))
    left[:, acting] = some
    ranks = (s > RANK * s[:, :1]).sum(axis=1)
    found = []
    for r in sorted(set(ranks.tolist())):
        k = np.flatnonzero(ranks == r)
        free = _refined_free(scaled[k], some[k, :, :r], s[k, :r], vt[k, :r], vt[k, r:].swapaxes(1, 2))
        found.append((k, RowDecomposition(scale[k], left[k, :, :r], s[k, :r], vt[k, :r], free, rows[k])))
    return found


def _refined_free(scaled: Array, left: Array, values: Array, right: Array, free: Array) -> Array:
    """Return the free motions after a step of refinement: small parts, as turns beside long slides, are as exact.

    All arrays have the configurations along their first axis; ``scaled = left diag(values) right``.
    """
    parts = left.swapaxes(1, 2) @ (scaled @ free)
    return np.asarray(free - right.swapaxes(1, 2) @ (parts / values[..., None]))


def of_length_1(columns: Array) -> Array:
    """Return columns, shape (.., m, k), divided by their lengths."""
    return np.asarray(columns / np.linalg.norm(columns, axis=-2, keepdims=True))


def solved(matrix: Array, right: Array) -> Array:
    """Return x with ``matrix x = right``, shapes (.., k, k), (.., k) and (.., k)."""
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


class SingularMasses(np.linalg.LinAlgError):
    """A mass matrix, reduced to free motions or not, that is singular."""


def solved_positive(matrix: Array, right: Array) -> Array:
    """Return x with ``matrix x = right``, shapes (.., k, k), (.., k, c) and (.., k, c), of symmetric positive matrices.

    They are scaled to a diagonal of ones: LAPACK takes the largest entries as pivots, in which what is left of masses
    far smaller than others would be lost.

    Raises:
        SingularMasses: A matrix is singular.
    """
    diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
    scale = (1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)))[..., None]
    try:
        return np.asarray(scale * np.linalg.solve(scale * matrix * scale.swapaxes(-1, -2), scale * right))
    except np.linalg.LinAlgError as error:
        raise SingularMasses(str(error)) from None


def acting_values(rows: Array, units: Array) -> Array:
    """Return the singular values of matrices, descending; rows that are 0 cost nothing.

    Args:
        rows: G, shape (.., m, nv).
        units: What entries are multiplied by, shape (m, nv).
    """
    m, nv = units.shape
    every = rows.reshape(math.prod(rows.shape[:-2]), m, nv)
    most = np.maximum(np.maximum.reduce(every, initial=0.0), -np.minimum.reduce(every, initial=0.0)) * units
    sizes = np.maximum.reduce(most, axis=1, initial=0.0)
    counts = sizes > ROUNDING * sizes.max(initial=0.0)
    values = np.linalg.svd(every[:, counts] * units[counts], compute_uv=False)
    found = np.zeros((len(every), min(m, nv)))
    found[:, : values.shape[-1]] = values
    return found.reshape(*rows.shape[:-2], min(m, nv))

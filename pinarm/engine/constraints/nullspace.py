"""Null space, rank and redundant rows of the constraint matrix G, and its multipliers, by singular values.

Groups of rows that share no joint are decomposed apart: in one decomposition of all rows the forces of a loop of 1 mm,
a billionth of those of a loop of 1 m beside it, would be rounding. Sizes of the work grow with the cube of the largest
group: 200 joints in one group take about 20 ms a state, 1,000 joints seconds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache, cached_property, lru_cache
from typing import Any

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.records import Record, replace

MANY = 100
"""Velocities above which figures of accuracy that cost a decomposition of M are left out."""

UNCLOSED = 1e-9
"""Largest gap of redundant rows, relative to the extent of the mechanism or in rad: a file with 10 digits says no more.
The loop is then closed in the sense of least squares, and the result says by how much it is not."""

VANISHED = 4e-9
"""Length of a row of G, relative to the length that it can have, below which it is 0: axes or hinges that are off by
``UNCLOSED`` leave as much of the rows that hold a plane linkage in its plane, or a shaft in its second bearing."""

SHORT = 1e-2
"""Length of a row of G, relative to the length that it can have, below which it is not scaled to 1, but multiplied by
100 over that length: scaling to 1 would amplify the rounding of a redundant row that passes through 0. A row that
stands alone is 40 times above ``RANK`` where it is ``VANISHED``."""

RANK = 1e-7
"""Singular value of G, its rows of length 1 or less, relative to the largest, below which rows count as dependent. The
effect of ``UNCLOSED`` on redundant rows stays well below it, so that it changes no rank and is not divided by."""

ROUNDING = 1e-16
"""Part of the largest entry of all rows below which a row is 0, as those that hold a plane linkage in its plane."""

TIED = 1e-14
"""Entry of G, relative to the length that its row can have, above which the row ties the joint; less is rounding."""

ACTS = 1e-7
"""Part of a self-stress of length 1 that acts on a component: tilts by rounding of the file stay below."""


class RowGroup(Record, frozen=True):
    """Rows of G that share joints, decomposed: ``D G = U S V^T``, cut at the rank r; D scales rows to the length 1.

    Of k singular values those beyond the rank of a configuration, and their inverses, are 0.

    Attributes:
        rows: Places of the rows, shape (m,).
        joints: Places of their joints in v, shape (w,).
        matrix: G of these rows and joints, shape (.., m, w).
        scale: Diagonal of D, shape (.., m).
        left: U, shape (.., m, k).
        values: S, descending, shape (.., k).
        inverse: S^-1, shape (.., k).
        right: V^T, shape (.., w, w).
        rank: r, shape (..).
    """

    rows: Indices
    joints: Indices
    matrix: Array
    scale: Array
    left: Array
    values: Array
    inverse: Array
    right: Array
    rank: Indices

    @classmethod
    def of(cls, rows: Array, places: Indices, joints: Indices, reach: Array) -> RowGroup:
        """Return some rows of G, shape (.., m, nv), decomposed; of each row the length that it can have, shape (m,)."""
        matrix = np.ascontiguousarray(rows[..., places[:, None], joints])
        reach = reach[places]
        length = np.sqrt(np.vecdot(matrix, matrix))
        counts = length > VANISHED * reach
        scale = 1.0 / np.where(counts, np.maximum(length, SHORT * reach), 1.0)
        acting = counts.reshape(-1, len(places)).any(axis=0)  # others are 0 everywhere, as those that hold a plane
        scaled = matrix[..., acting, :] * (counts * scale)[..., acting, None]
        u, values, right = np.linalg.svd(scaled, full_matrices=bool(acting.sum() < len(joints)))
        left = np.zeros((*length.shape, values.shape[-1]))
        left[..., acting, :] = u[..., : values.shape[-1]]
        held = values > RANK * values[..., :1]
        inverse = held / np.where(held, values, 1.0)
        return cls(places, joints, matrix, scale, left, values * held, inverse, right, np.asarray(held.sum(axis=-1)))

    def of_one_rank(self) -> RowGroup:
        first = self.rank.flat[0]
        inverse = np.where((self.rank == first)[..., None], self.inverse, np.nan)
        return replace(self, inverse=inverse, rank=np.full_like(self.rank, first))

    @cached_property
    def free(self) -> Array:
        """Orthonormal basis of the null space, shape (.., w, f); 0 in place of motions that exist elsewhere only."""
        least, count = int(self.rank.min()), self.values.shape[-1]
        free = _beyond(self.right.swapaxes(-1, -2), self.rank, least)
        # one step of refinement, so that small parts, such as turns beside long slides, are as exact
        tied = self.left.swapaxes(-1, -2) @ (self.scale[..., None] * (self.matrix @ free))
        return np.asarray(free - self.right[..., :count, :].swapaxes(-1, -2) @ (self.inverse[..., None] * tied))

    @cached_property
    def stresses(self) -> Array:
        """Basis of the multipliers with ``G^T lam = 0``, each of length 1, shape (.., m, s); 0 as in ``free``."""
        least, count, m = int(self.rank.min()), self.values.shape[-1], len(self.rows)
        whole = self.left
        if count < m:
            whole = np.concatenate([whole, np.linalg.svd(whole)[0][..., count:]], axis=-1)
        beyond = self.scale[..., None] * _beyond(whole, self.rank, least)
        lengths = np.linalg.norm(beyond, axis=-2, keepdims=True)
        return np.asarray(beyond / np.where(lengths > 0.0, lengths, 1.0))

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (.., w)."""
        along = np.vecmat(self.scale * right, self.left) * self.inverse
        return np.asarray(np.vecmat(along, self.right[..., : along.shape[-1], :]))

    def reached(self, right: Array) -> Array:
        """Return ``D^-1 U U^T D right``, shape (.., m)."""
        along = np.vecmat(self.scale * right, self.left) * (self.inverse != 0.0)
        return np.asarray(np.matvec(self.left, along) / self.scale)

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, refined once, shape (.., m).

        A decomposition errs by rounding of the largest forces at all joints; the residual at a joint is known to the
        rounding of the forces at this joint.

        Source: Higham, Accuracy and Stability of Numerical Algorithms, second edition (2002), section 12.1.
        """
        lam = self._unrefined(force)
        return lam + self._unrefined(force - np.vecmat(lam, self.matrix))

    def _unrefined(self, force: Array) -> Array:
        along = np.matvec(self.right[..., : self.values.shape[-1], :], force)
        if (self.rank == len(self.rows)).all():
            return np.asarray(self.scale * np.matvec(self.left, along * self.inverse))
        q, r = self._spanned
        return np.asarray(np.matvec(q, np.linalg.solve(r, (along * (self.inverse != 0.0))[..., None])[..., 0]))

    @cached_property
    def _spanned(self) -> tuple[Array, Array]:
        """Q and R^T of ``G V = Q R``: redundant rows share a force by their own lengths; R is 1 beyond the rank."""
        held = self.inverse != 0.0
        q, r = np.linalg.qr(self.matrix @ (self.right[..., : held.shape[-1], :] * held[..., None]).swapaxes(-1, -2))
        return q, r.swapaxes(-1, -2) + np.eye(held.shape[-1]) * ~held[..., None]


def _beyond(basis: Array, rank: Indices, least: int) -> Array:
    """Return the columns of matrices behind the least rank; 0 in place of those within the rank, shape (..)."""
    columns = basis[..., least:]
    if (rank == least).all():
        return columns
    return np.where((np.arange(least, basis.shape[-1]) >= rank[..., None])[..., None, :], columns, 0.0)


class Decomposition(Record, frozen=True):
    """G decomposed at configurations, shape (..), group by group; their ranks may differ.

    Attributes:
        groups: Rows that share joints.
        alone: Joints that no row ties, shape (k,).
        shape: Of G, (.., m, nv).
    """

    groups: Sequence[RowGroup]
    alone: Indices
    shape: tuple[int, ...]

    @classmethod
    def of(cls, rows: Array, reach: Array | float = 1.0) -> Decomposition:
        """Return the decomposition of G, shape (.., m, nv).

        Args:
            reach: The length that each row can have, shape (m,), or one for all.
        """
        m, nv = rows.shape[-2:]
        states, reach = tuple(range(rows.ndim - 2)), np.broadcast_to(reach, m)
        largest = np.maximum(rows.max(axis=states, initial=0.0), -rows.min(axis=states, initial=0.0))
        groups, alone = _groups((largest > TIED * reach[:, None]).tobytes(), m, nv)
        return cls([RowGroup.of(rows, *group, reach) for group in groups], alone, rows.shape)

    def of_one_rank(self) -> Decomposition:
        """Return the decomposition with NaN at configurations whose rank is not that of the first."""
        return replace(self, groups=[group.of_one_rank() for group in self.groups])

    @cached_property
    def free(self) -> Array:
        """Orthonormal basis T of the motions that the rows allow, ``G T = 0``, shape (.., nv, f).

        Each is a motion of one group. Columns beyond the freedom of a configuration are 0; they are the last ones.
        """
        if len(self.groups) == 1 and not len(self.alone):
            free = self.groups[0].free
        else:
            parts = [(self.alone, np.eye(len(self.alone))), *((group.joints, group.free) for group in self.groups)]
            free = _side_by_side((*self.shape[:-2], self.shape[-1]), parts)
        if (self.freedom == free.shape[-1]).all():
            return free
        order = np.argsort(~free.any(axis=-2), axis=-1, kind="stable")
        return np.take_along_axis(free, order[..., None, :], axis=-1)

    def by_freedom(self) -> Iterator[tuple[Indices, Array]]:
        """Yield places of n configurations and T there, shape (places, .., nv, f), where the freedom f is the same."""
        freedom = self.freedom.reshape(self.shape[0], -1).max(axis=1)
        for count in sorted(set(freedom.tolist())):
            places = np.flatnonzero(freedom == count)
            yield places, self.free[places, ..., :count]

    @cached_property
    def freedom(self) -> Indices:
        """Number of free motions, shape (..)."""
        return np.asarray(self.shape[-1] - self.rank)

    @property
    def rank(self) -> Indices:
        """Number of independent rows, shape (..)."""
        return np.asarray(sum((group.rank for group in self.groups), np.zeros(self.shape[:-2], dtype=np.intp)))

    @cached_property
    def stresses(self) -> Array:
        """Basis of the multipliers with ``G^T lam = 0``, each of one group and of length 1, shape (.., m, s).

        0 where there are fewer than elsewhere.
        """
        return _side_by_side(self.shape[:-1], [(group.rows, group.stresses) for group in self.groups])

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (.., nv)."""
        return self._joined(
            self.shape[-1], [(group.joints, group.particular(right[..., group.rows])) for group in self.groups]
        )

    def reached(self, right: Array) -> Array:
        """Return the part of a right-hand side that some x gives, shape (.., m); the rest contradicts other rows."""
        return self._joined(
            self.shape[-2], [(group.rows, group.reached(right[..., group.rows])) for group in self.groups]
        )

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, shape (.., m)."""
        return self._joined(
            self.shape[-2], [(group.rows, group.multipliers(force[..., group.joints])) for group in self.groups]
        )

    def _joined(self, width: int, parts: Sequence[tuple[Indices, Array]]) -> Array:
        """Return the values of groups at their places in one array, shape (.., width), 0 elsewhere."""
        whole = np.zeros((*np.broadcast_shapes(self.shape[:-2], *(x.shape[:-1] for _, x in parts)), width))
        for places, x in parts:
            whole[..., places] = x
        return whole


def _side_by_side(shape: tuple[int, ...], parts: Sequence[tuple[Indices, Array]]) -> Array:
    """Return matrices with some rows each, of ``shape`` (.., rows), side by side; 0 in the other rows."""
    whole, end = np.zeros((*shape, sum(x.shape[-1] for _, x in parts))), 0
    for rows, x in parts:
        start, end = end, end + x.shape[-1]
        whole[..., rows, start:end] = x
    return whole


@lru_cache(maxsize=64)
def _groups(pattern: bytes, m: int, nv: int) -> tuple[list[tuple[Indices, Indices]], Indices]:
    """Return the groups of a pattern, the bytes of flags of shape (m, nv)."""
    tied, labels, before = np.frombuffer(pattern, dtype=bool).reshape(m, nv), np.arange(nv), None
    while before is None or (labels != before).any():  # joints take the least label of those that are tied to them
        before = labels
        least = np.where(tied, labels, nv).min(axis=1, initial=nv)
        labels = np.minimum(labels, np.where(tied, least[:, None], nv).min(axis=0, initial=nv))
    moved = np.asarray(tied.any(axis=0))
    names = sorted(set(labels[moved].tolist()))
    least = np.where(least < nv, least, names[0] if names else 0)
    groups = [(np.flatnonzero(least == name), np.flatnonzero(moved & (labels == name))) for name in names]
    if m and not groups:
        groups = [(np.arange(m), np.arange(0))]
    return groups, np.flatnonzero(~moved)


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


class SingularMasses(np.linalg.LinAlgError):
    """A mass matrix, reduced to free motions or not, that is singular."""


def solved_positive(matrix: Array, right: Array) -> Array:
    """Return x with ``matrix x = right``, shapes (.., k, k), (.., k, c) and (.., k, c), of symmetric positive matrices.

    They are scaled to a diagonal of ones: LAPACK takes the largest entries as pivots, in which masses far smaller than
    others would be lost.
    """
    diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
    scale = (1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)))[..., None]
    try:
        return np.asarray(scale * np.linalg.solve(scale * matrix * scale.swapaxes(-1, -2), scale * right))
    except np.linalg.LinAlgError as error:
        raise SingularMasses(str(error)) from None


NOTHING = 1e-12
"""Part of the largest number in a row below which another one is rounding."""


def coupled_joints(rows: Array, right: Array, v: Array) -> Flags:
    """Return a mask of the joints that ``G v = b`` moves, or couples to moving ones row by row, shape (nv,).

    The others can stay at rest. The velocities nearest to rest in the measure of the masses alone would move them, as
    a pendulum is pulled along with its carrier.
    """
    sizes = np.abs(rows)
    touched = sizes > NOTHING * sizes.max(axis=1, initial=0.0)[:, None]
    moving: Flags = v != 0.0
    before = -1
    while before != (before := int(np.count_nonzero(moving))):
        reached = (right != 0.0) | touched[:, moving].any(axis=1)
        moving = np.asarray(moving | touched[reached].any(axis=0))
    return moving


SMALL = 16
"""Velocities up to which matrices are too small for OpenBLAS to share them among threads, as it does from 48 rows on:
they have as many rows as velocities and constraints together."""


def one_blas_thread(nv: int) -> AbstractContextManager[Any]:
    """Let linear algebra use one thread in a ``with`` block, if it would use more for a mechanism of nv velocities.

    Two threads take longer for all matrices up to 256 rows (``docs/speed.md``).
    """
    return nullcontext() if nv <= SMALL else _libraries().limit(limits=1)


@cache
def _libraries() -> Any:
    """Return the libraries of linear algebra that are loaded."""
    from threadpoolctl import ThreadpoolController  # 10 ms, which small mechanisms need not wait for

    return ThreadpoolController().select(user_api="blas")

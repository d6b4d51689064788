"""Null space, rank and redundant rows of the constraint matrix G, and its multipliers, by singular values.

Groups of rows that share no joint are decomposed apart: in one decomposition of all rows the forces of a loop of 1 mm,
a billionth of those of a loop of 1 m beside it, would be rounding. Sizes of the work grow with the cube of the largest
group: 200 joints in one group take about 20 ms a state, 1,000 joints seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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

    Attributes:
        rows: Places of the rows, shape (m,).
        joints: Places of their joints in v, shape (w,).
        matrix: G of these rows and joints, shape (.., m, w).
        scale: Diagonal of D, shape (.., m).
        left: U, shape (.., m, r).
        values: S, descending, shape (.., r).
        right: V^T, shape (.., r, w).
        free: Orthonormal basis of the null space, shape (.., w, w - r).
    """

    rows: Indices
    joints: Indices
    matrix: Array
    scale: Array
    left: Array
    values: Array
    right: Array
    free: Array

    @property
    def rank(self) -> int:
        """Number r of independent rows."""
        return int(self.values.shape[-1])

    @cached_property
    def stresses(self) -> Array:
        """Basis of the multipliers with ``G^T lam = 0``, each of length 1, shape (.., m, m - r)."""
        beyond = self.scale[..., None] * np.linalg.svd(self.left)[0][..., self.rank :]
        return np.asarray(beyond / np.linalg.norm(beyond, axis=-2, keepdims=True))

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (.., w)."""
        return np.asarray(np.vecmat(np.vecmat(self.scale * right, self.left) / self.values, self.right))

    def reached(self, right: Array) -> Array:
        """Return ``D^-1 U U^T D right``, shape (.., m)."""
        return np.asarray(np.matvec(self.left, np.vecmat(self.scale * right, self.left)) / self.scale)

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, refined once, shape (.., m).

        A decomposition errs by rounding of the largest forces at all joints; the residual at a joint is known to the
        rounding of the forces at this joint.

        Source: Higham, Accuracy and Stability of Numerical Algorithms, second edition (2002), section 12.1.
        """
        lam = self._unrefined(force)
        return lam + self._unrefined(force - np.vecmat(lam, self.matrix))

    def _unrefined(self, force: Array) -> Array:
        along = np.matvec(self.right, force)
        if self.scale.shape == self.values.shape:
            return np.asarray(self.scale * np.matvec(self.left, along / self.values))
        q, r = self._spanned
        return np.asarray(np.matvec(q, _solved(r.swapaxes(-1, -2), along)))

    @cached_property
    def _spanned(self) -> tuple[Array, Array]:
        """``G V = Q R``: redundant rows share a force by their own lengths."""
        q, r = np.linalg.qr(self.matrix @ self.right.swapaxes(-1, -2))
        return q, r


class SplitRows(Record, frozen=True):
    """The null space of G, and its rows decomposed by group, at one or at several configurations of the same rank.

    Attributes:
        shape: Of G, (.., m, nv).
    """

    groups: Sequence[RowGroup]
    alone: Indices
    shape: tuple[int, ...]

    @cached_property
    def free(self) -> Array:
        """Orthonormal basis T of the motions that the rows allow, ``G T = 0``, shape (.., nv, nv - r).

        Each is a motion of one group.
        """
        if len(self.groups) == 1 and not len(self.alone):
            return self.groups[0].free
        parts = [(self.alone, np.eye(len(self.alone))), *((group.joints, group.free) for group in self.groups)]
        return _side_by_side((*self.shape[:-2], self.shape[-1]), parts)

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return sum(group.rank for group in self.groups)

    @property
    def regularity(self) -> float:
        """Smallest singular value of the independent rows, relative to the largest of its group; of one configuration.

        0 without rows.
        """
        return min((float(group.values[-1] / group.values[0]) for group in self.groups if group.rank), default=0.0)

    @cached_property
    def stresses(self) -> Array:
        """Basis of the multipliers with ``G^T lam = 0``, each of one group and of length 1, shape (.., m, m - r)."""
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


def split_rows(rows: Array, reach: Array | float = 1.0) -> SplitRows:
    """Return the decomposition of G at one configuration, shape (m, nv); ``reach`` as in ``RowDecompositions.of``."""
    groups, alone = _groups_of(rows[None], reach)
    return SplitRows([_decomposed(rows[None], group, reach)[1](0) for group in groups], alone, rows.shape)


def of_one_rank(rows: Array, reach: Array | float = 1.0) -> SplitRows:
    """Return the decomposition of G, shape (n, k, m, nv); NaN at configurations without the rank of the first."""
    flat, states = rows.reshape(-1, *rows.shape[-2:]), rows.shape[:-2]
    groups, alone = _groups_of(flat, reach)
    cuts = (_decomposed(flat, group, reach, one_rank=True)[1](np.arange(len(flat))) for group in groups)
    arrays = ("matrix", "scale", "left", "values", "right", "free")
    shaped = [
        replace(cut, **{name: (x := getattr(cut, name)).reshape(*states, *x.shape[1:]) for name in arrays})
        for cut in cuts
    ]
    return SplitRows(shaped, alone, rows.shape)


class RowDecompositions(Record, frozen=True):
    """G decomposed at n configurations, those with the same ranks together.

    Attributes:
        parts: Places of some of the configurations, and their decomposition.
        shape: Of G, (n, m, nv), of k variants (n, k, m, nv).
    """

    parts: Sequence[tuple[Indices, SplitRows]]
    shape: tuple[int, ...]

    @classmethod
    def of(cls, rows: Array, reach: Array | float = 1.0) -> RowDecompositions:
        """Return the decompositions."""
        groups, alone = _groups_of(rows, reach)
        decomposed = [_decomposed(rows, group, reach) for group in groups]
        ranks = np.array([own for own, _ in decomposed]).reshape(len(groups), len(rows)).T
        parts = []
        for kind in sorted(set(map(tuple, ranks.tolist()))):
            places = np.flatnonzero((ranks == kind).all(axis=1))
            shape = len(places), *rows.shape[1:]
            parts.append((places, SplitRows([cut(places) for _, cut in decomposed], alone, shape)))
        return cls(parts, rows.shape)

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, shape (n, m)."""
        return self.each(self.shape[-2], lambda split, force: split.multipliers(force), force)

    @property
    def rank(self) -> int:
        """Number of independent rows, where there are fewest."""
        return min(split.rank for _, split in self.parts)

    @property
    def stresses(self) -> Array:
        """Multipliers with ``G^T lam = 0``, shape (n, m, s); padded with 0 where there are fewer than elsewhere."""
        stresses = np.zeros((*self.shape[:-1], self.shape[-2] - self.rank))
        for places, split in self.parts:
            stresses[places, ..., : split.stresses.shape[-1]] = split.stresses
        return stresses

    def each(self, width: int, function: Callable[..., Array], *arrays: Any) -> Array:
        """Return a function of the decomposition and of rows of arrays at all configurations, shape (n, width)."""
        values = np.empty((*self.shape[:-2], width))
        for places, split in self.parts:
            values[places] = function(split, *(x[places] for x in arrays))
        return values


def _decomposed(
    rows: Array, group: tuple[Indices, Indices], reach: Array | float, *, one_rank: bool = False
) -> tuple[Indices, Callable[[Indices | int], RowGroup]]:
    """Return the ranks of one group at n configurations, and the group at one of them, or at several of one rank.

    With ``one_rank``, it is NaN at configurations without the rank of the first.
    """
    some, joints = group
    matrix = np.ascontiguousarray(rows[:, some[:, None], joints])
    reach = np.broadcast_to(reach, rows.shape[1])[some]
    length = np.sqrt(np.vecdot(matrix, matrix))
    counts = length > VANISHED * reach
    scale = 1.0 / np.where(counts, np.maximum(length, SHORT * reach), 1.0)
    acting = counts.any(axis=0)  # other rows are 0 everywhere, as those that hold a plane linkage in its plane
    scaled, left = np.zeros_like(matrix), np.zeros((*matrix.shape[:2], min(int(acting.sum()), len(joints))))
    scaled[:, acting] = matrix[:, acting] * (counts * scale)[:, acting, None]
    u, values, right = np.linalg.svd(scaled[:, acting], full_matrices=bool(acting.sum() < len(joints)))
    left[:, acting] = u[..., : left.shape[2]]
    ranks = (values > RANK * values[:, :1]).sum(axis=1)
    if one_rank:
        values[ranks != ranks[:1]] = np.nan

    def cut(at: Indices | int) -> RowGroup:
        r = int(np.ravel(ranks[at])[0])
        u, s, vt = left[at][..., :r], values[at][..., :r], right[at][..., :r, :]
        free = right[at][..., r:, :].swapaxes(-1, -2)
        # one step of refinement, so that small parts, such as turns beside long slides, are as exact
        free = free - vt.swapaxes(-1, -2) @ ((u.swapaxes(-1, -2) @ (scaled[at] @ free)) / s[..., None])
        return RowGroup(some, joints, matrix[at], scale[at], u, s, vt, free)

    return ranks, cut


def _groups_of(rows: Array, reach: Array | float) -> tuple[list[tuple[Indices, Indices]], Indices]:
    """Return rows and joints of each group of G, shape (n, m, nv), and the joints that no row ties."""
    _, m, nv = rows.shape
    largest = np.maximum(rows.max(axis=0, initial=0.0), -rows.min(axis=0, initial=0.0))
    return _groups((largest > TIED * np.asarray(reach)[..., None]).tobytes(), m, nv)


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


def _solved(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


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

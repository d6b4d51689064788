"""The rows G of mechanisms side by side, each taken apart by itself.

Singular values of all rows together would mix them: beside a loop of 1 m, the forces of one of 1 mm, a billionth of
those of the other, would be the rounding of these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.nullspaces.dense_nullspace import MANY, RowDecomposition, SplitRows, dense_parts
from pinarm.records import Record

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Parts = list[tuple[Indices, SplitRows]]
"""Places of some configurations, and what is theirs."""

Groups = list[tuple[Indices, Indices]]
"""Rows and joints of each group."""

TIED = 1e-14
"""Entry of G, relative to the length that its row can have, from which on it ties its joint: others are rounding."""


class RowGroup(Record, frozen=True):
    """Rows that tie joints which no other row ties.

    Attributes:
        rows: Places of the rows, shape (k,).
        joints: Places of the joints in v, shape (w,).
        split: These rows of these joints, taken apart.
    """

    rows: Indices
    joints: Indices
    split: SplitRows


class SeparateRows(Record, frozen=True):
    """The rows of several groups, taken apart one by one; see ``RowDecomposition``.

    Attributes:
        groups: Those with joints in common, each by itself.
        alone: Joints that no row ties.
        shape: Of G, (.., m, nv).
    """

    groups: Sequence[RowGroup]
    alone: Indices
    shape: tuple[int, ...]

    @cached_property
    def free(self) -> Array:
        """T, a basis of the motions that the rows allow, each a motion of one group, shape (.., nv, nv - r)."""
        *states, _, nv = self.shape
        found = np.zeros((*states, nv, nv - self.rank))
        found[..., self.alone, np.arange(len(self.alone))] = 1.0
        start = len(self.alone)
        for group in self.groups:
            own = group.split.free
            found[..., group.joints, start : start + own.shape[-1]] = own
            start += own.shape[-1]
        return found

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return sum(group.split.rank for group in self.groups)

    @property
    def regularity(self) -> float:
        """Least regularity of a group; of a single configuration."""
        return min(group.split.regularity for group in self.groups)

    def stresses_on(self, functions: Array) -> Array:
        """Return multipliers that do nothing, each of one group; see ``SplitRows.stresses_on``."""
        each = [group.split.stresses_on(functions[..., group.rows, :]) for group in self.groups]
        found = np.zeros((*self.shape[:-1], sum(own.shape[-1] for own in each)))
        start = 0
        for group, own in zip(self.groups, each, strict=True):
            found[..., group.rows, start : start + own.shape[-1]] = own
            start += own.shape[-1]
        return found

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (.., nv)."""
        found = np.zeros((*right.shape[:-1], self.shape[-1]))
        for group in self.groups:
            found[..., group.joints] = group.split.particular(right[..., group.rows])
        return found

    def reached(self, right: Array) -> Array:
        """Return the part of a right-hand side that some x gives, shape (.., m)."""
        return self._of_rows(lambda group: group.split.reached(right[..., group.rows]), right.shape[:-1])

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, shape (.., m)."""
        return self._of_rows(lambda group: group.split.multipliers(force[..., group.joints]), force.shape[:-1])

    def _of_rows(self, value: Callable[[RowGroup], Array], states: tuple[int, ...]) -> Array:
        found = np.empty((*states, self.shape[-2]))
        for group in self.groups:
            found[..., group.rows] = value(group)
        return found


def split_apart(rows: Array, reach: Array | float) -> SplitRows:
    """Return the parts of the rows G, shape (m, nv); ``reach`` as in ``RowDecompositions.of``."""
    groups, alone = _groups_of(rows, reach)
    if len(groups) + bool(len(alone)) < 2:
        return RowDecomposition.of(rows, reach)
    each = [RowGroup(some, joints, RowDecomposition.of(rows[np.ix_(some, joints)], _some(reach, some)))
            for some, joints in groups]  # fmt: skip
    return SeparateRows(each, alone, rows.shape)


def parts_apart(rows: Array, reach: Array | float) -> Parts:
    """Return the parts of G at n configurations, shape (n, m, nv), those whose groups have the same ranks together."""
    groups, alone = _groups_of(rows, reach)
    if len(groups) + bool(len(alone)) < 2:
        return dense_parts(rows, reach)
    each = [dense_parts(np.ascontiguousarray(rows[:, some[:, None], joints]), _some(reach, some))
            for some, joints in groups]  # fmt: skip
    return _joined(groups, alone, each, rows.shape, lambda places: parts_apart(rows[places], reach))


def sparse_split_apart(rows: csr_array, reach: Array | float) -> SplitRows:
    """Return the parts of G of many joints, shape (m, nv), as ``split_apart`` does."""
    from pinarm.engine.constraints.nullspaces.sparse_nullspace import sparse_split

    groups, alone = _groups_of_sparse([rows], reach)
    if len(groups) + bool(len(alone)) < 2:
        return sparse_split(rows, reach)
    blocks = _blocks([rows], groups)
    each = [RowGroup(some, joints, RowDecomposition.of(block[0], _some(reach, some)) if len(joints) <= MANY
                     else sparse_split(rows[some][:, joints], _some(reach, some)))
            for (some, joints), block in zip(groups, blocks, strict=True)]  # fmt: skip
    return SeparateRows(each, alone, rows.shape)


def sparse_parts_apart(rows: Sequence[csr_array], reach: Array | float) -> Parts:
    """Return the parts of G of many joints, n of shape (m, nv), as ``parts_apart`` does."""
    from pinarm.engine.constraints.nullspaces.sparse_nullspace import sparse_parts

    groups, alone = _groups_of_sparse(rows, reach)
    if len(groups) + bool(len(alone)) < 2:
        return sparse_parts(rows, reach)
    blocks = _blocks(rows, groups)
    each = [dense_parts(block, _some(reach, some)) if len(joints) <= MANY
            else sparse_parts([matrix[some][:, joints] for matrix in rows], _some(reach, some))
            for (some, joints), block in zip(groups, blocks, strict=True)]  # fmt: skip
    shape = (len(rows), *rows[0].shape)
    return _joined(groups, alone, each, shape, lambda places: sparse_parts_apart([rows[k] for k in places], reach))


def _blocks(rows: Sequence[csr_array], groups: Groups) -> Iterator[Array]:
    """Yield the rows of each group of few joints at n configurations, shape (n, k, w); of others nothing of use."""
    m, nv = rows[0].shape
    row, column, entry = _entries(rows)
    state = np.repeat(np.arange(len(rows)), [matrix.nnz for matrix in rows])
    (owner, row_place), (column_owner, column_place) = np.full((2, m), -1), np.full((2, nv), -1)
    for k, (some, joints) in enumerate(groups):
        owner[some], row_place[some] = k, np.arange(len(some))
        column_owner[joints], column_place[joints] = k, np.arange(len(joints))
    own = np.flatnonzero(owner[row] == column_owner[column])  # not what is rounding
    own = own[np.argsort(owner[row[own]], kind="stable")]
    bounds = np.searchsorted(owner[row[own]], np.arange(len(groups) + 1))
    for k, (some, joints) in enumerate(groups):
        here = own[bounds[k] : bounds[k + 1]] if len(joints) <= MANY else own[:0]
        block = np.zeros((len(rows), len(some), len(joints)) if len(joints) <= MANY else (0, 0, 0))
        block[state[here], row_place[row[here]], column_place[column[here]]] = entry[here]
        yield block


def _joined(
    groups: Groups, alone: Indices, each: Sequence[Parts], shape: tuple[int, ...], again: Callable[[Indices], Parts]
) -> Parts:
    """Return the parts of all groups as one, or where their ranks differ between configurations, of those alike."""
    if all(len(parts) == 1 for parts in each):
        found = [RowGroup(*group, split) for group, ((_, split),) in zip(groups, each, strict=True)]
        return [(np.arange(shape[0]), SeparateRows(found, alone, shape))]
    kinds = np.empty((shape[0], len(groups)), dtype=np.intp)
    for column, parts in enumerate(each):
        for kind, (places, _) in enumerate(parts):
            kinds[places, column] = kind
    alike = [np.flatnonzero((kinds == kind).all(axis=1)) for kind in sorted(set(map(tuple, kinds.tolist())))]
    return [(some[places], split) for some in alike for places, split in again(some)]


def _some(reach: Array | float, rows: Indices) -> Array | float:
    return reach[rows] if isinstance(reach, np.ndarray) else reach


def _groups_of(rows: Array, reach: Array | float) -> tuple[Groups, Indices]:
    """Return rows and joints of each group, and the joints that no row ties; G has the shape (.., m, nv).

    Rows that tie no joint go with the first group.
    """
    *states, m, nv = rows.shape
    largest = np.maximum(rows.max(axis=0, initial=0.0), -rows.min(axis=0, initial=0.0)) if states else np.abs(rows)
    return _groups((largest > TIED * np.asarray(reach)[..., None]).tobytes(), m, nv)


@lru_cache(maxsize=64)
def _groups(pattern: bytes, m: int, nv: int) -> tuple[Groups, Indices]:
    """Return the same of flags of which rows tie which joints, the bytes of an array of shape (m, nv)."""
    tied, labels, before = np.frombuffer(pattern, dtype=bool).reshape(m, nv), np.arange(nv), None
    while before is None or (labels != before).any():  # joints take the least label of those that are tied to them
        before = labels
        least = np.where(tied, labels, nv).min(axis=1, initial=nv)
        labels = np.minimum(labels, np.where(tied, least[:, None], nv).min(axis=0, initial=nv))
    return _by_label(least, labels, np.asarray(tied.any(axis=0)), nv)


def _groups_of_sparse(rows: Sequence[csr_array], reach: Array | float) -> tuple[Groups, Indices]:
    """Return the same of n matrices of shape (m, nv)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    m, nv = rows[0].shape
    row, column, entry = _entries(rows)
    ties = np.abs(entry) > TIED * np.broadcast_to(reach, m)[row]
    row, column = row[ties], column[ties]
    graph = coo_array((np.ones(len(row)), (row, m + column)), shape=(m + nv, m + nv))
    labels = connected_components(graph, directed=False)[1]
    tied = np.zeros(m + nv, dtype=bool)
    tied[row], tied[m + column] = True, True
    none = m + nv
    return _by_label(np.where(tied[:m], labels[:m], none), labels[m:], tied[m:], none)


def _entries(rows: Sequence[csr_array]) -> tuple[Indices, Indices, Array]:
    """Return rows, columns and values of the entries of all matrices, one after the other."""
    row = [np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr)) for matrix in rows]
    column, entry = ([getattr(matrix, name) for matrix in rows] for name in ("indices", "data"))
    return np.concatenate(row), np.concatenate(column), np.concatenate(entry)


def _by_label(rows: Indices, joints: Indices, tied: Flags, none: int) -> tuple[Groups, Indices]:
    """Return the groups by labels of rows and of joints, and the joints that are not tied; ``none`` labels no group."""
    names = sorted(set(joints[tied].tolist()))
    rows = np.where(rows < none, rows, names[0] if names else none)
    groups = [(np.flatnonzero(rows == name), np.flatnonzero(tied & (joints == name))) for name in names]
    return groups, np.flatnonzero(~tied)

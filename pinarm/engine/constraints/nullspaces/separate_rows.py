"""The rows G of mechanisms side by side, each taken apart by itself.

Singular values of all rows together would mix them: beside a loop of 1 m, the forces of one of 1 mm, a billionth of
those of the other, would be the rounding of these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.nullspaces.dense_nullspace import RowDecomposition, SplitRows, dense_parts
from pinarm.records import Record

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
        rows: G itself, shape (.., m, nv).
    """

    groups: Sequence[RowGroup]
    alone: Indices
    rows: Array

    @cached_property
    def free(self) -> Array:
        """T, a basis of the motions that the rows allow, each a motion of one group, shape (.., nv, nv - r)."""
        *states, _, nv = self.rows.shape
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
        found = np.zeros((*self.rows.shape[:-1], sum(own.shape[-1] for own in each)))
        start = 0
        for group, own in zip(self.groups, each, strict=True):
            found[..., group.rows, start : start + own.shape[-1]] = own
            start += own.shape[-1]
        return found

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (.., nv)."""
        found = np.zeros((*right.shape[:-1], self.rows.shape[-1]))
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
        found = np.empty((*states, self.rows.shape[-2]))
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
    return SeparateRows(each, alone, rows)


def parts_apart(rows: Array, reach: Array | float) -> list[tuple[Indices, SplitRows]]:
    """Return the parts of G at n configurations, shape (n, m, nv), those whose groups have the same ranks together."""
    groups, alone = _groups_of(rows, reach)
    if len(groups) + bool(len(alone)) < 2:
        return dense_parts(rows, reach)
    each = [dense_parts(rows[:, some[:, None], joints], _some(reach, some)) for some, joints in groups]
    if all(len(parts) == 1 for parts in each):
        found = [RowGroup(*group, split) for group, ((_, split),) in zip(groups, each, strict=True)]
        return [(np.arange(len(rows)), SeparateRows(found, alone, rows))]
    kinds = np.empty((len(rows), len(groups)), dtype=np.intp)
    for column, parts in enumerate(each):
        for kind, (places, _) in enumerate(parts):
            kinds[places, column] = kind
    alike = [np.flatnonzero((kinds == kind).all(axis=1)) for kind in sorted(set(map(tuple, kinds.tolist())))]
    return [(some[places], split) for some in alike for places, split in parts_apart(rows[some], reach)]


def _some(reach: Array | float, rows: Indices) -> Array | float:
    return reach[rows] if isinstance(reach, np.ndarray) else reach


def _groups_of(rows: Array, reach: Array | float) -> tuple[list[tuple[Indices, Indices]], Indices]:
    """Return rows and joints of each group, and the joints that no row ties; G has the shape (.., m, nv).

    Rows that tie no joint go with the first group.
    """
    *states, _, nv = rows.shape
    tied = np.abs(rows) > TIED * np.asarray(reach)[..., None]
    return _groups((tied.any(axis=0) if states else tied).tobytes(), nv)


@lru_cache(maxsize=64)
def _groups(pattern: bytes, nv: int) -> tuple[list[tuple[Indices, Indices]], Indices]:
    """Return the same of flags of which rows tie which joints, the bytes of an array of shape (m, nv)."""
    tied, labels, before = np.frombuffer(pattern, dtype=bool).reshape(-1, nv), np.arange(nv), None
    while before is None or (labels != before).any():  # joints take the least label of those that are tied to them
        before = labels
        least = np.where(tied, labels, nv).min(axis=1, initial=nv)
        labels = np.minimum(labels, np.where(tied, least[:, None], nv).min(axis=0, initial=nv))
    alone = ~tied.any(axis=0)
    names = np.array(sorted(set(labels[~alone].tolist())), dtype=np.intp)
    owners = np.where(least < nv, least, names[:1] if len(names) else nv)
    return [(np.flatnonzero(owners == name), np.flatnonzero(~alone & (labels == name))) for name in names], (
        np.flatnonzero(alone)
    )

"""Pairs that differ only in the joints between their frames, evaluated as one pair at more configurations.

The cells of a lattice, or a row of equal four-bars, have loop joints whose chains are the same but for the indices of
their coordinates. L of them at n configurations are one at L n. The simple route is each pair by itself,
``row_measures.EvaluatedPair``.
"""

from __future__ import annotations

from collections.abc import Container, Hashable, Iterable, Iterator, Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct

from pinarm.arrays import Array, Indices, constants_of
from pinarm.engine.constraints.nullspaces.elimination import Row
from pinarm.engine.constraints.row_measures import EvaluatedPair, PairMeasure, RowMeasure
from pinarm.records import Record, replace

BLOCK = 2048
"""Number of configurations that are worked on at once: arrays of more would not stay in the processor's cache."""


class AlikePairs(Record, frozen=True):
    """Pairs with the same constants.

    Attributes:
        measure: One of them, the joints of its chain numbered through.
        joints: Index in q and v of each pair's joints, shape (L, s).
        places: Places of the pairs among the measures that they belong to.
    """

    measure: PairMeasure
    joints: Indices
    places: tuple[int, ...]

    def at(self, q: Array, cosine: Array, sine: Array) -> Iterator[tuple[slice, EvaluatedAlike]]:
        """Yield some of the pairs, and their rows at configurations; see ``PairMeasure.at``."""
        together = max(1, BLOCK // max(1, q.shape[1]))
        for first in range(0, len(self.joints), together):
            some = slice(first, first + together)
            columns = (_columns(x, self.joints[some]) for x in (q, cosine, sine))
            yield some, EvaluatedAlike(self.measure.at(*columns), self.joints[some])


class EvaluatedAlike(Struct, eq=False, dict=True, weakref=True):
    """The rows of L alike pairs at n configurations; arrays have the shape (L n,), or (1,).

    Attributes:
        pair: All of them as one.
        joints: Index in q and v of each pair's joints, shape (L, s).
    """

    pair: EvaluatedPair
    joints: Indices
    _drift: tuple[Array, dict[int, Array]] | None = None

    @cached_property
    def every(self) -> range:
        """The numbers of the rows."""
        return range(len(self.pair.pair.along))

    @cached_property
    def gap(self) -> list[Array]:
        """The value of every row."""
        return self.pair.gap()

    @cached_property
    def rows(self) -> dict[int, Row]:
        """The rows of J, by the number of the joint in the chain."""
        return dict(self.pair.rows(self.every))

    def matrices(self, n: int) -> Array:
        """Return all rows of J at n configurations by the number of the joint in the chain, shape (n, L, m, s)."""
        pairs, stages = self.joints.shape
        found = np.zeros((len(self.every), stages, pairs * n))
        if self.pair.pair.constant is not None:
            found[:] = self.pair.placed.rows(*self.pair.pair.constant)
        else:
            for i, row in self.rows.items():
                for stage, x in row.items():
                    found[i, stage] = x
        return found.reshape(len(self.every), stages, pairs, n).transpose(3, 2, 0, 1)

    def drift(self, v: Array) -> dict[int, Array]:
        """Return J' v for velocities v, shape (nv, n)."""
        if self._drift is None or self._drift[0] is not v:
            self._drift = v, self.pair.drift(self.every, _columns(v, self.joints))
        return self._drift[1]

    def stacked(self, n: int, values: Iterable[tuple[int, Array]]) -> Array:
        """Return numbers of rows of all pairs at n configurations, by the number of the row, shape (n, L, m)."""
        found = np.zeros((len(self.every), len(self.joints), n))
        for i, x in values:
            found[i] = self.spread(n, x)
        return found.transpose(2, 1, 0)

    def spread(self, n: int, x: Array) -> Array:
        """Return what belongs to all pairs at n configurations, shape (L, n) or (1, 1)."""
        return x.reshape(-1, n) if len(x) == len(self.joints) * n else x[:, None]

    def of_pair(self, k: int, x: Array) -> Array:
        """Return what belongs to one of the pairs, shape (n,) or (1,)."""
        return x if len(x) == 1 else x.reshape(len(self.joints), -1)[k]


class AlikeRows(Record, frozen=True):
    """The rows of one of several alike pairs; see ``EvaluatedRows``.

    Attributes:
        alike: All of them.
        k: Number of the pair.
    """

    alike: EvaluatedAlike
    k: int

    def gap(self) -> list[Array]:
        """Return the open lengths and angles."""
        return [self.alike.of_pair(self.k, x) for x in self.alike.gap]

    def rows(self, wanted: Container[int]) -> dict[int, Row]:
        """Return the wanted rows of J."""
        joints = self.alike.joints[self.k].tolist()
        return {
            i: {joints[stage]: self.alike.of_pair(self.k, x) for stage, x in row.items()}
            for i, row in self.alike.rows.items()
            if i in wanted
        }

    def drift(self, wanted: Container[int], v: Array) -> dict[int, Array]:
        """Return J' v of the wanted rows."""
        return {i: self.alike.of_pair(self.k, x) for i, x in self.alike.drift(v).items() if i in wanted}


def _columns(x: Array, joints: Indices) -> Array:
    """Return the numbers of each pair's joints, shape (s, L n), from those of all, shape (nv, n)."""
    return x.take(joints.T.ravel(), axis=0).reshape(joints.shape[1], len(joints) * x.shape[1])


def alike_pairs(measures: Sequence[RowMeasure]) -> tuple[AlikePairs, ...]:
    """Return the pairs among measures, those with the same constants together."""
    found: dict[Hashable, tuple[PairMeasure, list[list[int]], list[int]]] = {}
    for place, measure in enumerate(measures):
        if isinstance(measure, PairMeasure):
            stages = measure.chain.stages
            numbered = tuple(replace(stage, index=k) for k, stage in enumerate(stages))
            one = replace(measure, chain=replace(measure.chain, stages=numbered))
            _, joints, places = found.setdefault(constants_of(one), (one, [], []))
            joints.append([stage.index for stage in stages])
            places.append(place)
    return tuple(
        AlikePairs(one, np.array(joints, dtype=np.intp).reshape(len(places), -1), tuple(places))
        for one, joints, places in found.values()
    )

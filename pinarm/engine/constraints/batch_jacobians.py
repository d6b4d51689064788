"""What constraints and coordinates measure, at many configurations at once: values, rows of J and drifts.

The rows of each are those of ``row_measures``, numbered through.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.alike_pairs import BLOCK, AlikePairs, AlikeRows, EvaluatedAlike, alike_pairs
from pinarm.engine.constraints.constraint import Constraint
from pinarm.engine.constraints.nullspaces.elimination import Row
from pinarm.engine.constraints.row_measures import EvaluatedRows, RowMeasure, row_measure
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.model_variants import Model
from pinarm.records import Record

if TYPE_CHECKING:
    from scipy.sparse import csr_array

EVERY = range(1 << 16)
"""Numbers of the rows of any single measure."""

__all__ = ["BLOCK", "BatchJacobians", "EvaluatedJacobians", "rows_of"]


class BatchJacobians(Record, frozen=True):
    """What several constraints and coordinates measure, their rows numbered through.

    Attributes:
        parts: First row of each measure, and the measure.
        size: Number of rows.
    """

    parts: tuple[tuple[int, RowMeasure], ...]
    size: int

    @classmethod
    def of(cls, model: Model, ones: Sequence[Constraint | Coordinate]) -> BatchJacobians | None:
        """Return the measures of a model; ``None`` where one of them cannot be had at many configurations."""
        parts, size = [], 0
        for one in ones:
            measure = row_measure(model, one) if model.nq == model.nv else None
            if measure is None:
                return None
            parts.append((size, measure))
            size += measure.size
        return cls(tuple(parts), size)

    def repeated(self, n: int) -> BatchJacobians:
        """Return the measures for n rows of all variants of a model, row by row."""
        return BatchJacobians(tuple((start, part.repeated(n)) for start, part in self.parts), self.size)

    @cached_property
    def alike(self) -> tuple[AlikePairs, ...]:
        """The pairs among the measures, those with the same constants together."""
        return alike_pairs([measure for _, measure in self.parts])

    @cached_property
    def kinds(self) -> int:
        """Number of measures that differ in more than their joints."""
        return len(self.parts) - sum(len(pairs.places) - 1 for pairs in self.alike)

    @cached_property
    def _stacked(self) -> list[tuple[AlikePairs, Indices]]:
        """The pairs that are alike, and their rows, shape (L, m)."""
        starts = np.array([start for start, _ in self.parts], dtype=np.intp)
        return [(pairs, starts[list(pairs.places), None] + np.arange(pairs.measure.size)) for pairs in self.alike]

    @cached_property
    def _apart(self) -> list[tuple[int, RowMeasure]]:
        """The other measures, and the first row of each."""
        stacked = {place for pairs in self.alike for place in pairs.places}
        return [part for place, part in enumerate(self.parts) if place not in stacked]

    def each(self, q: Array) -> EvaluatedJacobians:
        """Return the rows at configurations, shape (nv, n), each measure by itself."""
        cosine, sine = np.cos(q), np.sin(q)
        return EvaluatedJacobians([(start, measure.at(q, cosine, sine)) for start, measure in self.parts])

    def at(self, q: Array) -> EvaluatedJacobians:
        """Return the rows at configurations, shape (nv, n), measures that are alike together."""
        cosine, sine = np.cos(q), np.sin(q)
        apart = [(start, measure.at(q, cosine, sine)) for start, measure in self._apart]
        return EvaluatedJacobians(apart, [
            (rows[some], alike) for pairs, rows in self._stacked for some, alike in pairs.at(q, cosine, sine)
        ])  # fmt: skip


class EvaluatedJacobians(Record, frozen=True):
    """The rows of several measures at many configurations.

    Attributes:
        apart: First row of each measure that is like no other, and its rows.
        stacked: The rows of alike pairs, shape (L, m), and what they are.
    """

    apart: Sequence[tuple[int, EvaluatedRows]]
    stacked: Sequence[tuple[Indices, EvaluatedAlike]] = ()

    @cached_property
    def parts(self) -> list[tuple[int, EvaluatedRows]]:
        """First row of each measure, and its rows, in their order."""
        pairs = [
            (start, AlikeRows(alike, k)) for rows, alike in self.stacked for k, start in enumerate(rows[:, 0].tolist())
        ]
        return sorted([*self.apart, *pairs], key=lambda part: part[0])

    def gap(self) -> list[Array]:
        """Return the value of every row [m or rad], shape (n,) or (1,)."""
        return [value for _, part in self.parts for value in part.gap()]

    def rows(self, wanted: Container[int]) -> dict[int, Row]:
        """Return the wanted rows of J."""
        found = {}
        for start, part in self.parts:
            found.update({start + i: row for i, row in part.rows(_Own(wanted, start)).items()})
        return found

    def drift(self, wanted: Container[int], v: Array) -> dict[int, Array]:
        """Return J' v of the wanted rows, shape (n,) or (1,), for velocities v, shape (nv, n); absent where it is 0."""
        found = {}
        for start, part in self.parts:
            found.update({start + i: x for i, x in part.drift(_Own(wanted, start), v).items()})
        return found

    def gaps(self, n: int) -> Array:
        """Return the values of all rows at n configurations [m or rad], shape (n, m)."""
        apart = [(start, part.gap()) for start, part in self.apart]
        found = np.empty((n, sum(len(gap) for _, gap in apart) + sum(rows.size for rows, _ in self.stacked)))
        for start, gap in apart:
            for row, x in enumerate(gap, start):
                found[:, row] = x
        for rows, alike in self.stacked:
            found[:, rows] = alike.stacked(n, enumerate(alike.gap))
        return found

    def matrices(self, shape: tuple[int, ...]) -> Array:
        """Return J with all rows, of the shape (n, m, nv)."""
        found = np.zeros(shape)
        for start, part in self.apart:
            for i, row in part.rows(EVERY).items():
                for column, x in row.items():
                    found[:, start + i, column] = x
        for rows, alike in self.stacked:
            found[:, rows[:, :, None], alike.joints[:, None]] = alike.matrices(shape[0])
        return found

    def sparse_matrices(self, shape: tuple[int, int, int]) -> list[csr_array]:
        """Return J with all rows, of the shape (n, m, nv), as n sparse matrices."""
        from scipy.sparse import csr_array

        n, *size = shape
        entries = [(np.empty(0, np.intp), np.empty(0, np.intp), np.empty((n, 0))), *self._entries(n)]
        rows, columns, values = (np.concatenate(each, axis=-1) for each in zip(*entries, strict=True))
        order = np.lexsort((columns, rows))
        columns, values = columns[order], values[:, order]
        starts = np.searchsorted(rows[order], np.arange(size[0] + 1))
        matrices = [csr_array((own, columns.copy(), starts.copy()), shape=size) for own in values]
        for matrix in matrices:
            matrix.eliminate_zeros()
        return matrices

    def drifts(self, v: Array, m: int) -> Array:
        """Return J' v of all m rows, shape (n, m), for velocities v, shape (nv, n)."""
        n = v.shape[1]
        found = np.zeros((n, m))
        for start, part in self.apart:
            for i, x in part.drift(EVERY, v).items():
                found[:, start + i] = x
        for rows, alike in self.stacked:
            found[:, rows] = alike.stacked(n, alike.drift(v).items())
        return found

    def _entries(self, n: int) -> Iterator[tuple[Indices, Indices, Array]]:
        """Yield rows and columns of some entries of J, shape (e,), and their values at n configurations, (n, e)."""
        for start, part in self.apart:
            for i, row in part.rows(EVERY).items():
                for column, x in row.items():
                    yield np.array([start + i]), np.array([column]), np.broadcast_to(x, n)[:, None]
        for rows, alike in self.stacked:
            for i, row in alike.rows.items():
                for stage, x in row.items():
                    values = np.broadcast_to(alike.spread(n, x).T, (n, len(rows)))
                    yield rows[:, i], alike.joints[:, stage], values


class _Own(Record, frozen=True):
    """Which of its rows are wanted of a measure, those of all measures being numbered through.

    Attributes:
        wanted: Numbers of wanted rows of all measures.
        start: Number of the measure's first row.
    """

    wanted: Container[int]
    start: int

    def __contains__(self, row: object) -> bool:
        return isinstance(row, int) and row + self.start in self.wanted


def rows_of(model: Model, coordinates: Sequence[Coordinate], q: Array) -> Array:
    """Return the rows J of coordinates at configurations q, shape (n, nq), as an array of shape (n, d, nv)."""
    found = np.zeros((len(q), len(coordinates), model.nv))
    for d, coordinate in enumerate(coordinates):
        measures = BatchJacobians.of(model, [coordinate])
        if isinstance(coordinate, LinearCoordinate):
            found[:, d] = coordinate.weights
        elif measures is not None:
            for j, x in measures.at(q.T).rows([0])[0].items():
                found[:, d, j] = x
        else:
            found[:, d] = [coordinate.row(Kinematics.at(model, configuration)) for configuration in q]
    return found

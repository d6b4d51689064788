"""What constraints and coordinates measure, at many configurations at once: values, rows of J and drifts.

The rows of each are those of ``row_measures``, numbered through.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.alike_pairs import BLOCK, AlikePairs, alike_pairs
from pinarm.engine.constraints.constraint import Constraint
from pinarm.engine.constraints.nullspaces.elimination import Row
from pinarm.engine.constraints.row_measures import EvaluatedRows, RowMeasure, row_measure
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.model_variants import Model
from pinarm.records import Record

if TYPE_CHECKING:
    from scipy.sparse import csr_array

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

    def each(self, q: Array) -> EvaluatedJacobians:
        """Return the rows at configurations, shape (nv, n), each measure by itself."""
        cosine, sine = np.cos(q), np.sin(q)
        return EvaluatedJacobians([(start, measure.at(q, cosine, sine)) for start, measure in self.parts])

    def at(self, q: Array) -> EvaluatedJacobians:
        """Return the rows at configurations, shape (nv, n), measures that are alike together."""
        cosine, sine = np.cos(q), np.sin(q)
        known = dict(rows for pairs in self.alike for rows in pairs.at(q, cosine, sine))
        return EvaluatedJacobians([
            (start, known.get(place) or measure.at(q, cosine, sine))
            for place, (start, measure) in enumerate(self.parts)
        ])  # fmt: skip


class EvaluatedJacobians(Record, frozen=True):
    """The rows of several measures at many configurations.

    Attributes:
        parts: First row of each measure, and its rows.
    """

    parts: list[tuple[int, EvaluatedRows]]

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
        gap = self.gap()
        found = np.empty((n, len(gap)))
        for row, x in enumerate(gap):
            found[:, row] = x
        return found

    def matrices(self, shape: tuple[int, ...]) -> Array:
        """Return J with all rows, of the shape (n, m, nv)."""
        found = np.zeros(shape)
        for row, coefficients in self.rows(range(shape[1])).items():
            for column, x in coefficients.items():
                found[:, row, column] = x
        return found

    def sparse_matrices(self, shape: tuple[int, int, int]) -> list[csr_array]:
        """Return J with all rows, of the shape (n, m, nv), as n sparse matrices."""
        from scipy.sparse import csr_array

        n, *size = shape
        found = self.rows(range(size[0]))
        rows = [found.get(row, {}) for row in range(size[0])]
        starts = np.cumsum([0, *map(len, rows)])
        columns = np.array([column for row in rows for column in row], dtype=np.intp)
        values = np.empty((n, len(columns)))
        for k, x in enumerate(x for row in rows for x in row.values()):
            values[:, k] = x
        matrices = [csr_array((own, columns.copy(), starts.copy()), shape=size) for own in values]
        for matrix in matrices:
            matrix.eliminate_zeros()
            matrix.sort_indices()
        return matrices

    def drifts(self, v: Array, m: int) -> Array:
        """Return J' v of all m rows, shape (n, m), for velocities v, shape (nv, n)."""
        found = np.zeros((v.shape[1], m))
        for row, x in self.drift(range(m), v).items():
            found[:, row] = x
        return found


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

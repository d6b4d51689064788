"""Cases as a table: a column of values for each path. A case becomes a mapping only where it is asked for."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.records import replace
from pinarm.use.cases.case import Case, Row, Value


@dataclass(frozen=True)
class Column:
    """The values of one path.

    Attributes:
        path: Where in the scenario they go.
        values: Numbers, or words; many numbers take 8 bytes each in an ``array``.
        unit: Of the numbers; empty for none.
    """

    path: str
    values: Sequence[Value]
    unit: str = ""

    def at(self, row: int) -> Value:
        """Return a value as a scenario file would have it."""
        value = self.values[row]
        return f"{value!r} {self.unit}" if self.unit else value

    def some(self, rows: Indices) -> Column:
        """Return the values of some rows."""
        if isinstance(self.values, array):
            return replace(self, values=array("d", self.as_array[rows].tobytes()))
        return replace(self, values=[self.values[row] for row in rows.tolist()])

    @property
    def is_numeric(self) -> bool:
        """Whether the values are numbers."""
        return isinstance(self.values, array) or not any(isinstance(value, str | bool) for value in self.values)

    @cached_property
    def as_array(self) -> Array:
        """The values as numbers, or as words, shape (values,)."""
        return np.asarray(self.values, float if self.is_numeric else str)


@dataclass(frozen=True, eq=False)
class CaseTable:
    """Cases with values at the same paths.

    Attributes:
        columns: At least one, all of one length.
    """

    columns: tuple[Column, ...]

    @classmethod
    def of(cls, cases: Sequence[Case]) -> CaseTable:
        """Return the table of at least one case, all with the same paths."""
        return cls(tuple(Column(path, [case[path] for case in cases]) for path in cases[0]))

    def __len__(self) -> int:
        return len(self.columns[0].values)

    def __getitem__(self, case: int) -> dict[str, Value]:
        """Return the values of one case by path."""
        return {column.path: column.at(case) for column in self.columns}

    def __iter__(self) -> Iterator[dict[str, Value]]:
        return map(self.__getitem__, range(len(self)))

    def some(self, cases: Indices) -> CaseTable:
        """Return some of the cases."""
        return CaseTable(tuple(column.some(cases) for column in self.columns))


SomeCases = Sequence[Case] | CaseTable
"""Several cases, whatever they vary."""


@dataclass(frozen=True, eq=False)
class RowTable:
    """What came out of cases that refer to the same files, none of which failed.

    Attributes:
        numbers: Those of each case, see ``Row``, shape (cases, numbers).
        files: The files.
    """

    numbers: Array
    files: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, case: int) -> Row:
        """Return what came out of one case."""
        return Row(tuple(self.numbers[case].tolist()), "", self.files)

    def __iter__(self) -> Iterator[Row]:
        return map(self.__getitem__, range(len(self)))

"""Table of cases: a column of values for each path, and which numbers may differ among cases solved together."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.input.units import unit
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
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
    """Results of solved cases that refer to the same files.

    Attributes:
        numbers: Numbers of each case, see ``Row``, shape (cases, numbers).
        files: The files.
    """

    numbers: Array
    files: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, case: int) -> Row:
        return Row(tuple(self.numbers[case].tolist()), "", self.files)

    def __iter__(self) -> Iterator[Row]:
        return map(self.__getitem__, range(len(self)))


ARGUMENT = "arguments."
"""Prefix of paths to arguments of the model."""

PRESCRIBED = tuple(f"problem.{key}." for key in ("motion", "time", "over", "hold", "velocity", "acceleration"))
"""Prefixes of paths to numbers of laws, of rows and of initial states."""

COLUMNS = (ARGUMENT, *PRESCRIBED)
"""Prefixes of paths to numbers that may differ between cases of one kind."""

Kind = tuple[tuple[str, Value], ...] | None
"""Values common to cases that may be solved together; ``None`` for a case that varies none of ``COLUMNS``."""


@lru_cache(1000)
def is_column(path: str) -> bool:
    """Tell whether numbers at a path may differ: numbers of rows may not, which arrays have in common."""
    return path.startswith(COLUMNS) and not path.endswith(".samples")


def kind_of(values: Case) -> Kind:
    """Return the kind of a case: its values but for those of ``COLUMNS``."""
    kept = tuple([(path, "" if is_column(path) else value) for path, value in values.items()])
    return kept if any(map(is_column, values)) else None


def of_kind(anchor: Case, values: Case) -> Case | None:
    """Return the numbers of one case that may differ with all else of another; ``None`` where it has not the same."""
    own, other = ({path for path in case if is_column(path)} for case in (anchor, values))
    return {path: anchor[path] if path in own else value for path, value in values.items()} if own == other else None


def grouped(cases: SomeCases) -> dict[Kind, Indices]:
    """Return the kinds of cases, and the places of those of each, ascending."""
    if isinstance(cases, CaseTable) and len(cases) and all(is_column(column.path) for column in cases.columns):
        return {kind_of(cases[0]): np.arange(len(cases))}
    groups = dict[Kind, list[int]]()
    for place, case in enumerate(cases):
        groups.setdefault(kind_of(case), []).append(place)
    return {kind: np.array(places) for kind, places in groups.items()}


def tabled(cases: SomeCases, places: Indices) -> CaseTable:
    """Return cases of one kind as a table."""
    if isinstance(cases, CaseTable):
        return cases.some(places)
    return CaseTable.of([cases[place] for place in places.tolist()])


def moving(cases: CaseTable) -> list[Column]:
    """Return the columns that say how cases move: those of laws, rows and initial states."""
    return [column for column in cases.columns if column.path.startswith(COLUMNS[1:])]


def numbers_of(column: Column, first: Value) -> Array:
    """Return the numbers of a column [SI]; a value as a scenario has it says their unit.

    Raises:
        VariantsDiffer: They are not all numbers with the unit of the first.
    """
    if not isinstance(first, str):
        if column.unit or not column.is_numeric:
            raise VariantsDiffer("numbers with and without a unit")
        return column.as_array
    measured = first.partition(" ")[2]
    numbers = column.as_array if column.unit and column.unit == measured else _read(column.values, measured)
    return numbers * (unit(measured).factor if measured else 1.0)


def number_of(value: Value, first: Value) -> float:
    """Return one number [SI]; see ``numbers_of``."""
    return float(numbers_of(Column("", [value]), first)[0])


def _read(values: Sequence[Value], measured: str) -> Array:
    """Return numbers that are given as texts with a unit."""
    ending = f" {measured}" if measured else ""
    texts = [value for value in values if isinstance(value, str) and value.endswith(ending)]
    if len(texts) < len(values):
        raise VariantsDiffer("several units")
    try:
        return np.array([float(text.removesuffix(ending)) for text in texts])
    except ValueError:
        raise VariantsDiffer("values that are no plain numbers") from None

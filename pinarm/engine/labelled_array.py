"""Tables of real or complex numbers whose rows and columns have names and units, such as mode shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array, Complex
from pinarm.errors import InputError
from pinarm.input.units import HERTZ, Unit, unit
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pandas import DataFrame

PARTS = ("values", "rows", "columns", "row_units", "column_units")
"""Names of the plain arrays that a table is stored as."""

UNKNOWN = "?"


class LabelledArray(Record, frozen=True):
    """A table of numbers.

    Attributes:
        values: The numbers [SI], real or complex, NaN where there is no value, shape (n, m).
        rows: Names of the rows.
        columns: Names of the columns.
        row_units: Units of the rows; ``None`` where one is not known.
        column_units: Units of the columns: an entry is in the product of the units of its row and column.
    """

    unshown = ("values",)

    values: Array | Complex
    rows: Sequence[str]
    columns: Sequence[str]
    row_units: Sequence[Unit | None]
    column_units: Sequence[Unit | None]

    def unit(self, row: int, column: int) -> Unit | None:
        """Return the unit of an entry; ``None`` where it is not known."""
        of_row, of_column = self.row_units[row], self.column_units[column]
        return None if of_row is None or of_column is None else of_row * of_column

    def entry(self, row: str, column: str) -> complex:
        """Return an entry [SI] by the names of its row and column.

        Raises:
            InputError: There is no such row or column.
        """
        for name, names in ((row, self.rows), (column, self.columns)):
            if name not in names:
                raise InputError(f"the table has no '{name}'", expected=f"one of {', '.join(names)}")
        return complex(self.values[list(self.rows).index(row), list(self.columns).index(column)])

    def headings(self) -> tuple[list[str], list[str]]:
        return _with_units(self.rows, self.row_units), _with_units(self.columns, self.column_units)

    def to_dataframe(self) -> DataFrame:
        from pinarm.engine.labelled_array import dataframe

        rows, columns = self.headings()
        return dataframe(self.values, columns).set_axis(rows, axis="index")


def _with_units(names: Sequence[str], units: Sequence[Unit | None]) -> list[str]:
    return [f"{name} [{own or UNKNOWN}]" if str(own) != "1" else name for name, own in zip(names, units, strict=True)]


def _unit(text: str) -> Unit | None:
    return {UNKNOWN: None, str(HERTZ): HERTZ}[text] if text in (UNKNOWN, str(HERTZ)) else unit(text)


def plain_arrays(tables: Mapping[str, LabelledArray]) -> dict[str, Any]:
    """Return tables as arrays of numbers and texts, from which ``labelled_arrays`` makes them again."""
    arrays: dict[str, Any] = {"array.names": np.array([*tables], str)} if tables else {}
    for k, table in enumerate(tables.values()):
        arrays |= {f"array.{k}.{name}": part for name, part in zip(PARTS, plain_table(table), strict=True)}
    return arrays


def plain_table(table: LabelledArray) -> list[NDArray[Any]]:
    """Return a table as arrays of numbers and texts, in the order of ``PARTS``."""
    units = [np.array([str(x) if x else UNKNOWN for x in own]) for own in (table.row_units, table.column_units)]
    return [np.asarray(table.values), np.array([*table.rows], str), np.array([*table.columns], str), *units]


def labelled_arrays(arrays: Mapping[str, Any]) -> dict[str, LabelledArray]:
    """Return the tables among stored arrays; see ``plain_arrays``."""
    tables = dict[str, LabelledArray]()
    for k, name in enumerate(arrays["array.names"].tolist() if "array.names" in arrays else ()):
        parts = [arrays.get(f"array.{k}.{part}", np.zeros(0)) for part in PARTS]
        values, rows, columns, row_units, column_units = parts
        if (
            values.ndim != 2
            or values.shape != (len(rows), len(columns))
            or [len(x) for x in parts[3:]] != [*values.shape]
        ):
            raise InputError(f"the table '{name}' has not the rows and columns that it names")
        units = [[_unit(str(text)) for text in own] for own in (row_units, column_units)]
        tables[str(name)] = LabelledArray(values, rows.tolist(), columns.tolist(), *units)
    return tables


def dataframe(
    data: Mapping[str, Any] | Sequence[Any] | NDArray[Any], columns: Sequence[str] | None = None
) -> DataFrame:
    """Return a table of pandas; see ``pandas.DataFrame``."""
    try:
        pandas = import_module("pandas")
    except ImportError:
        raise InputError("pandas is not installed", hint="pip install 'pinarm[table]'") from None
    table: DataFrame = pandas.DataFrame(data, columns=columns)
    return table

"""Which values of cases are numbers that may differ among cases that are solved together."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.input.units import unit
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.use.cases.case import Case, Value
from pinarm.use.cases.case_table import CaseTable, Column, SomeCases

ARGUMENT = "arguments."
"""What begins paths to arguments of the model."""

PRESCRIBED = tuple(f"problem.{key}." for key in ("motion", "time", "over", "hold", "velocity", "acceleration"))
"""What begins paths to numbers of laws, and of the rows at which they are looked at."""

INITIAL = "problem.initial."
"""What begins paths to numbers of initial states."""

COLUMNS = (ARGUMENT, *PRESCRIBED, INITIAL)
"""What begins paths to numbers that may differ from case to case."""

Kind = tuple[tuple[str, Value], ...] | None
"""What cases have in common that may be solved together; ``None`` of one that varies none of ``COLUMNS``."""


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
    found = dict[Kind, list[int]]()
    for place, case in enumerate(cases):
        found.setdefault(kind_of(case), []).append(place)
    return {kind: np.array(places) for kind, places in found.items()}


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

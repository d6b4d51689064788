"""Which values of cases are numbers that may differ among cases that are solved together."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from pinarm.input.units import unit
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.use.cases.case import Case, Value

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


def moving(values: Case) -> dict[str, Value]:
    """Return the values that say how a case moves: those of laws, rows and initial states."""
    return {path: value for path, value in values.items() if path.startswith(COLUMNS[1:])}


def column_of(first: Value, values: Sequence[Value]) -> list[float]:
    """Return numbers [SI], given as a scenario has them; the first says their unit.

    Raises:
        VariantsDiffer: They are not all numbers with the unit of the first.
    """
    if not isinstance(first, str):
        if any(isinstance(value, str | bool) for value in values):
            raise VariantsDiffer("numbers with and without a unit")
        return [float(value) for value in values]
    measured = first.partition(" ")[2]
    factor, ending = unit(measured).factor if measured else 1.0, f" {measured}" if measured else ""
    texts = [value for value in values if isinstance(value, str) and value.endswith(ending)]
    if len(texts) < len(values):
        raise VariantsDiffer("several units")
    try:
        return [float(text.removesuffix(ending)) * factor for text in texts]
    except ValueError:
        raise VariantsDiffer("values that are no plain numbers") from None

"""Which values of cases are numbers that may differ among cases that are solved together."""

from __future__ import annotations

from collections.abc import Mapping

from pinarm.use.study.sweep.axes import Value

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


def kind_of(values: Mapping[str, Value]) -> Kind:
    """Return the kind of a case: its values but for those of ``COLUMNS``."""
    kept = tuple((path, "" if _is_column(path) else value) for path, value in values.items())
    return kept if any(map(_is_column, values)) else None


def _is_column(path: str) -> bool:
    """Whether numbers at a path may differ from case to case: those of rows may not, which arrays have in common."""
    return path.startswith(COLUMNS) and not path.endswith(".samples")


def moving(values: Mapping[str, Value]) -> dict[str, Value]:
    """Return the values that say how a case moves: those of laws, rows and initial states."""
    return {path: value for path, value in values.items() if path.startswith(COLUMNS[1:])}

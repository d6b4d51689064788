"""Table with a line per case of a sweep, or motion of a batch: CSV, arrays, pandas, statistics, failures."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pinarm.engine.labelled_array import dataframe
from pinarm.engine.series import Series
from pinarm.errors import InputError, choices, require_name
from pinarm.input.numbers import DECIMAL
from pinarm.use.result.presentation import Presentation
from pinarm.use.store.files import cell, write_arrays, write_parts

if TYPE_CHECKING:
    from pathlib import Path

    from pandas import DataFrame

_NUMBER = re.compile(DECIMAL)
NAMED = 12
"""Most columns that the ``repr`` of a table names."""
BLOCK = 10_000
"""Lines whose texts are made at once."""
TEXTS, SHORTEST = 25_000_000, 20
"""Characters that an array of texts may have in all, each as long as the longest; and what is left of each at least."""
QUANTILES = {"5 %": 0.05, "median": 0.5, "95 %": 0.95}


PLAIN = Presentation()


@dataclass(frozen=True, eq=False, repr=False)
class LineTable:
    """Columns with one number, or word, per line.

    Attributes:
        name: Name of the scenario.
        columns: Numbers in SI; NaN where a line failed.
        errors: Line -> why it failed.
        presentation: In which units tables for people are.
        of: What a line is, for headings.
    """

    name: str
    columns: Sequence[Series]
    errors: Mapping[int, str]
    presentation: Presentation = PLAIN
    of: ClassVar[str] = "motion"

    def __len__(self) -> int:
        return len(self.columns[0].values)

    @property
    def given(self) -> list[Series]:
        """Further columns, before the others, in the units that they were given in."""
        return []

    @cached_property
    def table(self) -> dict[str, Series]:
        """All columns by name."""
        return {series.name: series for series in (*self.given, *self.columns)}

    def __repr__(self) -> str:
        """Return its name, how many lines it has, and the first of its columns."""
        failed = f", {len(self.errors)} failed" if self.errors else ""
        names = ", ".join(list(self.table)[:NAMED])
        return f"<{type(self).__name__} of '{self.name}': {len(self)} {self.of}s{failed}; {names}>"

    def __getitem__(self, name: str) -> Series:
        """Return a column by name, such as ``max A_y``.

        Raises:
            InputError: There is none of that name; the message lists those there are.
        """
        require_name(name)
        if name not in self.table:
            expected, hint = choices(name, self.table)
            raise InputError(f"the table has no column '{name}'", expected=expected, hint=hint)
        return self.table[name]

    def written(self) -> list[Series]:
        """Return the columns as tables for people have them: in the units that the scenario chooses."""
        return [*self.given, *map(self.presentation.written, self.columns)]

    def to_dataframe(self) -> DataFrame:
        """Return a pandas table, units in the headings, and why lines failed."""
        columns: dict[str, Any] = {series.label: series.values for series in self.written()}
        return dataframe({**columns, "error": [self.errors.get(line, "") for line in range(len(self))]})

    def csv(self) -> str:
        """Return the table as CSV: number of the line, columns, why it failed; what a line has not is empty."""
        return "".join(csv_lines(self.of, self.written(), self.errors))

    def write(self, folder: Path, name: str) -> None:
        """Write the table as CSV and npz."""
        lines = csv_lines(self.of, self.written(), self.errors)
        write_parts(folder / f"{name}.csv", (line.encode() for line in lines))
        write_arrays(folder / f"{name}.npz", arrays(list(self.table.values()), self.errors))

    def summary(self) -> dict[str, Any]:
        """Return statistics of every column over the lines, and why some failed."""
        return {
            "scenario": self.name,
            f"{self.of}s": len(self),
            "failed": len(self.errors),
            "columns": {series.name: statistics(series) for series in self.columns},
            "failures": failures(self.errors),
        }

    def _repr_html_(self) -> str:
        """Return the statistics, for notebooks."""
        from pinarm.use.show.notebook import blocks, heading, lines, table

        summary = self.summary()
        failed = [f"failed: {failure['reason']} ({failure['cases']})" for failure in summary["failures"]]
        rows = statistics_rows(self.of, summary["columns"])
        return blocks(heading(f"{self.name}, {len(self)} {self.of}s"), table(rows), lines(failed))


def csv_lines(of: str, columns: Sequence[Series], errors: Mapping[int, str]) -> Iterator[str]:
    """Yield a table as CSV: the number of each line, its columns, and why it failed.

    Numbers have the digits that it takes to read them back; those that are none are empty.

    Args:
        of: What the lines are, for the heading of their numbers.
        columns: At least one, all of one length.
        errors: Line -> why it failed.
    """
    yield ",".join([of, *(cell(series.label) for series in columns), "error"]) + "\n"
    for start in range(0, len(columns[0].values), BLOCK):
        texts = [_texts(series.values[start : start + BLOCK]) for series in columns]
        for number, row in enumerate(zip(*texts, strict=True), start):
            yield ",".join([str(number), *row, cell(errors.get(number, ""))]) + "\n"


def _texts(values: NDArray[Any]) -> list[str]:
    """Return the cells of a column."""
    if values.dtype.kind != "f":
        return [cell(value) if isinstance(value, str) else repr(value) for value in values.tolist()]
    texts = [*map(repr, values.tolist())]
    for row in np.flatnonzero(np.isnan(values)).tolist():
        texts[row] = ""
    return texts


def arrays(columns: Sequence[Series], errors: Mapping[int, str]) -> dict[str, Any]:
    """Return the same as arrays by name, with the units of all; of many lines what failed is cut to ``TEXTS``."""
    n = len(columns[0].values)
    width = max(SHORTEST, TEXTS // max(n, 1))
    shown = {number: _shortened(error, width) for number, error in errors.items()}
    texts = np.zeros(n, f"U{max((len(text) for text in shown.values()), default=1) or 1}")
    for number, text in shown.items():
        texts[number] = text
    units = np.array([[series.name, str(series.unit or "?")] for series in columns])
    return {**{series.name: series.values for series in columns}, "error": texts, "units": units}


def _shortened(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: width - 3]}..."


def statistics(series: Series) -> dict[str, Any]:
    """Return statistics of a column over the lines that have numbers.

    The standard deviation is that of a sample, which one number has not.
    """
    solved = np.flatnonzero(np.isfinite(series.values))
    values = series.values[solved]
    found: dict[str, Any] = {"unit": str(series.unit or "?"), "cases": len(values)}
    if not len(values):
        return found
    low, high = int(values.argmin()), int(values.argmax())
    found |= {"min": values[low], "at_min": int(solved[low]), "max": values[high], "at_max": int(solved[high])}
    exponent = int(np.frexp(np.abs(values).max())[1])  # squares of sizes up to 1 are finite
    scaled = np.ldexp(values, -exponent)
    measures = {"mean": scaled.mean(), **({"deviation": scaled.std(ddof=1)} if len(values) > 1 else {})}
    measures |= {name: np.quantile(scaled, share) for name, share in QUANTILES.items()}
    found |= {name: np.ldexp(x, exponent) for name, x in measures.items()}
    return {name: float(value) if isinstance(value, np.floating) else value for name, value in found.items()}


def statistics_rows(each: str, entries: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    """Return a table of the statistics of columns: a heading, and a row for each.

    Args:
        each: What a line of the columns is, such as ``case``, for the headings.
        entries: Column -> its ``statistics``.
    """
    rows = [["", "unit", "min", f"in {each}", "mean", "deviation", "max", f"in {each}"]]
    for name, entry in entries.items():
        numbers = [entry.get(key) for key in ("min", "at_min", "mean", "deviation", "max", "at_max")]
        rows.append([name[:48], entry["unit"], *("-" if number is None else f"{number:.7g}" for number in numbers)])
    return rows


def failures(errors: Mapping[int, str]) -> list[dict[str, Any]]:
    """Return why lines failed: each reason once, as its first line has it, the most frequent first.

    Reasons that differ in their numbers only count as one.
    """
    reasons: dict[str, list[int]] = {}
    for number, error in errors.items():
        reasons.setdefault(_NUMBER.sub("#", error), []).append(number)
    ordered = sorted(reasons.values(), key=lambda lines: (-len(lines), lines[0]))
    return [{"reason": errors[lines[0]], "cases": len(lines), "first": lines[:10]} for lines in ordered]

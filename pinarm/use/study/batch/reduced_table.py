"""A few numbers of every motion of a batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pinarm.engine.series import Series
from pinarm.errors import InputError, choices, require_name
from pinarm.use.result.presentation import Presentation
from pinarm.use.store import case_columns as columns

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class ReducedTable:
    """A line per motion.

    Attributes:
        name: Name of the scenario.
        columns: The initial values that were given, then the numbers; NaN where a motion failed.
        errors: Motion -> why it could not be followed to its end.
        size: Number of motions.
        presentation: In which units tables for people are.
    """

    name: str
    columns: Sequence[Series] = field(repr=False)
    errors: Mapping[int, str]
    size: int
    presentation: Presentation = field(default_factory=Presentation, repr=False)

    def __len__(self) -> int:
        return self.size

    @cached_property
    def _named(self) -> dict[str, Series]:
        return {series.name: series for series in self.columns}

    def __getitem__(self, name: str) -> Series:
        """Return a column by name, such as ``max A_y``.

        Raises:
            InputError: There is none of that name; the message lists those there are.
        """
        require_name(name)
        if name not in self._named:
            expected, hint = choices(name, self._named)
            raise InputError(f"the table has no column '{name}'", expected=expected, hint=hint)
        return self._named[name]

    def written(self) -> list[Series]:
        """Return the columns as tables for people have them: in the units that the scenario chooses."""
        return [*map(self.presentation.written, self.columns)]

    def to_dataframe(self) -> DataFrame:
        """Return a pandas table, units in the headings, and why motions failed."""
        import pandas

        found: dict[str, Any] = {series.label: series.values for series in self.written()}
        return pandas.DataFrame({**found, "error": [self.errors.get(number, "") for number in range(self.size)]})

    def csv(self) -> str:
        """Return the table as CSV."""
        return columns.csv("motion", self.written(), self.errors)

    def summary(self) -> dict[str, Any]:
        """Return statistics of every column over the motions, and why some failed."""
        return {
            "scenario": self.name, "motions": self.size, "failed": len(self.errors),
            "columns": {series.name: columns.statistics(series) for series in self.columns},
            "failures": columns.failures(self.errors),
        }  # fmt: skip

    def _repr_html_(self) -> str:
        """Return the statistics, for notebooks."""
        from pinarm.use.show.notebook import blocks, heading, lines, table

        summary = self.summary()
        rows = columns.statistics_rows("motion", summary["columns"])
        failed = [f"failed: {failure['reason']} ({failure['cases']})" for failure in summary["failures"]]
        return blocks(heading(f"{self.name}, {len(self)} motions"), table(rows), lines(failed))

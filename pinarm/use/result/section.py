"""A section of a result: what an assessment of the run found, as tables, numbers, remarks and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from pinarm.engine.series import Series
from pinarm.input.units import Unit

if TYPE_CHECKING:
    from pandas import DataFrame

    from pinarm.use.show.plot import Picture

Cell = str | float


@dataclass(frozen=True)
class Table:
    """A table of texts and numbers.

    Attributes:
        name: Of its file, in lower case with underscores.
        title: Its heading, in words.
        columns: Names of the columns.
        units: Their units; ``None`` for texts.
        rows: Texts and numbers [SI], a tuple of one cell per column for each row.
    """

    name: str
    title: str
    columns: Sequence[str]
    units: Sequence[Unit | None]
    rows: Sequence[Sequence[Cell]] = field(repr=False)

    def headings(self) -> list[str]:
        """Return the names of the columns with their units."""
        return [f"{name} [{unit}]" if unit is not None and str(unit) != "1" else name
                for name, unit in zip(self.columns, self.units, strict=True)]  # fmt: skip

    def to_dataframe(self) -> DataFrame:
        """Return it as a pandas table, units in the headings."""
        import pandas

        return pandas.DataFrame(list(self.rows), columns=self.headings())


@dataclass(frozen=True)
class Section:
    """What an assessment found.

    Attributes:
        key: Key of the scenario that asked for it, such as ``shaking``.
        title: Its heading, in words.
        tables: Its tables, the most important one first.
        numbers: Its numbers by name, each a series of one value; ``KEY.NAME`` asks for them elsewhere.
        remarks: What to know, a sentence each.
        pictures: Name -> function that draws the picture.
    """

    key: str
    title: str
    tables: Sequence[Table] = ()
    numbers: Mapping[str, Series] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    pictures: Mapping[str, Callable[[], Picture]] = field(default_factory=dict)

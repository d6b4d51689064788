"""A section of a result: what an assessment of the run found, as tables, numbers, remarks and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from math import isfinite
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from msgspec import field

from pinarm.engine.series import Series
from pinarm.input.units import Unit
from pinarm.records import Record, replace
from pinarm.use.result.measures import SOLVED

if TYPE_CHECKING:
    from pandas import DataFrame

    from pinarm.engine.quantities.names import Quantities
    from pinarm.use.result.curve_figures import CurveFigure

Cell = str | float

Scales = Literal["", "x", "xy"]
"""Axes with logarithmic scales."""


class SectionTable(Record, frozen=True):
    """A table of texts and numbers.

    Attributes:
        name: Of its file, in lower case with underscores.
        title: Its heading, in words.
        columns: Names of the columns.
        units: Their units; ``None`` for texts.
        rows: Texts and numbers [SI], a tuple of one cell per column for each row.
        row_unit: Column of texts that are the unit of the numbers of their row whose columns have none; ``None`` where
            there is no such column.
    """

    unshown = ("rows",)

    name: str
    title: str
    columns: Sequence[str]
    units: Sequence[Unit | None]
    rows: Sequence[Sequence[Cell]]
    row_unit: int | None = None

    def shown(self, units: Mapping[str, Unit]) -> SectionTable:
        """Return the table with its numbers in other units.

        Args:
            units: The unit that numbers are in, as text -> the unit to show them in.
        """
        heads = [None if own is None else units.get(str(own), own) for own in self.units]
        return replace(self, units=heads, rows=[self._row_shown(row, heads, units) for row in self.rows])

    def _row_shown(
        self, row: Sequence[Cell], heads: Sequence[Unit | None], units: Mapping[str, Unit]
    ) -> Sequence[Cell]:
        of_row = None if self.row_unit is None else units.get(str(row[self.row_unit]))
        per_row = 1.0 / of_row.factor if of_row else 1.0
        scales = [
            own.factor / new.factor if own and new else per_row for own, new in zip(self.units, heads, strict=True)
        ]
        shown = [x if isinstance(x, str) or scale == 1.0 else x * scale for x, scale in zip(row, scales, strict=True)]
        return [str(of_row) if of_row and k == self.row_unit else cell for k, cell in enumerate(shown)]

    def cleared(self) -> SectionTable:
        """Return the table with 0 for numbers that are rounding beside the largest of their column.

        Only columns with a unit hold numbers of one kind. Those of errors are left: these are small by right.
        """
        levels = list[float]()
        for unit, name, *cells in zip(self.units, self.columns, *self.rows, strict=True):
            sizes = [abs(x) for x in cells if not isinstance(x, str) and isfinite(x)]
            levels.append(0.0 if unit is None or "error" in name else SOLVED * max(sizes, default=0.0))
        rows = [
            [0.0 if not isinstance(x, str) and abs(x) < least else x for x, least in zip(row, levels, strict=True)]
            for row in self.rows
        ]
        return replace(self, rows=rows)

    def headings(self) -> list[str]:
        """Return the names of the columns with their units."""
        return [
            f"{name} [{unit}]" if unit is not None and str(unit) != "1" else name
            for name, unit in zip(self.columns, self.units, strict=True)
        ]

    def to_dataframe(self) -> DataFrame:
        """Return it as a pandas table, units in the headings."""
        from pinarm.engine.labelled_array import dataframe

        return dataframe(list(self.rows), self.headings())


class Curve(Record, frozen=True):
    """A curve of a graph: one series over another.

    Attributes:
        across: What runs along the horizontal axis.
        up: What runs along the vertical axis.
        label: Its name in the legend; none where it is empty.
        points: Whether its points stand for themselves, and are not joined.
    """

    across: Series
    up: Series
    label: str = ""
    points: bool = False


class Graph(Record, frozen=True):
    """A graph of a section.

    Attributes:
        name: Of its file, in lower case with underscores.
        title: Its heading, in words.
        curves: Its curves; names and units on the axes are those of the first.
        equal: Whether a unit is as long on both axes, as for paths in a plane.
        below: Curves of a second panel over the same horizontal axis, such as the phase below an amplitude.
        logarithmic: Axes with logarithmic scales: ``x``, or ``xy``, of which the second panel has the horizontal one.
        marks: Vertical lines: places on the horizontal axis [SI], and a short text for each.
        bars: Names of horizontal bars from top down, whose lengths are the values along the horizontal axis of its one
            curve; none where it is a graph of curves.
    """

    unshown = ("curves", "below")

    name: str
    title: str
    curves: Sequence[Curve]
    equal: bool = False
    below: Sequence[Curve] = ()
    logarithmic: Scales = ""
    marks: Sequence[tuple[float, str]] = ()
    bars: Sequence[str] = ()


class Numbered(Protocol):
    """Source of a section with numbers of a run: an assessment, or a search for an optimum."""

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        """Return the names of the numbers that its section may have, and their units, with nothing solved.

        Args:
            quantities: Those of one row.

        Raises:
            InputError: It asks for something that does not exist.
        """
        ...


class Section(Record, frozen=True):
    """Findings of an assessment: tables, numbers, remarks and graphs.

    Attributes:
        key: Key of the scenario that asked for it, such as ``shaking``.
        title: Its heading, in words.
        tables: Its tables, the most important one first.
        numbers: Its numbers by name, each a series of one value; ``KEY.NAME`` asks for them elsewhere.
        errors: Quadrature errors of these numbers [SI], by name; 0 where none is given.
        remarks: Remarks, a sentence each.
        graphs: Its graphs.
    """

    key: str
    title: str
    tables: Sequence[SectionTable] = ()
    numbers: Mapping[str, Series] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    graphs: Sequence[Graph] = ()
    errors: Mapping[str, float] = field(default_factory=dict)

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        return {name: series.unit for name, series in self.numbers.items()}

    def shown(self, units: Mapping[str, Unit]) -> Section:
        return replace(self, tables=[table.shown(units) for table in self.tables])

    def bounded(self, bounds: Mapping[str, float]) -> Section:
        """Return the section with bounds of the errors of its numbers [SI], by name: a table of them, and a remark."""
        pairs = [(name, float(self.numbers[name].values[0]), bound) for name, bound in bounds.items()]
        rows = [(name, str(self.numbers[name].unit or "?"), value, bound) for name, value, bound in pairs]
        table = SectionTable("bounds", "Bounds of the errors of its numbers, in 99 of 100 cases",
                             ("", "unit", "value", "error below"), (None,) * 4, rows, row_unit=1)  # fmt: skip
        worst, name = max(((bound / abs(value), name) for name, value, bound in pairs if value), default=(0.0, ""))
        below = f"below {worst:.1e} of themselves in 99 of 100 cases, largest in {name}"
        said = [f"errors of its numbers: {below if isfinite(worst) else f'no bound, as of {name}'}"]
        return replace(self, tables=[*self.tables, table], remarks=[*self.remarks, *(said if name else ())])

    def _repr_html_(self) -> str:
        """Return the first table, remarks and graphs, for notebooks."""
        from pinarm.use.result.presentation import FOR_PEOPLE

        html: str = import_module("pinarm.use.show.text").section_html(self.shown(FOR_PEOPLE))  # above the results
        return html


def numbered(figures: Mapping[str, CurveFigure]) -> dict[str, Any]:
    """Return the fields ``numbers`` and ``errors`` of a section, from figures by name."""
    numbers = {name: Series(name, x.unit, np.array([x.value]), x.doubt) for name, x in figures.items()}
    return {"numbers": numbers, "errors": {name: x.error for name, x in figures.items()}}

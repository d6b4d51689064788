"""Sections of a result as a file, and read back: what was concluded is not computed again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, get_args

import numpy as np

from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.use.result.section import Cell, Curve, Graph, Scales, Section, SectionTable
from pinarm.use.store.files import json_text

SECTIONS = "sections.json"

MOST_BYTES = 200_000_000
"""Of a file of sections that is read: a thousand times those of the longest here."""

ENDLESS = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}
"""Numbers that JSON has no word for, as texts in lists of one."""


def sections_text(sections: Mapping[str, Section]) -> str:
    """Return sections as JSON: numbers with the digits that it takes to read them back."""
    return json_text([_section(section) for section in sections.values()]) + "\n"


def read_sections(path: Path) -> dict[str, Section]:
    """Return the sections in a file, by key; none where there is no such file.

    Raises:
        InputError: The file is damaged.
    """
    import msgspec

    if not path.is_file():
        return {}
    try:
        with open(path, "rb") as stream:
            raw = stream.read(MOST_BYTES + 1)
        if len(raw) > MOST_BYTES:
            raise ValueError(f"it has more than {MOST_BYTES} bytes")
        found = [_section_again(each) for each in msgspec.json.decode(raw)]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise InputError(f"{path} holds no sections of a result ({error})", hint="run the scenario again") from None
    return {section.key: section for section in found}


def _section(section: Section) -> dict[str, Any]:
    return {
        "key": section.key,
        "title": section.title,
        "tables": [_table(table) for table in section.tables],
        "numbers": {name: _series(series) for name, series in section.numbers.items()},
        "remarks": list(section.remarks),
        "graphs": [_graph(graph) for graph in section.graphs],
        "errors": {name: _number(error) for name, error in section.errors.items()},
    }


def _section_again(data: Any) -> Section:
    return Section(
        str(data["key"]),
        str(data["title"]),
        [_table_again(each) for each in data["tables"]],
        {str(name): _series_again(each) for name, each in data["numbers"].items()},
        [str(remark) for remark in data["remarks"]],
        [_graph_again(each) for each in data["graphs"]],
        {str(name): _number_again(each) for name, each in data["errors"].items()},
    )


def _table(table: SectionTable) -> dict[str, Any]:
    rows = [[cell if isinstance(cell, str) else _number(cell) for cell in row] for row in table.rows]
    units = [_unit(unit) for unit in table.units]
    return {"name": table.name, "title": table.title, "columns": list(table.columns), "units": units, "rows": rows,
            "row_unit": table.row_unit}  # fmt: skip


def _table_again(data: Any) -> SectionTable:
    name, columns = str(data["name"]), [str(each) for each in data["columns"]]
    if not name.isidentifier():
        raise ValueError(f"'{name[:40]}' names no table")
    units, rows = [_unit_again(each) for each in data["units"]], [tuple(map(_cell, row)) for row in data["rows"]]
    if any(len(row) != len(columns) for row in (units, *rows)):
        raise ValueError(f"the table '{name}' has rows of different lengths")
    row_unit = data.get("row_unit")
    if row_unit is not None and not (isinstance(row_unit, int) and 0 <= row_unit < len(columns)):
        raise ValueError(f"the table '{name}' has no column {row_unit!r}")
    return SectionTable(name, str(data["title"]), columns, units, rows, row_unit)


def _cell(data: Any) -> Cell:
    return data if isinstance(data, str) else _number_again(data)


def _graph(graph: Graph) -> dict[str, Any]:
    plain = {"name": graph.name, "title": graph.title, "curves": _curves(graph.curves), "equal": graph.equal}
    marks = [[_number(place), text] for place, text in graph.marks]
    return {
        **plain,
        "below": _curves(graph.below),
        "logarithmic": graph.logarithmic,
        "marks": marks,
        "bars": [*graph.bars],
    }


def _curves(curves: Sequence[Curve]) -> list[dict[str, Any]]:
    return [
        {"across": _series(curve.across), "up": _series(curve.up), "label": curve.label, "points": curve.points}
        for curve in curves
    ]


def _graph_again(data: Any) -> Graph:
    name, scales = str(data["name"]), data.get("logarithmic", "")
    if not name.isidentifier() or scales not in get_args(Scales):
        raise ValueError(f"'{name[:40]}' names no graph")
    marks = [(_number_again(place), str(text)) for place, text in data.get("marks", ())]
    curves, below = (_curves_again(data.get(key, ())) for key in ("curves", "below"))
    return Graph(
        name,
        str(data["title"]),
        curves,
        bool(data["equal"]),
        below,
        scales,
        marks,
        [str(name) for name in data.get("bars", ())],
    )


def _curves_again(data: Any) -> list[Curve]:
    return [
        Curve(_series_again(each["across"]), _series_again(each["up"]), str(each["label"]), bool(each["points"]))
        for each in data
    ]


def _series(series: Series) -> dict[str, Any]:
    values = [_number(value) for value in np.asarray(series.values, float).tolist()]
    return {"name": series.name, "unit": _unit(series.unit), "values": values, "doubt": series.doubt}


def _series_again(data: Any) -> Series:
    values = np.array([_number_again(each) for each in data["values"]], float)
    return Series(str(data["name"]), _unit_again(data["unit"]), values, str(data["doubt"]))


def _number(value: float) -> float | list[str]:
    return float(value) if math.isfinite(value) else [str(float(value))]


def _number_again(data: float | Sequence[str]) -> float:
    return ENDLESS[data[0]] if isinstance(data, list) else float(data)  # type: ignore[arg-type]


def _unit(unit: Unit | None) -> dict[str, Any] | None:
    if unit is None:
        return None
    return {"factor": unit.factor, "dimension": [str(each) for each in unit.dimension], "text": unit.text}


def _unit_again(data: Any) -> Unit | None:
    if data is None:
        return None
    metres, kilograms, seconds, amperes, *_ = (*map(Fraction, data["dimension"]), Fraction(0))  # some have three
    return Unit(float(data["factor"]), (metres, kilograms, seconds, amperes), str(data["text"]))

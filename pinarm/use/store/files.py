"""Contents of files of results, the same bytes for the same content; sections of a result as a file, and read back.

Conclusions of sections are not computed again.
"""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cache
from itertools import chain
from pathlib import Path
from typing import IO, Any, get_args

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.records import Record
from pinarm.use.output import no_text
from pinarm.use.result.presentation import CsvForm
from pinarm.use.result.section import Curve, Graph, Scales, Section, SectionTable


def write(path: Path, content: str | Iterable[bytes]) -> None:
    """Write a new file, of a text or piece by piece; what appears whole is its folder (``whole_folder``)."""
    with open(path, "xb") as stream:
        stream.writelines([content.encode()] if isinstance(content, str) else content)


def write_arrays(target: Path | IO[bytes], arrays: dict[str, Any]) -> None:
    """Write a new npz file, or one into a stream, whose bytes depend on the arrays only; any name will do."""
    with zipfile.ZipFile(target, "x") as archive:
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, array, allow_pickle=False)


def yaml_text(data: Any) -> str:
    """Return plain data as YAML, its keys in the order they have; every reader takes its texts for text.

    Raises:
        InputError: A text is none in Unicode, such as the name of a folder that is not UTF-8.
    """
    import yaml

    try:
        return str(yaml.dump(data, Dumper=_dumper(), sort_keys=False, allow_unicode=True, width=WIDTH))
    except UnicodeEncodeError as error:
        raise no_text(error) from None


@cache
def _dumper() -> Any:
    import yaml

    class Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
        """PyYAML knows YAML 1.1; this puts what later versions and other readers take for a number in quotes too."""

        ignore_aliases = staticmethod(lambda data: True)

    Dumper.add_implicit_resolver("!else", re.compile(SOMETHING_ELSE, re.IGNORECASE), None)
    return Dumper


WIDTH = 10**9
"""Lines are not folded."""

SOMETHING_ELSE = r"([-+]?\.?[0-9][\w.+-]*|y|n)$"
"""Text that some reader of YAML takes for a number or a truth value."""


MARKS: Mapping[CsvForm, tuple[str, str]] = {"commas": (",", "."), "semicolons": (";", ",")}
"""Key ``csv`` of a scenario -> what stands between cells, and the decimal mark."""


def csv_lines(
    headings: Sequence[str], blocks: Iterable[Array | Iterable[Sequence[str | float]]], form: CsvForm = "commas"
) -> Iterator[bytes]:
    """Yield a table as CSV, piece by piece: headings, then every number with as many digits as it needs.

    Read again the numbers are the same to the last bit. Text that a spreadsheet would take for a formula gets an
    apostrophe before it.

    Args:
        headings: Names of the columns, with units.
        blocks: Rows of texts and numbers, in arrays where all are numbers.
        form: How cells are separated.
    """
    between, mark = MARKS[form]

    def cell(x: str | float) -> str:
        if not isinstance(x, str):
            return repr(x).replace(".", mark)
        safe = f"'{x}" if x.startswith(("=", "+", "-", "@", "\t", "\r")) else x
        return '"' + safe.replace('"', '""') + '"' if any(sign in safe for sign in f'{between}"\n\r') else safe

    for block in chain([[headings]], blocks):
        if isinstance(block, np.ndarray) and np.isfinite(block).all():  # eight times as fast as Python's own
            lines = msgspec.json.encode(block.tolist())[2:-2].replace(b"],[", b"\n") + b"\n"
            yield lines if form == "commas" else lines.replace(b",", b";").replace(b".", b",")
        else:
            rows = block.tolist() if isinstance(block, np.ndarray) else block
            yield "".join(between.join(map(cell, row)) + "\n" for row in rows).encode()


def json_text(value: object) -> str:
    """Return plain data as JSON; numbers that are not finite become null, which JSON has a word for."""
    return json.dumps(_finite(value), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)


SECTIONS = "sections.json"

MOST_BYTES = 200_000_000
"""Largest file of sections that is read: a thousand times the longest here."""

ENDLESS = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}
"""Numbers that JSON has no word for, as texts in lists of one."""


def sections_text(sections: Mapping[str, Section]) -> str:
    """Return sections as JSON: numbers with the digits that it takes to read them back."""
    return json_text([_plain(section) for section in sections.values()]) + "\n"


def _plain(value: Any) -> Any:
    """Return a section, or a part of it, as plain data: maps of the fields of its records."""
    if isinstance(value, Unit):
        return {"factor": value.factor, "dimension": [str(power) for power in value.dimension], "text": value.text}
    if isinstance(value, Series):
        values = [_plain(number) for number in np.asarray(value.values, float).tolist()]
        return {"name": value.name, "unit": _plain(value.unit), "values": values, "doubt": value.doubt}
    if isinstance(value, Record):
        return {name: _plain(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, Mapping):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, str | bool | int) or value is None:
        return value
    if isinstance(value, Sequence):
        return [_plain(inner) for inner in value]
    return float(value) if math.isfinite(value) else [str(float(value))]


def read_sections(path: Path) -> dict[str, Section]:
    """Return the sections in a file, by key; none where there is no such file.

    Raises:
        InputError: The file is damaged.
    """
    import msgspec

    if not path.is_file():
        return {}
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"it has more than {MOST_BYTES} bytes")
        sections = [_section(data) for data in msgspec.json.decode(path.read_bytes())]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise InputError(f"{path} holds no sections of a result ({error})", hint="run the scenario again") from None
    return {section.key: section for section in sections}


def _section(data: Any) -> Section:
    return Section(
        str(data["key"]),
        str(data["title"]),
        [*map(_table, data["tables"])],
        {str(name): _series(series) for name, series in data["numbers"].items()},
        [*map(str, data["remarks"])],
        [*map(_graph, data["graphs"])],
        {str(name): _number(error) for name, error in data["errors"].items()},
    )


def _table(data: Any) -> SectionTable:
    name, columns, units = _name(data), [*map(str, data["columns"])], [*map(_unit, data["units"])]
    rows = [tuple(cell if isinstance(cell, str) else _number(cell) for cell in row) for row in data["rows"]]
    if any(len(row) != len(columns) for row in (units, *rows)):
        raise ValueError(f"the table '{name}' has rows of different lengths")
    row_unit = data.get("row_unit")
    if row_unit is not None and not (isinstance(row_unit, int) and 0 <= row_unit < len(columns)):
        raise ValueError(f"the table '{name}' has no column {row_unit!r}")
    return SectionTable(name, str(data["title"]), columns, units, rows, row_unit)


def _name(data: Any) -> str:
    """Return the name of a table or a graph, which becomes that of its file."""
    name = str(data["name"])
    if not name.isidentifier():
        raise ValueError(f"'{name[:40]}' names no table or graph")
    return name


def _graph(data: Any) -> Graph:
    scales = data.get("logarithmic", "")
    if scales not in get_args(Scales):
        raise ValueError(f"a graph has the scales {str(scales)[:40]}")
    curves, below = (
        [Curve(_series(x["across"]), _series(x["up"]), str(x["label"]), bool(x["points"])) for x in data.get(key, ())]
        for key in ("curves", "below")
    )
    marks = [(_number(place), str(text)) for place, text in data.get("marks", ())]
    bars = [*map(str, data.get("bars", ()))]
    return Graph(_name(data), str(data["title"]), curves, bool(data["equal"]), below, scales, marks, bars)


def _series(data: Any) -> Series:
    values = np.array([*map(_number, data["values"])], float)
    return Series(str(data["name"]), _unit(data["unit"]), values, str(data["doubt"]))


def _number(value: Any) -> float:
    return ENDLESS[value[0]] if isinstance(value, list) else float(value)


def _unit(data: Any) -> Unit | None:
    if data is None:
        return None
    metres, kilograms, seconds, amperes, *_ = (*map(Fraction, data["dimension"]), Fraction(0))  # some have three
    return Unit(float(data["factor"]), (metres, kilograms, seconds, amperes), str(data["text"]))

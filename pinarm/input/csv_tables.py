"""Tables in CSV files: a heading with names and units, then numbers.

One row a line; a quote that is not closed is an error, not the end of the table.
"""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TypeAlias

from pinarm.errors import InputError, Location, PinarmError, choices
from pinarm.input.roots import Stamp, similar_file, stamp_of
from pinarm.input.units import Unit, decimal, unit
from pinarm.input.yaml.schema import LARGEST
from pinarm.records import Record

MAX_BYTES = 50_000_000
"""Largest size of a table: about 1.5 million rows, read in 4 s."""

SEPARATORS = {";": "semicolons", "\t": "tabs"}
"""Separators of cells in other programs' tables, and their names."""

Row = tuple[int, list[str]]
"""The number of a line, and its cells."""


def table(path: Path, source: str) -> tuple[list[str], Iterator[Row]]:
    """Return the heading of a CSV file, and its rows with the numbers of their lines; see ``rows``."""
    lines = rows(path, source)
    line, heads = next(lines, (1, []))
    if heads and heads[0].lstrip().startswith("#") and "[" not in "".join(heads):
        raise in_line(
            source, line, heads, "the first line is a comment, which tables do not have", "a heading", "remove the line"
        )
    for mark, name in SEPARATORS.items():
        if len(heads) == 1 and mark in heads[0]:
            raise in_line(source, line, heads, f"the cells of this table are separated by {name}",
                          "commas between cells, decimal points in numbers")  # fmt: skip
    return heads, _fitting(lines, len(heads), source)


def _fitting(lines: Iterator[Row], width: int, source: str) -> Iterator[Row]:
    for line, row in lines:
        if any(cell.strip() for cell in row[width:]):
            raise in_line(
                source, line, row, f"the row has {len(row)} cells, the heading {width}", "numbers with a decimal point"
            )
        yield line, row


def in_line(
    source: str, line: int, row: Sequence[str], message: str, expected: str = "", hint: str = ""
) -> PinarmError:
    """Return an error at a line of a table, with the cells of that line."""
    return InputError(message, expected=expected, hint=hint).at(Location(source, line, 1, ",".join(row)))


def rows(path: Path, source: str) -> Iterator[Row]:
    """Yield the rows of a CSV file that are not empty, with the numbers of their lines; messages call it ``source``."""
    last = 0
    try:
        if path.exists() and not path.is_file():  # a pipe would keep the reader waiting
            raise OSError(0, "it is not a regular file")
        with open(path, newline="", encoding="utf-8-sig") as stream:
            if path.stat().st_size > MAX_BYTES:
                raise InputError("the table is too large", expected=f"at most {MAX_BYTES} bytes").at(Location(source))
            reader = csv.reader(stream, strict=True)
            for row in reader:
                if reader.line_num > last + 1:
                    raise _unclosed(source, last + 1)
                last += 1
                if len(row) > 1 or (row and row[0].strip()):
                    yield last, row
    except csv.Error as error:
        if "unexpected end" in str(error):
            raise _unclosed(source, last + 1) from None
        raise in_line(
            source, last + 1, (), f"this is not CSV ({error})", "cells separated by commas, a row a line"
        ) from None
    except FileNotFoundError:
        problem = InputError(f"there is no file {path}", hint=similar_file(path))
        raise problem.at(Location(source)) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"the table cannot be read as UTF-8 text ({reason})").at(Location(source)) from None


def _unclosed(source: str, line: int) -> PinarmError:
    message = "a quote is not closed in this line: the rows below it would be part of the cell"
    expected = 'a row a line; a quote within a quoted cell is written twice: "5"" pipe"'
    return in_line(source, line, (), message, expected)


def split_heading(cell: str) -> tuple[str, str | None] | None:
    """Return the name and the unit of a heading such as ``theta [deg]``, the unit ``None`` without brackets.

    Returns:
        ``None`` where the cell is no heading: its brackets are not one pair at its end.
    """
    name, opened, rest = cell.strip().partition("[")
    unit, closed, after = rest.partition("]")
    if "]" in name or "[" in unit or after or bool(opened) != bool(closed):
        return None
    return name.strip(), unit if opened else None


Column: TypeAlias = "array[float]"


class MotionTable(Record, frozen=True):
    """Two columns of a CSV file: values over instants or over a coordinate.

    Attributes:
        columns: Instants or values of the coordinate, and the values, in SI.
    """

    heading: str
    columns: tuple[Column, Column]
    units: tuple[Unit, Unit]


def read_table(path: Path, column: str | None, *, jumps: bool = False) -> MotionTable:
    """Read the first column of a CSV file and one more; a file that has not changed is not read again.

    Args:
        path: An absolute path that may be read.
        column: Name in the heading of the other column; ``None`` for the second, if it alone has a unit.
        jumps: Whether two rows may have the same value in the first column.
    """
    return _table(path, column, jumps, stamp_of(path.stat()))


@lru_cache(maxsize=64)
def _table(path: Path, column: str | None, jumps: bool, stamp: Stamp) -> MotionTable:
    file = path.name
    heads, below = table(path, file)
    if len(heads) < 2:
        raise _too_short(file)
    place = _place(heads, column, file)
    along, measured = (_unit(heads, k, file) for k in (0, place))
    first, second = array("d"), array("d")  # a quarter of the memory of lists
    for line, row in below:
        t, value = (_number(row, k, heads[k], file, line) for k in (0, place))
        if first and not (t * along.factor > first[-1] or (jumps and t * along.factor == first[-1])):
            raise in_line(file, line, row, "the first column does not increase", "each larger than the one before")
        first.append(t * along.factor)
        second.append(value * measured.factor)
    if len(first) < 2:
        raise _too_short(file)
    return MotionTable(_name(heads[place]), (first, second), (along, measured))


def _place(heads: list[str], column: str | None, file: str) -> int:
    """Return the place of the column with a name, or of the only one with a unit beside the first."""
    names = {place: _name(head) for place, head in enumerate(heads) if place}
    if column is None:
        measured = [
            place for place in names if place > 1 and (split_heading(heads[place]) or ("", None))[1] is not None
        ]
        fitting, said = [1, *measured], f"the table {file} has several columns"
    else:
        fitting = [place for place, name in names.items() if name == column]
        said = f"the table {file} has {'several columns' if fitting else 'no column'} '{column}'"
    if len(fitting) == 1:
        return fitting[0]
    expected, hint = choices(column or "", [name for name in names.values() if name])
    raise in_line(file, 1, heads, said, f"column: {expected}", hint)


def _name(head: str) -> str:
    heading = split_heading(head)
    return heading[0] if heading else head.strip()


def read_columns(path: Path, names: Collection[str]) -> dict[str, Column]:
    """Read columns of a CSV file: headings as they are written, each with its numbers as they are written.

    Args:
        path: An absolute path that may be read.
        names: Names in the headings of the columns that are read; others may hold anything, and come without numbers.
    """
    return _columns(path, frozenset(names), stamp_of(path.stat()))


@lru_cache(maxsize=8)
def _columns(path: Path, names: frozenset[str], stamp: Stamp) -> dict[str, Column]:
    file = path.name
    heads, below = table(path, file)
    heads = [head.strip() for head in heads]
    places = [place for place, head in enumerate(heads) if _name(head) in names]
    read = [heads[place] for place in places]
    if twice := [head for head in read if read.count(head) > 1]:
        raise in_line(file, 1, heads, f"two columns have the heading '{twice[0]}'", "a heading of its own for each")
    numbers = [array("d") for _ in places]
    for line, row in below:
        for column, place in zip(numbers, places, strict=True):
            column.append(_number(row, place, heads[place], file, line))
    if numbers and not numbers[0]:
        raise _too_short(file)
    return {**dict.fromkeys(heads, array("d")), **dict(zip(read, numbers, strict=True))}


def measured_columns(path: Path, units: Mapping[str, str], needed: Collection[str] = ()) -> dict[str, list[float]]:
    """Return the columns of a CSV file that are known, in SI, by name.

    Args:
        path: The file, which may be read.
        units: Names of known columns -> a unit of their quantity; empty for numbers without one.
        needed: Names that the table must have.

    Raises:
        InputError: None is there, one that is needed is missing, or a heading has no unit of its quantity.
    """
    heads = {_name(head): head.strip() for head in table(path, path.name)[0]}
    for name in needed if units.keys() & heads.keys() else [*needed, *units][:1]:
        if name not in heads:
            expected, hint = choices(name, heads)
            known = {**dict.fromkeys(needed, ""), **units}.items()
            named = f"the columns {', '.join(f'{key} [{of}]' if of else key for key, of in known)}"
            message = f"the table {path.name} has no column '{name}', but {expected}"
            raise InputError(message, expected=named, hint=hint).at(Location(path.name, 1))
    factors = dict[str, float]()
    for name in units.keys() & heads.keys():
        written = (split_heading(heads[name]) or ("", None))[1]
        if units[name] and (written is None or unit(written).dimension != unit(units[name]).dimension):
            error = InputError(
                f"the heading '{heads[name]}' has no unit of this quantity", expected=f"{name} [{units[name]}]"
            )
            raise error.at(Location(path.name, 1, 1, heads[name]))
        factors[name] = unit(written).factor if written and units[name] else 1.0
    columns = read_columns(path, units)
    return {name: [factor * x for x in columns[heads[name]]] for name, factor in factors.items()}


def _too_short(file: str) -> InputError:
    expected = "a heading and at least two rows of two columns, separated by commas"
    return InputError(f"the table {file} is too short", expected=expected)


def _unit(heads: list[str], place: int, file: str) -> Unit:
    heading = split_heading(heads[place])
    if heading and heading[1] is not None:
        return unit(heading[1])
    message = f"the heading '{heads[place]}' has no unit"
    raise in_line(file, 1, heads[place : place + 1], message, "such as t [s] and theta [deg]")


def _number(row: list[str], column: int, heading: str, file: str, line: int) -> float:
    try:
        number = decimal(row[column])
    except (ValueError, IndexError):
        number = math.nan
    if abs(number) <= LARGEST:
        return number
    if not math.isfinite(number):
        raise in_line(file, line, row, "a finite number is missing", f"one in the column {heading.strip()}")
    raise in_line(file, line, row, f"{number:g} is out of bounds", f"a size of at most {LARGEST:g}")

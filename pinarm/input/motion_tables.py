"""Tables of motion in CSV files: a heading with names and units, then numbers."""

from __future__ import annotations

import math
from array import array
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TypeAlias

from pinarm.errors import InputError, choices
from pinarm.input.csv_rows import in_line, split_heading, table
from pinarm.input.numbers import decimal
from pinarm.input.roots import Stamp
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import LARGEST
from pinarm.records import Record

Column: TypeAlias = "array[float]"


class MotionTable(Record, frozen=True):
    """Two columns of a CSV file: values over instants or over a coordinate.

    Attributes:
        heading: Name in the heading of the values.
        columns: Instants or values of the coordinate, and the values, in SI.
        units: In which they are written.
    """

    heading: str
    columns: tuple[Column, Column]
    units: tuple[Unit, Unit]


@lru_cache(maxsize=64)
def read_table(name: str, column: str | None, stamp: Stamp) -> MotionTable:
    """Read the first column of a CSV file and one more.

    Args:
        name: The file, as an absolute path that may be read.
        column: Name in the heading of the other column; ``None`` for the second, if it alone has a unit.
        stamp: Of the file; part of the cache key, so that a changed file is read again.

    Raises:
        InputError: The file cannot be read, has no heading, a cell is not a finite number or lies beyond the heading,
            the first column does not increase, or it is not clear which column is meant; located at the line.
    """
    file = Path(name).name
    heads, below = table(Path(name), file)
    if len(heads) < 2:
        raise _too_short(file)
    place = _place(heads, column, file)
    along, measured = (_unit(heads, k, file) for k in (0, place))
    first, second = array("d"), array("d")  # a quarter of the memory of lists
    for line, row in below:
        t, value = (_number(row, k, heads[k], file, line) for k in (0, place))
        if first and not t * along.factor > first[-1]:
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
        measured = {place for place in names if (split_heading(heads[place]) or ("", None))[1] is not None}
        fitting = [1, *sorted(measured - {1})]
        said = f"the table {file} has several columns"
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


def read_headings(name: str) -> list[str]:
    """Return the headings of a CSV file as they are written; its rows are not read."""
    return [head.strip() for head in table(Path(name), Path(name).name)[0]]


@lru_cache(maxsize=8)
def read_columns(
    name: str, names: frozenset[str], stamp: tuple[int, int], most: int | None = None
) -> dict[str, Column]:
    """Read columns of a CSV file: headings as they are written, each with its numbers as they are written.

    Args:
        name: The file, as an absolute path that may be read.
        names: Names in the headings of the columns that are read; others may hold anything, and come without numbers.
        stamp: Time and size of the file; part of the cache key, so that a changed file is read again.
        most: How many rows to read; all where it is ``None``.

    Raises:
        InputError: The file cannot be read, two headings are the same, or a cell is not a finite number; located at
            the line.
    """
    file = Path(name).name
    heads, below = table(Path(name), file)
    heads = [head.strip() for head in heads]
    places = [place for place, head in enumerate(heads) if _name(head) in names]
    read = [heads[place] for place in places]
    if twice := [head for head in read if read.count(head) > 1]:
        raise in_line(file, 1, heads, f"two columns have the heading '{twice[0]}'", "a heading of its own for each")
    numbers = [array("d") for _ in places]
    for line, row in islice(below, most):
        for column, place in zip(numbers, places, strict=True):
            column.append(_number(row, place, heads[place], file, line))
    if not (numbers and numbers[0]):
        raise _too_short(file)
    return {**dict.fromkeys(heads, array("d")), **dict(zip(read, numbers, strict=True))}


def _too_short(file: str) -> InputError:
    return InputError(
        f"the table {file} is too short",
        expected="a heading and at least two rows of two columns, separated by commas",
    )


def _unit(heads: list[str], place: int, file: str) -> Unit:
    heading = split_heading(heads[place])
    if heading and heading[1] is not None:
        return unit(heading[1])
    raise in_line(
        file, 1, heads[place : place + 1], f"the heading '{heads[place]}' has no unit", "such as t [s] and theta [deg]"
    )


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

"""Tables of motion in CSV files: a heading with names and units, then numbers."""

from __future__ import annotations

import csv
import math
import re
from functools import lru_cache
from pathlib import Path

from pinarm.errors import InputError, Location
from pinarm.input.units import Unit, unit

MAX_BYTES = 50_000_000
"""Largest size of a table: about 1.5 million rows, read in 4 s."""
_HEADING = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*")


Column = tuple[float, ...]


@lru_cache(maxsize=64)
def read_table(name: str, stamp: tuple[int, int]) -> tuple[Column, Column, Unit, Unit]:
    """Read the first two columns of a CSV file, values over instants or over a coordinate.

    Args:
        name: The file, as an absolute path that may be read.
        stamp: Time and size of the file; part of the cache key, so that a changed file is read again.

    Returns:
        Both columns in SI, and their units.

    Raises:
        InputError: The file cannot be read, has no heading, a cell is not a finite number or lies beyond the heading,
            or the first column does not increase; located at the line.
    """
    path = Path(name)
    file = path.name
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"the table {file} is too large", expected=f"at most {MAX_BYTES} bytes")
    try:
        with open(path, newline="", encoding="utf-8-sig") as stream:
            rows = list(csv.reader(stream))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"the table {file} is not CSV text ({error})") from None
    if len(rows) < 3 or len(rows[0]) < 2:
        raise InputError(
            f"the table {file} is too short",
            expected="a heading and at least two rows of two columns, separated by commas",
        )
    (along, measured), numbers = (_unit(cell, file) for cell in rows[0][:2]), []
    for line, row in enumerate(rows[1:], start=2):
        if row:
            if any(cell.strip() for cell in row[len(rows[0]) :]):
                raise InputError(
                    f"the row has {len(row)} cells, the heading {len(rows[0])}", expected="numbers with a decimal point"
                ).at(Location(file, line, 1, ",".join(row)))
            t, value = (_number(row, column, file, line) for column in (0, 1))
            numbers.append((t * along.factor, value * measured.factor))
            if len(numbers) > 1 and not numbers[-1][0] > numbers[-2][0]:
                raise InputError("the first column does not increase", expected="each larger than the one before").at(
                    Location(file, line, 1, ",".join(row))
                )
    if len(numbers) < 2:
        raise InputError(f"the table {file} is too short", expected="at least two rows of numbers")
    return tuple(t for t, _ in numbers), tuple(value for _, value in numbers), along, measured


def _unit(cell: str, file: str) -> Unit:
    match = _HEADING.fullmatch(cell)
    try:
        float(cell)
    except ValueError:
        if match and match["unit"] is not None:
            return unit(match["unit"])
    raise InputError(f"the heading '{cell}' has no unit", expected="such as t [s] and theta [deg]").at(
        Location(file, 1, 1, cell)
    )


def _number(row: list[str], column: int, file: str, line: int) -> float:
    try:
        number = float(row[column])
    except (ValueError, IndexError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError("a finite number is missing", expected="two numbers").at(
            Location(file, line, 1, ",".join(row))
        )
    return number

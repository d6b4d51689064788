"""Strict reader of CSV files: one row a line; a quote that is not closed is an error, not the end of the table."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

from pinarm.errors import InputError, Location, PinarmError
from pinarm.input.roots import similar_file

MAX_BYTES = 50_000_000
"""Largest size of a table: about 1.5 million rows, read in 4 s."""

SEPARATORS = {";": "semicolons", "\t": "tabs"}
"""Separators of cells in other programs' tables, and their names."""

Row = tuple[int, list[str]]
"""The number of a line, and its cells."""


def table(path: Path, source: str) -> tuple[list[str], Iterator[Row]]:
    """Return the heading of a CSV file, and its rows with the numbers of their lines; see ``rows``.

    Raises:
        InputError: The cells are separated by something else than commas, a comment stands above them, or a row has
            more cells than the heading, as where numbers have decimal commas; located at the line.
    """
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
    """Yield the rows of a CSV file that are not empty, with the numbers of their lines; messages call it ``source``.

    Raises:
        InputError: It is no regular file, too large, not UTF-8, a quote is not closed, or a cell goes over several
            lines; located at the line.
    """
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

"""Values in many rows at once: an expansion whose arguments are columns of numbers.

Arithmetic with a column gives a column, row by row. In text a column is a mark, ``__column_3__``, which no file of the
model contains. Every decision by a column (a branch, a comparison, whether a text is a number) is that of its first
row; rows that decide otherwise are no longer held. What cannot be expanded so raises ``NotByRows``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import repeat
from typing import Any

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.errors import ModelError

MARK = "__column_"
"""Begin of all marks; an expression takes a mark for a name."""
_MARK = re.compile(f"{MARK}([0-9]+)__")

EXACT: dict[str, Callable[..., Any]] = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}
"""The four operations of IEEE 754, which arrays and single numbers take bit by bit alike."""


class NotByRows(ModelError):
    """A model that depends on a number in a way that is not followed for many rows."""

    def __init__(self) -> None:
        super().__init__("what the model is depends on a number in a way that is not followed")


def column(values: Iterable[Any]) -> Array:
    """Return values in the rows of a table: floats, or objects where some are others."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return values
    rows = list(values)
    filled: Array = np.empty(len(rows), dtype=float if {*map(type, rows)} == {float} else object)
    filled[:] = rows
    return filled


def require_unmarked(text: str) -> str:
    """Return a text that does not depend on a column."""
    if MARK in text:
        raise NotByRows
    return text


class Column:
    """A value of an expansion in all rows; its text is a mark, its truth a decision."""

    def __init__(self, rows: Rows, values: Array) -> None:
        self.rows, self.values, self.place = rows, values, -1

    def __str__(self) -> str:
        if self.place < 0:
            self.place = len(self.rows.marked)
            self.rows.marked.append(self)
        return f"{MARK}{self.place}__"

    def __bool__(self) -> bool:
        return self.rows.decided(self.values.astype(bool))


class Rows:
    """The rows of an expansion.

    Attributes:
        holds: Rows that take all decisions as the first one does, shape (count,).
    """

    def __init__(self, count: int) -> None:
        self.holds: Flags = np.ones(count, dtype=bool)
        self.marked: list[Column] = []

    def decided(self, outcomes: Flags) -> bool:
        """Return the outcome of the first row, and drop rows that have another."""
        self.holds &= outcomes == outcomes[0]
        return bool(outcomes[0])

    def applied(self, function: Callable[..., Any], operands: Sequence[Any], name: str = "") -> Column:
        """Return the values of a function in all rows; those of rows that are not held are of the first row."""
        values = [operand.values if isinstance(operand, Column) else operand for operand in operands]
        if name in EXACT and all(map(_are_floats, values)) and (name != "/" or np.all(values[1])):
            with np.errstate(all="ignore"):  # what overflows is infinite in Python, too
                return Column(self, np.asarray(EXACT[name](*values), dtype=np.float64))
        spread = [value.tolist() if isinstance(value, np.ndarray) else repeat(value) for value in values]
        results: list[Any] = []
        for holds, row in zip(self.holds.tolist(), zip(*spread, strict=False), strict=False):
            results.append(function(*row) if holds else results[0])
        return Column(self, column(results))

    def literal(self, plain: Callable[[Any], Any], text: str) -> Any:
        """Return the number that a text is, or the text, as ``plain`` finds it in every row."""
        if MARK not in text:
            return plain(text)
        read = self.lifted(text)
        if read.values.dtype != np.float64:  # Python writes floats so that they are read as themselves
            read = self.applied(lambda value: plain(str(value)), [read])
            if self.decided(np.array([isinstance(value, str) for value in read.values.tolist()])):
                return str(read)
        return read

    def lifted(self, text: str) -> Column:
        """Return the column that a text with marks is."""
        texts, columns = self.parts(text)
        if texts == ["", ""]:
            return columns[0]
        return self.applied(lambda *values: joined(texts, values), columns)

    def parts(self, text: str) -> tuple[list[str], list[Column]]:
        """Return the texts around the marks of a text, and the columns that these stand for."""
        pieces = _MARK.split(text)
        return pieces[::2], [self.marked[int(place)] for place in pieces[1::2]]

    def named(self, name: str) -> Column | None:
        """Return the column of a mark in an expression, numbers without a sign; ``None`` for another name."""
        match = _MARK.fullmatch(name)
        if match is None:
            return None
        known = self.marked[int(match[1])]
        values = known.values.tolist()
        plain = [type(value) in (int, float) and not str(value).startswith("-") for value in values]
        if not self.decided(np.array(plain)):
            raise NotByRows
        return known


def joined(texts: Sequence[str], values: Iterable[Any]) -> str:
    """Return texts with a value between each and the next."""
    return texts[0] + "".join(f"{value}{text}" for value, text in zip(values, texts[1:], strict=True))


def _are_floats(values: Any) -> bool:
    """Return whether a value is a column of floats, or a number: beside floats Python takes integers as floats."""
    return values.dtype == np.float64 if isinstance(values, np.ndarray) else type(values) in (float, int)

"""Values in many rows at once: an expansion whose arguments are columns of numbers.

Arithmetic with a column gives a column, row by row. In text a column is a mark of control characters, which no XML file
can contain. Every decision by a column (a branch, a comparison, whether a text is a number) is that of its first row;
rows that decide otherwise are no longer held. What cannot be expanded so raises ``NotByRows``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import repeat
from typing import Any

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.errors import ModelError

OPEN, CLOSE = "\x01", "\x02"
_MARK = re.compile(f"{OPEN}([0-9]+){CLOSE}")
_NAMED = re.compile("__column_([0-9]+)__")
"""Name of a mark within an expression; properties have no such names."""

EXACT: dict[str, Callable[..., Any]] = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}
"""The four operations of IEEE 754, which arrays and single numbers take bit by bit alike."""

AnyColumn = Array
"""Values in the rows of a table: floats, or objects where some are others."""


class NotByRows(ModelError):
    """A model that depends on a number in a way that is not followed for many rows."""

    def __init__(self) -> None:
        super().__init__("what the model is depends on a number in a way that is not followed")


def column(values: Iterable[Any]) -> AnyColumn:
    """Return values in the rows of a table."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return values
    rows = list(values)
    if {*map(type, rows)} == {float}:
        return np.array(rows)
    filled = np.empty(len(rows), dtype=object)
    filled[:] = rows
    return filled


class Column:
    """A value of an expansion in all rows; its text is a mark, its truth a decision."""

    def __init__(self, rows: Rows, values: AnyColumn) -> None:
        self.rows, self.values, self.place = rows, values, -1

    def __str__(self) -> str:
        if self.place < 0:
            self.place = len(self.rows.marked)
            self.rows.marked.append(self)
        return f"{OPEN}{self.place}{CLOSE}"

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

    def applied(self, function: Callable[..., Any], operands: Sequence[Any], symbol: str = "") -> Column:
        """Return the values of a function in all rows; those of rows that are not held are of the first row."""
        values = [operand.values if isinstance(operand, Column) else operand for operand in operands]
        if symbol in EXACT and all(map(_are_floats, values)) and (symbol != "/" or np.all(values[1])):
            with np.errstate(all="ignore"):  # what overflows is infinite in Python, too
                return Column(self, np.asarray(EXACT[symbol](*values), dtype=np.float64))
        spread = [value.tolist() if isinstance(value, np.ndarray) else repeat(value) for value in values]
        results: list[Any] = []
        for holds, row in zip(self.holds.tolist(), zip(*spread, strict=False), strict=False):
            results.append(function(*row) if holds else results[0])
        return Column(self, column(results))

    def literal(self, plain: Callable[[Any], Any], text: str) -> Any:
        """Return the number that a text is, or the text, as ``plain`` finds it in every row."""
        if OPEN not in text:
            return plain(text)
        read = self.lifted(text)
        if read.values.dtype != np.float64:  # Python writes floats so that they are read as themselves
            read = self.applied(lambda value: plain(str(value)), [read])
            kinds = [isinstance(value, str) for value in read.values.tolist()]
            if self.decided(np.array(kinds)):
                return str(read)
        return read

    def lifted(self, text: str) -> Column:
        texts, columns = self.parts(text)
        if texts == ["", ""]:
            return columns[0]
        return self.applied(lambda *values: joined(texts, values), columns)

    def parts(self, text: str) -> tuple[list[str], list[Column]]:
        pieces = _MARK.split(text)
        return pieces[::2], [self.marked[int(place)] for place in pieces[1::2]]

    def expression(self, text: str) -> str:
        """Return an expression with names in place of its marks."""
        if _NAMED.search(text):
            raise NotByRows
        return _MARK.sub(self._name, text)

    def _name(self, mark: re.Match[str]) -> str:
        values = self.marked[int(mark[1])].values.tolist()
        numbers = [isinstance(value, int | float) and not isinstance(value, bool) for value in values]
        unsigned = [not str(value).startswith("-") for value in values]
        if not numbers[0] or not self.decided(np.array(unsigned) & numbers):
            raise NotByRows
        return f"__column_{mark[1]}__"

    def named(self, name: str) -> Column | None:
        """Return the column of a name that ``expression`` gave; ``None`` for another name."""
        match = _NAMED.fullmatch(name)
        return self.marked[int(match[1])] if match else None


def joined(texts: Sequence[str], values: Iterable[Any]) -> str:
    """Return texts with a value between each and the next."""
    return texts[0] + "".join(f"{value}{text}" for value, text in zip(values, texts[1:], strict=True))


def _are_floats(values: Any) -> bool:
    """Return whether a value is a column of floats, or a number: beside floats Python takes integers as floats."""
    return values.dtype == np.float64 if isinstance(values, np.ndarray) else type(values) in (float, int)

"""The expressions of xacro: Python's numbers, texts, truth values, lists and maps, of bounded size, and columns.

A column is a float in many rows at once: of an expansion whose arguments are columns of numbers. Arithmetic with a
column gives a column, row by row. In text a column is a mark, ``__column_3__``, which no file of the model contains.
Every decision by a column (a branch, an integer, a text) is that of its first row; rows that decide otherwise are no
longer held. What cannot be expanded so raises ``NotByRows``, such as a number with a mark for some of its digits.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import repeat
from typing import Any

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.errors import ExpressionError, ModelError, choices
from pinarm.input.formulas.grammar import MANY, MAX_INTEGER, Grammar, interpret, read_formula, unknown_name
from pinarm.input.xml_text import MAX_TEXT
from pinarm.records import ValueRecord

MARK = "__column_"
"""Begin of all marks; an expression takes a mark for a name."""
MARKS = re.compile(f"{MARK}[0-9]+__")

EXACT: dict[str, Callable[..., Any]] = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}
"""The four operations of IEEE 754, which arrays and single numbers take bit by bit alike."""


class NotByRows(ModelError):
    """A model that depends on a number in a way that is not followed for many rows."""

    def __init__(self) -> None:
        super().__init__("what the model is depends on a number in a way that is not followed")


def require_unmarked(text: str) -> str:
    """Return a text that does not depend on a column."""
    if MARK in text:
        raise NotByRows
    return text


class Column:
    """A float in all rows; its text is a mark, its truth a decision."""

    def __init__(self, rows: Rows, values: Array) -> None:
        self.rows, self.values, self.mark = rows, values, ""

    def __str__(self) -> str:
        self.mark = self.mark or f"{MARK}{len(self.rows.marked)}__"
        self.rows.marked[self.mark] = self
        return self.mark

    def __bool__(self) -> bool:
        return self.rows.decided(self.values.astype(bool))


class Rows:
    """The rows of an expansion.

    Attributes:
        holds: Rows that take all decisions as the first one does, shape (count,).
    """

    def __init__(self, count: int) -> None:
        self.holds: Flags = np.ones(count, dtype=bool)
        self.marked: dict[str, Column] = {}

    def decided(self, outcomes: Flags) -> bool:
        """Return the outcome of the first row, and drop rows that have another."""
        self.holds &= outcomes == outcomes[0]
        return bool(outcomes[0])

    def applied(self, function: Callable[..., Any], operands: Sequence[Any], name: str = "") -> Any:
        """Return the values of a function in all rows, those of rows that are not held are of the first row.

        A value that is no float is a decision, and the same in all rows.
        """
        values = [operand.values if isinstance(operand, Column) else operand for operand in operands]
        if name in EXACT and all(map(_is_number, values)) and (name != "/" or np.all(values[1])):
            with np.errstate(all="ignore"):  # what overflows is infinite in Python, too
                return Column(self, np.asarray(EXACT[name](*values), dtype=np.float64))
        spread = [value.tolist() if isinstance(value, np.ndarray) else repeat(value) for value in values]
        results: list[Any] = []
        for row, arguments in enumerate(zip(*spread, strict=False)):
            result = function(*arguments) if self.holds[row] else results[0]
            first = results[0] if results else result
            self.holds[row] &= type(result) is type(first) and (isinstance(result, float) or result == first)
            results.append(result if self.holds[row] else first)
        return Column(self, np.array(results)) if isinstance(results[0], float) else results[0]

    def literal(self, plain: Callable[[str], Any], text: str) -> Any:
        """Return the number that a text is, or the text; of a word with a mark in it only ``-mark`` is followed."""
        word = text.strip()
        if MARK not in word or len(word.split()) > 1:
            return plain(text)
        if word[0] != "-":
            return self.column(word)
        return self.applied(operator.neg, [self.column(word[1:], signed=False)], "-x")

    def column(self, mark: str, *, signed: bool = True) -> Column:
        """Return the column of a mark; only in rows without a sign, as in the first one, where it may have none."""
        known = self.marked.get(mark)
        if known is None or not (signed or self.decided(~np.signbit(known.values))):
            raise NotByRows
        return known

    def named(self, name: str) -> Column | None:
        """Return the column of a mark in an expression; ``None`` for another name."""
        return self.column(name, signed=False) if MARKS.fullmatch(name) else None


def _is_number(value: Any) -> bool:
    """Return whether a value is a column, or a number: beside floats Python takes integers as floats."""
    return isinstance(value, np.ndarray) or type(value) in (float, int)


MAX_ITEMS = 1000
"""Largest number of values in a list or map that an expression makes, inner ones included."""

Functions = Mapping[str, Callable[..., Any]]


class Expressions(ValueRecord, frozen=True):
    """The algebra of expressions, of plain values and of columns.

    Attributes:
        look: Name -> its value, ``None`` where it has none.
        names: Lists the names that have values.
        functions: Functions that the file's place matters to, such as ``xacro.load_yaml``.
    """

    look: Callable[[str], Any] = lambda name: None
    names: Callable[[], Iterable[str]] = tuple
    functions: Functions = {}

    def evaluate(self, text: str) -> Any:
        return interpret(read_formula(text, GRAMMAR), self, text)

    def constant(self, value: Any) -> Any:
        return require_unmarked(value) if isinstance(value, str) else value

    def name(self, name: str) -> Any:
        value = self.look(name)
        value = _CONSTANTS.get(name) if value is None else value
        if value is None:
            raise unknown_name(name, [*self.names(), *_CONSTANTS])
        return _bounded(value)

    def logic(self, symbol: str, operands: Sequence[Callable[[], Any]]) -> Any:
        result = operands[0]()
        for operand in operands[1:]:
            if bool(result) == (symbol == "or"):
                break
            result = operand()
        return result

    def choose(self, test: Any, then: Callable[[], Any], otherwise: Callable[[], Any]) -> Any:
        return then() if test else otherwise()

    def call(self, function: str, arguments: Sequence[Any]) -> Any:
        """Apply a function or an operator; ``+`` joins texts."""
        if known := self.functions.get(function, _COLLECTIONS.get(function)):
            return known(*arguments)
        apply = partial(_applied, _FUNCTIONS[function][0])
        for argument in arguments:
            if isinstance(argument, Column):
                return argument.rows.applied(apply, arguments, function)
        return apply(*arguments)


def _applied(function: Callable[..., Any], *operands: Any) -> Any:
    try:
        return _bounded(function(*operands))
    except (ArithmeticError, TypeError, ValueError) as error:
        if isinstance(error, ExpressionError):
            raise
        raise ExpressionError(f"this cannot be computed ({error})") from None


def _bounded(value: Any) -> Any:
    if not isinstance(value, int | float | str | list | dict | Column):
        raise ExpressionError(f"a {type(value).__name__} is no value of a model", expected="a number or a text")
    if isinstance(value, int) and abs(value) >= MAX_INTEGER:
        raise ExpressionError("the value is too large", expected="a value below 2**64")
    if isinstance(value, str) and len(value) > MAX_TEXT:
        raise ExpressionError("the text is too long", expected=f"at most {MAX_TEXT} characters")
    return value


def _computed(symbol: str, left: Any, right: Any) -> Any:
    if not isinstance(left, int | float) or not isinstance(right, int | float):
        if not (isinstance(left, str) and isinstance(right, str) and symbol == "+"):
            raise ExpressionError(f"'{symbol}' does not go with text", expected="numbers, or text + text")
    elif symbol == "**" and isinstance(left, int) and isinstance(right, int) and left.bit_length() * right > 64:
        raise ExpressionError("the power is too large", expected="a value below 2**64")
    return _ARITHMETIC[symbol](left, right)


def _compared(symbol: str, left: Any, right: Any) -> bool:
    if isinstance(left, list | dict) or isinstance(right, list | dict):
        raise ExpressionError("lists and maps are not compared", expected="numbers or texts")
    return bool(_COMPARISONS[symbol](left, right))


def _contained(symbol: str, value: Any, holder: Any) -> bool:
    if not isinstance(holder, list | dict | str) or isinstance(value, list | dict):
        raise ExpressionError(f"'{symbol}' needs a list, a map or a text", expected="name in {'a': 1}")
    if isinstance(holder, list) and len(holder) > MAX_ITEMS:
        raise ExpressionError("the list is too long to look for a value", expected=f"at most {MAX_ITEMS} values")
    return (value in holder) == (symbol == "in")


def _list(*values: Any) -> list[Any]:
    _count(values)
    return list(values)


def _dict(*entries: Any) -> dict[Any, Any]:
    keys = entries[::2]
    if len(entries) % 2 or not all(isinstance(key, str | int | float) for key in keys):
        raise ExpressionError("this is no map", expected="a map such as dict(a=1), its keys texts or numbers")
    _count(entries)
    return dict(zip(keys, entries[1::2], strict=True))


def _count(values: Sequence[Any]) -> None:
    """Refuse more than ``MAX_ITEMS`` values, those in lists and maps among them included."""
    waiting, count = [*values], 0
    while waiting:
        value, count = waiting.pop(), count + 1
        if isinstance(value, list | dict):
            waiting += value.values() if isinstance(value, dict) else value
        if count + len(waiting) > MAX_ITEMS:
            raise ExpressionError("the list or map is too large", expected=f"at most {MAX_ITEMS} values")


def entry(holder: Any, key: Any) -> Any:
    """Return the entry of a list or text at an index, or of a map at a key."""
    if isinstance(holder, Column) or isinstance(key, Column):
        raise NotByRows
    if isinstance(holder, dict) and isinstance(key, str | int | float):
        if key in holder:
            return _bounded(holder[key])
        expected, hint = choices(str(key), map(str, holder), most=40)
        raise ExpressionError(f"the map has no '{str(key)[:60]}'", expected=expected, hint=hint)
    if isinstance(holder, list | str) and isinstance(key, int) and -len(holder) <= key < len(holder):
        return _bounded(holder[key])
    raise ExpressionError(f"{str(key)[:60]!r} is no key or index here", expected="a list, or a map with that key")


def _split(text: Any, separator: Any = None) -> list[str]:
    if not isinstance(text, str) or not (separator is None or (isinstance(separator, str) and separator)):
        raise ExpressionError("only texts are split", expected="text.split(' ')")
    return _list(*require_unmarked(text).split(separator, MAX_ITEMS))


def _round(value: float, digits: int = 0) -> float:
    return round(value, max(-20, min(20, digits))) if digits else round(value)


def _number(kind: Callable[[Any], float], value: Any) -> float:
    if isinstance(value, str) and (not value.isascii() or "_" in value):
        raise ValueError(f"not a decimal number: {value[:40]!r}")
    return kind(value)


_ARITHMETIC: Functions = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "//": operator.floordiv,
    "%": operator.mod, "**": operator.pow,
}  # fmt: skip
_COMPARISONS: Functions = {
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip
_COLLECTIONS: Functions = {"list": _list, "dict": _dict, "item": entry, "split": _split}

_ONE_ARGUMENT = (
    math.sin, math.cos, math.tan, math.asin, math.acos, math.atan, math.sinh, math.cosh, math.tanh, math.asinh,
    math.acosh, math.atanh, math.sqrt, math.exp, math.log2, math.log10, math.fabs, math.floor, math.ceil, math.trunc,
    math.radians, math.degrees, math.isnan, math.isinf, math.isfinite,
)  # fmt: skip
_MATH: dict[str, tuple[Callable[..., Any], int, int]] = {
    **{function.__name__: (function, 1, 1) for function in _ONE_ARGUMENT},
    "atan2": (math.atan2, 2, 2), "copysign": (math.copysign, 2, 2), "fmod": (math.fmod, 2, 2), "pow": (math.pow, 2, 2),
    "log": (math.log, 1, 2), "hypot": (math.hypot, 2, MANY),
}  # fmt: skip
_PYTHON: dict[str, tuple[Callable[..., Any], int, int]] = {
    "abs": (abs, 1, 1), "min": (min, 2, MANY), "max": (max, 2, MANY), "round": (_round, 1, 2), "len": (len, 1, 1),
    "int": (partial(_number, int), 1, 1), "float": (partial(_number, float), 1, 1),
    "str": (str, 1, 1), "bool": (bool, 1, 1),
}  # fmt: skip
_NAMED = {
    **_MATH,
    **_PYTHON,
    **{f"math.{name}": known for name, known in _MATH.items()},
    **{f"python.{name}": known for name, known in _PYTHON.items()},
}
_FUNCTIONS: dict[str, tuple[Callable[..., Any], int, int]] = {
    **_NAMED,
    **{symbol: (partial(_computed, symbol), 2, 2) for symbol in _ARITHMETIC},
    **{symbol: (partial(_compared, symbol), 2, 2) for symbol in _COMPARISONS},
    **{symbol: (partial(_contained, symbol), 2, 2) for symbol in ("in", "not in")},
    "+x": (operator.pos, 1, 1), "-x": (operator.neg, 1, 1), "not": (operator.not_, 1, 1),
}  # fmt: skip
_PLAIN_CONSTANTS = {name: getattr(math, name) for name in ("pi", "e", "tau", "inf", "nan")}
_CONSTANTS = {**_PLAIN_CONSTANTS, **{f"math.{name}": value for name, value in _PLAIN_CONSTANTS.items()}}

GRAMMAR = Grammar(
    (int, float, str, bool),
    {
        **{name: (least, most) for name, (_, least, most) in _NAMED.items()},
        "xacro.load_yaml": (1, 1), "load_yaml": (1, 1), "xacro.arg": (1, 1), "xacro.warning": (1, MANY),
        "split": (1, 2), "dict": (0, 2 * MAX_ITEMS),
    },
    collections=True,
)  # fmt: skip

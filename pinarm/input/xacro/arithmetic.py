"""The arithmetic of xacro: Python's numbers, texts and truth values, of bounded size."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from pinarm.errors import ExpressionError
from pinarm.input.formulas.grammar import MANY, MAX_INTEGER, Algebra, Grammar, interpret, look_up, read_tree
from pinarm.input.xml_text import MAX_TEXT
from pinarm.records import ValueRecord


def evaluate(text: str, algebra: Algebra[Any]) -> Any:
    """Evaluate an expression of xacro in an algebra: that of plain values, ``Scalars``, or one that follows it."""
    return interpret(read_tree(text, _GRAMMAR), algebra, text)


class Names(Mapping[str, Any]):
    """The properties in reach; ``a.b`` is property ``b`` of namespace ``a``."""

    def __init__(self, symbols: Any, namespace: type) -> None:
        self.symbols, self.namespace = symbols, namespace

    def _home(self, name: str) -> tuple[Mapping[str, Any], str]:
        *spaces, last = name.split(".")
        table = self.symbols
        for space in spaces:
            if space not in table or not isinstance(table[space], self.namespace):
                return {}, last
            table = table[space]
        return table, last

    def __getitem__(self, name: str) -> Any:
        table, last = self._home(name)
        return table[last]

    def __contains__(self, name: object) -> bool:
        table, last = self._home(str(name))
        return last in table

    def __iter__(self) -> Iterator[str]:
        table = self.symbols
        while table:
            yield from (name for name in dict.keys(table) if name.isidentifier())
            table = getattr(table, "parent", None)

    def __len__(self) -> int:
        return sum(1 for _ in self)


class Scalars(ValueRecord, frozen=True):
    """The algebra of xacro: Python's numbers, texts and truth values, of bounded size."""

    names: Mapping[str, Any]

    def constant(self, value: Any) -> Any:
        """Return a literal."""
        return value

    def name(self, name: str) -> Any:
        """Return the value of a property."""
        return _bounded(look_up(name, self.names, _CONSTANTS))

    def unary(self, symbol: str, operand: Any) -> Any:
        """Apply ``+``, ``-`` or ``not``."""
        return _applied(_UNARY[symbol], operand)

    def binary(self, symbol: str, left: Any, right: Any) -> Any:
        """Apply an arithmetic operator; ``+`` joins texts."""
        if isinstance(left, str) != isinstance(right, str) or (isinstance(left, str) and symbol != "+"):
            raise ExpressionError(f"'{symbol}' does not go with text", expected="numbers, or text + text")
        if symbol == "**" and isinstance(left, int) and isinstance(right, int) and left.bit_length() * right > 64:
            raise ExpressionError("the power is too large", expected="a value below 2**64")
        return _applied(_OPERATIONS[symbol], left, right)

    def compare(self, symbols: Sequence[str], operands: Sequence[Any]) -> Any:
        """Compare neighbours."""
        pairs = zip(symbols, operands, operands[1:], strict=False)
        return all(_applied(_OPERATIONS[symbol], left, right) for symbol, left, right in pairs)

    def logic(self, symbol: str, operands: Sequence[Callable[[], Any]]) -> Any:
        """Apply ``and`` or ``or``, as far as it takes."""
        result = operands[0]()
        for operand in operands[1:]:
            if bool(result) == (symbol == "or"):
                break
            result = operand()
        return result

    def choose(self, test: Any, then: Callable[[], Any], otherwise: Callable[[], Any]) -> Any:
        """Return one of two."""
        return then() if test else otherwise()

    def call(self, function: str, arguments: Sequence[Any]) -> Any:
        """Apply a function."""
        return _applied(_FUNCTIONS[function][0], *arguments)


def _applied(function: Callable[..., Any], *operands: Any) -> Any:
    try:
        value = function(*operands)
    except (ArithmeticError, TypeError, ValueError) as error:
        raise ExpressionError(f"this cannot be computed ({error})") from None
    return _bounded(value)


def _bounded(value: Any) -> Any:
    if not isinstance(value, int | float | str):
        raise ExpressionError(f"a {type(value).__name__} is no value of a model", expected="a number or a text")
    if isinstance(value, int) and abs(value) >= MAX_INTEGER:
        raise ExpressionError("the value is too large", expected="a value below 2**64")
    if isinstance(value, str) and len(value) > MAX_TEXT:
        raise ExpressionError("the text is too long", expected=f"at most {MAX_TEXT} characters")
    return value


def _round(value: float, digits: int = 0) -> float:
    return round(value, max(-20, min(20, digits))) if digits else round(value)


def _number(kind: Callable[[Any], float], value: Any) -> float:
    if isinstance(value, str) and (not value.isascii() or "_" in value):
        raise ValueError(f"not a decimal number: {value[:40]!r}")
    return kind(value)


_UNARY: Mapping[str, Callable[[Any], Any]] = {"+": operator.pos, "-": operator.neg, "not": operator.not_}
_OPERATIONS: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "//": operator.floordiv,
    "%": operator.mod, "**": operator.pow, "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le,
    ">": operator.gt, ">=": operator.ge,
}  # fmt: skip

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
_FUNCTIONS = {
    **_MATH, **_PYTHON, **{f"math.{name}": entry for name, entry in _MATH.items()},
    **{f"python.{name}": entry for name, entry in _PYTHON.items()},
}  # fmt: skip
_PLAIN_CONSTANTS = {name: getattr(math, name) for name in ("pi", "e", "tau", "inf", "nan")}
_CONSTANTS = {**_PLAIN_CONSTANTS, **{f"math.{name}": value for name, value in _PLAIN_CONSTANTS.items()}}
_GRAMMAR = Grammar((int, float, str, bool), {name: arity for name, (_, *arity) in _FUNCTIONS.items()})  # type: ignore[misc]

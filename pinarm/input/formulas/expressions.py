"""Formulas: arithmetic over named quantities, for values and for units; ``grammar`` says what may stand in them."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache, reduce
from itertools import pairwise
from typing import Any

import numpy as np
from msgspec import field

from pinarm.arrays import Array
from pinarm.errors import ExpressionError, UnitError
from pinarm.input.formulas.grammar import (
    CONSTANTS,
    MANY,
    Grammar,
    MeasuredNumber,
    interpret,
    look_up,
    names_in,
    read_tree,
)
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.records import Record, ValueRecord


class Expression(Record, frozen=True):
    """A formula, parsed and checked.

    Attributes:
        names: The names in it, constants such as ``pi`` included: a given name takes precedence over them.
    """

    unshown = ("tree", "names", "measured")

    text: str
    tree: ast.expr
    names: frozenset[str]
    measured: tuple[MeasuredNumber, ...] = ()

    def __eq__(self, other: object) -> bool:
        return self.text == other.text if isinstance(other, Expression) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.text)

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Read a formula."""
        return _parsed(text)

    def evaluate(self, names: Mapping[str, Any]) -> Any:
        """Return the value: a float or bool where all the names are numbers, else an array.

        Args:
            names: Numbers and arrays whose shapes broadcast.
        """
        with np.errstate(all="ignore"):
            result = interpret(self.tree, _Values(names), self.text)
        return result.item() if np.ndim(result) == 0 else result

    def switches(self, names: Mapping[str, Any]) -> list[Array]:
        """Return functions that change their sign wherever the formula goes from one smooth part of it to another.

        Those are the arguments of ``abs`` and ``sign``, differences of what ``min``, ``max`` and comparisons compare,
        and of what ``%``, ``//``, ``floor`` and ``ceil`` round the sine of pi times it; constant ones are left out.
        """
        switches = _Switches(names)
        with np.errstate(all="ignore"):
            interpret(self.tree, switches, self.text)
        return [np.asarray(values, float) for values in switches.met if np.ndim(values)]

    def dimension(self, names: Mapping[str, Unit | None]) -> Unit | None:
        """Return the SI unit of the value; ``None`` where it cannot be known.

        Args:
            names: Units of the names; ``None`` is unknown and fits everything, as a literal 0 does.
        """
        measure = interpret(self.tree, _Units(names), self.text)
        return None if measure.value == 0 else measure.unit


@lru_cache(maxsize=1024)  # those of a mechanism file are the same in every variant of a sweep
def _parsed(text: str) -> Expression:
    tree = read_tree(text, FORMULA)
    constants: Iterator[Any] = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
    measured = tuple(value for value in constants if isinstance(value, MeasuredNumber))
    return Expression(text.strip(), tree, frozenset(names_in(tree, FORMULA)), measured)


class _Values(ValueRecord, frozen=True):
    """The algebra of numbers and arrays, elementwise, in double precision."""

    names: Mapping[str, Any]

    def constant(self, value: Any) -> Any:
        return np.float64(value.value if isinstance(value, MeasuredNumber) else value)

    def name(self, name: str) -> Any:
        value = np.asarray(look_up(name, self.names, CONSTANTS))
        if value.dtype.kind not in "biufc":
            raise ExpressionError(f"'{name}' is not a number")
        return value[()] if value.dtype.kind in "bfc" else value.astype(float)[()]

    def unary(self, symbol: str, operand: Any) -> Any:
        result = _applied({"+": np.positive, "-": np.negative, "not": np.logical_not}[symbol], operand)
        return _unless(np.isnan(operand), result) if symbol == "not" else result

    def binary(self, symbol: str, left: Any, right: Any) -> Any:
        return _applied(_OPERATIONS[symbol], left, right)

    def compare(self, symbols: Sequence[str], operands: Sequence[Any]) -> Any:
        pairs = zip(symbols, operands, operands[1:], strict=False)
        result = reduce(np.logical_and, [_applied(_OPERATIONS[symbol], left, right) for symbol, left, right in pairs])
        return _unless(reduce(np.logical_or, map(np.isnan, operands)), result)

    def logic(self, symbol: str, operands: Sequence[Callable[[], Any]]) -> Any:
        decided, unknown = np.False_, np.False_
        for operand in operands:
            value = operand()
            decided = _applied(np.logical_or, decided, (value == 0.0) if symbol == "and" else (np.abs(value) > 0.0))
            unknown = np.logical_or(unknown, np.isnan(value))
            if np.ndim(decided) == 0 and decided:
                break
        return _unless(unknown & ~decided, ~decided if symbol == "and" else decided)

    def choose(self, test: Any, then: Callable[[], Any], otherwise: Callable[[], Any]) -> Any:
        if np.ndim(test) == 0:
            return test if np.isnan(test) else then() if test else otherwise()
        return _unless(np.isnan(test), _applied(np.where, test, then(), otherwise()))

    def call(self, function: str, arguments: Sequence[Any]) -> Any:
        return _applied(_FUNCTIONS[function].apply, *arguments)


class _Switches(_Values, frozen=True):
    """Algebra of values that records functions whose zeros separate smooth parts of the result."""

    met: list[Any] = field(default_factory=list)

    def binary(self, symbol: str, left: Any, right: Any) -> Any:
        if symbol in ("%", "//"):
            self.met.append(np.sin(np.pi * left / right))
        return super().binary(symbol, left, right)

    def compare(self, symbols: Sequence[str], operands: Sequence[Any]) -> Any:
        self.met.extend(left - right for left, right in pairwise(operands))
        return super().compare(symbols, operands)

    def call(self, function: str, arguments: Sequence[Any]) -> Any:
        if function in ("abs", "sign"):
            self.met.append(arguments[0])
        elif function in ("min", "max"):
            so_far = _FUNCTIONS[function].apply
            self.met.extend(so_far(*arguments[:k]) - arguments[k] for k in range(1, len(arguments)))
        elif function in ("floor", "ceil"):
            self.met.append(np.sin(np.pi * arguments[0]))
        return super().call(function, arguments)


def _unless(unknown: Any, result: Any) -> Any:
    """Return a result, NaN where it is unknown: what hangs on a quantity that is no number is none."""
    return np.where(unknown, np.nan, result)[()] if np.any(unknown) else result


def _applied(function: Callable[..., Any], *operands: Any) -> Any:
    try:
        result = function(*operands)
    except (TypeError, ValueError) as error:
        raise ExpressionError(f"these cannot be combined ({error})") from None
    if np.ndim(result) == 0 and not np.isfinite(result) and all(np.isfinite(operand) for operand in operands):
        raise ExpressionError("the value is not finite: a division by zero, an overflow, or outside the domain")
    return result


Measures = Sequence["Measure"]


class Measure(ValueRecord, frozen=True):
    """The unit of a value in dimensional analysis.

    Attributes:
        unit: SI unit; ``None`` where unknown.
        value: The number, where it follows from literals only: exponents need it, and 0 fits every dimension.
    """

    unit: Unit | None
    value: Fraction | None = None


Rule = Callable[[Measures], Measure]
"""From the measures of the arguments of a function to that of its value."""

_PURE = Measure(DIMENSIONLESS)
_UNKNOWN = Measure(None)
_PURE_CONSTANTS = dict.fromkeys(CONSTANTS, DIMENSIONLESS)


class _Units(ValueRecord, frozen=True):
    names: Mapping[str, Unit | None]

    def constant(self, value: Any) -> Measure:
        if isinstance(value, MeasuredNumber):
            return Measure(Unit(1.0, value.unit.dimension))
        return Measure(DIMENSIONLESS, Fraction(repr(value)))

    def name(self, name: str) -> Measure:
        unit = look_up(name, self.names, _PURE_CONSTANTS)
        return Measure(None if unit is None else Unit(1.0, unit.dimension))

    def unary(self, symbol: str, operand: Measure) -> Measure:
        if symbol == "-" and operand.value is not None:
            return Measure(operand.unit, -operand.value)
        return _PURE if symbol == "not" else operand

    def binary(self, symbol: str, left: Measure, right: Measure) -> Measure:
        if left.value is not None and right.value is not None and (folded := _folded(symbol, left.value, right.value)):
            return Measure(DIMENSIONLESS, folded[0])
        if symbol in "+-%":
            return same([left, right])
        if symbol == "//":
            return ratio([left, right])
        if symbol == "**":
            return power(left, right)
        if left.unit is None or right.unit is None:
            return _UNKNOWN
        return Measure(left.unit * right.unit if symbol == "*" else left.unit / right.unit)

    def compare(self, symbols: Sequence[str], operands: Measures) -> Measure:
        return ratio(operands)

    def logic(self, symbol: str, operands: Sequence[Callable[[], Measure]]) -> Measure:
        for operand in operands:
            operand()
        return _PURE

    def choose(self, test: Measure, then: Callable[[], Measure], otherwise: Callable[[], Measure]) -> Measure:
        return same([then(), otherwise()])

    def call(self, function: str, arguments: Measures) -> Measure:
        return _FUNCTIONS[function].rule(arguments)


def _folded(symbol: str, left: Fraction, right: Fraction) -> tuple[Fraction] | None:
    """Return the value of an operation on literals in a tuple, since 0 is false; ``None`` for other operations."""
    if symbol == "/" and right != 0:
        return (left / right,)
    folds = {"+": left + right, "-": left - right, "*": left * right}
    return (folds[symbol],) if symbol in folds else None


def same(measures: Measures) -> Measure:
    """Return the common measure of operands of one dimension: sums, minima, ..."""
    units = [measure.unit for measure in measures if measure.unit is not None and measure.value != 0]
    for unit in units[1:]:
        if unit.dimension != units[0].dimension:
            raise UnitError(f"[{units[0]}] and [{unit}] do not go together", expected="quantities of one dimension")
    unknown = any(measure.unit is None for measure in measures)
    return Measure(units[0]) if units else _UNKNOWN if unknown else Measure(DIMENSIONLESS, Fraction(0))


def ratio(measures: Measures) -> Measure:
    """Return a dimensionless measure from quantities of one dimension: quotients, comparisons, atan2."""
    same(measures)
    return _PURE


def pure(measures: Measures) -> Measure:
    """Return a dimensionless measure from dimensionless arguments: sines, logarithms, ..."""
    for measure in measures:
        if measure.unit is not None and measure.value != 0 and measure.unit.dimension != DIMENSIONLESS.dimension:
            raise UnitError(
                f"a quantity in [{measure.unit}] where a number is expected", hint="a ratio of two quantities"
            )
    return _PURE


def power(base: Measure, exponent: Measure) -> Measure:
    """Return the measure of a power, whose exponent must be known where the base has a dimension."""
    pure([exponent])
    if base.unit is None:
        return _UNKNOWN
    if exponent.value is not None:
        return Measure(base.unit**exponent.value)
    if base.unit.dimension != DIMENSIONLESS.dimension:
        raise UnitError(f"the unit of [{base.unit}] to a power that varies is not determined", expected="x**2, x**0.5")
    return _PURE


def root(measures: Measures) -> Measure:
    """Return the measure of a square root."""
    return power(measures[0], Measure(DIMENSIONLESS, Fraction(1, 2)))


def sign(measures: Measures) -> Measure:
    """Return a dimensionless measure, from any argument."""
    return _PURE


class _Function(ValueRecord, frozen=True):
    """A function of formulas: how it is computed, the rule for its unit, the number of its arguments."""

    apply: Callable[..., Any]
    rule: Rule = pure
    least: int = 1
    most: int = 1


_OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "//": np.floor_divide, "%": np.mod,
    "**": np.power, "==": np.equal, "!=": np.not_equal, "<": np.less, "<=": np.less_equal, ">": np.greater,
    ">=": np.greater_equal,
}  # fmt: skip


def _least(*arguments: Any) -> Any:
    return reduce(np.minimum, arguments)


def _greatest(*arguments: Any) -> Any:
    return reduce(np.maximum, arguments)


_FUNCTIONS: Mapping[str, _Function] = {
    "sin": _Function(np.sin), "cos": _Function(np.cos), "tan": _Function(np.tan),
    "asin": _Function(np.arcsin), "acos": _Function(np.arccos), "atan": _Function(np.arctan),
    "atan2": _Function(np.arctan2, ratio, 2, 2), "hypot": _Function(np.hypot, same, 2, 2),
    "sinh": _Function(np.sinh), "cosh": _Function(np.cosh), "tanh": _Function(np.tanh),
    "sqrt": _Function(np.sqrt, root), "exp": _Function(np.exp), "log": _Function(np.log), "log10": _Function(np.log10),
    "abs": _Function(np.abs, same), "sign": _Function(np.sign, sign),
    "min": _Function(_least, same, 2, MANY), "max": _Function(_greatest, same, 2, MANY),
    "floor": _Function(np.floor), "ceil": _Function(np.ceil),
    "radians": _Function(np.radians), "degrees": _Function(np.degrees),
}  # fmt: skip
FORMULA = Grammar((int, float, MeasuredNumber), {name: (entry.least, entry.most) for name, entry in _FUNCTIONS.items()})
"""The language of scenario files."""

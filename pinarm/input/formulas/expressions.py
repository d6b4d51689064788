"""Formulas: arithmetic over named quantities, for values and for units; ``grammar`` says what may stand in them."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache, reduce
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
    Part,
    interpret,
    read_formula,
    unknown_name,
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
    tree: Part
    names: frozenset[str]
    measured: tuple[MeasuredNumber, ...] = ()

    def __eq__(self, other: object) -> bool:
        return self.text == other.text if isinstance(other, Expression) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.text)

    @classmethod
    def parse(cls, text: str) -> Expression:
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
    tree = read_formula(text, FORMULA)
    leaves = [(part.function, part.value) for part in tree.leaves()]
    measured = tuple(value for _, value in leaves if isinstance(value, MeasuredNumber))
    return Expression(text.strip(), tree, frozenset(value for kind, value in leaves if kind == "name"), measured)


def _look_up(name: str, names: Mapping[str, Any], constants: Mapping[str, Any]) -> Any:
    table = names if name in names else constants
    if name not in table:
        raise unknown_name(name, [*names, *constants])
    return table[name]


class _Values(ValueRecord, frozen=True):
    """The algebra of numbers and arrays, elementwise, in double precision."""

    names: Mapping[str, Any]

    def constant(self, value: Any) -> Any:
        return np.float64(value.value if isinstance(value, MeasuredNumber) else value)

    def name(self, name: str) -> Any:
        value = np.asarray(_look_up(name, self.names, CONSTANTS))
        if value.dtype.kind not in "biufc":
            raise ExpressionError(f"'{name}' is not a number")
        return value[()] if value.dtype.kind in "bfc" else value.astype(float)[()]

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
        result = _applied(_FUNCTIONS[function].apply, *arguments)
        if function in _TRUTHS:
            return _unless(reduce(np.logical_or, map(np.isnan, arguments)), result)
        return result


class _Switches(_Values, frozen=True):
    """Algebra of values that records functions whose zeros separate smooth parts of the result."""

    met: list[Any] = field(default_factory=list)

    def call(self, function: str, arguments: Sequence[Any]) -> Any:
        if function in _TRUTHS and len(arguments) == 2:
            self.met.append(arguments[0] - arguments[1])
        elif function in ("abs", "sign"):
            self.met.append(arguments[0])
        elif function in ("min", "max"):
            so_far = _FUNCTIONS[function].apply
            self.met.extend(so_far(*arguments[:k]) - arguments[k] for k in range(1, len(arguments)))
        elif function in ("floor", "ceil"):
            self.met.append(np.sin(np.pi * arguments[0]))
        elif function in ("%", "//"):
            self.met.append(np.sin(np.pi * arguments[0] / arguments[1]))
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
        unit = _look_up(name, self.names, _PURE_CONSTANTS)
        return Measure(None if unit is None else Unit(1.0, unit.dimension))

    def logic(self, symbol: str, operands: Sequence[Callable[[], Measure]]) -> Measure:
        for operand in operands:
            operand()
        return _PURE

    def choose(self, test: Measure, then: Callable[[], Measure], otherwise: Callable[[], Measure]) -> Measure:
        return same([then(), otherwise()])

    def call(self, function: str, arguments: Measures) -> Measure:
        folds = function in _FOLDS and not (function == "/" and arguments[1].value == 0)
        values = [measure.value for measure in arguments if folds and measure.value is not None]
        if values and len(values) == len(arguments):
            return Measure(DIMENSIONLESS, _FOLDS[function](*values))
        return _FUNCTIONS[function].rule(arguments)


_FOLDS: Mapping[str, Callable[..., Fraction]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "-x": operator.neg,
    "+x": operator.pos,
}  # fmt: skip
"""Operations that are carried out on literals, since exponents need their values."""


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


class _Function(ValueRecord, frozen=True):
    """A function of formulas: how it is computed, the rule for its unit, the number of its arguments."""

    apply: Callable[..., Any]
    rule: Rule = pure
    least: int = 1
    most: int = 1


def _least(*arguments: Any) -> Any:
    return reduce(np.minimum, arguments)


def _greatest(*arguments: Any) -> Any:
    return reduce(np.maximum, arguments)


def _any(measures: Measures) -> Measure:
    return _PURE


def _joined(operation: Callable[[Unit, Unit], Unit]) -> Rule:
    """Return the rule of a product or a quotient."""

    def rule(measures: Measures) -> Measure:
        left, right = (measure.unit for measure in measures)
        return _UNKNOWN if left is None or right is None else Measure(operation(left, right))

    return rule


_FUNCTIONS: Mapping[str, _Function] = {
    "+": _Function(np.add, same), "-": _Function(np.subtract, same), "*": _Function(np.multiply, _joined(operator.mul)),
    "/": _Function(np.divide, _joined(operator.truediv)), "//": _Function(np.floor_divide, ratio),
    "%": _Function(np.mod, same), "**": _Function(np.power, lambda measures: power(*measures)),
    "+x": _Function(np.positive, same), "-x": _Function(np.negative, same), "not": _Function(np.logical_not, _any),
    "==": _Function(np.equal, ratio), "!=": _Function(np.not_equal, ratio), "<": _Function(np.less, ratio),
    "<=": _Function(np.less_equal, ratio), ">": _Function(np.greater, ratio), ">=": _Function(np.greater_equal, ratio),
    "sin": _Function(np.sin), "cos": _Function(np.cos), "tan": _Function(np.tan),
    "asin": _Function(np.arcsin), "acos": _Function(np.arccos), "atan": _Function(np.arctan),
    "atan2": _Function(np.arctan2, ratio, 2, 2), "hypot": _Function(np.hypot, same, 2, 2),
    "sinh": _Function(np.sinh), "cosh": _Function(np.cosh), "tanh": _Function(np.tanh),
    "sqrt": _Function(np.sqrt, root), "exp": _Function(np.exp), "log": _Function(np.log), "log10": _Function(np.log10),
    "abs": _Function(np.abs, same), "sign": _Function(np.sign, _any),
    "min": _Function(_least, same, 2, MANY), "max": _Function(_greatest, same, 2, MANY),
    "floor": _Function(np.floor), "ceil": _Function(np.ceil),
    "radians": _Function(np.radians), "degrees": _Function(np.degrees),
}  # fmt: skip
_TRUTHS = ("not", "==", "!=", "<", "<=", ">", ">=")
"""Functions whose value is true or false; of what is no number it is none."""

FORMULA = Grammar(
    (int, float, MeasuredNumber),
    {name: (entry.least, entry.most) for name, entry in _FUNCTIONS.items() if name.isidentifier() and name != "not"},
)
"""The language of scenario files."""

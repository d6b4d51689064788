"""Dimensional analysis of formulas: the unit of a formula's value."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

from pinarm.errors import UnitError
from pinarm.input.formulas.grammar import CONSTANTS, interpret, look_up
from pinarm.input.formulas.measured_numbers import MeasuredNumber
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.records import ValueRecord

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
_CONSTANTS = dict.fromkeys(CONSTANTS, DIMENSIONLESS)


def unit_of(tree: ast.expr, names: Mapping[str, Unit | None], rules: Mapping[str, Rule], text: str) -> Unit | None:
    """Return the SI unit of a formula's value, see ``Expression.dimension``; ``rules`` has that of each function."""
    measure = interpret(tree, _Units(names, rules), text)
    return None if measure.value == 0 else measure.unit


class _Units(ValueRecord, frozen=True):
    """The algebra of units."""

    names: Mapping[str, Unit | None]
    rules: Mapping[str, Rule]

    def constant(self, value: Any) -> Measure:
        if isinstance(value, MeasuredNumber):
            return Measure(Unit(1.0, value.unit.dimension))
        return Measure(DIMENSIONLESS, Fraction(repr(value)))

    def name(self, name: str) -> Measure:
        unit = look_up(name, self.names, _CONSTANTS)
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
        return self.rules[function](arguments)


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

"""Numbers of a model as formulas of its arguments: what a xacro file computes, traced through its expansion."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
import sympy

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.errors import PinarmError
from pinarm.input.roots import contained_file, file_root, root_of
from pinarm.input.xacro.columns import Column, Rows, joined
from pinarm.input.xacro.expander import Expander
from pinarm.records import ValueRecord

WORD = re.compile(r"(-?)traced_([0-9]+)")
"""A traced number in the text of an expanded model."""

OPERATORS: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
}
FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "neg": operator.neg, "pos": operator.pos, "sin": sympy.sin, "cos": sympy.cos, "tan": sympy.tan, "asin": sympy.asin,
    "acos": sympy.acos, "atan": sympy.atan, "atan2": sympy.atan2, "sqrt": sympy.sqrt, "exp": sympy.exp,
    "pow": operator.pow, "hypot": lambda *sides: sympy.sqrt(sum(side**2 for side in sides)),
    "radians": lambda degrees: degrees * sympy.pi / 180,
}  # fmt: skip

DENOMINATOR = 1000
"""Largest denominator of a number that is written as a fraction, or as a fraction of pi."""


def letter(name: str) -> sympy.Symbol:
    """Return the symbol of a name."""
    return sympy.Symbol(name, real=True)


def exact(value: float) -> sympy.Expr:
    """Return a number as a fraction, or as a fraction of pi, where it is one to rounding."""
    for unit, factor in ((1.0, sympy.Integer(1)), (math.pi, sympy.pi)):
        fraction = sympy.Rational(value / unit).limit_denominator(DENOMINATOR)
        if abs(float(fraction) * unit - value) <= 4e-16 * abs(value):
            return fraction * factor
    return sympy.Float(value, 17)


class TracedNumber(Column):
    """A number of an expansion, and the formula that gives it; ``None`` where it is not followed."""

    def __init__(self, rows: Rows, values: Array, formula: sympy.Expr | None) -> None:
        super().__init__(rows, values)
        self.formula = formula


class TracedRows(Rows):
    """The one row of a traced expansion."""

    def __init__(self) -> None:
        super().__init__(1)

    def applied(self, function: Callable[..., Any], operands: Sequence[Any], symbol: str = "") -> Column:
        """Return the value of a function, with its formula; see ``Rows``."""
        values = super().applied(function, operands, symbol).values
        while isinstance(function, partial):
            function = function.args[-1] if function.args and callable(function.args[-1]) else function.func
        known = OPERATORS.get(symbol) or FUNCTIONS.get(getattr(function, "__name__", ""))
        terms = [_formula(operand) for operand in operands]
        formula = known(*terms) if known and all(term is not None for term in terms) else None
        return TracedNumber(self, values, formula)

    def lifted(self, text: str) -> Column:
        """Return the number of a text with marks; a minus before a mark is followed."""
        texts, columns = self.parts(text)
        return self.applied(operator.neg, columns) if texts == ["-", ""] else super().lifted(text)


def _formula(operand: Any) -> sympy.Expr | None:
    if isinstance(operand, TracedNumber):
        return operand.formula
    return exact(float(operand)) if isinstance(operand, int | float) else None


class TracedModel(ValueRecord, frozen=True):
    """The text of a model, with words for numbers that follow from its arguments.

    Attributes:
        xml: The text.
        formulas: The formula of each word; of one that is not followed its value.
    """

    xml: str
    formulas: Mapping[str, sympy.Expr]

    def number(self, text: str) -> sympy.Expr:
        """Return the formula of a number in the text."""
        match = WORD.fullmatch(text)
        if match is None:
            return exact(float(text))
        formula = self.formulas[f"traced_{match[2]}"]
        return -formula if match[1] else formula

    def vector(self, text: str | None, otherwise: str = "0 0 0") -> sympy.Matrix:
        """Return the formulas of three numbers, shape (3, 1)."""
        return sympy.Matrix([self.number(word) for word in (text or otherwise).split()])


def traced_model(mechanism: Mechanism) -> TracedModel:
    """Return the model of a mechanism with its arguments as symbols; with numbers alone where that is not possible."""
    path, rows = mechanism.source.robot, TracedRows()
    numbers = {name: value for name, value in mechanism.arguments.items() if isinstance(value, int | float)}
    texts = {name: str(TracedNumber(rows, np.array([float(value)]), letter(name))) for name, value in numbers.items()}
    if path.suffix == ".xacro" and texts:
        root = root_of(mechanism.source.folder / "mechanism.yaml")
        with suppress(PinarmError), file_root(None, mechanism.source.packages):
            expansion = Expander(root, texts, rows).run(contained_file(path.absolute(), root), str(path))
            pieces, used = rows.parts(expansion.xml)
            words = {f"traced_{number.place}": _value(number) for number in used}
            return TracedModel(joined(pieces, (f"traced_{number.place}" for number in used)), words)
    return TracedModel(mechanism.xml, {})


def _value(number: Column) -> sympy.Expr:
    formula = _formula(number)
    value = number.values.tolist()[0]
    return formula if formula is not None else exact(float(value)) if isinstance(value, int | float) else sympy.nan

"""Formulas: what they give, what they weigh, and what they refuse."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import numpy as np
import pytest

from pinarm.errors import ExpressionError, UnitError
from pinarm.input.formulas.expressions import Expression
from pinarm.input.formulas.grammar import CONSTANTS, MAX_LENGTH
from pinarm.input.units import Unit, unit

X = np.array([0.0, 1.0, 2.0])

SCALARS = [
    ("1 + 2*3 - 4/8", 6.5),
    ("-2**2", -4.0),
    ("2**-1", 0.5),
    ("2**0.5", math.sqrt(2)),
    ("pi/2 + 90*deg", math.pi),
    ("0 < a <= 1", True),
    ("0 < a < 1", False),
    ("not a == 1 or a != 2", True),
    ("1/zero if zero != 0 else 5", 5.0),
    ("zero == 0 or 1/zero > 2", True),
    ("min(3, a, 2) + max(0, a)", 2.0),
    ("atan2(1, 1) + hypot(3, 4)", math.pi / 4 + 5),
    ("sqrt(4) + abs(-1) + sign(-3) + floor(1.5) + ceil(1.5)", 5.0),
    ("log(exp(2)) + log10(100)", 4.0),
    ("sinh(1)**2 - cosh(1)**2 + tanh(0)", -1.0),
    ("asin(1) + acos(1) + atan(0) + sin(0) + cos(0) + tan(0)", math.pi / 2 + 1),
    (" a\n+\n1 ", 2.0),
]
NAMES = {"a": 1, "zero": 0.0, "joint.knee.effort": 4.0, "x": X}


@pytest.mark.parametrize(("text", "value"), SCALARS)
def test_numbers(text: str, value: float) -> None:
    result = Expression.parse(text).evaluate(NAMES)
    assert type(result) in (float, bool)
    assert result == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("x**2", X**2),
        ("min(x, 1)", np.minimum(X, 1)),
        ("x if x > 0 else -1", np.array([-1.0, 1.0, 2.0])),
        ("0 < x < 2", np.array([False, True, False])),
        ("x == 0 or not x < 2", np.array([True, False, True])),
        ("sqrt(-x)", np.array([0.0, np.nan, np.nan])),
    ],
)
def test_arrays_are_taken_elementwise_and_silently(text: str, value: np.ndarray) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(Expression.parse(text).evaluate(NAMES), value)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1 if x > 0 else 2", (1.0, np.nan, 2.0)),
        ("x < 0", (0.0, np.nan, 1.0)),
        ("x > 0 and x < 5", (1.0, np.nan, 0.0)),
        ("x > 0 and 0 > 1", (0.0, 0.0, 0.0)),  # whatever x is
        ("1 if x > 0 and 1/x > 0 else 7", (1.0, np.nan, 7.0)),
    ],
)
def test_what_hangs_on_no_number_is_none(text: str, values: tuple[float, ...]) -> None:
    x, expression = (1.0, np.nan, -1.0), Expression.parse(text)
    np.testing.assert_array_equal(expression.evaluate({"x": np.array(x)}), values)
    np.testing.assert_array_equal([expression.evaluate({"x": one}) for one in x], values)


def test_names_are_flattened_and_win_over_constants() -> None:
    expression = Expression.parse("pi*joint.knee.effort + e + min(a, 2)")
    assert expression.names == {"pi", "joint.knee.effort", "e", "a"}
    assert expression.evaluate({"pi": 3, "joint.knee.effort": 1, "e": 0.5, "a": 1}) == 4.5
    assert "e" not in CONSTANTS


@pytest.mark.parametrize("word", ["in", "lambda", "True", "if", "not"])
def test_keywords_of_python_are_words_of_names(word: str) -> None:
    name = f"joint.{word}.effort"
    expression = Expression.parse(f"é + 2*{name} - {word}.{word}/(3 N) if {name} > 0 else 1")
    assert expression.names == {"é", name, f"{word}.{word}"}
    assert expression.evaluate({"é": 1.0, name: 5.0, f"{word}.{word}": 6.0}) == 1.0 + 10.0 - 2.0


def test_numbers_are_words_of_names() -> None:
    expression = Expression.parse("é*2.5*mode.1.frequency + .5*a.12/mode.22.if - 1.e1*1e-1*b")
    assert expression.names == {"é", "mode.1.frequency", "a.12", "mode.22.if", "b"}
    values = {"é": 1.0, "mode.1.frequency": 2.0, "a.12": 6.0, "mode.22.if": 3.0, "b": 4.0}
    assert expression.evaluate(values) == 5.0 + 1.0 - 4.0
    for wrong in ("1.mode", "2.5.x", "mode.1.", "mode..1"):
        with pytest.raises(ExpressionError):
            Expression.parse(wrong)


def test_integers_are_floats_so_that_powers_end() -> None:
    assert Expression.parse("10**300").evaluate({}) == 1e300
    with pytest.raises(ExpressionError, match="not finite"):
        Expression.parse("9**9**9**9").evaluate({})
    with pytest.raises(ExpressionError, match="not finite"):
        Expression.parse("n**n**n").evaluate({"n": 9})


@pytest.mark.parametrize("text", ["1/0", "1%0", "(-1)**0.5", "exp(1e5)"])
def test_numbers_that_are_not_finite_are_errors(text: str) -> None:
    with pytest.raises(ExpressionError, match="not finite"):
        Expression.parse(text).evaluate(NAMES)


REFUSED = [
    "", "a b", "a = 1", "a := 1", "joint.1a", "x[0]", "(1, 2)", "{1: 2}", "'a'", "f'{x}'", "True", "...", "1j", "1e999",
    "9" * 30, "x.y()", "(1).real", "x(1)(2)", "lambda: 1", "[i for i in x]", "x @ x", "x ^ 2", "~x", "x in y",
    "min(*x, 1)", "min(x, y, key=1)", "min(1)", "sin(1, 2)", "open(1)", "__import__(1)", "x.__class__()", "await x",
    "x; y", "x\\\n+1", "\0", "a\0b", "\ud800", "é(1)", "²", "(" * 1500, "-" * 1500 + "1", "not " * 400 + "1",
    "+".join(["1"] * 900), "(" * 150 + "1" + ")" * 150 + ")", "1" + "**1" * 600, "sin(" * 300 + "1" + ")" * 300,
    "1 if 1 else " * 160 + "1)", "a" + ".a" * 900 + "(", "1" * (MAX_LENGTH + 1),
]  # fmt: skip


@pytest.mark.parametrize("text", REFUSED, ids=range(len(REFUSED)))
def test_everything_else_is_refused_when_it_is_read(text: str) -> None:
    with pytest.raises(ExpressionError):
        Expression.parse(text)


def test_long_names_are_refused_for_their_length() -> None:
    with pytest.raises(ExpressionError, match="too long"):
        Expression.parse("a" * (MAX_LENGTH + 1))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("2*x^2", [r"'x\^2|2\*x\^2'", r"\*\* for powers"]),
        ("a + knee", ["unknown name 'knee'", "column 5", "one of a, deg, knew, pi", "try: knew"]),
        ("1 + sn(2)", ["no function 'sn'", "column 5 of '1 \\+ sn\\(2\\)'", "try: sin"]),
        ("1 + (2", ["column 5"]),
        ("a = 2", ["column 3", "== to compare"]),
        ("é*é + zz", ["column 7"]),
    ],
)
def test_errors_tell_the_column_and_what_to_try(text: str, told: list[str]) -> None:
    for pattern in told:
        with pytest.raises(ExpressionError, match=pattern) as caught:
            Expression.parse(text).evaluate({"a": 1, "knew": 2, "é": 1})
        assert caught.value.location is None  # the caller knows the file


UNITS = {"L": unit("m"), "m": unit("kg"), "t": unit("ms"), "F": unit("N"), "a": unit("deg"), "u": None}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("m*L/t**2 + F", "N"),
        ("(L**3)**(1/3)", "m"),
        ("L**1.5 / L**0.5", "m"),
        ("sin(a) + cos(L/L)", "1"),
        ("hypot(L, 0)", "m"),
        ("L > 0 and not F == 0", "1"),
        ("F if L > 0 else 0", "N"),
        ("2**a", "1"),
        ("sign(F)*L + abs(L)", "m"),
        ("L % (2*L)", "m"),
        ("u + L", "m"),
        ("pi*L*deg", "m"),
        ("F*L*(1 - 1) + 0", "N*m"),
    ],
)
def test_dimensions(text: str, expected: str) -> None:
    found = Expression.parse(text).dimension(UNITS)
    assert isinstance(found, Unit)
    assert found.dimension == unit(expected).dimension
    assert found.factor == 1.0


@pytest.mark.parametrize("text", ["u*L", "sqrt(u)", "u if u else u", "1 - 1"])
def test_what_is_unknown_stays_unknown(text: str) -> None:
    assert Expression.parse(text).dimension(UNITS) is None


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1 + (F + L)", r"\[N\] and \[m\].*'F \+ L' at column 6"),
        ("L > 1", r"\[m\] and \[1\]"),
        ("F if L > 0 else L", r"\[N\] and \[m\]"),
        ("min(L, F)", r"\[m\] and \[N\]"),
        ("hypot(L, 1)", r"\[m\] and \[1\]"),
        ("2*sin(L)", r"\[m\] where a number is expected.*'sin\(L\)' at column 3"),
        ("2**L", "where a number is expected"),
        ("L**a", "not determined"),
        ("L**u", "not determined"),
    ],
)
def test_dimensions_that_do_not_go_together(text: str, told: str) -> None:
    with pytest.raises(UnitError, match=told):
        Expression.parse(text).dimension(UNITS)


@pytest.mark.parametrize(("text", "met"), [
    ("2*x + sin(x)", []),
    ("abs(x - 1) + sign(2)", [lambda x: x - 1]),
    ("max(x, 1, x**2)", [lambda x: x - 1, lambda x: np.maximum(x, 1) - x**2]),
    ("x if 0 < x <= 2 else 3*x", [lambda x: 0 - x, lambda x: x - 2]),
    ("abs(x) if x > 1 or x < 0 else min(x, 2)", [lambda x: x - 1, lambda x: x, lambda x: x, lambda x: x - 2]),
    ("x % 0.7 + floor(3*x)", [lambda x: np.sin(np.pi * x / 0.7), lambda x: np.sin(3 * np.pi * x)]),
    ("abs(abs(x) - 1)", [lambda x: x, lambda x: np.abs(x) - 1]),
])  # fmt: skip
def test_switches_are_where_smooth_parts_end(text: str, met: list[Callable[[np.ndarray], np.ndarray]]) -> None:
    x = np.linspace(-2.0, 3.0, 11)
    found = Expression.parse(text).switches({"x": x})
    assert len(found) == len(met)
    for values, of in zip(found, met, strict=True):
        assert values == pytest.approx(of(x), abs=1e-14)

"""Numbers with units in formulas: where they may stand, what they weigh, and what is refused."""

import math

import pytest

from pinarm.errors import ExpressionError, InputError
from pinarm.input.formulas.expressions import Expression
from pinarm.input.units import unit

NAMES = {"x": 3.0, "F": 8.0, "kn": 1.0, "kN": 4.0}


@pytest.mark.parametrize(
    ("text", "value", "dimension"),
    [
        ("2e4 N/m", 2e4, "N/m"), ("-30 deg", -math.pi / 6, "1"), (" 1.5e-3   kg*m^2 ", 1.5e-3, "kg*m^2"),
        ("(20 kN/m)*x", 6e4, "N"), ("x*(2 mm)", 6e-3, "m^2"), ("x + 20 mm - 3 cm", 2.99, "m"), ("x < 4 m", True, "1"),
        ("max(x, 5 m)", 5.0, "m"), ("hypot(x, 4 m)/(2 s)", 2.5, "m/s"), ("2 m**2", 2.0, "m^2"), ("3 1/s", None, None),
        ("1 m if x > 2 m else 4 m", 1.0, "m"), ("x - -2 m", 5.0, "m"), ("(5 rad/s)**2", 25.0, "1/s^2"),
        ("1 kg*m/s^2 + F", 9.0, "N"), ("sin(30 deg)", 0.5, "1"), ("-(2 m)/x", -2 / 3, "1"), ("x == 3 m", True, "1"),
        ("2*kN", 8.0, "1"), ("90*deg", math.pi / 2, "1"), ("(0 m) + 0", 0.0, "m"), ("2 N*s/m", 2.0, "N*s/m"),
        ("7 if kn else 8", 7.0, "1"), ("1 and kn", True, "1"), ("3 in", None, None),
    ],
)  # fmt: skip
def test_what_they_are_worth(text: str, value: float | None, dimension: str | None) -> None:
    if value is None:
        with pytest.raises(ExpressionError):
            Expression.parse(text)
        return
    formula = Expression.parse(text)
    units = {"x": unit("m"), "F": unit("N"), "kn": unit("1"), "kN": unit("1")}
    assert formula.evaluate(NAMES) == pytest.approx(value, rel=1e-15)
    assert formula.dimension(units).dimension == unit(dimension).dimension
    assert formula.text == text.strip()


@pytest.mark.parametrize("text", ["2 m*x", "x*2 m", "2**-1 m", "x*-2 m", "(2 m)(3)", "2 m^3^2"])
def test_where_it_is_not_clear_where_the_unit_ends(text: str) -> None:
    with pytest.raises(ExpressionError):
        Expression.parse(text)


def test_parentheses_are_proposed() -> None:
    with pytest.raises(
        ExpressionError, match=r"not clear where a unit ends: '2 m' at column 5 of 'x \+ 2 m \* 3'"
    ) as told:
        Expression.parse("x + 2 m * 3")
    assert "try: (2 m)" in str(told.value)
    with pytest.raises(ExpressionError, match="unknown unit 'Omega'"):
        Expression.parse("é + 2 Omega")


@pytest.mark.parametrize("text", ["2 joint.x", "2 sin(x)", "x 2 m", "2m", "1e999 m"])
def test_what_is_no_number_with_a_unit(text: str) -> None:
    with pytest.raises(ExpressionError):
        Expression.parse(text)


def test_a_product_whose_sign_was_forgotten_is_refused(mechanism, chain) -> None:
    """Where all the words of the unit are names, 2 m*g may be a weight as well as metres times grams."""
    symbols = {"m": "2 + 1", "bad": "2 m*g", "good": "2 N/m", "far": "5 m"}
    arm = mechanism(chain({"name": "arm"}), symbols=symbols).at([[0.3]])
    assert str(arm["good"].unit) == "N/m"
    assert arm["good"].values == 2.0
    for name in ("bad", "far"):
        with pytest.raises(InputError, match="a name here too"):
            arm[name]

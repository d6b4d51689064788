"""Units: every one of the table, what is made of them, and what is refused."""

import math
from fractions import Fraction

import pytest

from pinarm.errors import UnitError
from pinarm.input.units import (
    _TABLE,
    decimal,
    half_last_digit,
    is_decimal,
    leading_number,
    printed,
    read_quantity,
    unit,
)

LENGTH, MASS, TIME, NUMBER = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 0)
VOLTAGE = (2, 1, -3, -1)
FORCE, PRESSURE, ENERGY, POWER = (1, 1, -2, 0), (-1, 1, -2, 0), (2, 1, -2, 0), (2, 1, -3, 0)
KNOWN = {
    "m": (1, LENGTH), "mm": (0.001, LENGTH), "cm": (0.01, LENGTH), "km": (1000, LENGTH), "um": (1e-6, LENGTH),
    "kg": (1, MASS), "g": (0.001, MASS), "mg": (1e-6, MASS), "t": (1000, MASS),
    "s": (1, TIME), "ms": (0.001, TIME), "us": (1e-6, TIME), "min": (60, TIME), "h": (3600, TIME),
    "N": (1, FORCE), "mN": (0.001, FORCE), "daN": (10, FORCE), "kN": (1000, FORCE), "MN": (1e6, FORCE),
    "Pa": (1, PRESSURE), "kPa": (1e3, PRESSURE), "MPa": (1e6, PRESSURE), "bar": (1e5, PRESSURE),
    "J": (1, ENERGY), "mJ": (1e-3, ENERGY), "kJ": (1e3, ENERGY), "MJ": (1e6, ENERGY),
    "W": (1, POWER), "mW": (1e-3, POWER), "kW": (1e3, POWER),
    "rad": (1, NUMBER), "mrad": (1e-3, NUMBER), "deg": (0.017453292519943295, NUMBER),
    "°": (0.017453292519943295, NUMBER), "rev": (6.283185307179586, NUMBER),
    "tr": (2 * math.pi, NUMBER), "U": (2 * math.pi, NUMBER),
    "rpm": (0.10471975511965977, (0, 0, -1, 0)), "1": (1, NUMBER), "%": (0.01, NUMBER),
    "A": (1, (0, 0, 0, 1)), "mA": (1e-3, (0, 0, 0, 1)), "V": (1, VOLTAGE), "mV": (1e-3, VOLTAGE),
    "ohm": (1, (2, 1, -3, -2)), "mohm": (1e-3, (2, 1, -3, -2)), "H": (1, (2, 1, -2, -2)), "mH": (1e-3, (2, 1, -2, -2)),
}  # fmt: skip


def test_every_unit() -> None:
    assert set(KNOWN) == set(_TABLE)
    for name, (factor, dimension) in KNOWN.items():
        assert unit(name).dimension == dimension
        assert unit(name).factor == pytest.approx(factor, rel=1e-15), name  # one rounding of a constant


@pytest.mark.parametrize(
    ("text", "factor", "dimension"),
    [
        ("N·m", 1, ENERGY), (" N * m ", 1, ENERGY), ("kg*m**2", 1, (2, 1, 0, 0)), ("kg*m²", 1, (2, 1, 0, 0)),
        ("mm³", 1e-9, (3, 0, 0, 0)), ("s^-1", 1, (0, 0, -1, 0)), ("m/s/s", 1, (1, 0, -2, 0)),
        ("N*mm/deg", 1e-3 / math.radians(1), ENERGY), ("rev/min", 2 * math.pi / 60, (0, 0, -1, 0)),
        ("deg/h^2", math.pi / 180 / 3600**2, (0, 0, -2, 0)), ("1/ms", 1000, (0, 0, -1, 0)), ("m^0", 1, NUMBER),
        ("g^(1/2)*mm/s", 1e-3 * math.sqrt(1e-3), (1, 0.5, -1, 0)), ("m**(-1/3)", 1, (Fraction(-1, 3), 0, 0, 0)),
        ("V*A", 1, POWER), ("N*m/A", 1, (2, 1, -2, -1)),
    ],
)  # fmt: skip
def test_products_quotients_and_powers(text: str, factor: float, dimension: tuple[int, int, int, int]) -> None:
    read = unit(text)
    assert read.dimension == dimension
    assert read.factor == pytest.approx(factor, rel=1e-14)  # a few roundings


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("sec", "unknown unit 'sec'"), ("KG", "unknown unit 'KG'"), ("N*", "not a unit"), ("N m", "not a unit"),
        ("m^1.5", "not a unit"), ("m^100", "not a unit"), ("m^1/2", "not a unit"), ("m^(1/0)", "beyond all numbers"),
        ("2 m", "not a unit"), ("m\nkg", "not a unit"), ("Hz", "ambiguous"), ("1/min", "ambiguous"),
        ("s/min²", "ambiguous"), ("V*min", "ambiguous"), ("m^2²", "not a unit"), ("m^٢", "not a unit"),
    ],
)  # fmt: skip
def test_wrong_units(text: str, says: str) -> None:
    with pytest.raises(UnitError, match=says):
        unit(text)


@pytest.mark.parametrize(("wrong", "right"), [("rads", "rad"), ("Nm", "N*m"), ("kWh", "kW*h")])
def test_a_near_miss_gets_a_suggestion(wrong: str, right: str) -> None:
    with pytest.raises(UnitError) as caught:
        unit(wrong)
    assert caught.value.hint == right


@pytest.mark.parametrize("text", ["60,5 deg"])
def test_a_comma_in_a_number_is_told(text: str) -> None:
    with pytest.raises(UnitError, match="comma in its number") as caught:
        read_quantity(text)
    assert "decimals with a point" in caught.value.expected


@pytest.mark.parametrize("text", ["h^99", "1/um^99"])
def test_a_power_beyond_all_floats_is_an_error_of_the_user(text: str) -> None:
    with pytest.raises(UnitError):
        unit(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("30 deg", math.pi / 6), ("30deg", math.pi / 6), ("30°", math.pi / 6), ("3000 rpm", 100 * math.pi),
        ("4 bar", 4e5), ("-1.5 N*m", -1.5), ("+2 m", 2), (".5 m", 0.5), ("5. m", 5), ("1e-3 m", 1e-3),
        ("1E+3 mm", 1.0), ("2.5e-3kg", 2.5e-3), ("  7 s  ", 7), ("50 %", 0.5), ("12 1", 12),
    ],
)  # fmt: skip
def test_quantities(text: str, value: float) -> None:
    number, read = read_quantity(text)
    assert number == pytest.approx(value, rel=1e-15)  # one product
    assert read is not None


@pytest.mark.parametrize(
    "text",
    ["", "m", "0x10 m", "nan m", "--1 m", "1e m", "1 2 m", "１ m", "1_0 m"],
)
def test_what_is_no_quantity(text: str) -> None:
    with pytest.raises(UnitError):
        read_quantity(text)


@pytest.mark.parametrize(
    ("text", "half"),
    [
        ("192.2 N*m", 0.05), ("192 N*m", 0.5), ("192. N*m", 0.5), ("0.420 m", 5e-4), ("-1.89 rad/s", 5e-3),
        ("1.5e3 N", 50.0), ("1.50E-3 N", 5e-6), ("2168.5 rpm", 0.05 * 2 * math.pi / 60), ("55.9", 0.05),
        ("12.5 mm", 5e-5), ("100 %", 5e-3),
    ],
)  # fmt: skip
def test_half_a_unit_of_the_last_digit(text: str, half: float) -> None:
    assert half_last_digit(text) == pytest.approx(half, rel=1e-14)  # two products


@pytest.mark.parametrize("text", ["", "nan", "1e99999999999 N"])
def test_what_has_no_last_digit(text: str) -> None:
    with pytest.raises(UnitError):
        half_last_digit(text)


def test_units_print_in_the_words_of_mechanics() -> None:
    assert str(unit("N") * unit("m")) == "N*m"
    assert str(unit("m") / unit("s") ** 2) == "m/s^2"
    assert str(unit("kg") * unit("m") ** 3) == "kg*m^3"
    assert str(unit("kPa")) == "kPa"
    assert [printed(text) for text in ("N*m", "kg*m^2/s^3", "m^22", "kg^(1/2)")] == [
        "N·m",
        "kg·m²/s³",
        "m^22",
        "kg^(1/2)",
    ]


@pytest.mark.parametrize("text", ["１２", "1_0", "", ".", "1,5", "0x10", "1e", "1\u0660"])
def test_what_is_no_decimal_number(text: str) -> None:
    assert not is_decimal(text)
    with pytest.raises(ValueError, match=r"number|convert"):
        decimal(text)


@pytest.mark.parametrize(
    ("text", "parts"),
    [("2kg", ("2", "kg")), ("1e3", ("1e3", "")), ("1e m", ("1", "e m")), ("1.2.3", ("1.2", ".3")), ("kg", None),
     ("", None), ("..1", None), ("١ kg", None), ("1٢", ("1", "٢"))],
)  # fmt: skip
def test_the_number_that_a_text_begins_with(text: str, parts: tuple[str, str] | None) -> None:
    assert leading_number(text) == parts

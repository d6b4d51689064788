"""Units and decimal numbers: text in, SI out, and the dimension checked on the way.

Angles count as dimensionless, so that ``N*m/rad`` is ``N*m`` and ``rad/s`` is ``1/s``. Hertz is a unit of frequencies
only: as a speed it would read as rad/s and be wrong by 2 pi; write ``rpm`` or ``rev/s``. ``1/min`` is left out on
purpose: it counts turns in catalogues, in ``V*min`` and ``N*m*min`` too.

Numbers have ASCII digits. Python's own ``float`` takes Arabic and full-width digits too, and ``1_0`` for 10: in a table
or a model these are mistakes.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import lru_cache

from pinarm.errors import UnitError, choices
from pinarm.records import Record

Exponent = Fraction | int
Dimension = tuple[Exponent, Exponent, Exponent, Exponent]
"""Exponents of metre, kilogram, second and ampere."""


class Unit(Record, frozen=True):
    """A unit of measurement.

    Attributes:
        dimension: Exponents of (m, kg, s, A).
        text: As it is written; only for display.
    """

    factor: float
    dimension: Dimension
    text: str = ""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Unit):
            return NotImplemented
        return self.factor == other.factor and self.dimension == other.dimension

    def __hash__(self) -> int:
        return hash((self.factor, self.dimension))

    def __mul__(self, other: Unit) -> Unit:
        return Unit(self.factor * other.factor, _combine(self.dimension, other.dimension, 1))

    def __truediv__(self, other: Unit) -> Unit:
        return Unit(self.factor / other.factor, _combine(self.dimension, other.dimension, -1))

    def __pow__(self, exponent: Fraction | int) -> Unit:
        m, kg, s, ampere = self.dimension
        return Unit(math.pow(self.factor, exponent), (m * exponent, kg * exponent, s * exponent, ampere * exponent))

    def fits(self, other: Unit) -> bool:
        """Return whether numbers in one unit may stand where the other one is expected; Hz fits nothing but Hz."""
        return self.dimension == other.dimension and (self.text == "Hz") == (other.text == "Hz")

    @property
    def si(self) -> Unit:
        """The unit of SI of the same dimension; angles in rad."""
        if self.factor == 1.0:
            return self
        turning = any(word in self.text for word in ANGLES)
        return Unit(1.0, self.dimension, _ANGULAR.get(self.dimension, "") if turning else "")

    def __str__(self) -> str:
        return self.text or _SI_NAMES.get(self.dimension) or _composed(self.dimension)


def _combine(a: Dimension, b: Dimension, sign: int) -> Dimension:
    return (a[0] + sign * b[0], a[1] + sign * b[1], a[2] + sign * b[2], a[3] + sign * b[3])


def _composed(dimension: Dimension) -> str:
    m, kg, s, ampere = dimension
    powers = [("kg", kg), ("m", m), ("s", s), ("A", ampere)]
    above = [_power(name, n) for name, n in powers if n > 0]
    below = [_power(name, -n) for name, n in powers if n < 0]
    return "/".join(["*".join(above) or "1", *below])


def _power(name: str, exponent: Exponent) -> str:
    whole = exponent.denominator == 1
    return name if exponent == 1 else f"{name}^{exponent}" if whole else f"{name}^({exponent})"


def printed(text: str) -> str:
    """Return the text of a unit as it is printed, such as N·m² for ``N*m^2``."""
    return _SUPERSCRIPT.sub(lambda match: {"2": "²", "3": "³"}[match[1]], text.replace("*", "·"))


DIMENSIONLESS = Unit(1.0, (0, 0, 0, 0), "1")
_LENGTH, _MASS, _TIME = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0)
_VOLTAGE, _RESISTANCE, _INDUCTANCE = (2, 1, -3, -1), (2, 1, -3, -2), (2, 1, -2, -2)
_FORCE, _PRESSURE, _ENERGY, _POWER = (1, 1, -2, 0), (-1, 1, -2, 0), (2, 1, -2, 0), (2, 1, -3, 0)

_TABLE: dict[str, tuple[float, Dimension]] = {
    "m": (1.0, _LENGTH), "mm": (1e-3, _LENGTH), "cm": (1e-2, _LENGTH), "km": (1e3, _LENGTH), "um": (1e-6, _LENGTH),
    "kg": (1.0, _MASS), "g": (1e-3, _MASS), "mg": (1e-6, _MASS), "t": (1e3, _MASS),
    "s": (1.0, _TIME), "ms": (1e-3, _TIME), "us": (1e-6, _TIME), "min": (60.0, _TIME), "h": (3600.0, _TIME),
    "N": (1.0, _FORCE), "mN": (1e-3, _FORCE), "daN": (10.0, _FORCE), "kN": (1e3, _FORCE),
    "MN": (1e6, _FORCE),
    "Pa": (1.0, _PRESSURE), "kPa": (1e3, _PRESSURE), "MPa": (1e6, _PRESSURE), "bar": (1e5, _PRESSURE),
    "J": (1.0, _ENERGY), "mJ": (1e-3, _ENERGY), "kJ": (1e3, _ENERGY), "MJ": (1e6, _ENERGY),
    "W": (1.0, _POWER), "mW": (1e-3, _POWER), "kW": (1e3, _POWER),
    "A": (1.0, (0, 0, 0, 1)), "mA": (1e-3, (0, 0, 0, 1)), "V": (1.0, _VOLTAGE), "mV": (1e-3, _VOLTAGE),
    "ohm": (1.0, _RESISTANCE), "mohm": (1e-3, _RESISTANCE), "H": (1.0, _INDUCTANCE), "mH": (1e-3, _INDUCTANCE),
    "rad": (1.0, (0, 0, 0, 0)), "mrad": (1e-3, (0, 0, 0, 0)), "deg": (math.pi / 180, (0, 0, 0, 0)),
    "°": (math.pi / 180, (0, 0, 0, 0)), "rev": (2 * math.pi, (0, 0, 0, 0)),
    "tr": (2 * math.pi, (0, 0, 0, 0)), "U": (2 * math.pi, (0, 0, 0, 0)), "rpm": (2 * math.pi / 60, (0, 0, -1, 0)),
    "1": (1.0, (0, 0, 0, 0)), "%": (1e-2, (0, 0, 0, 0)),
}  # fmt: skip

_SI_NAMES: dict[Dimension, str] = {
    (0, 0, 0, 0): "1", _FORCE: "N", _ENERGY: "N*m", _PRESSURE: "Pa", _POWER: "W",
    _VOLTAGE: "V", _RESISTANCE: "ohm", _INDUCTANCE: "H", (0, 1, -2, 0): "N/m", (0, 1, -1, 0): "N*s/m",
    (2, 1, -1, 0): "kg*m^2/s", (1, 1, -1, 0): "kg*m/s", (1, 0, -1, 0): "m/s", (1, 0, -2, 0): "m/s^2",
    (2, 1, 0, 0): "kg*m^2",
}  # fmt: skip

HERTZ = Unit(1.0, (0, 0, -1, 0), "Hz")
"""Cycles per second. It fits frequencies only, and is refused where something turns: see ``Unit.fits``."""

_PER_SPEED = {(2, 1, -1, 0), (2, 1, -2, -1)}
"""Dimensions of a torque and of a voltage over a speed of rotation: of damping, and of the constant of a motor."""

_ANGULAR: dict[Dimension, str] = {(0, 0, 0, 0): "rad", (0, 0, -1, 0): "rad/s", (0, 0, -2, 0): "rad/s^2"}

ANGLES = ("deg", "°", "rev", "rpm", "rad", "tr", "U")
"""Words in units of angles and speeds of rotation."""

MAX_LENGTH = 100
"""Of a unit; nothing in mechanics needs half as much."""

MAX_QUANTITY = 600
"""Of a quantity: a number with the digits that a file may have, and a unit."""

_FACTOR = re.compile(
    r"\s*([*/·]?)\s*([A-Za-z°%]+|1)\s*"
    r"(?:(?:\^|\*\*)\s*(?:(-?[0-9]{1,2})|\((-?[0-9]{1,4}/[0-9]{1,4})\))|([²³]))?"
)
_SUPERSCRIPT = re.compile(r"\^([23])(?![0-9])")


@lru_cache(maxsize=256)
def unit(text: str) -> Unit:
    """Read a unit such as ``N*m``, ``kg*m^2`` or ``rad/s^2``.

    Args:
        text: Names of the table joined by ``*`` and ``/``, each with an integer power, or one such as ``kg^(1/2)``.
    """
    if len(text) > MAX_LENGTH:
        raise UnitError(f"'{text[:20]}...' is not a unit", expected=f"at most {MAX_LENGTH} characters")
    try:
        read = _product(text)
    except (OverflowError, ZeroDivisionError):
        raise UnitError(f"the unit '{text}' is beyond all numbers") from None
    if not 0.0 < read.factor < math.inf:
        raise UnitError(f"the unit '{text}' is beyond all numbers")
    if _counts_turns(read):
        hint = "rpm or rad/min" if read.dimension == (0, 0, -1, 0) else "rpm or rad/min in place of 1/min"
        raise UnitError(f"{text} is ambiguous between turns and radians", hint=hint)
    return read


def _counts_turns(read: Unit) -> bool:
    """Return whether it takes a speed per minute or hour, as catalogues do, with no word of what is counted."""
    m, kg, time, ampere = read.dimension
    rate = time < 0 and (m, kg, ampere) == (0, 0, 0)
    per_speed = not _PER_SPEED.isdisjoint((read.dimension, (-m, -kg, -time, -ampere)))
    names = {match[2] for match in _FACTOR.finditer(read.text)}
    return (rate or per_speed) and not names.isdisjoint(("min", "h")) and not any(w in read.text for w in ANGLES)


def _product(text: str) -> Unit:
    result, position = DIMENSIONLESS, 0
    while position < len(text.rstrip()):
        match = _FACTOR.match(text, position)
        if not match or bool(match[1]) != (position > 0):
            raise UnitError(f"'{text}' is not a unit", expected="names joined by * and /, such as kg*m^2 or rad/s")
        if match[2] not in _TABLE:
            raise _unknown(match[2])
        power = Fraction(match[4]) if match[4] else int(match[3] or {"²": 2, "³": 3}.get(match[5], 1))
        factor = Unit(*_TABLE[match[2]]) ** power
        result = result / factor if match[1] == "/" else result * factor
        position = match.end()
    return Unit(result.factor, result.dimension, text.strip())


def _unknown(name: str) -> UnitError:
    if name == "Hz":
        return UnitError("Hz is ambiguous between turns and radians", hint="rpm, rev/s or rad/s")
    expected, hint = choices(name, _TABLE, most=60)
    return UnitError(f"unknown unit '{name}'", expected=expected, hint=_apart(name) or hint)


def _apart(name: str) -> str:
    """Return the product of two units that are written without a sign, such as N*m for Nm; empty where it is none."""
    for last in ("m", "mm", "cm", "s", "h"):
        first = name.removesuffix(last)
        _, kg, time, ampere = _TABLE.get(first, (1.0, _LENGTH))[1]
        if first != name and ((kg and time) or ampere):
            return f"{first}*{last}"
    return ""


def read_quantity(text: str) -> tuple[float, Unit | None]:
    """Split ``"30 deg"`` into its SI value and its unit; the unit is ``None`` for a bare number."""
    parts = _parts(text)
    if not parts:
        expected = "a number and a unit, such as 30 deg or 1.5 N*m"
        raise UnitError(f"'{text[:MAX_LENGTH]}' is not a quantity", expected=expected)
    if parts[1][:1] == "," and parts[1][1:2].isdecimal():
        raise UnitError(
            f"'{text}' has a comma in its number",
            expected="decimals with a point, such as 0.6 kg; nothing between thousands",
        )
    read = HERTZ if parts[1] == "Hz" else unit(parts[1]) if parts[1] else None
    number = float(parts[0]) * (read.factor if read else 1.0)
    if not math.isfinite(number):
        raise UnitError(f"'{text}' is beyond all numbers")
    return number, read


def _parts(text: str) -> tuple[str, str] | None:
    text = text.strip()
    return leading_number(text) if len(text) <= MAX_QUANTITY else None


def half_last_digit(text: str) -> float:
    """Return half a unit of the last printed digit of ``"2168.5 rpm"``, in SI: 0.05 rpm as rad/s."""
    parts = _parts(text)
    if not parts:
        expected = "digits and a unit, such as 192.2 N*m"
        raise UnitError(f"'{text[:MAX_LENGTH]}' is not a printed number", expected=expected)
    mantissa, _, exponent = parts[0].lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    factor = unit(parts[1]).factor if parts[1] else 1.0
    half = 0.5 * float(f"1e{int(exponent or 0) - decimals}") * factor
    if not 0.0 < half < math.inf:
        raise UnitError(f"the last digit of '{text}' is beyond all numbers")
    return half


DECIMAL = r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[eE][+-]?[0-9]++)?+"
"""Pattern of a decimal number. Its repetitions never give back what they took, so that no text takes quadratic time."""

_LEADING = re.compile(DECIMAL)


def decimal(text: str) -> float:
    """Return the number that a text is, with or without blanks around it; also ``inf`` and ``nan``."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"not a decimal number: {text[:40]!r}")
    return float(text)


def is_decimal(text: str | None) -> bool:
    """Return whether a text is what ``decimal`` reads."""
    try:
        decimal(text or "")
    except ValueError:
        return False
    return True


def is_whole(text: str) -> bool:
    """Return whether a text is a whole number: ASCII digits, with a sign or without."""
    return re.fullmatch("[+-]?[0-9]+", text) is not None


def leading_number(text: str) -> tuple[str, str] | None:
    """Return the number that a text begins with and the rest, without blanks around; ``None`` where there is none."""
    text = text.strip()
    match = _LEADING.match(text)
    return (match[0], text[match.end() :].lstrip()) if match else None


def argument_word(value: object) -> str | None:
    """Return the word that a value of a model's argument is: ``right_``, ``true``; ``None`` for a number."""
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) and leading_number(value) is None else None

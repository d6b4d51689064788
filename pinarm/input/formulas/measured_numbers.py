"""Numbers with a unit in formulas, such as ``2e4 N/m``.

Such a number stands where a term of a sum does: alone, between ``+``, ``-`` or comparisons, as an argument of a
function, or in parentheses, ``(2e4 N/m)*x``. Beside ``*``, ``/`` or ``**`` it has to be in parentheses, so that nobody
has to ask where the unit ends.
"""

from __future__ import annotations

import re

from pinarm.errors import ExpressionError, Location, UnitError
from pinarm.input.units import Unit, read_quantity
from pinarm.records import ValueRecord

_NUMBER = r"(?<![\w.])(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_POWER = r"(?:(?:\^|\*\*)-?[0-9]{1,2})?"
_NAME = r"[A-Za-z]+(?!\w|\.\w| *\()"
_MEASURED = rf"{_NUMBER} +({_NAME}{_POWER}(?: *[*/] *(?:{_NAME}|1){_POWER})*)"
_WORD = r"[A-Za-z]+"
_KEYWORDS = ("if", "else", "and", "or", "not", "in", "is")


class MeasuredNumber(ValueRecord, frozen=True):
    """A number with a unit, as a literal of a formula.

    Attributes:
        value: In SI.
        unit: Its unit.
        text: As it is written.
    """

    value: float
    unit: Unit
    text: str

    @property
    def words(self) -> frozenset[str]:
        """The names in its unit."""
        return frozenset(re.findall(_WORD, str(self.unit)))


def find_measured(text: str) -> list[tuple[int, MeasuredNumber]]:
    """Return the numbers with a unit in a formula, each with its place, in time that grows as its length.

    Raises:
        ExpressionError: One stands beside ``*``, ``/`` or ``**``, or has no unit that is known.
    """
    numbers = []
    for match in re.finditer(_MEASURED, text):
        if match[1] in _KEYWORDS:
            continue
        try:
            numbers.append((match.start(), _read(match, text)))
        except ExpressionError as error:
            place = Location("", 1, len(text[: match.start()].encode()) + 1, width=len(match[0]))
            raise error.at(place) from None
    return numbers


def _read(match: re.Match[str], text: str) -> MeasuredNumber:
    written = match[0]
    if not (_ends_term(text[: match.start()]) and _begins_term(text[match.end() :])):
        raise ExpressionError("beside *, / and ** it is not clear where a unit ends",
                              expected="parentheses about the number and its unit", hint=f"({written})")  # fmt: skip
    try:
        value, unit = read_quantity(written)
    except UnitError as error:
        raise ExpressionError(f"this is no number with a unit ({error.message})", expected=error.expected,
                              hint="parentheses about a number and its unit, or * before a name") from None  # fmt: skip
    assert unit is not None
    return MeasuredNumber(value, unit, written)


def _ends_term(before: str) -> bool:
    """Return whether a term of a sum can begin after a text."""
    bare = before.rstrip()
    signless = bare.rstrip("+- ")
    if signless != bare:
        return signless[-1:] not in ("*", "/", "%")
    return bare[-1:] in ("", *"(,<>=") or bare.rsplit(None, 1)[-1] in _KEYWORDS


def _begins_term(after: str) -> bool:
    """Return whether a term of a sum can end before a text."""
    bare = after.lstrip()
    return bare[:1] in ("", *"),+-<>=!") or bare.split(None, 1)[0] in _KEYWORDS

"""Decimal numbers in text, in ASCII digits, read in time linear in the length of the text.

Python's own ``float`` takes Arabic and full-width digits too, and ``1_0`` for 10: in a table or a model these are
mistakes.
"""

from __future__ import annotations

import re

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

"""Where on a run something is asked: the place at which a coordinate has a value, ``{phi: 30 deg, side: left}``."""

from __future__ import annotations

from collections.abc import Mapping

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, Key, within
from pinarm.input.yaml.schema import in_si

Place = str | Mapping[str, str | int | float]
"""A word such as ``max``, or an instant."""


def instant(at: Place) -> dict[str, str | int | float]:
    """Return the coordinate of an instant, and its value; empty for words."""
    given = {} if isinstance(at, str) else at
    return {key: value for key, value in given.items() if key not in ("side", "occurrence")}


def located(at: Mapping[str, str | int | float], quantities: Quantities) -> tuple[str, float]:
    """Return the coordinate of an instant, and its value [SI].

    Args:
        at: The instant.
        quantities: Those of a run; nothing has to be solved.

    Raises:
        InputError: It names no coordinate, or several; there is none of that name; or the value has another dimension.
    """
    named = instant(at)
    if len(named) != 1:
        raise InputError("an instant names one coordinate", expected="such as {t: 1.5 s, side: left}")
    ((along, text),) = named.items()
    with within(Key(along)):
        measured = quantities[along].unit
    with within(along):
        return along, in_si(text, measured)

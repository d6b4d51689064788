"""What runs along the rows of a problem, in messages: its name, and values of it in the unit that people are shown."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from pinarm.input.units import Unit
from pinarm.mechanics.joints import RADIAN

_running: ContextVar[tuple[str, Unit] | None] = ContextVar("running", default=None)


@contextmanager
def running(name: str, measured: Unit) -> Iterator[None]:
    """Let messages of the block name what runs along the rows.

    Args:
        name: ``t``, or the coordinate that is swept.
        measured: Its unit; that of a number where rows are counted, which have no name.
    """
    token = _running.set((name, measured) if str(measured) != "1" else None)
    try:
        yield
    finally:
        _running.reset(token)


def instant(value: float) -> str:
    """Return a value [SI] as ``t = 0.5 s`` or ``C = 30 deg``; the number alone where nothing says what runs."""
    known = _running.get()
    if known is None:
        return f"{value:.9g}"
    name, measured = known
    if measured == RADIAN:
        return f"{name} = {math.degrees(value):.9g} deg"
    return f"{name} = {value:.9g} {measured}"

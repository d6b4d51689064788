"""Progress of work of many runs: what works says where it stands, and the command line shows it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_listener: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)


@contextmanager
def shown_by(show: Callable[[str], None]) -> Iterator[None]:
    """Show the progress of work in the block by a function of a line of text; it ends with an empty line."""
    token = _listener.set(show)
    try:
        yield
    finally:
        _listener.reset(token)
        show("")


def tell(text: str) -> None:
    """Say where work stands, such as ``find: run 12``; nothing happens where nobody shows it."""
    if (show := _listener.get()) is not None:
        show(text)


PAUSE = 0.1
"""Seconds between two lines on the progress of cases."""


def case_progress(show: Callable[[str], None]) -> Callable[[int, int, int], None]:
    """Return a function that shows cases done and failed, and the time that is left, by a function of a line.

    It is called with the numbers of cases that are done, that failed, and of all.
    """
    begin, last = time.monotonic(), -PAUSE

    def progress(done: int, failed: int, total: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last > PAUSE or done == total:
            last, left = now, (now - begin) * (total - done) / done
            show(f"{done}/{total} cases{f', {failed} failed' if failed else ''}, {left:.0f} s left")

    return progress

"""Progress of work of many runs: what works says where it stands, and the command line shows it."""

from __future__ import annotations

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

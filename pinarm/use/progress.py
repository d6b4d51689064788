"""Progress of work of many runs: what works says where it stands, and the command line shows it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import IO

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
"""Seconds between two updates of the bar."""


@contextmanager
def progress_bar(stream: IO[str]) -> Iterator[Callable[[int, int, int], None]]:
    """Show progress with the remaining time, where the stream is a terminal."""
    if not stream.isatty():
        yield lambda done, failed, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(file=stream), transient=True) as bar:
        task, last = bar.add_task("", total=None), 0.0

        def progress(done: int, failed: int, total: int) -> None:
            nonlocal last
            if time.monotonic() - last > PAUSE or done == total:
                last = time.monotonic()
                bar.update(task, completed=done, total=total, description=f"{failed} failed" if failed else "")

        yield progress

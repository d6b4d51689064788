"""Threads of linear algebra: one for the matrices of mechanisms, which are too small for more."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from functools import cache
from typing import Any

SMALL = 16
"""Velocities up to which matrices are too small for OpenBLAS to share them among threads, as it does from 48 rows on:
they have as many rows as velocities and constraints together."""

UNLIMITED = nullcontext()
"""What such matrices are worked on in."""

_limited = ContextVar("limited", default=False)
"""Whether a block of this thread has set the limit: those within it need not ask the libraries again (30 us)."""


def one_blas_thread(nv: int) -> AbstractContextManager[Any]:
    """Let linear algebra use one thread in a ``with`` block, if it would use more for a mechanism of nv velocities.

    Two threads take longer for all matrices up to 256 rows (``docs/speed.md``). What the process used before is
    in force again after the block; environment variables stay as they are. Of blocks in several threads at once, that
    which was the first decides, as the limit is the whole process's.
    """
    return UNLIMITED if nv <= SMALL or _limited.get() else _one_thread()


@contextmanager
def _one_thread() -> Iterator[None]:
    before = _limited.set(True)
    try:
        with _libraries().limit(limits=1):
            yield
    finally:
        _limited.reset(before)


@cache
def _libraries() -> Any:
    """Return the libraries of linear algebra that are loaded."""
    from threadpoolctl import ThreadpoolController  # 10 ms, which small mechanisms need not wait for

    return ThreadpoolController().select(user_api="blas")

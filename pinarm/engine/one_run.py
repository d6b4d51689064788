"""What the parts of one run share, and what is forgotten at its end: another run measures anew, as others would.

Runs of several threads take turns: buffers of a mechanism serve one at a time, and Python's lock does not let two
compute at once in any case.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from threading import RLock
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
T = TypeVar("T")

_kept: list[Any] = []
"""The functions whose values are kept."""


_turn = RLock()
"""Held by the thread that computes."""


def _free_turn() -> None:
    """Let a process that was forked while another thread computed compute itself."""
    global _turn
    _turn = RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_free_turn)


def kept_in_a_run(most: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that keeps the last values of a function, ``most`` of them, until ``one_run`` ends."""

    def keep(compute: Callable[P, T]) -> Callable[P, T]:
        cached = lru_cache(maxsize=most)(compute)
        _kept.append(cached)
        return cast("Callable[P, T]", cached)

    return keep


@contextmanager
def one_run() -> Iterator[None]:
    """Wait for the turn of this thread; forget what has been kept at the end of a ``with`` block."""
    with one_at_a_time():
        try:
            yield
        finally:
            for cached in _kept:
                cached.cache_clear()


def one_at_a_time() -> RLock:
    """Return the lock of what computes with the buffers of a mechanism, for a ``with`` block."""
    return _turn

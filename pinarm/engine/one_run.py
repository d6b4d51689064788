"""What the parts of one run share, and what is forgotten at its end: another run measures anew, as others would."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
T = TypeVar("T")

_kept: list[Any] = []
"""The functions whose values are kept."""


def kept_in_a_run(most: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that keeps the last values of a function, ``most`` of them, until ``one_run`` ends."""

    def keep(compute: Callable[P, T]) -> Callable[P, T]:
        cached = lru_cache(maxsize=most)(compute)
        _kept.append(cached)
        return cast("Callable[P, T]", cached)

    return keep


@contextmanager
def one_run() -> Iterator[None]:
    """Forget what has been kept at the end of a ``with`` block."""
    try:
        yield
    finally:
        for cached in _kept:
            cached.cache_clear()

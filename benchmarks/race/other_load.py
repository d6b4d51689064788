"""How much of the machine other programs use while the race measures."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

import psutil

T = TypeVar("T")

QUIET = 0.5
"""Cores that other programs may use while something is measured: with more it is measured again."""

TICKS = 0.03
"""Processor time that may be that of the race itself, as it is counted in ticks of 10 ms for each process [s]."""

REPEATS = 5
"""How often it is measured again at most; then it counts, and its load is told."""


def quietly(measure: Callable[[], T]) -> tuple[T, float, int]:
    """Return what a function measures, how many cores others used meanwhile, and how often it was repeated."""
    repeated = 0
    while True:
        before = _used()
        found = measure()
        elapsed, machine, own = (now - then for now, then in zip(_used(), before, strict=True))
        others = max(0.0, machine - own - TICKS) / elapsed
        if others <= QUIET or repeated == REPEATS:
            return found, others, repeated
        repeated += 1


def _used() -> tuple[float, float, float]:
    """Return the time, and the processor time that the machine, and this process with all it started, have used [s]."""
    cores, this, own = psutil.cpu_times(), psutil.Process(), 0.0
    idle = sum(getattr(cores, name, 0.0) for name in ("idle", "iowait", "guest", "guest_nice"))  # guests are in user
    for process in (this, *this.children(recursive=True)):
        with suppress(psutil.NoSuchProcess):
            own += sum(process.cpu_times()[:4])  # of those that have ended, too
    return time.perf_counter(), sum(cores) - idle, own

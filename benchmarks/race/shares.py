"""Where pinarm's time goes: what a run is doing at many instants of its computing time."""

from __future__ import annotations

import signal
import time
from collections import defaultdict
from pathlib import Path
from types import FrameType

from benchmarks.race.engines import Run

INTERVAL, LASTING = 1e-3, 2.0
"""Computing time between two looks, and of all of them [s]."""

PHASES = {
    ("driver.py", "integrate"): "steps",
    ("segments.py", "complete"): "rows",
    ("balance.py", "energy_balance"): "energy",
    ("scenario.py", "measured"): "residuals",
}
"""Functions by file and name, and what they do."""

REST = "rest"
NAMES = (*PHASES.values(), REST)


def shares(run: Run) -> dict[str, float]:
    """Return which part of its computing time a run spends on what; they add up to 1.

    A look comes after the call of a library that was under way, however long it took: it counts what passed since the
    last one.
    """
    found = defaultdict[str, float](float)
    last = [time.process_time()]

    def look(number: int, frame: FrameType | None) -> None:
        last.append(time.process_time())
        found[_phase(frame)] += last[-1] - last[-2]

    before = signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, INTERVAL, INTERVAL)
    try:
        begin = time.process_time()
        while time.process_time() - begin < LASTING:
            run()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    return {name: found[name] / sum(found.values()) for name in NAMES}


def _phase(frame: FrameType | None) -> str:
    """Return what the outermost function that is known does."""
    phase = REST
    while frame is not None:
        phase = PHASES.get((Path(frame.f_code.co_filename).name, frame.f_code.co_name), phase)
        frame = frame.f_back
    return phase

"""Progress, statistics and failures of a sweep, as text."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING

from pinarm.use.result.measures import CLOSURES, RESIDUALS, singularity_words
from pinarm.use.show.terminal import aligned
from pinarm.use.store.line_table import statistics_rows
from pinarm.use.study.sweep.solving import Progress

if TYPE_CHECKING:
    from pinarm.use.study.sweep.sweep import Sweep

PAUSE = 0.1
"""Seconds between two looks at the progress."""
SCALED = ("min", "mean", "deviation", "max")
"""Statistics that have the unit of their column."""
SHOWN = 10
"""Reasons of failures that are printed."""


@contextmanager
def progress_bar(stream: IO[str]) -> Iterator[Progress]:
    """Show progress with the remaining time, where the stream is a terminal."""
    if not stream.isatty():
        yield lambda done, failed, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Bar(*columns, console=Console(file=stream), transient=True) as bar:
        shown, last = bar.add_task("", total=None), 0.0

        def progress(done: int, failed: int, total: int) -> None:
            nonlocal last
            if time.monotonic() - last > PAUSE or done == total:
                last = time.monotonic()
                bar.update(shown, completed=done, total=total, description=f"{failed} failed" if failed else "")

        yield progress


def report(sweep: Sweep) -> str:
    """Return the statistics of a sweep and why cases failed, as text."""
    return "\n".join([sweep.title or sweep.name, *aligned(ranges(sweep)), *remarks(sweep)])


def ranges(sweep: Sweep) -> list[list[str]]:
    """Return a heading and the statistics of every result, in the units and by the labels of the scenario."""
    how, entries = sweep.presentation, {}
    for name, entry in sweep.summary()["results"].items():
        scale, unit = how.scale(sweep[name])
        numbers = {key: value * scale if value is not None and key in SCALED else value for key, value in entry.items()}
        entries[how.label(name)] = {**numbers, "unit": str(unit or "?")}
    return statistics_rows("case", entries)


def remarks(sweep: Sweep) -> list[str]:
    """Return what is to be said beside the numbers, a line each: accuracy, notes, and why cases failed."""
    found, lines = sweep.summary(), []
    for head, names in (
        ("accuracy: largest relative residuals", RESIDUALS),
        ("loops [m or rad, s]: largest", CLOSURES),
    ):
        measured = [f"{name} {found['accuracy'][name]:.1e}" for name in names if name in found["accuracy"]]
        lines += [f"{head}: {', '.join(measured)}"] if measured else []
    if "global error" in found["accuracy"]:
        lines.append(f"error: at most {found['accuracy']['global error']:.1e} of the largest value")
    if words := singularity_words(found["accuracy"]):
        lines.append(f"regularity: {words} in the worst case; 0 at a singular position")
    lines += [f"note: {note}" for note in found["notes"]]
    lines.append(f"cases: {found['cases']}" + (f", {found['failed']} failed" if found["failed"] else ""))
    for name, cases in found["missing"].items():
        left = found["results"][name]["cases"]
        said = f"is not finite in some cases ({_counted(len(cases), cases)}); its statistics are over {left}"
        lines.append(f"missing: {name} {said}")
    for failure in found["failures"][:SHOWN]:
        lines.append(f"failed: {failure['reason']} ({_counted(failure['cases'], failure['first'])})")
    if len(found["failures"]) > SHOWN:
        lines.append(f"failed: {len(found['failures']) - SHOWN} more reasons")
    return lines


def _counted(count: int, cases: Sequence[int]) -> str:
    """Return how many cases there are, and the first three of them."""
    return f"{count}: {', '.join(map(str, cases[:3]))}{', ...' if count > 3 else ''}"

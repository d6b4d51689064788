"""Files and texts of a sweep: tables, summary, progress. The same cases give the same bytes, whoever solved them."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.use.cases.case import OPEN
from pinarm.use.output.folder import whole_folder
from pinarm.use.result.measures import CLOSURES, RESIDUALS, singularity_words
from pinarm.use.show.terminal import aligned, counted
from pinarm.use.store.files import json_text, write, yaml_text
from pinarm.use.store.line_table import failures, statistics, statistics_rows
from pinarm.use.study.sweep.journal import JOURNAL
from pinarm.use.study.sweep.parquet import PARQUET, write_parquet
from pinarm.use.study.sweep.solving import Progress

if TYPE_CHECKING:
    from pinarm.use.show.picture_files import PictureFormat
    from pinarm.use.study.sweep.sweep import Sweep

WORST: dict[str, Callable[[Array], Any]] = {
    **dict.fromkeys((*RESIDUALS, *CLOSURES, "condition", "global error"), np.nanmax),
    "regularity": np.nanmin,
    "relative regularity": np.nanmin,
}
"""Measures of accuracy, and which of their values is the worst."""

SHOWN_CASES = 5
"""Number of cases that a note names."""


def save(
    sweep: Sweep, folder: Path, *, plots: PictureFormat | bool = True, dpi: int = 200, parquet: bool = False
) -> Path:
    """Write a sweep.

    The folder gets ``sweep.yaml`` (what was asked), ``cases.csv`` and ``cases.npz`` (a line per case), ``summary.json``
    (statistics and failures), with ``plots`` a picture per result, and with ``parquet`` the table in parts below
    ``cases.parquet``.

    Raises:
        InputError: The folder cannot be written, or holds files that are not an earlier sweep's, or pyarrow is not
            installed.
    """
    source = Path(given) if (given := sweep.definition.get("scenario")) else None
    with whole_folder(folder, "sweep", source=source, beside=(JOURNAL,)) as draft:
        write_tables(sweep, draft, folder)
        if parquet:
            write_parquet(sweep.cases, sweep.columns, sweep.errors, draft / PARQUET)
        if plots:
            from pinarm.use.show.picture_files import write_pictures
            from pinarm.use.study.sweep.plots import pictures

            write_pictures(pictures(sweep), draft / "plots", plots, dpi)
    return folder


def write_tables(sweep: Sweep, draft: Path, folder: Path) -> None:
    """Write the definition, the table and the summary of a sweep to a draft of its folder."""
    write(draft / "sweep.yaml", yaml_text(_definition(sweep, folder)))
    sweep.write(draft, "cases")
    write(draft / "summary.json", json_text(summary(sweep)) + "\n")


def _definition(sweep: Sweep, folder: Path) -> dict[str, Any]:
    """Return what was asked, with files named from the folder."""
    written = dict(sweep.definition)
    for key in ("scenario", "cases"):
        if written.get(key):
            written[key] = os.path.relpath(written[key], folder)
    return {key: value for key, value in written.items() if value is not None}


def summary(sweep: Sweep) -> dict[str, Any]:
    """Return statistics of every result, the worst measures of accuracy, cases without a result, and failures."""
    names = [series.name for series in sweep.columns if series.name in WORST]
    return {
        "scenario": sweep.name,
        "title": sweep.title,
        "cases": len(sweep),
        "failed": len(sweep.errors),
        "results": {series.name: statistics(series) for series in sweep.results()},
        "accuracy": {name: float(WORST[name](sweep[name].values)) for name in names},
        "missing": sweep.missing,
        "failures": failures(sweep.errors),
        "notes": [
            *(f"{series.name}: {series.doubt}" for series in sweep.columns if series.doubt),
            *sweep.notes,
            *_open_cases(sweep),
        ],
    }


def _open_cases(sweep: Sweep) -> list[str]:
    """Return a note of the cases whose results hang on decisions that are not certain; none where there are none."""
    cases = [np.flatnonzero(series.values > 0.0) for series in sweep.columns if series.name == OPEN]
    if not cases or not len(cases[0]):
        return []
    first = ", ".join(map(str, cases[0][:SHOWN_CASES].tolist()))
    more = ", ..." if len(cases[0]) > SHOWN_CASES else ""
    return [
        f"{len(cases[0])} cases hang on decisions that are not certain, such as whether an event takes place: column "
        f"'{OPEN}', and the notes of single runs (cases {first}{more})"
    ]


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
    lines += [f"note: {note}" for note in counted(found["notes"])]
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

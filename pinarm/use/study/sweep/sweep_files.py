"""A sweep as a folder of files. The same cases give the same bytes, whatever the number of workers and pauses."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.use.cases.case import OPEN
from pinarm.use.output.folder import whole_folder
from pinarm.use.result.measures import CLOSURES, RESIDUALS
from pinarm.use.store import case_columns as columns
from pinarm.use.store.files import json_text, write, write_arrays, write_parts, yaml_text
from pinarm.use.study.sweep.journal import JOURNAL

if TYPE_CHECKING:
    from pinarm.use.show.plot import PictureFormat
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
        write(draft / "sweep.yaml", yaml_text(_definition(sweep, folder)))
        lines = columns.csv_lines("case", sweep.written(), sweep.errors)
        write_parts(draft / "cases.csv", (line.encode() for line in lines))
        write_arrays(draft / "cases.npz", columns.arrays(list(sweep.table.values()), sweep.errors))
        if parquet:
            from pinarm.use.study.sweep import parquet_parts

            parquet_parts.write_parts(sweep, draft / parquet_parts.PARQUET)
        write(draft / "summary.json", json_text(summary(sweep)) + "\n")
        if plots:
            from pinarm.use.show.plot import picture_format
            from pinarm.use.study.sweep.plots import save_plots

            save_plots(sweep, draft, picture_format(plots, dpi), dpi)
    return folder


def _definition(sweep: Sweep, folder: Path) -> dict[str, Any]:
    """Return what was asked, with files named from the folder."""
    written = dict(sweep.definition)
    for key in ("scenario", "cases"):
        if written.get(key):
            written[key] = os.path.relpath(written[key], folder)
    return {key: value for key, value in written.items() if value is not None}


def csv(sweep: Sweep) -> str:
    """Return the table as CSV: number of the case, what was varied, results, measures of accuracy, why it failed.

    Those of cases that failed, or do not come to a result, are empty.
    """
    return columns.csv("case", sweep.written(), sweep.errors)


def summary(sweep: Sweep) -> dict[str, Any]:
    """Return the number of cases, the statistics of every result over those that have it, and what others have not.

    With the worst measures of accuracy, and the failures.
    """
    return {
        "scenario": sweep.name,
        "title": sweep.title,
        "cases": len(sweep),
        "failed": len(sweep.errors),
        "results": {series.name: columns.statistics(series) for series in sweep.results()},
        "accuracy": {series.name: worst(series) for series in sweep.columns if series.name in WORST},
        "missing": sweep.missing,
        "failures": columns.failures(sweep.errors),
        "notes": [*(f"{series.name}: {series.doubt}" for series in sweep.columns if series.doubt), *sweep.notes,
                  *_open_cases(sweep)],
    }  # fmt: skip


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


def worst(series: Series) -> float:
    """Return the value of a measure of accuracy that is furthest from what is wanted."""
    return float(WORST[series.name](series.values))

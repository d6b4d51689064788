"""A sweep as a folder of files. The same cases give the same bytes, whatever the number of workers and pauses."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.trajectory import Series
from pinarm.errors import InputError
from pinarm.use.files import cell, json_text, write, write_arrays, yaml_text
from pinarm.use.result import CLOSURES, RESIDUALS

if TYPE_CHECKING:
    from pinarm.use.sweep.study import Sweep

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
WORST: dict[str, Callable[[Array], Any]] = {
    **dict.fromkeys((*RESIDUALS, *CLOSURES, "condition", "global error"), np.nanmax),
    "regularity": np.nanmin,
}
"""Measures of accuracy, and which of their values is the worst."""
QUANTILES = {"5 %": 0.05, "median": 0.5, "95 %": 0.95}


def save(sweep: Sweep, folder: Path, *, plots: bool = True) -> Path:
    """Write a sweep.

    The folder gets ``sweep.yaml`` (what was asked), ``cases.csv``, ``cases.npz`` and, where pyarrow is installed,
    ``cases.parquet`` (a line per case), ``summary.json`` (statistics and failures), and with ``plots`` a picture per
    result.

    Raises:
        InputError: The folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write(folder / "sweep.yaml", yaml_text(_definition(sweep, folder)))
        write(folder / "cases.csv", csv(sweep))
        write_arrays(folder / "cases.npz", _arrays(sweep))
        if find_spec("pyarrow"):
            _write_parquet(sweep, folder / "cases.parquet")
        write(folder / "summary.json", json_text(summary(sweep)) + "\n")
    except OSError as error:
        raise InputError(f"the sweep cannot be written to {folder}: {error.strerror}") from None
    if plots:
        from pinarm.use.sweep.maps import save_plots

        save_plots(sweep, folder)
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

    Numbers have the digits that it takes to read them back; those of cases that failed are empty.
    """
    columns = list(sweep.table.values())
    lines = [",".join(["case", *(cell(series.label) for series in columns), "error"])]
    texts = [[_text(value) for value in series.values.tolist()] for series in columns]
    for case, row in enumerate(zip(*texts, strict=True)):
        lines.append(",".join([str(case), *row, cell(sweep.errors.get(case, ""))]))
    return "\n".join(lines) + "\n"


def _text(value: object) -> str:
    if isinstance(value, float) and math.isnan(value):
        return ""
    return cell(value) if isinstance(value, str) else repr(value)


def _arrays(sweep: Sweep) -> dict[str, Any]:
    columns = {series.name: np.ascontiguousarray(series.values) for series in sweep.table.values()}
    units = np.array([[series.name, str(series.unit or "?")] for series in sweep.table.values()])
    errors = np.array([sweep.errors.get(case, "") for case in range(len(sweep))], dtype=str)
    return {**columns, "error": errors, "units": units}


def _write_parquet(sweep: Sweep, path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    columns: dict[str, Any] = {series.label: series.values for series in sweep.table.values()}
    columns["error"] = [sweep.errors.get(case, "") for case in range(len(sweep))]
    draft = path.with_name(f".{path.name}.part")
    pyarrow.parquet.write_table(pyarrow.table(columns), draft)
    draft.replace(path)


def summary(sweep: Sweep) -> dict[str, Any]:
    """Return the number of cases, the statistics of every result, the worst measures of accuracy, and the failures."""
    return {
        "scenario": sweep.name,
        "title": sweep.title,
        "cases": len(sweep),
        "failed": len(sweep.errors),
        "results": {series.name: statistics(series) for series in sweep.results()},
        "accuracy": {series.name: worst(series) for series in sweep.columns if series.name in WORST},
        "failures": failures(sweep.errors),
        "notes": [f"{series.name}: least multipliers; {series.doubt}" for series in sweep.columns if series.doubt],
    }


def worst(series: Series) -> float:
    """Return the value of a measure of accuracy that is furthest from what is wanted."""
    return float(WORST[series.name](series.values))


def statistics(series: Series) -> dict[str, Any]:
    """Return statistics of a column over the cases that were solved; the standard deviation is that of a sample."""
    solved = np.flatnonzero(np.isfinite(series.values))
    values = series.values[solved]
    found: dict[str, Any] = {"unit": str(series.unit or "?"), "cases": len(values)}
    if not len(values):
        return found
    low, high = int(values.argmin()), int(values.argmax())
    found |= {"min": values[low], "at_min": int(solved[low]), "max": values[high], "at_max": int(solved[high])}
    found |= {"mean": values.mean(), "deviation": values.std(ddof=1) if len(values) > 1 else 0.0}
    found |= {name: np.quantile(values, share) for name, share in QUANTILES.items()}
    return {name: float(value) if isinstance(value, np.floating) else value for name, value in found.items()}


def failures(errors: Mapping[int, str]) -> list[dict[str, Any]]:
    """Return why cases failed: each reason once, as its first case has it, the most frequent first.

    Reasons that differ in their numbers only count as one.
    """
    reasons: dict[str, list[int]] = {}
    for case, error in errors.items():
        reasons.setdefault(_NUMBER.sub("#", error), []).append(case)
    ordered = sorted(reasons.values(), key=lambda cases: (-len(cases), cases[0]))
    return [{"reason": errors[cases[0]], "cases": len(cases), "first": cases[:10]} for cases in ordered]

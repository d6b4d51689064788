"""Files of a sweep: table, summary, plots, Parquet. The same cases give the same bytes, however they were solved."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS
from pinarm.use.cases.case import OPEN, WORTH
from pinarm.use.output.folder import whole_folder, write_file
from pinarm.use.output.manifest import PARTIAL
from pinarm.use.result.measures import CLOSURES, RESIDUALS
from pinarm.use.store.files import json_text, write, yaml_text
from pinarm.use.store.line_table import failures, statistics
from pinarm.use.study.sweep.axes import Cases
from pinarm.use.study.sweep.journal import JOURNAL

if TYPE_CHECKING:
    from pinarm.use.show.picture_files import PictureFormat
    from pinarm.use.study.sweep.sweep import Sweep

WORST: dict[str, Callable[[Array], Any]] = {
    **dict.fromkeys((*RESIDUALS, *CLOSURES, "condition", "global error"), np.nanmax),
    "regularity": np.nanmin,
    "relative regularity": np.nanmin,
}
"""Measures of accuracy, and which of their values is the worst."""

PARQUET = "cases.parquet"
"""Folder of the table as Parquet, in parts, which pandas, pyarrow, Polars and Spark read as one table."""

PART = 10_000
"""Cases of a part, from a multiple of it on, so that its bytes do not depend on the order of the answers: some 1 MB."""

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
            _write_parquet(sweep, draft / PARQUET)
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


def require_parquet() -> None:
    """Raise where Parquet cannot be written.

    Raises:
        InputError: pyarrow is not installed.
    """
    if find_spec("pyarrow") is None:
        raise InputError("Parquet is written by pyarrow, which is not installed", hint="pip install 'pinarm[parquet]'")


class Parts:
    """Parquet of a sweep under way, in ``partial/cases.parquet`` of its folder: a part appears when its cases are done.

    Args:
        folder: That of the sweep. Parts that an earlier sweep left there are removed.
        cases: The values of every case.
        columns: Results and all measures of accuracy, whose values are written while cases are solved.
        errors: Case -> why it failed, likewise.
    """

    def __init__(self, folder: Path, cases: Cases, columns: Sequence[Series], errors: Mapping[int, str]) -> None:
        self.folder, self.cases, self.columns, self.errors = folder / PARTIAL, cases, columns, errors
        self.left = np.array([len(part) for part in _parts(len(cases))])
        with whole_folder(self.folder, "sweep"):
            pass

    def note(self, case: int) -> None:
        """Note that a case is done, and write its part where it is the last one of it."""
        number = case // PART
        self.left[number] -= 1
        if not self.left[number]:
            content = _part(self.cases, self.columns, self.errors, number)
            write_file(self.folder / PARQUET / _name(number), [content], home=self.folder)


def _write_parquet(sweep: Sweep, folder: Path) -> None:
    """Write the table into a new folder: number of the case, the columns of the CSV file in SI, why it failed.

    Raises:
        InputError: pyarrow is not installed.
    """
    require_parquet()
    folder.mkdir()
    known, none = {series.name: series for series in sweep.columns}, np.full(len(sweep), np.nan)
    measures = [known.get(name, Series(name, DIMENSIONLESS, none)) for name in WORTH]
    for number in range(len(_parts(len(sweep)))):
        content = _part(sweep.cases, [*sweep.results(), *measures], sweep.errors, number)
        (folder / _name(number)).write_bytes(content)


def _parts(cases: int) -> list[range]:
    return [range(begin, min(begin + PART, cases)) for begin in range(0, cases, PART)]


def _name(number: int) -> str:
    return f"part-{number:06d}.parquet"


def _part(cases: Cases, columns: Sequence[Series], errors: Mapping[int, str], number: int) -> bytes:
    import pyarrow
    import pyarrow.parquet

    part = _parts(len(cases))[number]
    table: dict[str, Any] = {"case": part}
    table |= {series.label: series.values for series in cases.table(part)}
    table |= {series.label: series.values[part.start : part.stop] for series in columns}
    table["error"] = [errors.get(case, "") for case in part]
    written = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(table), written)
    return written.getvalue()

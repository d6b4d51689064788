"""Table of a sweep as Parquet, in parts: written at once, or part by part while the cases are solved."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS
from pinarm.use.cases.case import WORTH
from pinarm.use.output.folder import whole_folder, write_file
from pinarm.use.output.manifest import PARTIAL
from pinarm.use.study.sweep.axes import Cases

PARQUET = "cases.parquet"
"""Folder of the table as Parquet, in parts, which pandas, pyarrow, Polars and Spark read as one table."""

PART = 10_000
"""Cases of a part, from a multiple of it on, so that its bytes do not depend on the order of the answers: some 1 MB."""


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


def write_parquet(cases: Cases, columns: Sequence[Series], errors: Mapping[int, str], folder: Path) -> None:
    """Write the table into a new folder: number of the case, the columns of the CSV file in SI, why it failed.

    Raises:
        InputError: pyarrow is not installed.
    """
    require_parquet()
    folder.mkdir()
    known, none = {series.name: series for series in columns}, np.full(len(cases), np.nan)
    results = [series for series in columns if series.name not in WORTH]
    measures = [known.get(name, Series(name, DIMENSIONLESS, none)) for name in WORTH]
    for number in range(len(_parts(len(cases)))):
        content = _part(cases, [*results, *measures], errors, number)
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

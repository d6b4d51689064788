"""The table of a sweep as Parquet: a folder of parts, which pandas, pyarrow, Polars and Spark read as one table.

A part has the cases from a multiple of ``PART`` on, so that its bytes do not depend on the order of the answers.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS
from pinarm.use.cases.case import WORTH
from pinarm.use.output.folder import whole_folder, write_file
from pinarm.use.output.manifest import PARTIAL
from pinarm.use.study.sweep.axes import Cases

if TYPE_CHECKING:
    from pinarm.use.study.sweep.sweep import Sweep

PARQUET = "cases.parquet"
"""Name of the folder of parts."""

PART = 10_000
"""Cases of a part: some 1 MB of a table of 16 columns."""


def require_parquet() -> None:
    """Raise where Parquet cannot be written.

    Raises:
        InputError: pyarrow is not installed.
    """
    if find_spec("pyarrow") is None:
        raise InputError("Parquet is written by pyarrow, which is not installed", hint="pip install 'pinarm[parquet]'")


class Parts:
    """The parts of a sweep under way, in ``partial/cases.parquet`` of its folder: each appears when its cases are done.

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
            content = _content(self.cases, self.columns, self.errors, number)
            write_file(self.folder / PARQUET / _name(number), [content], home=self.folder)


def write_parts(sweep: Sweep, folder: Path) -> None:
    """Write the table of a sweep into a new folder, as ``part-000000.parquet`` and so on.

    The columns are the number of the case, those of the CSV file, with their units in the headings, and why it failed;
    numbers of cases that failed are not a number, nor are measures of accuracy that no case has.

    Raises:
        InputError: pyarrow is not installed.
    """
    require_parquet()
    folder.mkdir()
    known = {series.name: series for series in sweep.columns}
    none = np.full(len(sweep), np.nan)
    measures = [known.get(name, Series(name, DIMENSIONLESS, none)) for name in WORTH]
    for number in range(len(_parts(len(sweep)))):
        content = _content(sweep.cases, [*sweep.results(), *measures], sweep.errors, number)
        (folder / _name(number)).write_bytes(content)


def _parts(cases: int) -> list[range]:
    return [range(begin, min(begin + PART, cases)) for begin in range(0, cases, PART)]


def _name(number: int) -> str:
    return f"part-{number:06d}.parquet"


def _content(cases: Cases, columns: Sequence[Series], errors: Mapping[int, str], number: int) -> bytes:
    import pyarrow
    import pyarrow.parquet

    part = range(number * PART, min((number + 1) * PART, len(cases)))
    table: dict[str, Any] = {"case": part}
    table |= {series.label: series.values for series in cases.table(part)}
    table |= {series.label: series.values[part.start : part.stop] for series in columns}
    table["error"] = [errors.get(case, "") for case in part]
    written = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(table), written)
    return written.getvalue()

"""The table of a sweep as Parquet: a folder of parts, which pandas, pyarrow, Polars and Spark read as one table."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinarm.errors import InputError

if TYPE_CHECKING:
    from pinarm.use.study.sweep.sweep import Sweep

PARQUET = "cases.parquet"
"""Name of the folder of parts."""

PART = 100_000
"""Cases of a part: some 10 MB of a table of 16 columns."""


def require_parquet() -> None:
    """Raise where Parquet cannot be written.

    Raises:
        InputError: pyarrow is not installed.
    """
    if find_spec("pyarrow") is None:
        raise InputError("Parquet is written by pyarrow, which is not installed", hint="pip install 'pinarm[parquet]'")


def write_parts(sweep: Sweep, folder: Path) -> None:
    """Write the table of a sweep into a new folder, as ``part-000000.parquet`` and so on.

    The columns are the number of the case, those of the CSV file, with their units in the headings, and why it failed;
    numbers of cases that failed are not a number.

    Raises:
        InputError: pyarrow is not installed.
    """
    require_parquet()
    import pyarrow
    import pyarrow.parquet

    folder.mkdir()
    for number, begin in enumerate(range(0, len(sweep), PART)):
        cases = range(begin, min(begin + PART, len(sweep)))
        columns: dict[str, Any] = {"case": cases}
        columns |= {series.label: series.values[begin : cases.stop] for series in sweep.table.values()}
        columns["error"] = [sweep.errors.get(case, "") for case in cases]
        pyarrow.parquet.write_table(pyarrow.table(columns), folder / f"part-{number:06d}.parquet")

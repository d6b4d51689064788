"""A batch as a folder of files, written motion by motion."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pinarm.engine.series import Series
from pinarm.errors import NumericsError
from pinarm.input.units import DIMENSIONLESS
from pinarm.use.result.measures import COSTS, MEASURES
from pinarm.use.result.result import Result
from pinarm.use.store import case_columns as columns
from pinarm.use.store.files import json_text, write, write_arrays, write_parts
from pinarm.use.store.save import arrays, csv
from pinarm.use.study.batch.block import Block
from pinarm.use.study.batch.reduced_table import ReducedTable

WORTH = (*(name for name in MEASURES if name != "least regular at"), *COSTS)
"""Figures of every motion: what it is worth, and what it cost."""


@dataclass(frozen=True)
class SavedMotion:
    """What is kept of a motion.

    Attributes:
        line: Its line in the table: least and greatest value of every output, then its ``WORTH``.
        error: Why it could not be followed to its end; empty where it was.
        csv: Its table as CSV, in pieces; none where there is no row.
        npz: The same as npz; empty where there is no row.
    """

    line: list[float]
    error: str = ""
    csv: tuple[bytes, ...] = field(default=(), repr=False)
    npz: bytes = field(default=b"", repr=False)

    def write(self, path: Path) -> None:
        """Write the files of the motion, of a path without ending."""
        if self.npz:
            write_parts(path.with_suffix(".csv"), self.csv)
            write_parts(path.with_suffix(".npz"), [self.npz])


def saved(block: Block) -> list[SavedMotion]:
    """Return what is kept of the motions of a block."""
    return [_saved(block, number) for number in range(len(block))]


def _saved(block: Block, number: int) -> SavedMotion:
    outputs, why = block.question.scenario.content.outputs, ""
    try:
        result = block.run(number)
    except NumericsError as error:
        found, why = error.partial, error.message
        if not isinstance(found, Result):
            return SavedMotion([np.nan] * (2 * len(dict.fromkeys(outputs)) + len(WORTH)), why)
        result = found
    table = result.table_columns()
    packed, lines = io.BytesIO(), csv([result.presentation.written(series) for series in table])
    write_arrays(packed, arrays(result, table))
    bounds = [result.quantities.bounds(series.name) for series in result.columns()[1:]]
    extremes = [x for least, greatest in bounds for x in (least.values.min(), greatest.values.max())]
    line = [float(x) for x in (*extremes, *(result.figures.get(name, np.nan) for name in WORTH))]
    return SavedMotion([np.nan if why else x for x in line], why, tuple(lines), packed.getvalue())


def write_table(table: ReducedTable, folder: Path) -> None:
    """Write the table of all motions, and what their numbers are over all of them."""
    write(folder / "motions.csv", table.csv())
    write_arrays(folder / "motions.npz", columns.arrays(table.columns, table.errors))
    write(folder / "summary.json", json_text(table.summary()) + "\n")


def headings(outputs: list[Series]) -> list[Series]:
    """Return the columns of the lines, still empty."""
    named = [(f"{which} {series.name}", series.unit) for series in outputs for which in ("min", "max")]
    return [Series(name, measured, np.zeros(0)) for name, measured in (*named, *((x, DIMENSIONLESS) for x in WORTH))]

"""Reductions of the motions of a block: a few numbers, or the files, of each over the instants that it reached."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.errors import InputError, NumericsError, choices, require_map
from pinarm.input.units import DIMENSIONLESS
from pinarm.use.result.measures import COSTS, MEASURES
from pinarm.use.result.result import Result
from pinarm.use.result.section_number import measured, read_number
from pinarm.use.store.files import write_arrays, write_parts
from pinarm.use.store.save import arrays, csv
from pinarm.use.study.batch.block import Block

WORTH = (*(name for name in MEASURES if name != "least regular at"), *COSTS)
"""Figures of every motion that is saved: accuracy, then cost."""

Measure = str | float
"""A name of ``REDUCTIONS``, or a percentage: the value below which so many of the instants are."""


def _mean(t: Array, x: Array) -> float:
    """Return the mean over time, by the trapezoidal rule."""
    return float(np.trapezoid(x, t) / (t[-1] - t[0])) if len(t) > 1 else float(x[0])


REDUCTIONS: Mapping[str, Callable[[Array, Array], float]] = {
    "min": lambda t, x: x.min(),
    "max": lambda t, x: x.max(),
    "largest": lambda t, x: np.abs(x).max(),
    "mean": _mean,
    "rms": lambda t, x: _mean(t, x * x) ** 0.5,
    "median": lambda t, x: np.percentile(x, 50.0),
    "start": lambda t, x: x[0],
    "end": lambda t, x: x[-1],
}


@dataclass(frozen=True)
class ColumnReduction:
    """One number of every motion: a measure of a quantity, symbol or formula."""

    quantity: str
    measure: Measure

    @classmethod
    def read(cls, given: Mapping[str, Measure | Sequence[Measure]]) -> list[ColumnReduction]:
        """Return the reductions of a map from quantities to one measure, or several.

        Raises:
            InputError: There is no such measure.
        """
        require_map(given, "quantities and measures", "{'A_y': ['max', 95]}")
        reductions = []
        for name, measures in given.items():
            for measure in [measures] if isinstance(measures, str | int | float) else measures:
                if isinstance(measure, str) and measure not in REDUCTIONS:
                    names, hint = choices(measure, REDUCTIONS)
                    expected = f"{names}, or a percentage such as 95"
                    raise InputError(f"there is no measure '{measure}' of {name}", hint=hint, expected=expected)
                if not isinstance(measure, str) and not 0.0 <= measure <= 100.0:
                    raise InputError(f"{measure} is no percentage of {name}", expected="a number from 0 to 100")
                reductions.append(cls(name, measure))
        return reductions

    @property
    def label(self) -> str:
        """Name of the number."""
        share = self.measure if isinstance(self.measure, str) else f"{self.measure:g} %"
        return f"{share} {self.quantity}"

    def of(self, t: Array, x: Array) -> float:
        """Return the number of one motion from its values x at the instants t, both of shape (n,)."""
        if isinstance(self.measure, str):
            return float(REDUCTIONS[self.measure](t, x))
        return float(np.percentile(x, self.measure))


def reduced(block: Block, reductions: Sequence[ColumnReduction]) -> Array:
    """Return the numbers of every motion, shape (b, k); NaN where it was not followed to its end."""
    names = list(dict.fromkeys(reduction.quantity for reduction in reductions))
    values = dict(zip(names, block.values(names), strict=True))
    numbers, reached = np.full((len(block), len(reductions)), np.nan), block.reached
    for motion in range(len(block)):
        here = reached[motion]
        if motion not in block.failures and here.any():
            numbers[motion] = [item.of(block.t[here], values[item.quantity][motion, here]) for item in reductions]
    return numbers


def numbered(block: Block, texts: Sequence[str]) -> list[list[float] | InputError]:
    """Return numbers of every motion as its run tells them, or why it has not all; NaN where it failed."""
    asked, rows = [read_number(text) for text in texts], list[list[float] | InputError]()
    for motion in range(len(block)):
        try:
            result = block.run(motion)
            rows.append([float(measured(number, result)[0].values[0]) for number in asked])
        except NumericsError:
            rows.append([np.nan] * len(asked))
        except InputError as error:
            rows.append(error)
    return rows


@dataclass(frozen=True)
class SavedMotion:
    """Files of a motion.

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
    """Return the files of the motions of a block."""
    return [_saved(block, motion) for motion in range(len(block))]


def _saved(block: Block, motion: int) -> SavedMotion:
    why, outputs = "", dict.fromkeys(block.question.scenario.content.outputs)
    try:
        result = block.run(motion)
    except NumericsError as error:
        why = error.message
        if not isinstance(error.partial, Result):
            return SavedMotion([np.nan] * (2 * len(outputs) + len(WORTH)), why)
        result = error.partial
    table, packed = result.table_columns(), io.BytesIO()
    lines = csv([result.presentation.written(series) for series in table])
    write_arrays(packed, arrays(result, table))
    bounds = [result.quantities.bounds(series.name) for series in result.columns()[1:]]
    extremes = [x for least, greatest in bounds for x in (least.values.min(), greatest.values.max())]
    line = [float(x) for x in (*extremes, *(result.figures.get(name, np.nan) for name in WORTH))]
    return SavedMotion([np.nan if why else x for x in line], why, tuple(lines), packed.getvalue())


def saved_columns(outputs: list[Series], numbers: Array) -> list[Series]:
    """Return the columns of the lines of saved motions, shape (b, columns), without those that no motion has."""
    named = [(f"{which} {series.name}", series.unit) for series in outputs for which in ("min", "max")]
    named += [(name, DIMENSIONLESS) for name in WORTH]
    pairs = zip(named, numbers.T, strict=True)
    return [Series(name, unit, column) for (name, unit), column in pairs if not np.isnan(column).all()]

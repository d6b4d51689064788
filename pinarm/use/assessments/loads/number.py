"""A number of a joint's loads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.use.result.row_lookup import PLATEAU, Lookup


@dataclass(frozen=True)
class LoadNumber:
    """A number, where it stands in the run, and what its quadrature, or the search for its peak, leaves of it.

    Attributes:
        value: The number [SI].
        unit: Its unit.
        at: The instant, or another parameter of the run; ``None`` for numbers of the whole run.
        error: Estimate of what is left [SI]; 0 for numbers of the model.
        doubt: Why it is one choice of many; empty where it is determined.
        direction: Unit vector of the load at its peak, in axes that ``axes`` names; empty where it has none.
        axes: The link.
    """

    value: float
    unit: Unit
    at: float | None = None
    error: float = 0.0
    doubt: str = ""
    direction: str = ""
    axes: str = ""

    @classmethod
    def pure(cls, value: float, error: float = 0.0) -> LoadNumber:
        """Return a number without a unit."""
        return cls(value, DIMENSIONLESS, error=error)

    def series(self, name: str) -> Series:
        """Return it as a series of one value."""
        return Series(name, self.unit, np.array([self.value]), self.doubt)


NOTHING = 1e-9
"""Of the largest force or moment of any joint: below that a component is rounding, and has no worst instant."""

CONSTANT = 1e-9
"""Relative change below which a curve is constant but for rounding, and its peak is at the start."""


def worst_row(run: Lookup, size: Callable[[Quantities], Array], least: float = 0.0) -> tuple[Quantities, float, float]:
    """Return the row of a run at which a size is largest, the first one where it is constant; the size, and its error.

    Args:
        run: The run.
        size: Quantities of n rows -> values that are not negative, shape (n,).
        least: Up to which size it is rounding.
    """
    start = run.at("start", run.run.parameter)
    first = float(size(start)[0])
    worst, error = run.highest(size, "the load", least if float(size(run.quantities).max()) <= least else 0.0)
    largest = float(size(worst)[0])
    if largest <= max(least, (1.0 + CONSTANT) * first):
        return start, first, error + max(largest - first, 0.0)
    return worst, largest, error


def peak(run: Lookup, measured: Unit, size: Callable[[Quantities], Array], least: float = 0.0) -> LoadNumber:
    """Return the largest of a size, see ``worst_row``, and where it is."""
    row, largest, error = worst_row(run, size, least)
    return LoadNumber(largest, measured, float(row.trajectory.grid.t[0]), error)


def rounding(run: Lookup, name: str, series: Series) -> float:
    """Return up to which size a component is rounding [N or N*m]: of the largest of any joint, and of its own terms."""
    part = slice(0, 3) if name.startswith("force") else slice(3, 6)
    largest = float(np.linalg.norm(run.quantities.reactions.joints[..., part], axis=-1).max())
    return max(NOTHING * largest, PLATEAU * float(np.max(series.terms)))

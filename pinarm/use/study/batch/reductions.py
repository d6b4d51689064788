"""What a motion is reduced to: a few numbers of its quantities, over the instants that it reached."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.errors import InputError, NumericsError, choices, require_map
from pinarm.input.units import Unit
from pinarm.use.study.batch.block import Block

Measure = str | float
"""A name of ``MEASURES``, or a percentage: the value below which so many of the instants are."""


def _mean(t: Array, x: Array) -> float:
    """Return the mean over time, by the trapezoidal rule."""
    return float(np.trapezoid(x, t) / (t[-1] - t[0])) if len(t) > 1 else float(x[0])


MEASURES: Mapping[str, Callable[[Array, Array], float]] = {
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
    """One number of every motion.

    Attributes:
        quantity: A quantity, a symbol or a formula.
        measure: What is taken of it.
    """

    quantity: str
    measure: Measure

    @classmethod
    def read(cls, given: Mapping[str, Measure | Sequence[Measure]]) -> list[ColumnReduction]:
        """Return what is reductions, quantity by quantity.

        Raises:
            InputError: There is no such measure.
        """
        require_map(given, "quantities and measures", "{'A_y': ['max', 95]}")
        found = []
        for name, measures in given.items():
            for measure in [measures] if isinstance(measures, str | int | float) else measures:
                if isinstance(measure, str) and measure not in MEASURES:
                    expected, hint = choices(measure, MEASURES)
                    raise InputError(f"there is no measure '{measure}' of {name}", hint=hint,
                                     expected=f"{expected}, or a percentage such as 95")  # fmt: skip
                if not isinstance(measure, str) and not 0.0 <= measure <= 100.0:
                    raise InputError(f"{measure} is no percentage of {name}", expected="a number from 0 to 100")
                found.append(cls(name, measure))
        return found

    @property
    def label(self) -> str:
        """Name of the number."""
        share = self.measure if isinstance(self.measure, str) else f"{self.measure:g} %"
        return f"{share} {self.quantity}"

    def unit(self, known: Mapping[str, Series]) -> Unit | None:
        """Return the unit of the number."""
        return known[self.quantity].unit

    def of(self, t: Array, x: Array) -> float:
        """Return the number of one motion from its values x at the instants t, both of shape (n,)."""
        if isinstance(self.measure, str):
            return float(MEASURES[self.measure](t, x))
        return float(np.percentile(x, self.measure))


def reduced(block: Block, reductions: Sequence[ColumnReduction]) -> Array:
    """Return the numbers of every motion of a block, shape (b, k); none where it was not followed to its end."""
    names = list(dict.fromkeys(one.quantity for one in reductions))
    values = dict(zip(names, block.values(names), strict=True))
    found, reached = np.full((len(block), len(reductions)), np.nan), block.reached
    for number in range(len(block)):
        if number not in block.failures and reached[number].any():
            here = reached[number]
            found[number] = [one.of(block.t[here], values[one.quantity][number, here]) for one in reductions]
    return found


def numbered(block: Block, texts: Sequence[str]) -> list[list[float] | InputError]:
    """Return numbers of every motion of a block as its run tells them, or why it has not all of them.

    A motion that was not followed to its end has none.
    """
    from pinarm.use.result.section_number import measured, read_number

    asked, found = [read_number(text) for text in texts], list[list[float] | InputError]()
    for number in range(len(block)):
        try:
            result = block.run(number)
            found.append([float(measured(one, result)[0].values[0]) for one in asked])
        except NumericsError:
            found.append([np.nan] * len(asked))
        except InputError as error:
            found.append(error)
    return found

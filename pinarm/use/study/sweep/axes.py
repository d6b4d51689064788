"""What varies in a sweep: columns of values, axes of columns that vary together, and all combinations of axes."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.use.cases.case import Value
from pinarm.use.cases.case_table import CaseTable, Column

MOST = 10_000_000
"""Cases of one sweep."""


@dataclass(frozen=True)
class Axis:
    """Paths that vary together.

    Attributes:
        columns: One per path, all of one length.
        drawn: Whether the values were drawn by chance.
    """

    columns: tuple[Column, ...]
    drawn: bool = False

    def __len__(self) -> int:
        return len(self.columns[0].values)


@dataclass(frozen=True)
class Cases:
    """All combinations of the values of axes; the last axis varies fastest."""

    axes: tuple[Axis, ...]

    @classmethod
    def of(cls, axes: Iterable[Axis]) -> Cases:
        """Combine axes.

        Raises:
            InputError: A path stands twice, or there are no cases, or too many.
        """
        cases = cls(tuple(axes))
        paths = [column.path for column in cases.columns()]
        if twice := [path for path, times in Counter(paths).items() if times > 1]:
            raise InputError(f"'{min(twice)}' is varied twice", expected="each path once")
        if not paths:
            raise InputError("nothing is varied", expected="paths of numbers with their values, or a file of cases",
                             hint="--over problem.time.end='1, 2, 3 s', or --cases FILE.csv")  # fmt: skip
        if not 0 < len(cases) <= MOST:
            raise InputError(f"the sweep has {len(cases)} cases", expected=f"1 to {MOST}")
        return cases

    def __len__(self) -> int:
        return math.prod(len(axis) for axis in self.axes)

    def columns(self) -> list[Column]:
        """Return the columns of all axes."""
        return [column for axis in self.axes for column in axis.columns]

    def values(self, case: int) -> dict[str, Value]:
        """Return the values of one case by path."""
        return self.some(np.array([case]))[0]

    def some(self, cases: Indices) -> CaseTable:
        """Return the values of some cases."""
        return CaseTable(tuple(column.some(rows) for column, rows in self._rows(cases)))

    def table(self, cases: range | None = None) -> list[Series]:
        """Return the values of every path over some cases, or all, in the units they were given in."""
        numbers = np.arange(len(self)) if cases is None else np.arange(cases.start, cases.stop)
        return [
            Series(column.path, unit(column.unit or "1"), column.as_array[rows]) for column, rows in self._rows(numbers)
        ]

    def _rows(self, cases: Indices) -> Iterator[tuple[Column, Indices]]:
        """Yield the columns, and which of their values cases have."""
        inner = len(self)
        for axis in self.axes:
            inner //= len(axis)
            rows = cases // inner % len(axis)
            yield from ((column, rows) for column in axis.columns)


@dataclass(frozen=True)
class Distribution:
    """Numbers that are drawn by chance.

    Attributes:
        path: Where in the scenario they go.
        kind: ``normal``, ``uniform`` or ``tolerance``.
        a: Mean, lower bound, or nominal value.
        b: Standard deviation, upper bound, or greatest deviation.
        unit: Of both; empty for none.
    """

    path: str
    kind: str
    a: float
    b: float
    unit: str = ""

    def quantile(self, share: Array) -> Array:
        """Return the values below which given shares of the numbers lie.

        Args:
            share: Between 0 and 1, shape (n,).
        """
        if self.kind == "normal":
            from scipy.special import ndtri

            return np.asarray(self.a + self.b * ndtri(np.maximum(share, np.finfo(float).tiny)))
        low, high = (self.a, self.b) if self.kind == "uniform" else (self.a - self.b, self.a + self.b)
        return low + (high - low) * share


Sampling = Literal["random", "latin"]


def draw(distributions: Sequence[Distribution], samples: int, seed: int, how: Sampling) -> Axis:
    """Draw numbers; the same seed gives the same.

    Args:
        distributions: What is varied, each independently of the others.
        samples: How many cases.
        seed: Of numpy's generator PCG64.
        how: ``random``, or ``latin`` for a Latin hypercube: each value once in each of ``samples`` parts of equal
            probability, which takes fewer cases for the same accuracy of a mean (McKay, Beckman and Conover, 1979).
    """
    generator = np.random.default_rng(seed)
    if how == "latin":
        from scipy.stats.qmc import LatinHypercube

        shares = LatinHypercube(len(distributions), seed=generator).random(samples)
    else:
        shares = generator.random((samples, len(distributions)))
    return Axis(
        tuple(
            Column(each.path, array("d", each.quantile(shares[:, index]).tobytes()), each.unit)
            for index, each in enumerate(distributions)
        ),
        drawn=True,
    )

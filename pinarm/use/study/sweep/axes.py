"""What varies in a sweep: columns of values, axes of columns that vary together, and all combinations of axes."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.use.cases.case import Value

MOST = 10_000_000
"""Cases of one sweep."""


@dataclass(frozen=True)
class Column:
    """The values of one path.

    Attributes:
        path: Where in the scenario they go.
        values: Numbers, or words; many numbers take 8 bytes each in an ``array``.
        unit: Of the numbers; empty for none.
    """

    path: str
    values: Sequence[Value]
    unit: str = ""

    def at(self, row: int) -> Value:
        """Return a value as a scenario file would have it."""
        value = self.values[row]
        return f"{value!r} {self.unit}" if self.unit else value

    @property
    def is_numeric(self) -> bool:
        """Whether the values are numbers."""
        return isinstance(self.values, array) or not any(isinstance(value, str | bool) for value in self.values)

    @cached_property
    def as_array(self) -> Array:
        """The values as numbers, or as words, shape (values,)."""
        return np.array(self.values, float if self.is_numeric else str)


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
        rows: list[int] = []
        for axis in reversed(self.axes):
            case, row = divmod(case, len(axis))
            rows.insert(0, row)
        return {
            column.path: column.at(row) for axis, row in zip(self.axes, rows, strict=True) for column in axis.columns
        }

    def table(self, cases: range | None = None) -> list[Series]:
        """Return the values of every path over some cases, or all, in the units they were given in."""
        cases = range(len(self)) if cases is None else cases
        found, inner = [], len(self)
        for axis in self.axes:
            inner //= len(axis)
            rows = np.arange(cases.start, cases.stop) // inner % len(axis)
            found += [Series(column.path, unit(column.unit or "1"), column.as_array[rows]) for column in axis.columns]
        return found


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

"""Values that vary in a sweep: columns, axes of columns that vary together, all combinations of axes; and their texts.

=============================  =======================================================================================
``20, 40, 60 kg``              these values; words such as names of laws too
``20:100:81 kg``               81 values from 20 kg to 100 kg, evenly spaced, ends included
``normal(0.25, 0.001) m``      mean and standard deviation
``uniform(0.1, 0.5) kg``       between two bounds
``tolerance(0.25, 0.001) m``   0.25 ± 0.001 m, uniform between
=============================  =======================================================================================

A unit stands once, at the end. Numbers without one are in the unit in which the file has the value that they replace,
or in that which the mechanism declares for the argument; where neither has one they stay bare.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.errors import InputError, Location
from pinarm.input.csv_tables import split_heading, table
from pinarm.input.units import DECIMAL, MAX_QUANTITY, is_whole, leading_number, unit
from pinarm.use.cases.case import Value

MOST = 10_000_000
"""Cases of one sweep."""


@dataclass(frozen=True)
class Column:
    """The values of one path.

    Attributes:
        path: Where in the scenario they go.
        unit: Of numbers; empty for none.
    """

    path: str
    values: Sequence[Value]
    unit: str = ""

    def at(self, row: int) -> Value:
        """Return a value as a scenario file would have it."""
        value = self.values[row]
        return f"{value!r} {self.unit}" if self.unit else value

    @cached_property
    def is_numeric(self) -> bool:
        return not any(isinstance(value, str | bool) for value in self.values)

    @cached_property
    def as_array(self) -> Array:
        """The values as numbers, or as words, shape (values,)."""
        return np.asarray(self.values, float if self.is_numeric else str)


@dataclass(frozen=True)
class Axis:
    """Paths that vary together: columns of one length; ``drawn`` where the values were drawn by chance."""

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
        """Combine axes."""
        cases = cls(tuple(axes))
        if not cases.axes:
            raise InputError(
                "nothing is varied",
                expected="paths of numbers with their values, or a file of cases",
                hint="--over problem.time.end='1, 2, 3 s', or --cases FILE.csv",
            )
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
        return {column.path: column.at(row) for axis, row in self._rows(case) for column in axis.columns}

    def table(self) -> list[Series]:
        """Return the values of every path over the cases, in the units they were given in."""
        rows = self._rows(np.arange(len(self)))
        return [Series(x.path, unit(x.unit or "1"), x.as_array[row]) for axis, row in rows for x in axis.columns]

    def _rows(self, cases: Any) -> Iterator[tuple[Axis, Any]]:
        """Yield each axis with its value's place in a case, or in several."""
        inner = len(self)
        for axis in self.axes:
            inner //= len(axis)
            yield axis, cases // inner % len(axis)


@dataclass(frozen=True)
class Distribution:
    """Numbers that are drawn by chance.

    Attributes:
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
        """Return the values below which shares of the numbers lie, between 0 and 1, shape (n,)."""
        if self.kind == "normal":
            from scipy.special import ndtri

            return np.asarray(self.a + self.b * ndtri(np.maximum(share, np.finfo(float).tiny)))
        low, high = (self.a, self.b) if self.kind == "uniform" else (self.a - self.b, self.a + self.b)
        return low + (high - low) * share


Sampling = Literal["random", "latin"]


def draw(distributions: Sequence[Distribution], samples: int, seed: int, how: Sampling) -> Axis:
    """Draw numbers, each independently of the others, by numpy's generator PCG64; the same seed gives the same.

    ``latin`` is a Latin hypercube: each value once in each of ``samples`` parts of equal probability, which takes fewer
    cases for the same accuracy of a mean (McKay, Beckman and Conover, 1979).
    """
    generator = np.random.default_rng(seed)
    if how == "latin":
        from scipy.stats.qmc import LatinHypercube

        shares = LatinHypercube(len(distributions), seed=generator).random(samples)
    else:
        shares = generator.random((samples, len(distributions)))
    pairs = zip(distributions, shares.T, strict=True)
    return Axis(tuple(Column(x.path, x.quantile(share).tolist(), x.unit) for x, share in pairs), drawn=True)


UnitOf = Callable[[str], str]
"""The unit of bare numbers at a path, empty for none."""

_UNIT = re.compile(r"[^\W\d_]|[°%]|1/")
"""Beginning of the unit after a number."""
_BETWEEN = r"\s*+{}\s*+".format
_GRID = re.compile(rf"({DECIMAL}){_BETWEEN(':')}({DECIMAL}){_BETWEEN(':')}([0-9]{{1,9}}+)\s*+(.*)")
_PAIR = rf"({DECIMAL}){_BETWEEN(',')}({DECIMAL})"
_DISTRIBUTION = re.compile(rf"(normal|uniform|tolerance){_BETWEEN('[(]')}{_PAIR}{_BETWEEN('[)]')}(.*)")
"""Of stripped text; no repetition gives back what it took, so that they take linear time."""
_ONE_OR_SEVERAL = re.compile(r",0[0-9]|^0,[0-9]+\s*[^,]*$")
"""A comma between thousands, or in place of the decimal point: ``1,000`` would be 1 and 0, ``0,5`` 0 and 5."""
SHOWN = 60
"""Characters of a value that a message repeats."""
_TRUTH: Mapping[str, bool] = {"true": True, "false": False}


def read_axis(path: str, given: object, unit_of: UnitOf) -> Axis | Distribution:
    """Read what is given for one path: text as in the table above, or a sequence of numbers or texts."""
    try:
        if not isinstance(given, str):
            items = given.tolist() if isinstance(given, np.ndarray) else given
            if not isinstance(items, Sequence) or not items:
                raise InputError(
                    f"'{given}' are no values", expected="a list, an array, or text such as '20:100:81 kg'"
                )
            return Axis((_column(path, [str(item) for item in items], unit_of),))
        given = given.strip()
        if match := _DISTRIBUTION.fullmatch(given):
            return _distribution(path, match, unit_of)
        if match := _GRID.fullmatch(given):
            return Axis((_grid(path, match, unit_of),))
        if "(" in given or ":" in given:
            raise InputError(
                f"'{given[:SHOWN]}' are no values",
                expected="20:100:81 kg, 20, 40 kg, or normal(40, 2) kg",
                hint="the unit once, at the end",
            )
        if _ONE_OR_SEVERAL.search(given):
            raise InputError(
                f"'{given[:SHOWN]}' may be one number or several: a comma is between digits, as in 0,5 and 1,000",
                expected="0.5 kg or 1000 kg for one value; 20, 40 kg for two",
            )
        return Axis((_column(path, given.split(","), unit_of, last=True),))
    except InputError as error:
        raise error.at(Location(f"--over {path}={given}"[:200])) from None


def _distribution(path: str, match: re.Match[str], unit_of: UnitOf) -> Distribution:
    kind, a, b = match[1], float(match[2]), float(match[3])
    if b <= (a if kind == "uniform" else 0.0):
        raise InputError(f"'{match[0].strip()}' has no width", expected="a deviation above 0, or two bounds in order")
    return Distribution(path, kind, a, b, _unit(path, match[4], unit_of))


def _grid(path: str, match: re.Match[str], unit_of: UnitOf) -> Column:
    start, end, count = float(match[1]), float(match[2]), int(match[3])
    if not 2 <= count <= MOST or start == end:
        raise InputError(f"'{match[0].strip()}' is no grid", expected=f"two different ends and 2 to {MOST:,} values")
    values, measured = np.linspace(start, end, count), _unit(path, match[4], unit_of)
    if not measured and is_whole(match[1]) and is_whole(match[2]) and (values == values.round()).all():
        return Column(path, [round(value) for value in values.tolist()])
    return Column(path, values.tolist(), measured)


def _column(path: str, items: Sequence[str], unit_of: UnitOf, *, last: bool = False) -> Column:
    """Return the values that texts say; with ``last`` a unit at the end of the last one is that of all."""
    values, words = [_item(item) for item in items], [item.strip() for item in items]
    if not any(values) and all(words):
        return Column(path, [_TRUTH.get(word, word) for word in words])
    numbers, units = list[int | float](), list[str]()
    for item, parts in zip(words, values, strict=True):
        if parts is None:
            raise InputError(f"'{item[:SHOWN]}' is no number, as others are", expected="all numbers, or all words")
        number, written = parts
        if not math.isfinite(float(number)):
            raise InputError(f"'{item[:SHOWN]}' is beyond all numbers", expected="numbers below 1e308")
        units.append(written)
        numbers.append(int(number) if is_whole(number) and not written else float(number))
    if last and not any(units[:-1]):
        units = [units[-1]] * len(units)
    if len(kinds := {text or "none" for text in units}) > 1:
        raise InputError(f"the values have different units: {', '.join(sorted(kinds))}", expected="20, 40, 60 kg")
    measured = _unit(path, units[0], unit_of)
    return Column(path, [float(number) for number in numbers] if measured else numbers, measured)


def _item(text: str) -> tuple[str, str] | None:
    """Return number and unit of a value as text; ``None`` where it is a word."""
    parts = leading_number(text) if len(text.strip()) <= MAX_QUANTITY else None
    return parts if parts and (not parts[1] or _UNIT.match(parts[1])) else None


def _unit(path: str, written: str, unit_of: UnitOf) -> str:
    if written:
        unit(written)  # raises where there is no such unit
    text = written or unit_of(path)
    return "" if text == "1" else text


def read_cases(path: Path, unit_of: UnitOf) -> Axis:
    """Read a CSV file of cases: a heading with paths and units such as ``arguments.m_A [kg]``, then a case a line."""
    heads, below = table(path, str(path))
    lines = [*below]
    if not lines:
        raise InputError("there are no cases", expected="a heading and at least one line").at(Location(str(path)))
    for line, row in lines:
        if len(row) != len(heads) or not all(map(str.strip, row)):
            place = Location(str(path), line, 1, ",".join(row))
            raise InputError("a value is missing, or one too many", expected=f"{len(heads)} values").at(place)
    columns = []
    for number, (head, *cells) in enumerate(zip(heads, *(row for _, row in lines), strict=True)):
        heading = split_heading(head)
        try:
            if heading is None or not heading[0]:
                raise InputError(f"'{head}' is no heading", expected="a path and its unit: arguments.m_A [kg]")
            measured = _unit(heading[0], heading[1] or "", unit_of)
        except InputError as error:
            raise error.at(Location(str(path), 1, 1, ",".join(heads))) from None
        try:
            columns.append(_column(heading[0], cells, {heading[0]: measured}.__getitem__))
        except InputError as error:
            line, row = next((line for line in lines if not _is_number(line[1][number])), (1, heads))
            raise error.at(Location(str(path), line, 1, ",".join(row))) from None
    return Axis(tuple(columns))


def _is_number(text: str) -> bool:
    item = _item(text)
    return item is not None and math.isfinite(float(item[0]))


def axes_of(
    unit_of: UnitOf,
    over: Mapping[str, object],
    cases: str | Path | None,
    samples: int | None,
    seed: int,
    how: Sampling,
) -> Iterator[Axis]:
    """Yield the axes: the lines of a file, then what is drawn, then each list or grid; see ``sweep``."""
    if cases is not None:
        yield read_cases(Path(cases), unit_of)
    read = [read_axis(path, given, unit_of) for path, given in over.items()]
    drawn = [values for values in read if isinstance(values, Distribution)]
    if drawn and (samples is None or not 1 <= samples <= MOST):
        raise InputError(
            f"'{drawn[0].path}' is to be drawn",
            expected=f"how many samples to draw, 1 to {MOST:,}",
            hint="--sample 1000",
        )
    if seed < 0:
        raise InputError(f"the seed is {seed}", expected="a whole number from 0")
    if (samples is not None or how != "random") and not drawn:
        raise InputError("there is nothing to draw samples of", expected="a distribution, such as normal(0.25, 0.01) m")
    if drawn and samples is not None:
        yield draw(drawn, samples, seed, how)
    yield from (values for values in read if isinstance(values, Axis))

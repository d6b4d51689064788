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
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.series import Series
from pinarm.errors import InputError, Location
from pinarm.input.csv_tables import split_heading, table
from pinarm.input.numbers import DECIMAL, decimals, is_whole, leading_number
from pinarm.input.units import MAX_QUANTITY, unit
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
            Column(distribution.path, array("d", distribution.quantile(shares[:, index]).tobytes()), distribution.unit)
            for index, distribution in enumerate(distributions)
        ),
        drawn=True,
    )


UnitOf = Callable[[str], str]
"""The unit of bare numbers at a path, empty for none."""

_UNIT = re.compile(r"[^\W\d_]|[°%]|1/")
"""Beginning of the unit after a number."""
_BETWEEN = r"\s*+{}\s*+".format
_GRID = re.compile(rf"({DECIMAL}){_BETWEEN(':')}({DECIMAL}){_BETWEEN(':')}([0-9]{{1,9}}+)\s*+(.*)")
_PAIR = rf"({DECIMAL}){_BETWEEN(',')}({DECIMAL})"
_DISTRIBUTION = re.compile(rf"(normal|uniform|tolerance){_BETWEEN('[(]')}{_PAIR}{_BETWEEN('[)]')}(.*)")
"""Of stripped text; no repetition gives back what it took, so that they take linear time."""
_THOUSANDS = re.compile(",0[0-9]")
"""A number that begins with 0 right behind a comma, as thousands do: 1,000 would be 1 and 0."""
SHOWN = 60
"""Characters of a value that a message repeats."""
_TRUTH: Mapping[str, bool] = {"true": True, "false": False}


def read_axis(path: str, given: object, unit_of: UnitOf) -> Axis | Distribution:
    """Read what is given for one path.

    Args:
        path: Where in the scenario the values go.
        given: Text as in the table above, or a sequence of numbers or texts.
        unit_of: The unit of bare numbers.

    Raises:
        InputError: It is none of the forms, or the unit is ambiguous.
    """
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
        if re.fullmatch(r"0,[0-9]+\s*[^,]*", given):
            first, two = given[:SHOWN].replace(",", "."), given[:SHOWN].replace(",", ", ")
            raise InputError(f"'{given[:SHOWN]}' may be one number or two", expected=f"{first}, with a point; or {two}")
        if _THOUSANDS.search(given):
            raise InputError(
                f"'{given[:SHOWN]}' has a comma between thousands, or a number that begins with 0",
                expected="1000 kg for one value, 20, 40 kg for two",
            )
        return Axis((_column(path, given.split(","), unit_of, last=True),))
    except InputError as error:
        raise error.at(Location(f"--over {path}={given}"[:200])) from None


def _distribution(path: str, match: re.Match[str], unit_of: UnitOf) -> Distribution:
    kind, a, b = match[1], float(match[2]), float(match[3])
    if b <= (a if kind == "uniform" else 0.0):
        needed = {
            "normal": "a mean and a standard deviation above 0",
            "uniform": "a lower and an upper bound",
            "tolerance": "a value and a deviation above 0",
        }
        raise InputError(f"'{match[0].strip()}' has no width", expected=needed[kind])
    return Distribution(path, kind, a, b, _unit(path, match[4], unit_of))


def _grid(path: str, match: re.Match[str], unit_of: UnitOf) -> Column:
    start, end, count = float(match[1]), float(match[2]), int(match[3])
    if not 2 <= count <= MOST or start == end:
        raise InputError(f"'{match[0].strip()}' is no grid", expected=f"two different ends and 2 to {MOST:,} values")
    values = np.linspace(start, end, count)
    measured = _unit(path, match[4], unit_of)
    if not measured and is_whole(match[1]) and is_whole(match[2]) and (values == values.round()).all():
        return Column(path, [round(value) for value in values.tolist()])
    return Column(path, array("d", values.tobytes()), measured)


def _column(path: str, items: Sequence[str], unit_of: UnitOf, *, last: bool = False) -> Column:
    """Return the values that texts say; with ``last`` a unit at the end of the last one is that of all."""
    plain = _plain(items)
    if plain is not None:
        measured = _unit(path, "", unit_of)
        return Column(path, array("d", plain) if measured else plain, measured)
    values = [_item(item) for item in items]
    words = [item.strip() for item in items]
    if not any(values) and all(words):
        return Column(path, [_TRUTH.get(word, word) for word in words])
    numbers, units = [], []
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
    if len(set(units)) == 1:
        measured = _unit(path, units[0], unit_of)
        return Column(path, array("d", numbers) if measured else numbers, measured)
    if not all(units):
        raise InputError("some of the values have a unit and some have none", expected="20, 40, 60 kg")
    factors = [unit(text).factor / unit(units[0]).factor for text in units]
    if len({unit(text).dimension for text in units}) > 1:
        raise InputError(f"the units {', '.join(sorted(set(units)))} are of different kinds", expected="one kind")
    return Column(path, [number * factor for number, factor in zip(numbers, factors, strict=True)], units[0])


def _plain(items: Sequence[str]) -> list[int | float] | None:
    """Return the numbers that texts are; ``None`` where one is none, or has a unit."""
    if max(map(len, items)) > MAX_QUANTITY:
        return None
    try:
        numbers = decimals(items)
    except ValueError:
        return None
    if not all(map(math.isfinite, numbers)):
        return None
    if not any(map(float.is_integer, numbers)):
        return numbers
    return [
        int(text) if number.is_integer() and is_whole(text.strip()) else number
        for text, number in zip(items, numbers, strict=True)
    ]


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
    """Read a CSV file of cases: a heading with paths and units such as ``arguments.m_A [kg]``, then a case a line.

    Raises:
        InputError: The file cannot be read or is no such table; the message says where.
    """
    heads, below = table(path, str(path))
    lines = [*below]
    if not lines:
        raise InputError("there are no cases", expected="a heading and at least one line").at(Location(str(path)))
    texts = [*zip(*(row for _, row in lines), strict=False)]
    alike = {len(row) for _, row in lines} == {len(heads)}
    if not alike or not all(all(map(str.strip, cells)) for cells in texts):
        line, row = next(each for each in lines if len(each[1]) != len(heads) or not all(map(str.strip, each[1])))
        place = Location(str(path), line, 1, ",".join(row))
        raise InputError("a value is missing, or one too many", expected=f"{len(heads)} values").at(place)
    columns = []
    for number, (head, cells) in enumerate(zip(heads, texts, strict=True)):
        heading = split_heading(head)
        try:
            if heading is None or not heading[0]:
                raise InputError(f"'{head}' is no heading", expected="a path and its unit: arguments.m_A [kg]")
            measured = _unit(heading[0], heading[1] or "", unit_of)
        except InputError as error:
            raise error.at(Location(str(path), 1, 1, ",".join(heads))) from None
        try:
            columns.append(_column(heading[0], cells, partial(_same, measured)))
        except InputError as error:
            line, row = next((each for each in lines if not _is_number(each[1][number])), (1, heads))
            raise error.at(Location(str(path), line, 1, ",".join(row))) from None
    return Axis(tuple(columns))


def _is_number(text: str) -> bool:
    item = _item(text)
    return item is not None and math.isfinite(float(item[0]))


def _same(measured: str, path: str) -> str:
    return measured


def axes_of(
    unit_of: UnitOf,
    over: Mapping[str, object],
    cases: str | Path | None,
    samples: int | None,
    seed: int,
    how: Sampling,
) -> Iterator[Axis]:
    """Yield the axes: the lines of a file, then what is drawn, then each list or grid.

    Args:
        unit_of: Path -> the unit of bare numbers.
        over: Path -> values; see ``sweep``, as for the others.
        cases: A file of cases.
        samples: How many values to draw.
        seed: Of the drawing.
        how: Of the drawing.

    Raises:
        InputError: Something is to be drawn and it is not said how often, or the other way round.
    """
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

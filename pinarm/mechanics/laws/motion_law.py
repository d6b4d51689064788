"""Laws of motion: a value s with its exact first and second derivatives, over time or over a coordinate.

A law is a sequence of smooth pieces. At a jump of any derivative each side has its own piece, valid up to and including
the instant of the jump, so that the values just before and just after it are both defined.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from bisect import bisect_left, insort
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.errors import InputError, within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import InputStruct, check_unit, measured_fields
from pinarm.records import Record, ValueRecord

FILE_KEYS = {"start": "from", "end": "to"}
"""Field -> key in files, where the key is a Python keyword or would shadow one of its meanings."""

Values = tuple[Array, Array, Array]
"""s, s' and s'' at the same instants, each of shape (n,)."""

SECOND = unit("s")

ROUNDING = 1e-12
"""Difference of instants, relative to the duration, below which they are the same instant."""

ULPS = 32.0
"""Units in the last place by which sums of durations may differ from the instants that they are."""

INSIDE = 1e-3
"""Part of an interval by which ``Grid.moved_inside`` moves its rows: a law that starts with a jerk, or with the fifth
power of the time, has left rest there by 1e-6 or 1e-12 of its range, and has not turned back yet."""

SAMPLES = np.array([0.0, *np.sort(0.5 * (math.sqrt(5.0) - 1.0) * np.arange(1, 8) % 1.0), 1.0])
"""Parts of a piece at which its size is estimated: between its ends multiples of the golden ratio, which are not all at
the zeros of what oscillates."""

JUMP = 1e-9
"""Difference of two sides, relative to the size of s, s' or s'', below which there is no jump."""


class Piece(ValueRecord, frozen=True):
    """A smooth interval of a law.

    Attributes:
        start: First instant [s]; may be ``-inf``.
        end: Last instant [s].
        function: ``t -> s, s', s''``, each of shape (n,).
        knots: Instants within it at which only a higher derivative jumps, as of a spline, ascending [s].
    """

    start: float
    end: float
    function: Callable[[Array], Values]
    knots: tuple[float, ...] = ()

    def size(self) -> Array:
        """Return estimates of the largest |s|, |s'| and |s''|, from 9 samples, shape (3,)."""
        ends = [end for end in (self.start, self.end) if math.isfinite(end)] or [0.0]
        t = ends[0] + (ends[-1] - ends[0]) * SAMPLES
        return np.asarray(np.abs(np.array(self.function(t))).max(axis=1))

    def between(self, low: float, high: float) -> Piece:
        start, end = max(self.start, low), min(self.end, high)
        return Piece(start, end, self.function, tuple(t for t in self.knots if start < t < end))


class PowerSeries(Record, frozen=True):
    """``s(t) = start + size sum_k c_k ((t - origin) / unit)^k`` with its derivatives, as the function of a piece.

    Attributes:
        origin: Where the powers are 0 [s].
        coefficients: c, from the constant one on.
        start: Value where the sum is 0.
        size: Difference to that where the sum is 1.
        unit: Of the powers [s].
    """

    origin: float
    coefficients: tuple[float, ...]
    start: float = 0.0
    size: float = 1.0
    unit: float = 1.0

    def __call__(self, t: Array) -> Values:
        x, (c, dc, ddc) = (np.asarray(t, float) - self.origin) / self.unit, self._derivatives
        rate = self.size / self.unit
        return self.start + self.size * _horner(c, x), rate * _horner(dc, x), rate / self.unit * _horner(ddc, x)

    @cached_property
    def _derivatives(self) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
        c = self.coefficients
        dc = [k * factor for k, factor in enumerate(c)][1:]
        return c, dc, [k * factor for k, factor in enumerate(dc)][1:]


class Wave(Record, frozen=True):
    """``s(t) = start + size (slope x + sin(x + phase))``, x = rate (t - begin), with its derivatives.

    Attributes:
        start: Mean of the wave, where x is 0.
        rate: Angular frequency [rad/s].
        phase: Angle at ``begin`` [rad].
        begin: Where x is 0 [s].
    """

    start: float
    size: float
    slope: float
    rate: float
    phase: float
    begin: float

    def __call__(self, t: Array) -> Values:
        x = self.rate * (t - self.begin)
        s, c = self.size * np.sin(x + self.phase), self.size * np.cos(x + self.phase)
        rise = self.size * self.slope
        return self.start + (rise * x + s), self.rate * (rise + c), -self.rate * (self.rate * s)


def polynomial(origin: float, *coefficients: float) -> PowerSeries:
    """Return ``s(t) = sum_k c_k (t - origin)^k`` with its derivatives."""
    return PowerSeries(float(origin), tuple(float(coefficient) for coefficient in coefficients))


def _horner(c: Sequence[float], x: Array) -> Array:
    total = np.zeros(x.shape)
    for coefficient in c[:0:-1]:
        total += coefficient
        total *= x
    if c:
        total += c[0]
    return total


class MotionLaw(InputStruct, frozen=True, dict=True):
    """Abstract law: the annotations of its fields give their units, ``pieces`` gives the law."""

    @abstractmethod
    def pieces(self) -> Sequence[Piece]:
        """Return the smooth pieces in order, which together cover ``-inf`` to ``inf``."""

    @property
    def may_jump(self) -> bool:
        """Whether it is meant for loads, which may jump."""
        return False

    @property
    def ends(self) -> tuple[float, float]:
        """The first and the last place of what it is given by; infinite where it has a formula for all places."""
        return -math.inf, math.inf

    @cached_property
    def smooth_pieces(self) -> Sequence[Piece]:
        return self.pieces()

    def check_units(self, of: Unit, along: Unit = SECOND) -> None:
        for name, kind in measured_fields(type(self)).items():
            with within(FILE_KEYS.get(name, name)):
                if kind.order is not None:
                    check_unit(getattr(self, name), of / along**kind.order if kind.order else of)
                elif kind.along is not None:
                    check_unit(getattr(self, name), along**kind.along)

    def check_follower(self, name: str, names: Collection[str]) -> None:
        """Check that the law is meant for the coordinate that follows it, where it says for which it is."""

    def breakpoints(self) -> list[float]:
        """Return the instants at which one piece meets the next [s]."""
        return [piece.start for piece in self.smooth_pieces[1:]]

    def knots(self) -> list[float]:
        """Return the instants within its pieces between which it may do anything, as between points of a spline [s]."""
        return [t for piece in self.smooth_pieces for t in piece.knots]

    def jumps(self, *orders: int) -> list[float]:
        """Return the breakpoints at which s, s' or s'' jumps, or those of given orders, not only a higher one [s]."""
        found = []
        for before, after in pairwise(self.smooth_pieces):
            left, right = (np.array(side.function(np.array([after.start])))[:, 0] for side in (before, after))
            jumping = np.abs(left - right) > JUMP * np.maximum(before.size(), after.size())
            if jumping[list(orders) or slice(None)].any():
                found.append(after.start)
        return found

    def require_continuous(self, along: Unit = SECOND) -> None:
        for t in self.jumps(0):
            raise InputError(
                f"the value jumps at {t:.6g} {along}",
                expected="a law without jumps (only loads over time may jump)",
            )

    def on(self, start: float, end: float) -> Callable[[Array], Values]:
        """Return the smooth function that holds between two neighbouring breakpoints, both ends included."""
        place = bisect_left(self.smooth_pieces, 0.5 * (start + end), key=lambda piece: piece.end)
        return self.smooth_pieces[place].function


class Grid(ValueRecord, frozen=True):
    """Instants at which a problem is solved, divided into intervals on which every law is one smooth piece.

    An instant at which s, s' or s'' of a law jumps has two rows: the end of one interval and the start of the next.
    Other cuts, where pieces meet smoothly, have no row of their own; an interval between them may have no row.

    Attributes:
        t: Instants [s], or values of the coordinate swept, shape (n,); of variants that have rows at others, shape
            (n, k), with the cuts of the first.
        cuts: Bounds of the intervals, shape (m + 1,).
        rows: First row of each interval, and n; shape (m + 1,).
    """

    t: Array
    cuts: tuple[float, ...]
    rows: tuple[int, ...]

    @classmethod
    def cover(
        cls, t: Array, laws: Iterable[MotionLaw], jumps: Iterable[float] = (), kinks: Iterable[float] = ()
    ) -> Grid:
        """Return the grid of the given instants, with the jumps of the laws between the first and the last added.

        Breakpoints of laws that only rounding parts from one another, or from an end, are one.

        Args:
            t: Instants, shape (n,).
        """
        first, last, laws, jumps = float(t[0]), float(t[-1]), list(laws), set(jumps)
        slack, fixed = ROUNDING * (last - first), {first, last, *jumps, *kinks}
        place = _places(fixed, {x for law in laws for x in law.breakpoints()})
        doubled = {first, last, *jumps, *(place[x] for law in laws for x in law.jumps())}
        inner = sorted(x for x in {*fixed, *place.values()} if first < x < last)
        cuts = (first, *inner, last)
        if not inner:
            return cls(t, cuts, (0, len(t)))
        parts = [_rows_between(t, start, end, doubled, slack) for start, end in pairwise(cuts)]
        rows = np.cumsum([0, *(len(part) for part in parts)])
        return cls(np.concatenate(parts), cuts, tuple(int(row) for row in rows))

    def intervals(self) -> list[tuple[float, float, slice]]:
        return [
            (start, end, slice(low, high))
            for (start, end), (low, high) in zip(pairwise(self.cuts), pairwise(self.rows), strict=True)
        ]

    def parted(self, jumps: Sequence[float]) -> Grid:
        """Return the grid of ascending instants with two rows at further jumps, which are apart from its cuts."""
        t, cuts, rows = list[Array](), [self.cuts[0]], [0]
        for start, end, own in self.intervals():
            inner, left = [x for x in jumps if start < x < end], self.t[own]
            for jump in inner:
                t, left = [*t, left[left < jump], np.array([jump])], np.array([jump, *left[left > jump]])
                rows.append(sum(map(len, t)))
            t.append(left)
            cuts += [*inner, end]
            rows.append(sum(map(len, t)))
        return Grid(np.concatenate(t), tuple(cuts), tuple(rows))

    def evaluate(self, law: MotionLaw) -> Values:
        parts = [law.on(start, end)(self.t[rows]) for start, end, rows in self.intervals()]
        s, ds, dds = (np.concatenate([part[k] for part in parts]) for k in range(3))
        return s, ds, dds

    def some(self, rows: Indices) -> Grid:
        """Return the grid of some of the rows, in their order, shape (n,); the intervals stay."""
        return Grid(self.t[rows], self.cuts, tuple(int(k) for k in np.searchsorted(rows, self.rows)))

    def sides(self) -> Array:
        """Return -1 for rows at the end of their interval, 1 for all others, shape (n,)."""
        starts, ends = self._bounds()
        span = np.abs(ends - starts)
        return np.where((np.abs(ends - self.t) <= ROUNDING * span) & (span > 0.0), -1.0, 1.0)

    def moved_inside(self, by: Array | None = None) -> Grid:
        """Return the grid with every row a little later, or earlier where its interval ends before.

        Args:
            by: By how much, at most half of the interval, shape (n,); ``INSIDE`` of it where it is left out.
        """
        starts, ends = self._bounds()
        step = INSIDE * (ends - starts) if by is None else np.minimum(by, 0.5 * (ends - starts))
        past = np.sign(step) * (self.t + step - ends) > 0.0
        return Grid(np.where(past, self.t - step, self.t + step), self.cuts, self.rows)

    def _bounds(self) -> tuple[Array, Array]:
        """Return where the interval of every row starts and ends, each of shape (n,)."""
        counts = np.diff(self.rows)
        return np.repeat(self.cuts[:-1], counts), np.repeat(self.cuts[1:], counts)

    def part(self, first: int, last: int) -> Grid:
        low, high = self.rows[first], self.rows[last + 1]
        rows = tuple(row - low for row in self.rows[first : last + 2])
        return Grid(self.t[low:high], self.cuts[first : last + 2], rows)

    def until(self, end: float) -> Grid:
        kept = [(start, min(stop, end), rows) for start, stop, rows in self.intervals() if start < end or start == stop]
        ends = [rows.start + int((self.t[rows] <= end).sum()) for _, _, rows in kept]
        return Grid(self.t[: ends[-1]], (self.cuts[0], *(stop for _, stop, _ in kept)), (0, *ends))


def _places(fixed: set[float], instants: set[float]) -> dict[float, float]:
    """Return for each instant the one that stands for it: a fixed one, or an earlier one, from which rounding parts it.

    The sum of 0.1 s and 0.7 s is 1e-16 s before 0.8 s: between them is no interval that could be integrated.
    """
    known, places = sorted(fixed), dict[float, float]()
    for x in sorted(instants):
        slack = ULPS * math.ulp(x)
        here = bisect_left(known, x - slack)
        places[x] = known[here] if here < len(known) and known[here] <= x + slack else x
        if places[x] == x:
            insort(known, x)
    return places


def _rows_between(t: Array, start: float, end: float, doubled: set[float], slack: float) -> Array:
    """Return the rows of one interval: its ends where they have two rows, and the requested instants between them."""
    below = t < end - slack if end in doubled else t <= end + slack
    inside = t[(t > start + slack) & below]
    return np.concatenate([[start] if start in doubled else [], inside, [end] if end in doubled else []])

"""Functions of a run as Chebyshev polynomials on pieces of it, and their integrals, extremes, percentiles and zeros.

Each number begins with the same first pieces, and halves those in which the polynomials do not tell it: a number does
not depend on the numbers that were asked before. Places where the run may bend or jump, such as points of laws and ends
of steps, are where pieces are halved, if there are any inside. Values that are known elsewhere, such as rows, lie on
the polynomials, or their pieces are halved.

Coefficients of smooth functions fall geometrically, those of a kink as 1/n², those of a jump as 1/n, and those of a
pole not at all. So the last ones are the error of the polynomial.

Source: Trefethen, *Approximation Theory and Approximation Practice*, chapters 3, 7, 8 and 18.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct
from numpy.polynomial import chebyshev

from pinarm.arrays import Array, Flags, Indices, distinct
from pinarm.errors import InputError
from pinarm.records import Record, replace

DEGREE = 16
_ORDERS = np.arange(DEGREE + 1)
_ANGLES = np.stack([np.linspace(-np.pi, 0.0, DEGREE + 1), -np.pi + np.pi * (_ORDERS + 0.5) / (DEGREE + 1)])

NODES: Array = np.cos(_ANGLES)
"""The points at which functions are evaluated, on [-1, 1]: with both ends, and without, shape (2, 17)."""

TO_COEFFICIENTS: Array = np.linalg.inv(np.cos(_ANGLES[..., None] * _ORDERS))
"""Values at the nodes -> coefficients of the Chebyshev polynomials, shape (2, 17, 17): T_n(cos x) = cos(n x)."""

WEIGHTS: Array = np.where(_ORDERS % 2, 0.0, 2.0 / (1.0 - _ORDERS**2 + _ORDERS % 2)) @ TO_COEFFICIENTS
"""Of the values in the integral of the polynomial over [-1, 1] (Clenshaw and Curtis, and Fejér), positive, shape (2,
17).
"""

_DENSE: Array = np.cos(np.outer(np.linspace(0.0, np.pi, 65), _ORDERS))
"""Chebyshev polynomials at 65 points of [-1, 1], shape (65, 17)."""

TAIL, HEAD = slice(-3, None), slice(6, 9)
"""Of the coefficients: the last ones, and those of degree 6 to 8."""

RESOLVED = 1e-8
"""Largest of the last coefficients, relative to how far the values vary: then an extreme of the polynomial is in the
place of that of the function to 1e-8 of the piece, and the value there is the extreme to the square of it."""

FALLING, SINGULAR = 0.1, 0.35
"""Last coefficients relative to those of degree 6 to 8: below the first they fall faster than at a kink, above the
other as slowly as at a pole; at a kink they are a fifth."""

CUSP = 4.0
"""Error of the polynomial relative to its estimate at the root of |x|, whose coefficients fall as n^-1.5."""

KINK, SMOOTH = 3.0, 50.0
"""Error of the integral over half the width and the last coefficients, which 96 % of kinks, corners of roots and jumps
do not exceed wherever they are; and the same over the square of the last coefficients relative to those of degree 6 to
8, where these fall."""

FLAT = 4 * np.finfo(float).eps
"""Relative difference of values that are one value but for rounding."""

REAL = 1e-6
"""Largest imaginary part of roots that count: a double root is split by the root of the rounding."""


class Pieces(Record, frozen=True):
    """Polynomials through k functions on m pieces of a run.

    Attributes:
        interval: Number of the interval of each, shape (m,).
        low: Where each begins, shape (m,).
        high: Where each ends, shape (m,).
        open: Whether the nodes are those without ends: 1 or 0, shape (m,).
        f: The functions at the nodes, shape (m, 17, k).
        off: Largest distance of values that are known elsewhere from the polynomials, shape (m, k).
        least: Error that a polynomial has at least unless its coefficients fall, as the half of another, shape (m, k).
        grown: Size that last coefficients have at least where there is a pole; 0 where nothing is known, shape (m, k).
    """

    interval: Indices
    low: Array
    high: Array
    open: Indices
    f: Array
    off: Array
    least: Array
    grown: Array

    def __len__(self) -> int:
        return len(self.low)

    def some(self, places: Indices | Flags) -> Pieces:
        """Return some of them."""
        return Pieces(*(getattr(self, name)[places] for name in self.__struct_fields__))

    def joined(self, other: Pieces) -> Pieces:
        """Return these and others, in the order of the run."""
        every = [np.concatenate([getattr(x, name) for x in (self, other)]) for name in self.__struct_fields__]
        order = np.lexsort((every[1], every[0]))
        return Pieces(*(part[order] for part in every))

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients of the Chebyshev polynomials, shape (m, 17, k)."""
        return np.asarray(np.einsum("mnp,mpk->mnk", TO_COEFFICIENTS[self.open], self.f))

    @property
    def half(self) -> Array:
        """Half the width of each, shape (m, 1)."""
        return np.asarray(0.5 * (self.high - self.low)[:, None])

    @cached_property
    def tail(self) -> Array:
        """Largest of the last coefficients, shape (m, k)."""
        return np.asarray(np.abs(self.coefficients[:, TAIL]).max(axis=1))

    @cached_property
    def head(self) -> Array:
        """Largest of the coefficients of degree 6 to 8, shape (m, k)."""
        return np.asarray(np.abs(self.coefficients[:, HEAD]).max(axis=1))

    @cached_property
    def error(self) -> Array:
        """Estimate of the largest difference between polynomials and functions, shape (m, k)."""
        return np.asarray(np.maximum(DEGREE * self.tail, self.off))

    @property
    def integrals(self) -> Array:
        """Of the polynomials, shape (m, k)."""
        return np.asarray(self.half * np.einsum("mp,mpk->mk", WEIGHTS[self.open], self.f))

    @property
    def sizes(self) -> Array:
        """Integrals of the sizes of the functions, shape (m, k)."""
        return np.asarray(self.half * np.einsum("mp,mpk->mk", WEIGHTS[self.open], np.abs(self.f)))

    @property
    def integral_errors(self) -> Array:
        """Bounds of the errors of the integrals, values that are known elsewhere left out, shape (m, k)."""
        falls = SMOOTH * self.tail / np.where(self.head > 0.0, self.head, np.inf)
        return np.asarray(self.half * self.tail * np.where(self.head > 0.0, np.minimum(KINK, falls), KINK))

    @property
    def resolved(self) -> Flags:
        """Whether the values vary, and the last coefficients have fallen to where the polynomial is the function."""
        return np.asarray(np.maximum(self.tail, self.off / DEGREE) < RESOLVED * np.ptp(self.f, axis=1))

    @property
    def constant(self) -> Flags:
        """Whether the values differ by rounding only, shape (m, k)."""
        return np.asarray((np.ptp(self.f, axis=1) <= FLAT * np.abs(self.f).max(axis=1)) & (self.off <= 0.0))

    def largest(self, sign: float) -> Array:
        """Return upper bounds of the polynomials times a sign, shape (m, k).

        Between the points of a dense grid they rise by an eighth of the second difference; twice that is allowed for.
        """
        values = sign * np.einsum("dn,mnk->mdk", _DENSE, self.coefficients)
        return np.asarray(values.max(axis=1) + 0.25 * np.abs(np.diff(values, 2, axis=1)).max(axis=1))

    def bounds(self, sign: float) -> Array:
        """Return upper bounds of the functions times a sign, estimated from the polynomials, shape (m, k)."""
        falls = self.tail < FALLING * self.head
        return self.largest(sign) + CUSP * np.where(falls, self.error, np.maximum(self.error, self.least))

    @property
    def is_singular(self) -> Flags:
        """Whether the coefficients fall as slowly as where a function passes through infinity, shape (m, k)."""
        return np.asarray(self.tail > np.maximum(self.grown, SINGULAR * self.head))

    def at(self, piece: Indices, t: Array) -> Array:
        """Return the polynomials of pieces at places, both of shape (n,), as an array of shape (n, k)."""
        x = (2.0 * t - self.low[piece] - self.high[piece]) / (self.high[piece] - self.low[piece])
        waves = np.cos(np.arccos(np.clip(x, -1.0, 1.0))[:, None] * _ORDERS)
        return np.asarray(np.einsum("np,npk->nk", waves, self.coefficients[piece]))

    def _places(self, piece: int, coefficients: Array) -> Array:
        """Return the places in a piece where a series is zero, ascending."""
        roots = chebyshev.chebroots(coefficients)
        real = np.sort(roots.real[np.abs(roots.imag) < REAL])
        low, high = self.low[piece], self.high[piece]
        return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * real[np.abs(real) <= 1.0])

    def extremes(self, piece: int) -> Array:
        """Return the places in a piece where the slope of the first polynomial is zero, ascending."""
        return self._places(piece, np.asarray(chebyshev.chebder(self.coefficients[piece, :, 0]), float))

    def zeros(self, piece: int) -> Array:
        """Return the places in a piece where the first polynomial is zero, ascending."""
        return self._places(piece, self.coefficients[piece, :, 0])

    def slope(self, piece: int, t: float) -> float:
        """Return the derivative of the first polynomial at a place of a piece."""
        low, high = self.low[piece], self.high[piece]
        rate = chebyshev.chebval(
            (2.0 * t - low - high) / (high - low), chebyshev.chebder(self.coefficients[piece, :, 0])
        )
        return float(rate * 2.0 / (high - low))


Spots = Sequence[tuple[int, Array]]
"""Numbers of intervals, and places in each, shape (n,)."""

Values = Callable[[Spots], Sequence[Array]]
"""Places of intervals -> values of k functions there, shape (n, k) each, or (n,) of one function."""

NARROWEST, ULPS = 1e-13, 256.0
"""Part of an interval, and units in the last place of its ends, below which pieces are not halved: their points would
not differ."""

CLOSE = 0.02
"""Width of pieces over the distance of known values from which on the pieces are narrower than what these tell."""

GROWTH, AT_FIRST = 1.25, 0.4
"""Least growth of the last coefficients from a piece to its half at a pole, and from which part of the first ones: they
double at a simple pole, by how close a node happens to be to it; a jump leaves them, and a kink halves them."""

INHERITED = 0.5
"""Part of the error of a piece that is left in its halves at least, unless their coefficients fall: a spike that one
node is close to may be far from all nodes of a half."""

MOST_CUTS = 50
"""Places at most in an interval at which functions are infinite."""

NEIGHBOURS: Array = np.add.outer((0.1127, 0.3819, 0.5, 0.7236, 0.9472), 1e-7 * np.arange(-1.5, 2.0))
"""Points whose differences are rounding, as parts of an interval: five clusters of four, shape (5, 4)."""


class Span(Record, frozen=True):
    """An interval of a run, ascending.

    Attributes:
        number: Its number.
        bounds: Where it is cut into the first pieces, ends included.
        points: Where functions may bend within the first pieces, such as points of laws; integrals are cut there.
        steps: Where they may bend a little, such as ends of steps.
        jumps: Places among bounds and points at which functions may jump: they are not evaluated there.
        sides: Places next to these on both sides.
        t: Where values are known, ascending, shape (n,).
        f: The values, shape (n, k).
    """

    number: int
    bounds: Array
    points: Array
    steps: Array
    jumps: Array
    sides: Array
    t: Array
    f: Array

    @cached_property
    def fine(self) -> Array:
        """Where it is cut for integrals."""
        return distinct(np.concatenate([self.bounds, self.points]))

    @cached_property
    def cuts(self) -> Array:
        """Where pieces are halved."""
        return distinct(np.concatenate([self.points, self.steps]))

    @cached_property
    def gaps(self) -> Array:
        """Distances of known values, shape (n,)."""
        return np.gradient(self.t) if len(self.t) > 1 else np.full(len(self.t), np.inf)

    def after(self, begin: float) -> Span:
        """Return the part of the interval after a place inside it."""
        known = self.t >= begin
        parts = {name: getattr(self, name) for name in ("points", "steps", "jumps", "sides")}
        later = {name: t[t > begin] for name, t in parts.items()}
        bounds = np.append(begin, self.bounds[self.bounds > begin])
        return Span(self.number, bounds, **later, t=self.t[known], f=self.f[known])

    @property
    def length(self) -> float:
        """Of the interval."""
        return float(self.bounds[-1] - self.bounds[0])

    def divisible(self, width: Array) -> Flags:
        """Return a mask of the pieces that can be halved, from their widths."""
        ends = np.abs(self.bounds[[0, -1]]).max()
        return np.asarray(width > max(NARROWEST * self.length, ULPS * math.ulp(float(ends))))


class Curve(Struct, eq=False, dict=True):
    """Functions of a run.

    Attributes:
        values: Evaluates them.
        spans: The intervals that have a length.
    """

    values: Values
    spans: Sequence[Span]
    _kept: dict[tuple[int, float, float], Array] = {}
    soft: dict[int, set[float]] = {}

    @cached_property
    def span(self) -> dict[int, Span]:
        return {span.number: span for span in self.spans}

    def after(self, begin: float) -> Curve:
        """Return the functions from a place on."""
        later = [span for span in self.spans if span.bounds[-1] > begin]
        return Curve(self.values, [span if span.bounds[0] >= begin else span.after(begin) for span in later])

    def first(self, *, fine: bool) -> Pieces:
        """Return the pieces with which a number begins; finer ones are cut at all points where functions may bend."""
        ends = [(span.number, span.fine if fine else span.bounds) for span in self.spans]
        interval = np.repeat([number for number, _ in ends], [len(bounds) - 1 for _, bounds in ends])
        low, high = (np.concatenate([bounds[part] for _, bounds in ends]) for part in (slice(-1), slice(1, None)))
        return self.pieces(interval, low, high)

    def pieces(self, interval: Indices, low: Array, high: Array) -> Pieces:
        """Return the pieces between bounds, each of shape (m,); those with infinite values are cut there.

        Raises:
            InputError: There is no end of places with infinite values.
        """
        while True:
            f = self._evaluated(interval, low, high)
            infinite = np.asarray(~np.isfinite(f).all(axis=2))
            if not infinite.any():
                break
            interval, low, high = self._cut(interval, low, high, infinite)
        nothing = np.zeros((len(low), f.shape[2]))
        pieces = Pieces(interval, low, high, self._open(interval, low, high), f, nothing, nothing, nothing)
        return replace(pieces, off=self._off(pieces))

    def _evaluated(self, interval: Indices, low: Array, high: Array) -> Array:
        """Return the functions at the nodes of pieces, shape (m, 17, k)."""
        spots = [*map(self.places, interval.tolist(), low.tolist(), high.tolist())]
        keys = [(number, float(t[0]), float(t[-1])) for number, t in spots]
        lacking = {key: spot for key, spot in zip(keys, spots, strict=True) if key not in self._kept}
        for key, f in zip(lacking, self.values([*lacking.values()]) if lacking else (), strict=True):
            self._kept[key] = f.reshape(DEGREE + 1, -1)
        return np.array([self._kept[key] for key in keys])

    def _open(self, interval: Indices, low: Array, high: Array) -> Indices:
        """Return 1 for each piece with an end at which functions may jump, 0 for others, shape (m,)."""
        ends = zip(interval.tolist(), low.tolist(), high.tolist(), strict=True)
        return np.array([self._may_jump(k, a) or self._may_jump(k, b) for k, a, b in ends], dtype=np.intp)

    def places(self, interval: int, low: float, high: float) -> tuple[int, Array]:
        """Return where functions are evaluated on a piece."""
        is_open = self._may_jump(interval, low) or self._may_jump(interval, high)
        t = 0.5 * (low + high) + 0.5 * (high - low) * NODES[int(is_open)]
        if not is_open:
            t[0], t[-1] = low, high
        return interval, t

    def _may_jump(self, interval: int, place: float) -> bool:
        if interval not in self.soft:
            self.soft[interval] = set(self.span[interval].jumps.tolist())
        return place in self.soft[interval]

    def _cut(self, interval: Indices, low: Array, high: Array, infinite: Flags) -> tuple[Indices, Array, Array]:
        """Return bounds of pieces with further cuts: at the first infinite value of each piece that has any."""
        more, before = list[tuple[int, float, float]](), {number: {*places} for number, places in self.soft.items()}
        for k in np.flatnonzero(infinite.any(axis=1)).tolist():
            node, number = int(infinite[k].argmax()), int(interval[k])
            place = float(self.places(number, float(low[k]), float(high[k]))[1][node])
            if place in before[number] or len(before[number]) > MOST_CUTS + len(self.span[number].jumps):
                raise InputError(f"it is not finite about {place:.9g}", expected="a quantity that is finite")
            self.soft[number].add(place)
            more += [(number, place, float(high[k]))] if low[k] < place < high[k] else []
            high[k] = place if low[k] < place < high[k] else high[k]
        starts = [np.array([piece[part] for piece in more]) for part in range(3)]
        if not more:
            return interval, low, high
        interval, low, high = (np.concatenate(pair) for pair in zip((interval, low, high), starts, strict=True))
        order = np.lexsort((low, interval))
        return interval[order], low[order], high[order]

    def _off(self, pieces: Pieces) -> Array:
        """Return the largest distance of known values within pieces from the polynomials, shape (m, k)."""
        off = np.zeros_like(pieces.tail)
        for number in distinct(pieces.interval).tolist():
            span, own = self.span[number], np.flatnonzero(pieces.interval == number)
            begin = np.searchsorted(span.t, pieces.low[own], "right")
            count = np.maximum(np.searchsorted(span.t, pieces.high[own], "left") - begin, 0)
            piece = np.repeat(own, count)
            known = np.arange(len(piece)) + np.repeat(begin - np.cumsum(count) + count, count)
            tells = (pieces.high - pieces.low)[piece] > CLOSE * span.gaps[known]
            piece, known = piece[tells], known[tells]
            if len(piece):
                np.maximum.at(off, piece, np.abs(pieces.at(piece, span.t[known]) - span.f[known]))
        return off

    def divisible(self, pieces: Pieces) -> Flags:
        """Return a mask of the pieces that can be halved, shape (m,)."""
        width, flags = pieces.high - pieces.low, np.zeros(len(pieces), bool)
        for number in distinct(pieces.interval).tolist():
            own = pieces.interval == number
            flags[own] = self.span[number].divisible(width[own])
        return flags

    def halves(self, pieces: Pieces) -> Pieces:
        """Return both parts of pieces, in the order of these: cut where functions may bend next to the middle."""
        middle = 0.5 * (pieces.low + pieces.high)
        for k, (number, low, high) in enumerate(zip(pieces.interval.tolist(), pieces.low, pieces.high, strict=True)):
            span = self.span[number]
            inside = span.cuts[np.searchsorted(span.cuts, low, "right") : np.searchsorted(span.cuts, high, "left")]
            inside = inside[span.divisible(inside - low) & span.divisible(high - inside)]
            if len(inside):
                middle[k] = inside[np.abs(inside - middle[k]).argmin()]
        low, high = np.stack([pieces.low, middle], 1).ravel(), np.stack([middle, pieces.high], 1).ravel()
        parts = self.pieces(pieces.interval.repeat(2), low, high)
        of = self._parents(pieces, parts)
        least = INHERITED * np.maximum(pieces.error, pieces.least)
        grown = GROWTH * np.where(pieces.grown > 0.0, pieces.grown, AT_FIRST * pieces.tail)
        return replace(parts, least=least[of], grown=grown[of])

    @staticmethod
    def _parents(pieces: Pieces, parts: Pieces) -> Indices:
        """Return the index of the piece that contains each part, shape (m,)."""
        inside = (parts.low[:, None] >= pieces.low) & (parts.high[:, None] <= pieces.high)
        return np.asarray((inside & (parts.interval[:, None] == pieces.interval)).argmax(axis=1))

    def refined(self, pieces: Pieces, poor: Indices) -> Pieces:
        """Return the pieces with some halved."""
        kept = np.ones(len(pieces), bool)
        kept[poor] = False
        return pieces.some(kept).joined(self.halves(pieces.some(poor)))

    @cached_property
    def noise(self) -> Array:
        """Rounding of the functions, shape (k,): what points next to each other differ by.

        Third differences d of a smooth function over steps of 1e-7 of an interval vanish; of independent errors with
        the deviation s they have the median ``d² = 0.455 · 20 s²``, in which a jump at a cluster has no part.
        """
        ends = np.cumsum([span.length for span in self.spans])
        places = [int(np.searchsorted(ends, part * ends[-1])) for part in NEIGHBOURS[:, 1]]
        spots = [
            (self.spans[k].number, self.spans[k].bounds[0] + self.spans[k].length * parts)
            for k, parts in zip(places, NEIGHBOURS, strict=True)
        ]
        values = np.array([f.reshape(len(t), -1) for f, (_, t) in zip(self.values(spots), spots, strict=True)])
        differences = np.diff(np.where(np.isfinite(values), values, 0.0), 3, axis=1)[:, 0]
        middle = np.sort(differences**2, axis=0)[len(differences) // 2]
        return np.asarray(np.sqrt(middle / 9.1))

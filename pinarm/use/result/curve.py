"""Functions of a run as Chebyshev polynomials on pieces of it; their integrals, percentiles, extremes and zeros.

Each number of a function begins with the same first pieces, and halves those in which the polynomials do not tell it: a
number does not depend on the numbers that were asked before. Pieces are halved at places where the run may bend or
jump, such as points of laws and ends of steps, if there are any inside. Known values, such as rows, lie on the
polynomials, or their pieces are halved.

Coefficients of smooth functions fall geometrically, those of a kink as 1/n², those of a jump as 1/n, and those of a
pole not at all. So the last coefficients are the error of the polynomial.

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
from pinarm.records import Record, ValueRecord, replace

DEGREE = 16
_ORDERS = np.arange(DEGREE + 1)
_ANGLES = np.linspace(-np.pi, 0.0, DEGREE + 1)

NODES: Array = np.cos(_ANGLES)
"""The points of [-1, 1] at which functions are evaluated, both ends among them."""

TO_COEFFICIENTS: Array = np.linalg.inv(np.cos(np.outer(_ANGLES, _ORDERS)))
"""Values at the nodes -> coefficients of the Chebyshev polynomials: T_n(cos x) = cos(n x)."""

WEIGHTS: Array = np.where(_ORDERS % 2, 0.0, 2.0 / (1.0 - _ORDERS**2 + _ORDERS % 2)) @ TO_COEFFICIENTS
"""Of the values in the integral of the polynomial over [-1, 1] (Clenshaw and Curtis), positive."""

_DENSE: Array = np.cos(np.outer(np.linspace(0.0, np.pi, 65), _ORDERS))
"""Chebyshev polynomials at 65 points of [-1, 1], shape (65, 17)."""

RESOLVED = 1e-8
"""Largest of the last coefficients, relative to how far the values vary: then an extreme of the polynomial is in the
place of that of the function to 1e-8 of the piece, and the value there is the extreme to the square of it."""

KINK, SMOOTH = 3.0, 50.0
"""Error of the integral over half the width and the last coefficients, which 96 % of kinks, corners of roots and jumps
do not exceed wherever they are; and the same over the square of the last coefficients relative to those of degree 6 to
8, where these fall."""

FLAT = 4 * np.finfo(float).eps
"""Relative difference of values that are one value but for rounding."""

NARROWEST, ULPS = 1e-13, 256.0
"""Part of an interval, and units in the last place of its ends, below which pieces are not halved: their points would
not differ."""

CLOSE = 0.02
"""Width of pieces over the distance of known values from which on the pieces are narrower than what these tell."""

BESIDE = 1e-14
"""Distance from a jump, relative to the ends of the interval, at which its two sides are evaluated."""

Spots = Sequence[tuple[int, Array]]
"""Numbers of intervals, and places in each, shape (n,)."""

Values = Callable[[Spots], Sequence[Array]]
"""Places of intervals -> values of k functions there, shape (n, k) each, or (n,) of one function."""


class Endless(InputError):
    """A function is infinite at a place, or grows without end towards it."""

    def __init__(self, place: float) -> None:
        super().__init__(f"it is not finite about {place:.9g}", expected="a quantity that is finite")
        self.place = place


class Pieces(Record, frozen=True):
    """Polynomials through k functions on m pieces of a run.

    Attributes:
        interval: Number of the interval of each, shape (m,).
        low: Where each begins, shape (m,).
        high: Where each ends, shape (m,).
        t: The nodes, shape (m, 17).
        f: The functions at the nodes, shape (m, 17, k).
        off: Largest distance of known values from the polynomials, shape (m, k).
    """

    interval: Indices
    low: Array
    high: Array
    t: Array
    f: Array
    off: Array

    def __len__(self) -> int:
        return len(self.low)

    def some(self, places: Indices | Flags) -> Pieces:
        return Pieces(*(getattr(self, name)[places] for name in self.__struct_fields__))

    @cached_property
    def coefficients(self) -> Array:
        return np.asarray(np.einsum("np,mpk->mnk", TO_COEFFICIENTS, self.f))

    @cached_property
    def width(self) -> Array:
        return np.asarray(self.high - self.low)

    @cached_property
    def tail(self) -> Array:
        return np.asarray(np.abs(self.coefficients[:, -3:]).max(axis=1))

    @cached_property
    def error(self) -> Array:
        """Estimate of the largest difference between polynomials and functions, shape (m, k)."""
        return np.asarray(np.maximum(DEGREE * self.tail, self.off))

    def integrals(self, f: Array) -> Array:
        """Return the integrals of functions with values at the nodes, shape (m, k)."""
        return np.asarray(0.5 * self.width[:, None] * np.einsum("p,mpk->mk", WEIGHTS, f))

    @property
    def integral_errors(self) -> Array:
        """Bounds of the errors of the integrals of the polynomials, shape (m, k)."""
        head = np.abs(self.coefficients[:, 6:9]).max(axis=1)
        falls = SMOOTH * self.tail / np.where(head > 0.0, head, np.inf)
        return np.asarray(0.5 * self.width[:, None] * self.tail * np.where(head > 0.0, np.minimum(KINK, falls), KINK))

    @property
    def flat(self) -> Flags:
        """Whether the values differ by rounding only, shape (m, k)."""
        return np.asarray((np.ptp(self.f, axis=1) <= FLAT * np.abs(self.f).max(axis=1)) & (self.off <= 0.0))

    @property
    def known(self) -> Flags:
        """Whether the polynomial is the function: it is flat, or the last coefficients have fallen, shape (m, k)."""
        return np.asarray(self.flat | (np.maximum(self.tail, self.off / DEGREE) < RESOLVED * np.ptp(self.f, axis=1)))

    def largest(self, sign: float = 1.0) -> Array:
        """Return upper bounds of the first polynomials times a sign, shape (m,).

        Between the points of a dense grid they rise by an eighth of the second difference; twice that is allowed for.
        """
        values = sign * self.coefficients[:, :, 0] @ _DENSE.T
        return np.asarray(values.max(axis=1) + 0.25 * np.abs(np.diff(values, 2, axis=1)).max(axis=1))

    def at(self, piece: Indices, t: Array) -> Array:
        x = (2.0 * t - self.low[piece] - self.high[piece]) / self.width[piece]
        waves = np.cos(np.arccos(np.clip(x, -1.0, 1.0))[:, None] * _ORDERS)
        return np.asarray(np.einsum("np,npk->nk", waves, self.coefficients[piece]))

    def zeros(self, piece: int, *, slope: bool = False, level: float = 0.0) -> Array:
        """Return the places in a piece where the first polynomial, or its slope, has a value, ascending."""
        series = self.coefficients[piece, :, 0] - level * (_ORDERS == 0)
        roots = chebyshev.chebroots(chebyshev.chebder(series) if slope else series)
        real = np.sort(roots.real[np.abs(roots.imag) < 1e-6])  # a double root is split by the root of the rounding
        middle, half = 0.5 * (self.low[piece] + self.high[piece]), 0.5 * self.width[piece]
        return np.asarray(middle + half * real[np.abs(real) <= 1.0])

    def turns(self, piece: int) -> Array:
        """Return where the first polynomial of a piece has extremes; none where it is flat."""
        return self.low[:0] if self.flat[piece, 0] else self.zeros(piece, slope=True)

    def below(self, value: float) -> float:
        """Return the length on which the first polynomials are below a value."""
        least, most = -self.largest(-1.0), self.largest()
        length = np.where(most < value, self.width, 0.0)
        for k in np.flatnonzero((least < value) & (value <= most)).tolist():
            bounds = np.concatenate([[self.low[k]], self.zeros(k, level=value), [self.high[k]]])
            middle = 0.5 * (bounds[1:] + bounds[:-1])
            length[k] = np.diff(bounds)[self.at(np.full(len(middle), k), middle)[:, 0] < value].sum()
        return float(length.sum())

    def percentile(self, share: float) -> float:
        from scipy.optimize import brentq

        turns = [self.at(np.full(len(t), k), t)[:, 0] for k in range(len(self)) if len(t := self.turns(k))]
        values = np.concatenate([self.f[:, :, 0].ravel(), *turns])
        low, high, wanted = float(values.min()), float(values.max()), share * float(self.width.sum())
        if low == high or self.below(low) >= wanted:  # at rest rounding of the polynomials is below all their values
            return low
        if self.below(high) <= wanted:
            return high
        return float(brentq(lambda value: self.below(value) - wanted, low, high, xtol=1e-15 * (high - low), rtol=FLAT))


class Span(Record, frozen=True):
    """An interval of a run, ascending.

    Attributes:
        number: Its number.
        bounds: Where it is cut into the first pieces, ends included.
        cuts: Where functions may bend within the first pieces, such as points of laws and ends of steps, ascending.
        jumps: Places among bounds and cuts at which functions may jump.
        t: Where values are known, ascending, shape (n,).
        f: The values, shape (n, k).
    """

    number: int
    bounds: Array
    cuts: Array
    jumps: Array
    t: Array
    f: Array

    @property
    def length(self) -> float:
        return float(self.bounds[-1] - self.bounds[0])

    def after(self, begin: float) -> Span:
        bounds, known = np.append(begin, self.bounds[self.bounds > begin]), self.t >= begin
        return replace(self, bounds=bounds, t=self.t[known], f=self.f[known])

    def divisible(self, width: Array) -> Flags:
        ends = np.abs(self.bounds[[0, -1]]).max()
        return np.asarray(width > max(NARROWEST * self.length, ULPS * math.ulp(float(ends))))

    def nodes(self, low: Array, high: Array) -> Array:
        """Return where functions are evaluated on pieces, shape (m, 17): beside ends at which they may jump."""
        t = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * NODES
        beside = BESIDE * np.abs(self.bounds[[0, -1]]).max()
        t[:, 0] = low + beside * np.isin(low, self.jumps)
        t[:, -1] = high - beside * np.isin(high, self.jumps)
        return t

    def middle(self, low: float, high: float) -> float:
        """Return where a piece is halved: where functions may bend next to the middle, else there."""
        middle = 0.5 * (low + high)
        inside = self.cuts[np.searchsorted(self.cuts, low, "right") : np.searchsorted(self.cuts, high, "left")]
        inside = inside[self.divisible(inside - low) & self.divisible(high - inside)]
        return float(inside[np.abs(inside - middle).argmin()]) if len(inside) else middle


class Curve(Struct, eq=False, dict=True):
    """Functions of a run.

    Attributes:
        source: Evaluates them.
        spans: The intervals that have a length.
        function: What is computed of the values, elementwise.
    """

    source: Values
    spans: Sequence[Span]
    function: Callable[[Array], Array] = np.asarray

    @cached_property
    def span(self) -> dict[int, Span]:
        return {span.number: span for span in self.spans}

    def values(self, spots: Spots) -> list[Array]:
        return [self.function(f) for f in self.source(spots)] if spots else []

    def after(self, begin: float) -> Curve:
        later = [span for span in self.spans if span.bounds[-1] > begin]
        later = [span if span.bounds[0] >= begin else span.after(begin) for span in later]
        return Curve(self.source, later, self.function)

    def of(self, function: Callable[[Array], Array]) -> Curve:
        """Return a function of the functions."""
        spans = [replace(span, f=function(span.f)) for span in self.spans]
        return Curve(self.source, spans, lambda f: function(self.function(f)))

    def first(self, spans: Sequence[Span]) -> Pieces:
        """Return the pieces of some intervals with which a number begins."""
        interval = np.repeat([span.number for span in spans], [len(span.bounds) - 1 for span in spans])
        low, high = (np.concatenate([span.bounds[part] for span in spans]) for part in (slice(-1), slice(1, None)))
        return self._pieces(interval, low, high)

    def _pieces(self, interval: Indices, low: Array, high: Array) -> Pieces:
        """Return the pieces between bounds, each of shape (m,).

        Raises:
            Endless: A function is not finite at a node.
        """
        t = np.empty((len(low), DEGREE + 1))
        for number in distinct(interval).tolist():
            own = interval == number
            t[own] = self.span[number].nodes(low[own], high[own])
        values = self.values([*zip(interval.tolist(), t, strict=True)])
        f = np.array([nodes.reshape(DEGREE + 1, -1) for nodes in values])
        infinite = ~np.isfinite(f).all(axis=2)
        if infinite.any():
            raise Endless(float(t[infinite][0]))
        pieces = Pieces(interval, low, high, t, f, np.zeros((len(low), f.shape[2])))
        return replace(pieces, off=self._off(pieces))

    def _off(self, pieces: Pieces) -> Array:
        """Return the largest distance of known values within pieces from the polynomials, shape (m, k)."""
        off = np.zeros_like(pieces.off)
        for number in distinct(pieces.interval).tolist():
            span, own = self.span[number], np.flatnonzero(pieces.interval == number)
            gaps = np.gradient(span.t) if len(span.t) > 1 else np.full(len(span.t), np.inf)
            piece = own[np.maximum(np.searchsorted(pieces.low[own], span.t, "right") - 1, 0)]
            within = (span.t > pieces.low[piece]) & (span.t < pieces.high[piece])
            known = np.flatnonzero(within & (pieces.width[piece] > CLOSE * gaps))
            piece = piece[known]
            np.maximum.at(off, piece, np.abs(pieces.at(piece, span.t[known]) - span.f[known]))
        return off

    def divisible(self, pieces: Pieces) -> Flags:
        each = zip(pieces.interval.tolist(), pieces.width, strict=True)
        return np.array([self.span[number].divisible(width) for number, width in each], bool)

    def halves(self, pieces: Pieces) -> Pieces:
        """Return both parts of pieces, in the order of these."""
        each = zip(pieces.interval.tolist(), pieces.low.tolist(), pieces.high.tolist(), strict=True)
        middle = np.array([self.span[number].middle(low, high) for number, low, high in each])
        low, high = np.stack([pieces.low, middle], 1).ravel(), np.stack([middle, pieces.high], 1).ravel()
        return self._pieces(pieces.interval.repeat(2), low, high)

    def refined(self, pieces: Pieces, poor: Indices) -> Pieces:
        """Return pieces of which some are halved, in the order of the run."""
        kept = np.ones(len(pieces), bool)
        kept[poor] = False
        both = pieces.some(kept), self.halves(pieces.some(poor))
        every = [np.concatenate([getattr(part, name) for part in both]) for name in pieces.__struct_fields__]
        order = np.lexsort((every[1], every[0]))
        return Pieces(*(part[order] for part in every))

    def heights(self, number: int, t: Array) -> Array:
        (f,) = self.values([(number, t)])
        return np.asarray(f.reshape(len(t), -1)[:, 0])


RELATIVE, ABSOLUTE = 1e-10, 1e-12
"""Errors at which an integral is good enough, relative to itself and to the integral of the size of what is summed."""

UNSEEN = 1e-6
"""Difference of a function of size 1 to its polynomial that the polynomial has not seen."""

NARROW, WIDER, STAYS = 1e-9, (256.0, 4096.0), 0.6
"""Part of an interval from which on pieces are so narrow that there is a pole in the last ones; how much wider the
pieces are that these are compared with; and their integrals over those of wider ones where an integral has no end: 1 at
a simple pole, 1/4 at x^(-5/6), 1/64 at x^(-1/2)."""

ENOUGH, ROUNDING, SHARE = 1e-10, 1e-13, 1e-12
"""Error of a polynomial for a percentile, relative to the range of the function; relative to the largest value; and the
rounding of a share of the length."""


def integrals(curve: Curve, least: float, most: int) -> tuple[Array, Array]:
    """Return the integrals of the functions, and bounds of their errors, both of shape (k,).

    Halving ends where every error is allowed, no piece can be halved, or ``most`` pieces have been evaluated: the
    bounds then tell what is left, infinite where a function has no integral.

    Args:
        curve: The curve.
        least: Size of functions that are not to be told from 0 beside others.
        most: Number of pieces that are evaluated at most, the first ones left out.

    Raises:
        Endless: A function is infinite at a node.
    """
    pieces, length = curve.first(curve.spans), sum(span.length for span in curve.spans)
    while True:
        unseen = np.where(pieces.off > UNSEEN + DEGREE * pieces.tail, pieces.width[:, None] * pieces.off, 0.0)
        total, errors = pieces.integrals(pieces.f).sum(axis=0), pieces.integral_errors + unseen
        error, sizes = errors.sum(axis=0) + errors.max(axis=0), pieces.integrals(np.abs(pieces.f))
        size = np.maximum(sizes.sum(axis=0), max(least * length, 1e-290))
        allowed = ABSOLUTE * size + RELATIVE * np.abs(total)
        poor = _poor(curve, pieces, errors / allowed, most // 2)
        if (error <= allowed).all() or not len(poor):
            return total, error + _left_over(curve, pieces, sizes, error > allowed)
        pieces, most = curve.refined(pieces, poor), most - 2 * len(poor)


def _poor(curve: Curve, pieces: Pieces, errors: Array, most: int) -> Indices:
    """Return the pieces that have to be halved, as few as leave half of the allowed errors, ascending."""
    share = errors.max(axis=1)
    order = share.argsort(kind="stable")
    worst = order[np.cumsum(share[order]) > 0.5]
    return np.sort(worst[curve.divisible(pieces)[worst]][-most:] if most > 0 else worst[:0])


def _left_over(curve: Curve, pieces: Pieces, sizes: Array, poor: Flags) -> Array:
    """Return the part of the narrowest pieces in integrals whose errors are not allowed, shape (k,).

    It is infinite where their part of an integral does not fall.
    """
    share = pieces.width / np.array([curve.span[number].length for number in pieces.interval.tolist()])
    least = float(share.min())
    narrow, wider = share <= min(2.0 * least, NARROW), (share > WIDER[0] * least) & (share < WIDER[1] * least)
    left = np.where(poor, sizes[narrow].sum(axis=0), 0.0)
    stays = sizes[narrow].max(axis=0, initial=0.0) > STAYS * sizes[wider].max(axis=0, initial=0.0)
    return np.where(stays & (left > 0.0), np.inf, left)


def percentile(curve: Curve, share: float, most: int) -> tuple[float, float]:
    """Return the value below which the first function is for a share of the length, and the error of the value.

    Of polynomials the length on which they are below a value is known from where they pass it, and with it the
    percentile, to the error of the polynomials: two functions that differ by e at most have percentiles that differ
    by e at most. ``most`` pieces are evaluated at most, the first ones left out.
    """
    pieces = curve.first(curve.spans)
    while True:
        error, f = pieces.error[:, 0], pieces.f[:, :, 0]
        level = max(ENOUGH * float(np.ptp(f)), ROUNDING * float(np.abs(f).max()))
        poor = np.flatnonzero((error > level) & curve.divisible(pieces))
        most -= 2 * len(poor)
        if not len(poor) or most < 0:
            break
        pieces = curve.refined(pieces, poor)
    unknown = SHARE + float(pieces.width[error > level].sum() / pieces.width.sum())
    apart = pieces.percentile(min(share + unknown, 1.0)) - pieces.percentile(max(share - unknown, 0.0))
    return pieces.percentile(share), min(float(error.max()), level) + apart  # values may jump just at the share


CUSP = 4.0
"""Error of the polynomial relative to its estimate at the root of |x|, whose coefficients fall as n^-1.5."""

HALVINGS, MOST_PIECES, MOST_KINKS = 6, 64, 4
"""Rounds of a search for the largest value in which 64 pieces are halved at most, those that may rise most; in later
rounds, towards kinks and poles, 4 pieces."""

POLE, RISES = NARROW * 3.0 ** -np.arange(9.0), 0.1
"""Distances from a place, as parts of the interval, towards which heights grow without end at a pole, and the part of
the height within them from which on it is a pole, or a peak as narrow as one."""


class Peak(ValueRecord, frozen=True):
    """A height of a function, and where it is.

    Attributes:
        height: The height.
        interval: Number of the interval.
        place: Where in it.
        error: By how much the function may be above it elsewhere.
    """

    height: float
    interval: int
    place: float
    error: float = 0.0


def highest(curve: Curve, sign: float, top: Peak, slack: float) -> Peak:
    """Return the largest value of the first function times a sign.

    Pieces are halved as long as their polynomials, with the error that the last coefficients tell, may rise above the
    largest value so far.

    Args:
        curve: The curve.
        sign: 1, or -1 for the smallest value of the function.
        top: A height that is known.
        slack: Difference of heights that does not matter.

    Raises:
        Endless: There is none, as the function passes through infinity.
    """
    if not curve.spans:
        return top
    known = np.concatenate([sign * span.f[:, 0] for span in curve.spans])
    values = np.append(known[np.isfinite(known)], top.height)
    floor = float(2.0 * values.min() - values.max())  # lower ones, down to poles on the other side, do not matter
    curve = curve.of(lambda f: np.maximum(sign * f, floor))
    seen = Peak(-np.inf, 0, 0.0)
    for span in (span for span in curve.spans if len(span.t)):
        seen = _higher(seen, span.number, span.t, span.f)
    pieces, rounds, left = curve.first(curve.spans), 0, 0.0
    while len(pieces):
        seen = _seen(curve, seen, pieces)
        level, bounds = max(top.height, seen.height) + slack, pieces.largest() + CUSP * pieces.error[:, 0]
        within = (pieces.interval == seen.interval) & (pieces.low <= seen.place) & (seen.place <= pieces.high)
        rising = np.flatnonzero((within & (bounds < seen.height - slack)) | (~pieces.known[:, 0] & (bounds > level)))
        wide = curve.divisible(pieces.some(rising))
        if not wide.all():
            _require_end(curve, seen, floor)
            left = max(left, *(_fall(pieces.f[k, :, 0]) for k in rising[~wide]))
        rising = rising[wide][np.argsort(-bounds[rising[wide]], kind="stable")]
        rising = np.sort(rising[: MOST_PIECES if rounds < HALVINGS else MOST_KINKS])
        pieces, rounds = curve.halves(pieces.some(rising)) if len(rising) else pieces.some(rising), rounds + 1
    return replace(seen if seen.height > top.height else top, error=left)


def _seen(curve: Curve, top: Peak, pieces: Pieces) -> Peak:
    """Return the largest value at nodes of pieces, and at extremes of polynomials that are the function."""
    piece = int(pieces.f[:, :, 0].max(axis=1).argmax())
    top = _higher(top, int(pieces.interval[piece]), pieces.t[piece], pieces.f[piece])
    spots = list[tuple[int, Array]]()
    for k in np.flatnonzero(pieces.known[:, 0] & (pieces.largest() + 4.0 * pieces.error[:, 0] > top.height)).tolist():
        if len(turns := pieces.turns(k)):
            best = pieces.at(np.full(len(turns), k), turns)[:, 0].argmax()
            spots.append((int(pieces.interval[k]), turns[[best]]))
    for (interval, t), f in zip(spots, curve.values(spots), strict=True):
        top = _higher(top, interval, t, f)
    return top


def _higher(top: Peak, interval: int, t: Array, f: Array) -> Peak:
    """Return the largest of values at places of an interval, or one that is known."""
    heights = f.reshape(len(t), -1)[:, 0]
    k = int(heights.argmax())
    return Peak(float(heights[k]), interval, float(t[k])) if heights[k] > top.height else top


def _require_end(curve: Curve, top: Peak, floor: float) -> None:
    """Raise where the function grows without end towards its highest place, from one side at least."""
    span = curve.span[top.interval]
    for way in (-span.length, span.length):
        t = np.clip(top.place + way * POLE, *span.bounds[[0, -1]])
        heights = np.append(curve.heights(top.interval, t), top.height)
        grows = (np.diff(heights) > 0.0).all()
        if grows and top.height - heights[0] > RISES * max(abs(top.height), top.height - floor):
            raise Endless(top.place)


def _fall(heights: Array) -> float:
    """Return by how much heights fall beside the largest, on the side of a jump that it is on."""
    peak = int(heights.argmax())
    beside = heights[[k for k in (peak - 2, peak + 2) if 0 <= k < len(heights)]]
    return float(heights[peak] - beside.max())


CROSSING_ROUNDS = 5
"""Rounds of halving of pieces in which two zeros may be unseen."""

TOUCHES, CONTINUOUS, ONE, NEAR = 1e-12, 1e-4, 1e-4, 1e-9
"""Height of an extreme, relative to the largest value, at which a function touches zero; value at a change of sign,
relative to those beside it, below which it is 0 there and does not jump over 0; part of the whole within which zeros
are one where the function is 0 between them; and part from a place to those on both sides of it."""


def zeros(curve: Curve, number: int, places: Array, level: float = 0.0) -> list[float]:
    """Return where the first function has a value in an interval, ascending; not where it jumps over the value.

    Places between which it has the value are one, told by the first.

    Args:
        curve: The curve.
        number: The interval.
        places: Where it is looked at besides, ascending, both ends of the interval among them.
        level: The value.
    """
    t, gaps = looked_at(curve, number, places, level)
    left, slack = list[float](), TOUCHES * float(np.abs(gaps).max(initial=0.0))
    for place in sorted([*t[gaps == 0.0].tolist(), *crossings(curve, number, t, gaps, level)]):
        near = left and place - left[-1] <= ONE * float(t[-1] - t[0])
        if not near or abs(curve.heights(number, np.array([0.5 * (place + left[-1])]))[0] - level) > slack:
            left.append(place)
    return left


def zeros_of_angle(curve: Curve, number: int, places: Array, level: float) -> list[float]:
    """Return where an angle has a value that is told between -180 and 180 deg, and jumps at these.

    The sine of the difference does not jump. Of its zeros those count beside which the angle has the value: others are
    half a turn or whole turns away.
    """
    near = NEAR * float(places[-1] - places[0]) * np.array([-1.0, 0.0, 1.0])
    return [
        place
        for place in zeros(curve.of(lambda f: np.sin(f - level)), number, places)
        if np.abs(curve.heights(number, np.clip(place + near, places[0], places[-1])) - level).min() < 1.0
    ]


def looked_at(curve: Curve, number: int, places: Array, level: float) -> tuple[Array, Array]:
    """Return places between which the function is taken to have the value once at most, and its gaps there."""
    t, gaps = [places], [curve.heights(number, places) - level]
    pieces = curve.first([curve.span[number]]) if number in curve.span else None
    for _ in range(CROSSING_ROUNDS + 1 if pieces else 0):
        assert pieces is not None
        pieces = pieces.some(~pieces.flat[:, 0])  # a rest has no zeros within
        t, gaps = [*t, pieces.t.ravel()], [*gaps, pieces.f[:, :, 0].ravel() - level]
        turns = [pieces.turns(k) for k in np.flatnonzero(pieces.known[:, 0]).tolist()]
        if len(tops := np.concatenate([*turns, places[:0]])):
            heights, size = curve.heights(number, tops) - level, max(np.abs(x).max(initial=0.0) for x in gaps)
            t, gaps = [*t, tops], [*gaps, np.where(np.abs(heights) > TOUCHES * size, heights, 0.0)]
        unsure = np.flatnonzero(_may_cross_unseen(pieces, level))
        if not len(unsure):
            break
        pieces = curve.halves(pieces.some(unsure))
    every, first = np.unique(np.concatenate(t), return_index=True)
    return every, np.concatenate(gaps)[first]


def _may_cross_unseen(pieces: Pieces, level: float) -> Flags:
    """Tell where a function may have a value twice between two nodes of a piece, whose extremes are not known."""
    f, margin = pieces.f[:, :, 0] - level, CUSP * pieces.error[:, 0]
    passing = (f.min(axis=1) <= 0.0) & (f.max(axis=1) >= 0.0)
    above = f.mean(axis=1) > 0.0
    nearest = np.where(above, pieces.largest(-1.0) + level, pieces.largest() - level)
    return np.asarray(~pieces.known[:, 0] & (passing | (nearest + margin >= 0.0)))


def crossings(curve: Curve, number: int, t: Array, gaps: Array, level: float) -> list[float]:
    """Return where the first function passes a value between places, of which the gaps are known, both of shape (n,).

    It has opposite gaps on both sides; where it jumps over the value is left out.
    """
    k = np.flatnonzero(gaps[:-1] * gaps[1:] < 0.0)
    places = roots(curve, number, t[k], t[k + 1], level)
    left = np.abs(curve.heights(number, places) - level) if len(k) else places
    return [*places[left <= CONTINUOUS * np.maximum(np.abs(gaps[k]), np.abs(gaps[k + 1]))].tolist()]


def roots(curve: Curve, number: int, low: Array, high: Array, level: float) -> Array:
    """Return where the first function has a value between places at which its gaps have opposite signs, shape (n,)."""
    if not len(low):
        return low
    from scipy.optimize.elementwise import find_root

    places = np.asarray(find_root(lambda t: curve.heights(number, t) - level, (low, high)).x)
    return np.where(np.isnan(places), low, places)  # solved beside other states an end may have the other sign

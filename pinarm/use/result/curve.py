"""Functions of a run as Chebyshev polynomials on pieces of it.

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
from pinarm.records import Record, replace

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
            begin = np.searchsorted(span.t, pieces.low[own], "right")
            count = np.maximum(np.searchsorted(span.t, pieces.high[own], "left") - begin, 0)
            piece = np.repeat(own, count)
            known = np.arange(len(piece)) + np.repeat(begin - np.cumsum(count) + count, count)
            tells = pieces.width[piece] > CLOSE * gaps[known]
            piece, known = piece[tells], known[tells]
            if len(piece):
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

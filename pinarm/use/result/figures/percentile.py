"""The value below which a curve lies for a share of its length, from polynomials on pieces of it.

A piece is halved until the Chebyshev polynomial of degree 16 through its values is the curve, and what is known of that
elsewhere, as rows of a table are, lies on it. Of polynomials the length on which they are below a value is known from
where they pass it, and with it the percentile, to the error of the polynomials: two curves that differ by e at most
have percentiles that differ by e at most.

Source: Trefethen, *Approximation Theory and Approximation Practice*, chapters 3, 7 and 8: coefficients of smooth curves
fall geometrically, those of a kink as 1/n², those of a jump as 1/n; what follows the last ones is of their size times
their number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Flags, distinct
from pinarm.records import Record, ValueRecord
from pinarm.use.result.figures.bracket_fit import BracketFit

FIRST, ROUNDS, MOST = 3, 40, 1024
"""Pieces of an interval at first; how often they are halved, and how many are halved in all."""

ENOUGH = 1e-10
"""Error of a piece, relative to the range of the curve, at which it is not halved."""

ROUNDING = 1e-13
"""Error of a piece, relative to the largest value, below which it is rounding of the curve."""

NEAR, HALVINGS = 1e-15, 60
"""Of a value, of the range of values, and of the length of a piece: to that they are looked for; steps at most."""


class SmoothCurve(ValueRecord, frozen=True):
    """A curve between two jumps.

    Attributes:
        low: Where it begins.
        high: Where it ends.
        at: Places, shape (n,) -> values there.
        cuts: Between which it is smooth, and does not change much.
        known: Places at which values are known, ascending, shape (m,).
        values: These values, shape (m,).
    """

    low: float
    high: float
    at: Callable[[Array], Array]
    cuts: Sequence[float]
    known: Array
    values: Array

    def off(self, fit: BracketFit) -> float:
        """Return how far known values within a polynomial's bracket are from it at most."""
        own = slice(*np.searchsorted(self.known, [fit.low, fit.high]).tolist())
        return float(np.abs(fit.at(self.known[own]) - self.values[own]).max(initial=0.0))


class CurvePiece(Record, frozen=True):
    """A curve between two places.

    Attributes:
        fit: The polynomial through its values.
        error: How far it may be from the curve.
    """

    fit: BracketFit
    error: float

    @property
    def length(self) -> float:
        """Of the piece."""
        return self.fit.high - self.fit.low

    @cached_property
    def turns(self) -> tuple[Array, Array]:
        """Places between which the polynomial rises or falls, and its values there, each of shape (n,)."""
        places = np.concatenate([[self.fit.low], self.fit.extremes, [self.fit.high]])
        return places, self.fit.at(places)


class CurveArcs(ValueRecord, frozen=True):
    """Polynomials between the places where they turn: each rises or falls from its one end to the other.

    Attributes:
        coefficients: Of Chebyshev polynomials on [-1, 1], shape (17, n).
        half: Half the length of what is [-1, 1] there, shape (n,).
        ends: Where the arcs begin and end in it, shape (2, n).
        values: Those at the ends, shape (2, n).
    """

    coefficients: Array
    half: Array
    ends: Array
    values: Array

    @classmethod
    def of(cls, pieces: Sequence[CurvePiece]) -> CurveArcs:
        """Return the arcs of pieces."""
        counts, fits = [len(piece.turns[0]) - 1 for piece in pieces], [piece.fit for piece in pieces]
        middle = np.repeat([0.5 * (fit.high + fit.low) for fit in fits], counts)
        half = np.repeat([0.5 * (fit.high - fit.low) for fit in fits], counts)
        coefficients = np.repeat([fit.coefficients for fit in fits], counts, axis=0).T
        places, values = (
            np.array([np.concatenate([turns[side] for turns in found]) for side in (slice(-1), slice(1, None))])
            for found in zip(*(piece.turns for piece in pieces), strict=True)
        )
        return cls(coefficients, half, (places - middle) / half, values)

    def below(self, value: float) -> float:
        """Return the length on which the polynomials are below a value."""
        least, most = self.values.min(axis=0), self.values.max(axis=0)
        passing = (least < value) & (value <= most)
        share = np.where(most < value, self.ends[1] - self.ends[0], 0.0)
        low, high = self.ends[:, passing]
        rising, place = self.values[1, passing] > self.values[0, passing], self._crossings(passing, value)
        share[passing] = np.where(rising, place - low, high - place)
        return float(share @ self.half)

    def _crossings(self, passing: Flags, value: float) -> Array:
        """Return where passing arcs have a value, shape (m,), by Newton's method; by bisection where it leaves them."""
        from numpy.polynomial import chebyshev

        curves = self.coefficients[:, passing].copy()
        curves[0] -= value
        slopes = np.asarray(chebyshev.chebder(curves), float)
        (low, high), rising = self.ends[:, passing].copy(), self.values[1, passing] > self.values[0, passing]
        place = 0.5 * (low + high)
        for _ in range(HALVINGS):
            beyond = np.asarray(chebyshev.chebval(place, curves, tensor=False))
            before = (beyond < 0.0) == rising
            low, high = np.where(before, place, low), np.where(before, high, place)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = beyond / np.asarray(chebyshev.chebval(place, slopes, tensor=False))
            found = (np.abs(step) <= NEAR) | (beyond == 0.0)
            if found.all():
                break
            moved = place - step
            place = np.where(found, place, np.where((low < moved) & (moved < high), moved, 0.5 * (low + high)))
        return np.asarray(place)


def percentile(curves: Sequence[SmoothCurve], share: float) -> tuple[float, float]:
    """Return the value below which a curve is for a share of its length, and the error of the value.

    Args:
        curves: The curve, between its jumps.
        share: Between 0 and 1.
    """
    pieces = [piece for curve in curves for piece in _pieces(curve)]
    arcs, rough = CurveArcs.of(pieces), max(piece.error for piece in pieces)
    value = _value(arcs, share)
    level = _level(pieces)
    unknown = sum(piece.length for piece in pieces if piece.error > level) / sum(piece.length for piece in pieces)
    if not unknown:
        return value, min(rough, level)
    ends = (_value(arcs, min(share + unknown, 1.0)), _value(arcs, max(share - unknown, 0.0)))
    return value, min(rough, level + ends[0] - ends[1])


def _pieces(curve: SmoothCurve) -> list[CurvePiece]:
    """Return the pieces of a curve, in no order."""
    cuts = distinct(np.concatenate([np.linspace(curve.low, curve.high, FIRST + 1), curve.cuts]))
    done, pending, halved = list[CurvePiece](), _fitted(cuts[:-1], cuts[1:], curve), 0
    for _ in range(ROUNDS):
        level = _level([*done, *pending])
        rough = [piece for piece in pending if piece.error > level]
        done += [piece for piece in pending if piece.error <= level]
        halved += len(rough)
        if not rough or halved > MOST + len(cuts):
            return [*done, *rough]
        ends = np.array([(piece.fit.low, piece.fit.high) for piece in rough])
        middle = ends.mean(axis=1)
        lows, highs = np.sort([[*ends[:, 0], *middle], [*middle, *ends[:, 1]]], axis=1)
        pending = _fitted(lows, highs, curve)
    return [*done, *pending]


def _level(pieces: Sequence[CurvePiece]) -> float:
    """Return the error of a piece at which it is not halved: ``ENOUGH``, or rounding where the curve is constant."""
    values = np.concatenate([piece.fit.values for piece in pieces])
    return max(ENOUGH * float(np.ptp(values)), ROUNDING * float(np.abs(values).max()))


def _fitted(lows: Array, highs: Array, curve: SmoothCurve) -> list[CurvePiece]:
    """Return pieces between places, each of shape (n,) and in order."""
    places = [BracketFit.places(low, high) for low, high in zip(lows.tolist(), highs.tolist(), strict=True)]
    values = curve.at(np.concatenate(places)).reshape(len(places), -1)
    fits = [BracketFit(t[0], t[-1], x) for t, x in zip(places, values, strict=True)]
    return [CurvePiece(fit, max(fit.error, curve.off(fit))) for fit in fits]


def _value(arcs: CurveArcs, share: float) -> float:
    """Return the value below which polynomials are for a share of their length."""
    from scipy.optimize import brentq

    low, high = float(arcs.values.min()), float(arcs.values.max())
    wanted = share * float((arcs.ends[1] - arcs.ends[0]) @ arcs.half)

    def excess(value: float) -> float:
        return arcs.below(value) - wanted

    if low == high or wanted <= 0.0 or excess(high) <= 0.0:
        return low if wanted <= 0.0 else high
    return float(brentq(excess, low, high, xtol=NEAR * (high - low), rtol=NEAR))

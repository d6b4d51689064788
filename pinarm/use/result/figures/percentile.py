"""The value below which a curve lies for a share of its length, from polynomials on pieces of it.

A piece is halved until the Chebyshev polynomial of degree 16 through its values is the curve. Of polynomials the length
on which they are below a value is known from their roots, and with it the percentile, to the error of the polynomials:
two curves that differ by e at most have percentiles that differ by e at most.

Source: Trefethen, *Approximation Theory and Approximation Practice*, chapters 3, 7 and 8: coefficients of smooth curves
fall geometrically, those of a kink as 1/n², those of a jump as 1/n; what follows the last ones is of their size times
their number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from pinarm.arrays import Array
from pinarm.records import Record
from pinarm.use.result.figures.bracket_fit import BracketFit

FIRST, ROUNDS, MOST = 3, 40, 512
"""Pieces of an interval at first; how often they are halved, and how many are halved in all."""

ENOUGH = 1e-10
"""Error of a piece, relative to the range of the curve, at which it is not halved."""

ROUNDING = 1e-13
"""Error of a piece, relative to the largest value, below which it is rounding of the curve."""

HALVINGS = 60
"""Of the range of values: then a value is known to rounding."""


class CurvePiece(Record, frozen=True):
    """A curve between two places.

    Attributes:
        fit: The polynomial through its values.
    """

    fit: BracketFit

    @property
    def length(self) -> float:
        """Of the piece."""
        return self.fit.high - self.fit.low

    @cached_property
    def turns(self) -> tuple[Array, Array]:
        """Places between which the polynomial rises or falls, and its values there, each of shape (n,)."""
        places = np.concatenate([[self.fit.low], self.fit.extremes, [self.fit.high]])
        return places, self.fit.at(places)

    def below(self, value: float) -> float:
        """Return the length on which the polynomial is below a value."""
        places, values = self.turns
        if value <= values.min():
            return 0.0
        if value > values.max():
            return self.length
        shifted = BracketFit(self.fit.low, self.fit.high, self.fit.values - value)
        cuts = np.sort(np.concatenate([places, shifted.crossings()]))
        middles = 0.5 * (cuts[1:] + cuts[:-1])
        return float(np.diff(cuts)[shifted.at(middles) < 0.0].sum())


def percentile(intervals: Sequence[tuple[float, float, Callable[[Array], Array]]], share: float) -> tuple[float, float]:
    """Return the value below which a curve is for a share of its length, and the error of the value.

    Args:
        intervals: Start, end and the curve as a function of places, shape (n,), of the intervals between its jumps.
        share: Between 0 and 1.
    """
    pieces = [piece for start, end, curve in intervals
              for piece in _pieces(min(start, end), max(start, end), curve)]  # fmt: skip
    value, rough = _value(pieces, share), max(piece.fit.error for piece in pieces)
    level = _level(pieces)
    unknown = sum(piece.length for piece in pieces if piece.fit.error > level) / sum(piece.length for piece in pieces)
    ends = (_value(pieces, min(share + unknown, 1.0)), _value(pieces, max(share - unknown, 0.0)))
    return value, min(rough, level + ends[0] - ends[1])


def _pieces(low: float, high: float, curve: Callable[[Array], Array]) -> list[CurvePiece]:
    """Return the pieces of one interval, in no order."""
    cuts = np.linspace(low, high, FIRST + 1)
    done, pending, halved = list[CurvePiece](), _fitted(cuts[:-1], cuts[1:], curve), 0
    for _ in range(ROUNDS):
        level = _level([*done, *pending])
        rough = [piece for piece in pending if piece.fit.error > level]
        done += [piece for piece in pending if piece.fit.error <= level]
        halved += len(rough)
        if not rough or halved > MOST:
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


def _fitted(lows: Array, highs: Array, curve: Callable[[Array], Array]) -> list[CurvePiece]:
    """Return pieces between places, each of shape (n,) and in order."""
    places = [BracketFit.places(low, high) for low, high in zip(lows.tolist(), highs.tolist(), strict=True)]
    values = curve(np.concatenate(places)).reshape(len(places), -1)
    return [CurvePiece(BracketFit(t[0], t[-1], x)) for t, x in zip(places, values, strict=True)]


def _value(pieces: Sequence[CurvePiece], share: float) -> float:
    """Return the value below which the polynomials are for a share of their length, by bisection."""
    values = np.concatenate([piece.turns[1] for piece in pieces])
    low, high = float(values.min()), float(values.max())
    wanted = share * sum(piece.length for piece in pieces)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if sum(piece.below(middle) for piece in pieces) < wanted:
            low = middle
        else:
            high = middle
    return high if share > 0.0 else float(values.min())

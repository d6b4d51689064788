"""The largest value of a curve, looked for in pieces of it: by polynomials, and halving where these may miss it.

A piece is halved as long as the Chebyshev polynomial through its values, with what its last coefficients say of its
error, may rise above the largest value so far. Where that has not ended after ``HALVINGS`` there is a kink, at which
the piece is narrowed to rounding, or a pole, at which values grow without end.

Source: Trefethen, *Approximation Theory and Approximation Practice*, chapters 7 and 8: the coefficients of smooth
curves fall geometrically, those of a kink as 1/n², those of a jump as 1/n, and those of a pole not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from pinarm.arrays import Array
from pinarm.records import Record, ValueRecord
from pinarm.use.result.figures.bracket_fit import FLAT, BracketFit
from pinarm.use.result.figures.crossings import POINTS

HALVINGS = 6
"""How often a piece is halved where 17 states do not resolve the curve: it goes up and down in it, or has a kink."""

MOST_PIECES = 64
"""Pieces that are looked into at once at most: those that may rise most."""

MOST_KINKS = 8
"""Pieces that are narrowed at most: those that may rise most."""

ROUNDS, WINDOW = 14, 3
"""How often a piece is narrowed, each time to an eighth: beyond the digits of a double; and in how many of these rounds
the rise of a curve is compared with that before."""

SPACING = 64 * np.finfo(float).eps
"""Distance of places, relative to their size, below which values differ by the rounding of the places."""

GROWTH, AT_FIRST = 1.25, 0.4
"""Least growth of the last coefficients from a piece to its half at a pole, and from which part of the first ones: they
double at a simple pole, by how close a node happens to be to it; a jump leaves them, and a kink halves them."""

FALLS = 0.5
"""Part of the error of a piece that is left in its halves at least, unless their coefficients fall: a spike that one
node is close to may be far from all nodes of a half."""

ENDLESS = 0.5
"""Part of a rise that follows it without end towards a pole: 500 times at a simple one, all of it at a logarithm; at a
kink a 500th."""

RISES = 1e-3
"""First rise, relative to the height, below which values grow by their rounding only where they do."""

Bracket = tuple[float, float]
"""Two places of one interval, ascending."""

Spots = Sequence[tuple[int, Array]]
"""Numbers of intervals, and places in each, shape (n,)."""

Curve = Callable[[Spots], Sequence[Array]]
"""Places of intervals -> heights there, shape (n,) each."""


class Endless(Exception):
    """A curve has no largest value.

    Attributes:
        place: Where it grows without end.
    """

    def __init__(self, place: float) -> None:
        self.place = place


class Peak(ValueRecord, frozen=True):
    """A height of a curve, and where it is.

    Attributes:
        height: The height.
        interval: Number of the interval.
        place: Where in it.
        error: By how much the curve may be above it: the place is known to rounding only, and so little does not count.
    """

    height: float
    interval: int
    place: float
    error: float = 0.0


class CurvePart(ValueRecord, frozen=True):
    """A part of one interval.

    Attributes:
        interval: Number of the interval.
        bracket: Where it begins and ends.
        grown: Size that its last coefficients have at least where it has a pole; 0 where nothing is known of it.
        error: Error that its polynomial has at least unless its coefficients fall, as that of what it is a half of.
    """

    interval: int
    bracket: Bracket
    grown: float = 0.0
    error: float = 0.0

    @property
    def places(self) -> tuple[int, Array]:
        """The interval, and where the curve is evaluated, shape (17,)."""
        return self.interval, BracketFit.places(*self.bracket)

    def halves(self, fit: BracketFit) -> list[CurvePart]:
        """Return both halves; the polynomial of the whole is given."""
        low, high = self.bracket
        middle, grown = 0.5 * (low + high), GROWTH * (self.grown or AT_FIRST * fit.tail)
        error = FALLS * max(fit.error, self.error)
        return [CurvePart(self.interval, half, grown, error) for half in ((low, middle), (middle, high))]

    def bound(self, fit: BracketFit) -> float:
        """Return what the curve does not exceed in it as far as the polynomial through its values can tell."""
        return fit.bound(fit.error if fit.is_falling else max(fit.error, self.error))


class PeakSearch(Record, frozen=True):
    """A search for the largest value of a curve.

    Attributes:
        curve: The curve.
        fit: Bracket, and heights at its nodes -> the polynomial through these.
        slack: Difference of heights that does not matter.
        seen: Intervals, and the polynomials of pieces that were not halved.
    """

    curve: Curve
    fit: Callable[[Bracket, Array], BracketFit]
    slack: float
    seen: list[tuple[int, BracketFit]] = []

    def highest(self, top: Peak, pieces: Sequence[CurvePart]) -> Peak:
        """Return the largest value in some pieces, or one that is known.

        Args:
            top: The one that is known.
            pieces: What is looked into.

        Raises:
            Endless: There is none, as the curve passes through infinity.
        """
        halvings = 0
        while pieces:
            top, rising = self._fitted(top, pieces)
            if halvings == HALVINGS:
                return self._narrowed(top, [piece for piece, _ in rising[:MOST_KINKS]])
            pieces = [half for piece, fit in rising for half in piece.halves(fit)][:MOST_PIECES]
            halvings += 1
        return top

    def _fitted(self, top: Peak, pieces: Sequence[CurvePart]) -> tuple[Peak, list[tuple[CurvePart, BracketFit]]]:
        """Return the largest value that is seen, and the pieces in which there may be larger ones, the best first."""
        fits, spots = list[tuple[CurvePart, BracketFit]](), [piece.places for piece in pieces]
        for piece, (interval, t), heights in zip(pieces, spots, self._heights(spots), strict=True):
            top = _higher(top, heights, interval, t)
            fits.append((piece, self.fit(piece.bracket, heights)))
        top = self._top_of_smooth(top, [(piece.interval, fit) for piece, fit in fits])
        rising = list[tuple[CurvePart, BracketFit]]()
        for piece, fit in fits:
            if self._may_rise(top, piece, fit):
                rising.append((piece, fit))
            else:
                self.seen.append((piece.interval, fit))
        return top, sorted(rising, key=lambda one: -one[0].bound(one[1]))

    def _may_rise(self, top: Peak, piece: CurvePart, fit: BracketFit) -> bool:
        """Tell whether the curve may be above a top in a piece, between the places at which it has been evaluated."""
        within = piece.interval == top.interval and fit.low <= top.place <= fit.high
        if within and piece.bound(fit) < top.height - self.slack:  # the polynomial does not tell what has been seen
            return True
        if fit.is_smooth:
            return False
        return piece.bound(fit) > top.height + self.slack or (
            fit.tail > max(piece.grown, self.slack) and fit.is_singular
        )

    def knows(self, interval: int, t: float, height: float) -> bool:
        """Tell whether a height at a place follows from the polynomials, so that there is nothing new beside it."""
        return any(
            abs(fit.at(np.array([t]))[0] - height) <= self.slack + fit.error
            for own, fit in self.seen if own == interval and fit.low <= t <= fit.high
        )  # fmt: skip

    def _top_of_smooth(self, top: Peak, fits: Sequence[tuple[int, BracketFit]]) -> Peak:
        """Return the largest value at the extremes of polynomials that are the curve, or the one that is known."""
        spots = [(interval, fit.extremes[[fit.at(fit.extremes).argmax()]]) for interval, fit in fits
                 if fit.is_resolved and fit.bound(fit.error) > top.height and len(fit.extremes)]  # fmt: skip
        return self.at(top, spots)

    def at(self, top: Peak, spots: Spots) -> Peak:
        """Return the largest value at places of intervals, or one that is known."""
        for (interval, t), heights in zip(spots, self._heights(spots), strict=True):
            top = _higher(top, heights, interval, t)
        return top

    def _heights(self, spots: Spots) -> list[Array]:
        return [bounded_below(heights, t) for (_, t), heights in zip(spots, self.curve(spots), strict=True)]

    def _narrowed(self, top: Peak, pieces: Sequence[CurvePart]) -> Peak:
        """Return the largest value in pieces with a kink, or one that is known, by narrowing them to rounding.

        Raises:
            Endless: A curve grows without end in one.
        """
        tops = dict.fromkeys(pieces, Peak(-np.inf, 0, 0.0))
        left, rounds = {piece: piece.bracket for piece in pieces}, {piece: list[Array]() for piece in pieces}
        for _ in range(ROUNDS):
            places = {piece: np.linspace(*bracket, POINTS) for piece, bracket in left.items()}
            every = self._heights([(piece.interval, t) for piece, t in places.items()])
            for (piece, t), heights in zip(places.items(), every, strict=True):
                peak = int(heights.argmax())
                found = Peak(float(heights[peak]), piece.interval, float(t[peak]), _fall(heights, peak))
                tops[piece] = max(found, tops[piece], key=_height)
                rounds[piece].append(heights)
                left[piece] = float(t[max(peak - 1, 0)]), float(t[min(peak + 1, POINTS - 1)])
                if _is_narrow(t) or _ends(rounds[piece], max(top.height, tops[piece].height)):
                    del left[piece]
        self._require_ends(tops)
        return max((top, *tops.values()), key=_height)

    def _require_ends(self, tops: Mapping[CurvePart, Peak]) -> None:
        """Raise where a curve grows without end towards its highest place in a piece, from one side at least.

        Raises:
            Endless: It does.
        """
        sides = [(top, t) for piece, top in tops.items() for t in _approaches(top.place, piece.bracket)]
        every = self._heights([(top.interval, t) for top, t in sides])
        for (top, _), heights in zip(sides, every, strict=True):
            if _grows(heights):
                raise Endless(top.place)


def bounded_below(heights: Array, t: Array) -> Array:
    """Return heights at places, with finite ones in place of those that are negatively infinite, shape (n,).

    Raises:
        Endless: One is infinite, or is not defined.
    """
    finite = np.isfinite(heights)
    if finite.all():
        return heights
    if (endless := ~finite & (heights != -np.inf)).any() or not finite.any():
        raise Endless(float(t[endless.argmax()]))
    return np.where(finite, heights, heights[finite].min() - np.ptp(heights[finite]))


def _height(peak: Peak) -> float:
    return peak.height


def _higher(top: Peak, heights: Array, interval: int, t: Array) -> Peak:
    """Return the largest of heights at places in one interval, or one that is known where none is above it."""
    peak = int(heights.argmax())
    return Peak(float(heights[peak]), interval, float(t[peak])) if heights[peak] > top.height else top


def _fall(heights: Array, peak: int) -> float:
    """Return by how much heights fall beside the largest, on the side of a jump that it is on."""
    beside = heights[[k for k in (peak - 2, peak + 2) if 0 <= k < len(heights)]]
    return float(heights[peak] - beside.max())


def _is_narrow(t: Array) -> bool:
    """Tell whether places are so close that values there differ by the rounding of the places."""
    return bool((t[-1] - t[0]) / len(t) < SPACING * max(abs(t[0]), abs(t[-1])))


def _ends(found: Sequence[Array], top: float) -> bool:
    """Tell whether narrowing on tells no more: heights differ by rounding, or come to an end below a top.

    Args:
        found: Heights of every round.
        top: The largest of all.
    """
    last, rise = found[-1].max(), np.ptp(found[-1])
    if rise <= FLAT * abs(last):
        return True
    return bool(len(found) > 2 and rise < 0.25 * np.ptp(found[-3]) and last + rise < top)


def _approaches(place: float, bracket: Bracket) -> list[Array]:
    """Return places that come near one from either end of a bracket, each an eighth as far away, shapes (n,)."""
    least = 4.0 * SPACING * abs(place)
    ways = [end - place for end in bracket if abs(end - place) > least]
    steps = [way * 8.0 ** -np.arange(1.0 + ROUNDS) for way in ways]
    return [place + step[np.abs(step) > least] for step in steps]


def _grows(heights: Array) -> bool:
    """Tell whether heights at places, each an eighth as far away as that before, grow without end."""
    rises = np.diff(heights[::WINDOW])
    if len(rises) < 2 or (np.diff(heights) <= 0.0).any() or rises[0] <= RISES * abs(heights[0]):
        return False
    return bool((rises[1:] > ENDLESS * rises[:-1]).all())

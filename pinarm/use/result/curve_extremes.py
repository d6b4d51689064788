"""Largest values of a function of a run, from its curve.

Pieces are halved as long as their polynomials, with what the last coefficients say of their errors, may rise above the
largest value so far. Where that does not end there is a kink, or a pole, at which values grow without end.
"""

from __future__ import annotations

import math

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.records import ValueRecord, replace
from pinarm.use.result.curve import ULPS, Curve, Spots
from pinarm.use.result.pieces import DEGREE, Pieces

HALVINGS, MOST_PIECES, MOST_KINKS = 6, 64, 4
"""Rounds of a search for the largest value in which 64 pieces are halved at most, those that may rise most; in later
rounds, towards kinks and poles, 4 pieces."""

BEGINS, ROUNDS, WINDOW, ENDLESS, RISES, NEARLY = 0.01, 14, 3, 0.5, 1e-3, 1e-9
"""How far from a pole, as a part of the interval, steps towards it begin; how many, each an eighth as far away; in how
many the rise of a function is compared with that before; part of a rise that follows it without end: 500 times at a
simple pole, all of it at a logarithm, a 500th at a kink; first rise, relative to the height, below which values grow by
their rounding."""


class Endless(Exception):
    """A function has no largest value.

    Attributes:
        place: Where it grows without end.
    """

    def __init__(self, place: float) -> None:
        self.place = place


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

    Args:
        curve: The curve.
        sign: 1, or -1 for the smallest value of the function.
        top: A value that is known.
        slack: Difference of heights that does not matter.

    Raises:
        Endless: There is none, as the function passes through infinity.
    """
    if not curve.spans:
        return top
    pieces, rounds, left = curve.first(fine=False), 0, 0.0
    top = _highest_known(curve, sign, top)
    top = higher(curve, sign, top, [(span.number, span.sides) for span in curve.spans if len(span.sides)])
    while len(pieces):
        top = _top(curve, sign, top, pieces)
        bounds = pieces.bounds(sign)[:, 0]
        rising = _rising(sign, top, pieces, bounds, slack)
        wide = curve.divisible(pieces.some(rising))
        narrow, rising = rising[~wide], rising[wide]
        if len(narrow):
            _require_end(curve, sign, top)
            left = max(left, *(_fall(sign * pieces.f[k, :, 0]) for k in narrow))
        rising = rising[np.argsort(-bounds[rising], kind="stable")][: MOST_PIECES if rounds < HALVINGS else MOST_KINKS]
        pieces, rounds = (
            curve.halves(pieces.some(np.sort(rising))) if len(rising) else pieces.some(rising),
            rounds + 1,
        )
    return replace(top, error=max(top.error, left))


def _highest_known(curve: Curve, sign: float, top: Peak) -> Peak:
    """Return the largest of the known values."""
    for span in curve.spans:
        if len(span.t):
            k = int((sign * span.f[:, 0]).argmax())
            top = max(top, Peak(float(sign * span.f[k, 0]), span.number, float(span.t[k])), key=_height)
    return top


def _top(curve: Curve, sign: float, top: Peak, pieces: Pieces) -> Peak:
    """Return the largest value at nodes of pieces, and at extremes of polynomials that are the function."""
    heights = sign * pieces.f[:, :, 0]
    piece, node = divmod(int(heights.argmax()), DEGREE + 1)
    if heights[piece, node] > top.height:
        interval, t = curve.places(int(pieces.interval[piece]), float(pieces.low[piece]), float(pieces.high[piece]))
        top = Peak(float(heights[piece, node]), interval, float(t[node]))
    may = pieces.resolved[:, 0] & (pieces.largest(sign)[:, 0] + 4.0 * pieces.error[:, 0] > top.height)
    spots = list[tuple[int, Array]]()
    for k in np.flatnonzero(may).tolist():
        turns = pieces.extremes(k)
        if len(turns):
            best = (sign * pieces.at(np.full(len(turns), k), turns)[:, 0]).argmax()
            spots.append((int(pieces.interval[k]), turns[[best]]))
    return higher(curve, sign, top, spots)


def higher(curve: Curve, sign: float, top: Peak, spots: Spots) -> Peak:
    """Return the largest value at places of intervals, or one that is known."""
    for (interval, t), f in zip(spots, curve.values(spots) if spots else (), strict=True):
        heights = sign * f.reshape(len(t), -1)[:, 0]
        k = int(heights.argmax())
        top = Peak(float(heights[k]), interval, float(t[k])) if heights[k] > top.height else top
    return top


def _rising(sign: float, top: Peak, pieces: Pieces, bounds: Array, slack: float) -> Indices:
    """Return the pieces in which the function may be above a top, between the places that have been evaluated."""
    within = (pieces.interval == top.interval) & (pieces.low <= top.place) & (top.place <= pieces.high)
    blind = within & (bounds < top.height - slack)  # the polynomial does not tell what has been seen
    smooth = pieces.resolved[:, 0] | pieces.constant[:, 0]
    poles = pieces.is_singular[:, 0] & (pieces.tail[:, 0] > slack)
    return np.flatnonzero(blind | (~smooth & ((bounds > top.height + slack) | poles)))


def _require_end(curve: Curve, sign: float, top: Peak) -> None:
    """Raise where the function grows without end towards its highest place, from one side at least.

    Raises:
        Endless: It does.
    """
    span, least = curve.span[top.interval], ULPS * math.ulp(top.place)
    ends = np.clip(top.place + BEGINS * span.length * np.array([-1.0, 1.0]), *span.bounds[[0, -1]])
    steps = [way * 8.0 ** -np.arange(1.0 + ROUNDS) for way in (ends - top.place).tolist() if abs(way) > least]
    spots = [(top.interval, top.place + step[np.abs(step) > least]) for step in steps]
    for f, (_, t) in zip(curve.values(spots), spots, strict=True):
        if _grows(sign * f.reshape(len(t), -1)[:, 0]):
            cuts = [t for t in curve.soft[top.interval] if abs(t - top.place) <= NEARLY * span.length]
            raise Endless(min(cuts, key=lambda t: abs(t - top.place), default=top.place))


def _height(peak: Peak) -> float:
    return peak.height


def _fall(heights: Array) -> float:
    """Return by how much heights fall beside the largest, on the side of a jump that it is on."""
    peak = int(heights.argmax())
    beside = heights[[k for k in (peak - 2, peak + 2) if 0 <= k < len(heights)]]
    return float(heights[peak] - beside.max())


def _grows(heights: Array) -> bool:
    """Tell whether heights at places, each an eighth as far away as that before, grow without end."""
    rises = np.diff(heights[::WINDOW])
    if len(rises) < 2 or (np.diff(heights) <= 0.0).any() or rises[0] <= RISES * abs(heights[0]):
        return False
    return bool((rises[1:] > ENDLESS * rises[:-1]).all())

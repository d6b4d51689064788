"""Integrals, percentiles, extremes and zeros of functions of a run, from its curve."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.records import ValueRecord, replace
from pinarm.use.result.curve import CUSP, DEGREE, ULPS, Curve, Endless, Pieces, Spots

RELATIVE, ABSOLUTE = 1e-10, 1e-12
"""Errors at which an integral is good enough, relative to itself and to the integral of the size of what is summed."""

UNSEEN = 1e-6
"""Difference of a function of size 1 to its polynomial that the polynomial has not seen."""

PATIENCE, NOISE, SPREAD = 4, 1e-4, 0.5
"""Rounds within which the error of an integral has to be halved, where it is below this part of the integral of the
size of a function, and no piece has more than this part of it: what is not halved is rounding of the function."""

NARROW, WIDER, STAYS = 1e-9, (256.0, 4096.0), 0.6
"""Part of an interval from which on pieces are so narrow that there is a pole in the last ones; how much wider the
pieces are that these are compared with; and their integrals over those of wider ones where an integral has no end: 1 at
a simple pole, 1/4 at x^(-5/6), 1/64 at x^(-1/2)."""

ENOUGH, ROUNDING, MOST, SHARE = 1e-10, 1e-13, 1024, 1e-12
"""Error of a polynomial for a percentile, relative to the range of the function; relative to the largest value; how
many pieces are halved at most; and the rounding of a share of the length."""


def integrals(curve: Curve, least: float, most: int) -> tuple[Array, Array]:
    """Return the integrals of the functions, and bounds of their errors, both of shape (k,).

    Halving ends where every error is allowed, no piece can be halved, halving no longer helps, or ``most`` pieces
    have been evaluated: the bounds then tell what is left, infinite where a function has no integral.

    Args:
        curve: The curve.
        least: Size of functions that are not to be told from 0 beside others.
        most: Number of pieces that are evaluated at most, the first ones left out.

    Raises:
        Endless: A function is infinite at a node.
    """
    pieces, before, length = curve.first(fine=True), list[Array](), sum(span.length for span in curve.spans)
    while True:
        unseen = np.where(pieces.off > UNSEEN + DEGREE * pieces.tail, pieces.width[:, None] * pieces.off, 0.0)
        total, errors = pieces.integrals(pieces.f).sum(axis=0), pieces.integral_errors + unseen
        error, sizes = errors.sum(axis=0) + errors.max(axis=0), pieces.integrals(np.abs(pieces.f))
        before.append(errors.sum(axis=0))
        size = np.maximum(sizes.sum(axis=0), max(least * length, 1e-290))
        allowed = ABSOLUTE * size + RELATIVE * np.abs(total)
        if (error <= allowed).all() or _stalled(before, errors, error <= allowed, NOISE * size):
            return total, error
        poor = _poor(curve, pieces, errors / allowed, most // 2)
        if not len(poor):
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


def _stalled(before: list[Array], errors: Array, allowed: Flags, small: Array) -> bool:
    """Tell whether the last rounds did not halve the errors that are not allowed, though all are small.

    Args:
        before: Sums of errors of every round, shape (k,) each.
        errors: Those of the pieces of the last one, shape (m, k).
        allowed: Which integrals are good enough, shape (k,).
        small: Errors that are small, shape (k,).
    """
    if len(before) <= PATIENCE or (before[-1] > small).any():
        return False
    spread = errors.max(axis=0) <= SPREAD * before[-1]
    return bool((allowed | (spread & (before[-1] >= 0.5 * before[-1 - PATIENCE]))).all())


def percentile(curve: Curve, share: float) -> tuple[float, float]:
    """Return the value below which the first function is for a share of the length, and the error of the value.

    Of polynomials the length on which they are below a value is known from where they pass it, and with it the
    percentile, to the error of the polynomials: two functions that differ by e at most have percentiles that differ
    by e at most.
    """
    pieces, left = curve.first(fine=True), MOST
    while True:
        error, f = pieces.error[:, 0], pieces.f[:, :, 0]
        level = max(ENOUGH * float(np.ptp(f)), ROUNDING * float(np.abs(f).max()))
        poor = np.flatnonzero((error > level) & curve.divisible(pieces))
        left -= len(poor)
        if not len(poor) or left < 0:
            break
        pieces = curve.refined(pieces, poor)
    rough, width = float(error.max()), pieces.width
    unknown = SHARE + float(width[error > level].sum() / width.sum())
    apart = pieces.percentile(min(share + unknown, 1.0)) - pieces.percentile(max(share - unknown, 0.0))
    return pieces.percentile(share), min(rough, level) + apart  # values may jump just at the share


HALVINGS, MOST_PIECES, MOST_KINKS = 6, 64, 4
"""Rounds of a search for the largest value in which 64 pieces are halved at most, those that may rise most; in later
rounds, towards kinks and poles, 4 pieces."""

WAYS, WINDOW, ENDLESS, RISES = 0.01 * 8.0 ** -np.arange(15.0), 3, 0.5, 1e-3
"""Distances from a place, as parts of the interval, at which a pole is looked for; how many of them a rise spans; least
ratio of successive rises that have no end: 500 at a simple pole, 1 at a logarithm, 1/500 at a kink; first rise,
relative to the height, below which values grow by their rounding."""


class Peak(ValueRecord, frozen=True):
    """A height of a function, and where it is.

    Attributes:
        height: The height: the function times the sign.
        interval: Number of the interval.
        place: Where in it.
        error: By how much the function may be above it elsewhere.
        sign: 1, or -1 of a smallest value.
    """

    height: float
    interval: int
    place: float
    error: float = 0.0
    sign: float = 1.0


def highest(curve: Curve, sign: float, top: Peak, slack: float) -> Peak:
    """Return the largest value of the first function times a sign.

    Pieces are halved as long as their polynomials, with the error that the last coefficients tell, may rise above the
    largest value so far.

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
    known = np.concatenate([sign * span.f[:, 0] for span in curve.spans])
    least = min(top.height, known[np.isfinite(known)].min(initial=top.height))
    with suppress(Endless):
        found = _highest(curve, sign, top, slack)
        if found.error <= max(found.height - least, slack):
            return found

    def cut(f: Array) -> Array:  # a function that passes through infinity on the other side only has a largest value
        return np.asarray(sign * np.maximum(sign * f, least))

    spans = [replace(span, f=cut(span.f)) for span in curve.spans]
    return _highest(Curve(lambda spots: [*map(cut, curve.values(spots))], spans), sign, top, slack)


def _highest(curve: Curve, sign: float, top: Peak, slack: float) -> Peak:
    """Return the largest value of the first function times a sign, or raise ``Endless``: see ``highest``."""
    pieces, rounds, left = curve.first(fine=False), 0, 0.0
    for span in (span for span in curve.spans if len(span.t)):
        k = int((sign * span.f[:, 0]).argmax())
        known = Peak(float(sign * span.f[k, 0]), span.number, float(span.t[k]), sign=sign)
        top = known if known.height > top.height else top
    while len(pieces):
        top = _top(curve, sign, top, pieces)
        bounds = pieces.largest(sign)[:, 0] + CUSP * pieces.error[:, 0]
        within = (pieces.interval == top.interval) & (pieces.low <= top.place) & (top.place <= pieces.high)
        unseen = within & (top.sign == sign) & (bounds < top.height - slack)
        known_there = pieces.resolved[:, 0] | pieces.constant[:, 0]
        rising = np.flatnonzero(unseen | (~known_there & (bounds > top.height + slack)))
        wide = curve.divisible(pieces.some(rising))
        if not wide.all():
            _require_end(curve, sign, top)
            left = max(left, *(_fall(sign * pieces.f[k, :, 0]) for k in rising[~wide]))
        rising = rising[wide][np.argsort(-bounds[rising[wide]], kind="stable")]
        rising = np.sort(rising[: MOST_PIECES if rounds < HALVINGS else MOST_KINKS])
        pieces, rounds = curve.halves(pieces.some(rising)) if len(rising) else pieces.some(rising), rounds + 1
    return replace(top, error=max(top.error, left))


def _top(curve: Curve, sign: float, top: Peak, pieces: Pieces) -> Peak:
    """Return the largest value at nodes of pieces, and at extremes of polynomials that are the function."""
    piece, node = divmod(int((sign * pieces.f[:, :, 0]).argmax()), DEGREE + 1)
    height = float(sign * pieces.f[piece, node, 0])
    if height > top.height:
        top = Peak(height, int(pieces.interval[piece]), float(pieces.t[piece, node]), sign=sign)
    may = pieces.resolved[:, 0] & (pieces.largest(sign)[:, 0] + 4.0 * pieces.error[:, 0] > top.height)
    spots = list[tuple[int, Array]]()
    for k in np.flatnonzero(may).tolist():
        turns = pieces.zeros(k, slope=True)
        if len(turns):
            best = (sign * pieces.at(np.full(len(turns), k), turns)[:, 0]).argmax()
            spots.append((int(pieces.interval[k]), turns[[best]]))
    return higher(curve, sign, top, spots)


def higher(curve: Curve, sign: float, top: Peak, spots: Spots) -> Peak:
    """Return the largest value at places of intervals, or one that is known."""
    for (interval, t), f in zip(spots, curve.values(spots) if spots else (), strict=True):
        heights = sign * f.reshape(len(t), -1)[:, 0]
        k = int(heights.argmax())
        if heights[k] > top.height:
            top = Peak(float(heights[k]), interval, float(t[k]), sign=sign)
    return top


def _require_end(curve: Curve, sign: float, top: Peak) -> None:
    """Raise where the function grows without end towards its highest place, from one side at least."""
    span = curve.span[top.interval]
    low, high = span.bounds[[0, -1]].tolist()
    for way in (-span.length, span.length):
        t = top.place + way * WAYS
        t = t[(t >= low) & (t <= high) & (np.abs(t - top.place) > ULPS * math.ulp(top.place))]
        heights = sign * curve.heights(top.interval, t) if len(t) else t
        rises = np.diff(heights[::WINDOW])
        grows = len(rises) > 1 and (np.diff(heights) > 0.0).all() and rises[0] > RISES * abs(heights[0])
        if grows and (rises[1:] > ENDLESS * rises[:-1]).all():
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


def zeros(curve: Curve, number: int, places: Array, level: float) -> list[float]:
    """Return where the first function has a value in an interval, ascending; not where it jumps over the value.

    Args:
        curve: The curve.
        number: The interval.
        places: Where it is looked at besides, ascending, both ends of the interval among them.
        level: The value.
    """
    t, gaps = looked_at(curve, number, places, level)
    return _once(curve, number, [*t[gaps == 0.0].tolist(), *crossings(curve, number, t, gaps, level)], t, gaps, level)


def zeros_of_angle(curve: Curve, number: int, places: Array, level: float) -> list[float]:
    """Return where an angle has a value, also one that is told between -180 and 180 deg, and jumps at these.

    Where it changes by more than half a turn between places that are looked at, it may have jumped there, and the
    sine of the difference is looked at too, which does not jump. Of its zeros those count beside which the angle
    has the value: others are half a turn or whole turns away.
    """
    t, gaps = looked_at(curve, number, places, level)
    direct = zeros(curve, number, places, level)
    if (np.abs(np.diff(gaps)) <= np.pi).all():
        return direct
    sine = Curve(
        lambda spots: [
            np.sin(f.reshape(len(t), -1)[:, :1] - level) for f, (_, t) in zip(curve.values(spots), spots, strict=True)
        ],
        [replace(span, f=np.sin(span.f - level)) for span in curve.spans],
    )
    low, high = float(places[0]), float(places[-1])
    near = NEAR * (high - low) * np.array([-1.0, 0.0, 1.0])
    others = [
        place
        for place in zeros(sine, number, places, 0.0)
        if np.abs(curve.heights(number, np.clip(place + near, low, high)) - level).min() < 1.0
    ]
    return _once(sine, number, [*direct, *others], t, np.ones(1), 0.0)


def looked_at(curve: Curve, number: int, places: Array, level: float) -> tuple[Array, Array]:
    """Return places between which the function is taken to have the value once at most, and its gaps there."""
    t, gaps = [places], [curve.heights(number, places) - level]
    bounds = curve.span[number].bounds if number in curve.span else places[:0]
    pieces = curve.pieces(np.full(len(bounds) - 1, number), bounds[:-1], bounds[1:]) if len(bounds) else None
    for _ in range(CROSSING_ROUNDS + 1 if pieces else 0):
        assert pieces is not None
        pieces = pieces.some(~pieces.constant[:, 0])  # a rest, which has no zeros within
        t, gaps = [*t, pieces.t.ravel()], [*gaps, pieces.f[:, :, 0].ravel() - level]
        turns = [pieces.zeros(k, slope=True) for k in np.flatnonzero(pieces.resolved[:, 0]).tolist()]
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
    nearest = np.where(above, pieces.largest(-1.0)[:, 0] + level, pieces.largest(1.0)[:, 0] - level)
    return np.asarray(~pieces.resolved[:, 0] & (passing | (nearest + margin >= 0.0)))


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
    if (rounded := np.isnan(places)).any():  # solved beside other states an end has the other sign
        gaps = np.abs([curve.heights(number, end[rounded]) - level for end in (low, high)])
        places[rounded] = np.where(gaps[0] < gaps[1], low[rounded], high[rounded])
    return places


def _once(curve: Curve, number: int, places: list[float], t: Array, gaps: Array, level: float) -> list[float]:
    """Return zeros, ascending, of which those between which the function is 0 are one, told by the first."""
    left, length, slack = list[float](), float(t[-1] - t[0]), TOUCHES * float(np.abs(gaps).max(initial=0.0))
    for place in sorted(places):
        middle = np.array([0.5 * (place + left[-1])]) if left and place - left[-1] <= ONE * length else None
        if middle is None or abs(curve.heights(number, middle)[0] - level) > slack:
            left.append(place)
    return left

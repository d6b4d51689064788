"""Largest values of a function of a run, and where it has a value, from its curve.

Pieces are halved as long as their polynomials, with what the last coefficients say of their errors, may rise above the
largest value so far, or may have the value twice between two nodes. Where halving does not end there is a kink, or a
pole, at which values grow without end.
"""

from __future__ import annotations

import math

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.records import ValueRecord, replace
from pinarm.use.result.curve import DEGREE, FLAT, ULPS, Curve, Pieces, Spots

HALVINGS, MOST_PIECES, MOST_KINKS = 6, 64, 4
"""Rounds of a search for the largest value in which 64 pieces are halved at most, those that may rise most; in later
rounds, towards kinks and poles, 4 pieces."""

BEGINS, ROUNDS, WINDOW, ENDLESS, RISES, NEARLY = 0.01, 14, 3, 0.5, 1e-3, 1e-9
"""Steps towards a pole: first distance, as a part of the interval; number of steps, each an eighth as far away; steps
of one rise; least ratio of successive rises that have no end: 500 at a simple pole, 1 at a logarithm, 1/500 at a kink;
first rise, relative to the height, below which values grow by their rounding; distance of a cut from the highest place,
as a part of the interval, within which the cut is the pole."""


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
    first = None if _is_seen(curve, sign, top, slack) else top  # of a size, the height of the other sign
    top = _highest_known(curve, sign, top)
    top = higher(curve, sign, top, [(span.number, span.sides) for span in curve.spans if len(span.sides)])
    while len(pieces):
        top = _top(curve, sign, top, pieces)
        bounds = pieces.bounds(sign)[:, 0]
        rising = _rising(top, pieces, bounds, slack, seen=top is not first)
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


def _is_seen(curve: Curve, sign: float, top: Peak, slack: float) -> bool:
    """Return whether the function times the sign has a height at its place."""
    [value] = curve.values([(top.interval, np.array([top.place]))])
    return bool(sign * value.reshape(-1)[0] >= top.height - slack)


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


def _rising(top: Peak, pieces: Pieces, bounds: Array, slack: float, *, seen: bool) -> Indices:
    """Return the pieces in which the function may be above a top, which it was seen to have or not, between places."""
    within = (pieces.interval == top.interval) & (pieces.low <= top.place) & (top.place <= pieces.high)
    blind = seen & within & (bounds < top.height - slack)  # the polynomial does not tell what has been seen
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


CROSSING_ROUNDS, CORRECTIONS = 5, 2
"""Rounds of halving of pieces in which two zeros may be unseen; Newton's steps from the zero of a polynomial."""

TOUCHES, CONTINUOUS, ONE, BESIDE = 1e-12, 1e-4, 1e-4, 1e-9
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
    return _zeros(curve, number, places, *looked_at(curve, number, places, level), level)


def zeros_of_angle(curve: Curve, number: int, places: Array, level: float) -> list[float]:
    """Return where an angle has a value, also one that is told between -180 and 180 deg, and jumps at these.

    Where it changes by more than half a turn between places that are looked at, it may have jumped there, and the
    sine of the difference is looked at too, which does not jump. Of its zeros those count beside which the angle
    has the value: others are half a turn or whole turns away.

    Args:
        curve: The curve.
        number: The interval.
        places: As in ``zeros``.
        level: The value [rad].
    """
    t, values = looked_at(curve, number, places, level)
    places_found = _zeros(curve, number, places, t, values, level)
    if (np.abs(np.diff(values)) <= np.pi).all():
        return places_found
    sine = Curve(
        lambda spots: [
            np.sin(f.reshape(len(t), -1)[:, :1] - level) for f, (_, t) in zip(curve.values(spots), spots, strict=True)
        ],
        [replace(span, f=np.sin(span.f - level)) for span in curve.spans],
    )
    low, high = float(places[0]), float(places[-1])
    near = BESIDE * (high - low) * np.array([-1.0, 0.0, 1.0])
    others = [
        place
        for place in zeros(sine, number, places, 0.0)
        if np.abs(_gaps(curve, number, np.clip(place + near, low, high), level)).min() < 1.0
    ]
    return _once(sine, number, sorted({*places_found, *others}), set(places_found), high - low, TOUCHES, 0.0)


def _gaps(curve: Curve, number: int, t: Array, level: float) -> Array:
    """Return the first function less a value at places, shape (n,)."""
    (f,) = curve.values([(number, t)])
    return np.asarray(f.reshape(len(t), -1)[:, 0] - level)


def looked_at(curve: Curve, number: int, places: Array, level: float) -> tuple[Array, Array]:
    """Return places between which the function is taken to have the value once at most, and its gaps there."""
    known = dict(zip(places.tolist(), _gaps(curve, number, places, level).tolist(), strict=True))
    if number not in curve.span:
        return _sorted(known)
    bounds, rounds = curve.span[number].bounds, 0
    pieces = curve.pieces(np.full(len(bounds) - 1, number), bounds[:-1], bounds[1:])
    pieces = replace(pieces, f=pieces.f - level)
    while len(pieces):
        pieces = pieces.some(~pieces.constant[:, 0])  # a rest, which has no zeros within
        size = max(map(abs, [*known.values(), *pieces.f[:, :, 0].ravel().tolist()]), default=0.0)
        for k in range(len(pieces)):
            t = curve.places(number, float(pieces.low[k]), float(pieces.high[k]))[1]
            known = {**dict(zip(t.tolist(), pieces.f[k, :, 0].tolist(), strict=True)), **known}
        known |= _turns(curve, number, pieces, level, TOUCHES * size)
        unsure = np.flatnonzero(_may_cross_unseen(pieces))
        if rounds == CROSSING_ROUNDS or not len(unsure):
            break
        pieces = curve.halves(replace(pieces, f=pieces.f + level).some(unsure))
        pieces, rounds = replace(pieces, f=pieces.f - level), rounds + 1
    return _sorted(known)


def _turns(curve: Curve, number: int, pieces: Pieces, level: float, slack: float) -> dict[float, float]:
    """Return places of extremes in resolved pieces, and the gaps there, 0 where the function touches the value."""
    turns = [pieces.extremes(k) for k in np.flatnonzero(pieces.resolved[:, 0]).tolist()]
    t = np.concatenate(turns) if turns else np.empty(0)
    gaps = _gaps(curve, number, t, level) if len(t) else t
    return dict(zip(t.tolist(), np.where(np.abs(gaps) > slack, gaps, 0.0).tolist(), strict=True))


def _zeros(curve: Curve, number: int, places: Array, t: Array, values: Array, level: float) -> list[float]:
    """Return where the gaps are zero between instants t, shape (n,), at which they have the values, shape (n,)."""
    zeros = list[float]()
    for k in np.flatnonzero((values == 0.0) | np.append(values[:-1] * values[1:] < 0.0, False)).tolist():
        if values[k] == 0.0:
            zeros.append(float(t[k]))
        else:
            place = root(curve, number, float(t[k]), float(t[k + 1]), level)
            gap = float(np.abs(_gaps(curve, number, np.array([place]), level)[0]))
            zeros += [place] if gap <= CONTINUOUS * np.abs(values[k : k + 2]).max() else []
    slack = TOUCHES * float(np.abs(values).max(initial=0.0))
    known = {*places.tolist()} & {*t[values == 0.0].tolist()}
    return _once(curve, number, zeros, known, float(t[-1] - t[0]), slack, level)


def _once(
    curve: Curve, number: int, places: list[float], known: set[float], length: float, slack: float, level: float
) -> list[float]:
    """Return zeros, of which those that are one are told once: by one of the known ones, else by the first."""
    left = list[float]()
    for place in places:
        same = left and place - left[-1] <= ONE * length
        if same and abs(_gaps(curve, number, np.array([0.5 * (place + left[-1])]), level)[0]) <= slack:
            left[-1] = place if place in known and left[-1] not in known else left[-1]
        else:
            left.append(place)
    return left


def root(curve: Curve, number: int, low: float, high: float, level: float) -> float:
    """Return where the first function has a value between two places on whose sides it has opposite gaps."""
    fit = curve.pieces(np.array([number]), np.array([low]), np.array([high])) if number in curve.span else None
    if fit is not None and len(fit) == 1 and fit.resolved[0, 0]:
        fit = replace(fit, f=fit.f - level)
        places = fit.zeros(0)
        if len(places) and fit.slope(0, t := float(places[0])) != 0.0:
            for _ in range(CORRECTIONS):
                t = min(max(t - float(_gaps(curve, number, np.array([t]), level)[0]) / fit.slope(0, t), low), high)
            return t
    from scipy.optimize import brentq

    gap = lambda t: float(_gaps(curve, number, np.array([t]), level)[0])  # noqa: E731
    return float(brentq(gap, low, high, xtol=4.0 * math.ulp(max(abs(low), abs(high))), rtol=FLAT))


def _sorted(known: dict[float, float]) -> tuple[Array, Array]:
    t = np.array(sorted(known))
    return t, np.array([known[place] for place in t.tolist()])


def _may_cross_unseen(pieces: Pieces) -> Flags:
    """Tell where a function may be zero twice between two nodes of a piece, whose extremes are not known."""
    f = pieces.f[:, :, 0]
    passing = (f.min(axis=1) <= 0.0) & (f.max(axis=1) >= 0.0)
    sign = np.where(f.mean(axis=1) > 0.0, -1.0, 1.0)
    bounds = np.where(sign > 0.0, pieces.bounds(1.0)[:, 0], pieces.bounds(-1.0)[:, 0])
    return np.asarray(~pieces.resolved[:, 0] & (passing | (bounds >= 0.0)))

"""Where a function of a run has a value, from its curve.

Pieces in which the function may have the value twice between two nodes are halved; extremes of polynomials are
evaluated too.
"""

from __future__ import annotations

import math

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.records import replace
from pinarm.use.result.curve import Curve
from pinarm.use.result.pieces import FLAT, Pieces

CROSSING_ROUNDS, CORRECTIONS = 5, 2
"""How often pieces are halved in which two zeros may be unseen; Newton's steps from the zero of a polynomial."""

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
    found = _zeros(curve, number, places, t, values, level)
    if (np.abs(np.diff(values)) <= np.pi).all():
        return found
    sine = Curve(lambda spots: [np.sin(f.reshape(len(t), -1)[:, :1] - level) for f, (_, t) in
                                zip(curve.values(spots), spots, strict=True)],
                 [replace(span, f=np.sin(span.f - level)) for span in curve.spans])  # fmt: skip
    low, high = float(places[0]), float(places[-1])
    near = BESIDE * (high - low) * np.array([-1.0, 0.0, 1.0])
    others = [place for place in zeros(sine, number, places, 0.0)
              if np.abs(_gaps(curve, number, np.clip(place + near, low, high), level)).min() < 1.0]  # fmt: skip
    return _once(sine, number, sorted({*found, *others}), set(found), high - low, TOUCHES, 0.0)


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
    found = list[float]()
    for k in np.flatnonzero((values == 0.0) | np.append(values[:-1] * values[1:] < 0.0, False)).tolist():
        if values[k] == 0.0:
            found.append(float(t[k]))
        else:
            place = root(curve, number, float(t[k]), float(t[k + 1]), level)
            gap = float(np.abs(_gaps(curve, number, np.array([place]), level)[0]))
            found += [place] if gap <= CONTINUOUS * np.abs(values[k : k + 2]).max() else []
    slack = TOUCHES * float(np.abs(values).max(initial=0.0))
    known = {*places.tolist()} & {*t[values == 0.0].tolist()}
    return _once(curve, number, found, known, float(t[-1] - t[0]), slack, level)


def _once(
    curve: Curve, number: int, found: list[float], known: set[float], length: float, slack: float, level: float
) -> list[float]:
    """Return zeros, of which those that are one are told once: by one of the known ones, else by the first."""
    left = list[float]()
    for place in found:
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

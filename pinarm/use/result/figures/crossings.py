"""Where a curve crosses zero: between neighbouring places with opposite signs, and near extremes between these.

Brackets in which the curve is no polynomial, as where it swings several times, are halved, as it may cross zero twice
between two places there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from pinarm.arrays import Array
from pinarm.use.result.figures.bracket_fit import FLAT, BracketFit

Curve = Callable[[Array], Array]
"""Values at places, shape (n,)."""

POINTS, ROUNDS = 17, 14
"""A bracket is cut in 16 parts 14 times: 16^14 is beyond the digits of a double, so it ends at rounding."""

CORRECTIONS = 2
"""Newton steps from the root of a polynomial, which is known to 1e-8 of the bracket: each squares that."""

TOUCHES = 1e-12
"""Height of an extreme, relative to the largest value, below which the curve touches zero there: it is one place."""

CONTINUOUS = 1e-4
"""Value at a change of sign, relative to those at the ends of its bracket, below which the curve is 0 there: it may be
steep, as a root is, but does not jump over 0, as an angle does from 180 to -180 deg, and a tangent at its pole."""

ONE = 1e-4
"""Part of the whole within which places are one where the curve between them is 0 but for rounding: a motion that comes
to rest at a value is there within rounding for that long."""

BESIDE = 1e-9
"""Part of the whole from a place to those on both sides of it: an angle has jumped between them, and changed little."""


HALVINGS = 5
"""How often brackets are halved in which the curve is no polynomial, such as those with many swings or a kink."""


def crossings(curve: Curve, t: Array, parts: int = 0) -> list[float]:
    """Return where a curve is zero, in the order of the places t, shape (n,); not where it jumps over zero.

    Args:
        curve: The curve.
        t: Places, ascending or descending: what takes place twice between two of them is not seen.
        parts: Into how many brackets the whole is cut besides, whose extremes are places as well; 0 for none.
    """
    return _zeros(curve, *_looked_at(curve, t, parts))


def _looked_at(curve: Curve, t: Array, parts: int) -> tuple[Array, Array]:
    """Return places between which a curve is taken to cross zero once at most, and its values there."""
    values = curve(t)
    return _with_extremes(curve, t, values, parts) if parts else (t, values)


def _zeros(curve: Curve, t: Array, values: Array) -> list[float]:
    """Return where a curve is zero between places, shape (n,), at which it has the values, shape (n,)."""
    found = []
    for k in range(len(t) - 1):
        if values[k] == 0.0:
            found.append(float(t[k]))
        elif values[k] * values[k + 1] < 0.0:
            place = root(curve, (float(t[k]), float(t[k + 1])))
            if np.abs(curve(np.array([place]))[0]) <= CONTINUOUS * np.abs(values[k : k + 2]).max():
                found.append(place)
    found += [float(t[-1])] if values[-1] == 0.0 else []
    return _once(curve, found, set(t[values == 0.0].tolist()), t, TOUCHES * float(np.abs(values).max(initial=0.0)))


def crossings_of_angle(difference: Curve, t: Array, parts: int = 0) -> list[float]:
    """Return where an angle takes a value, also one that is told between -180 and 180 deg, and jumps at these.

    Where it changes by more than half a turn between places that are looked at, it may have jumped there, and the sine
    of the difference is looked at too, which does not jump. Of its zeros those count beside which the angle takes the
    value: others are half a turn or whole turns away.

    Args:
        difference: The angle less the value [rad].
        t: Places, as in ``crossings``.
        parts: As there.
    """

    def sine(t: Array) -> Array:
        return np.sin(difference(t))

    places, values = _looked_at(difference, t, parts)
    found = _zeros(difference, places, values)
    if (np.abs(np.diff(values)) <= np.pi).all():
        return found
    near = BESIDE * abs(float(t[-1] - t[0]))
    low, high = sorted((float(t[0]), float(t[-1])))
    others = [
        place for place in crossings(sine, t, parts)
        if np.abs(difference(np.clip(place + near * np.array([-1.0, 0.0, 1.0]), low, high))).min() < 1.0
    ]  # fmt: skip
    merged = sorted({*found, *others}, reverse=bool(t[-1] < t[0]))
    return _once(sine, merged, set(found), t, TOUCHES)


def _once(curve: Curve, found: list[float], known: set[float], t: Array, slack: float) -> list[float]:
    """Return zeros, of which those that are one are told once: by one of the known ones, else by the first."""
    near, left = ONE * abs(float(t[-1] - t[0])), list[float]()
    for place in found:
        if left and abs(place - left[-1]) <= near and abs(curve(np.array([0.5 * (place + left[-1])]))[0]) <= slack:
            left[-1] = place if place in known and left[-1] not in known else left[-1]
        else:
            left.append(place)
    return left


def _with_extremes(curve: Curve, t: Array, values: Array, parts: int) -> tuple[Array, Array]:
    """Return places and values with those in brackets between the first and the last, and with extremes there."""
    known = dict(zip(t.tolist(), values.tolist(), strict=True))
    size = float(np.abs(values).max())
    begin, end = sorted((float(t[0]), float(t[-1])))
    brackets, halvings = [*pairwise(np.linspace(begin, end, parts + 1).tolist())], 0
    while brackets:
        unsure = list[BracketFit]()
        for low, high in brackets:
            places = BracketFit.places(low, high)
            heights = curve(places)
            if np.ptp(heights) <= FLAT * np.abs(heights).max():  # a rest, which has no crossings within
                continue
            size = max(size, float(np.abs(heights).max()))
            known = {**dict(zip(places.tolist(), heights.tolist(), strict=True)), **known}
            fit = BracketFit(low, high, heights)
            known.update(_extremes(curve, fit, TOUCHES * size))
            unsure += [fit] if _may_cross_unseen(fit) else []
        halves = [half for fit in unsure for half in pairwise((fit.low, 0.5 * (fit.low + fit.high), fit.high))]
        brackets, halvings = halves if halvings < HALVINGS else [], halvings + 1
    along = np.array(sorted(known, reverse=bool(t[-1] < t[0])))
    return along, np.array([known[place] for place in along.tolist()])


def _may_cross_unseen(fit: BracketFit) -> bool:
    """Tell whether a curve may cross zero twice between two places of a bracket, at whose extremes it is not known."""
    values = fit.values
    if fit.is_resolved or not np.isfinite(values).all():
        return False
    away = BracketFit(fit.low, fit.high, -np.abs(values))
    return bool(values.min() <= 0.0 <= values.max() or away.bound(fit.error) >= 0.0)


def _extremes(curve: Curve, fit: BracketFit, slack: float) -> Iterator[tuple[float, float]]:
    """Yield places of extremes and the values there, 0 where the curve touches it."""
    places = fit.extremes if fit.is_resolved else np.empty(0)
    for place, value in zip(places.tolist(), curve(places).tolist() if len(places) else (), strict=True):
        yield place, value if abs(value) > slack else 0.0


def root(curve: Curve, bracket: tuple[float, float]) -> float:
    """Return where a curve is zero between two places at which it has opposite signs."""
    (low, high), fit = sorted(bracket), BracketFit(*bracket, curve(BracketFit.places(*bracket)))
    places = fit.crossings() if fit.is_resolved else np.empty(0)
    if not len(places) or fit.slope(t := float(places[0])) == 0.0:
        return _bisected(curve, bracket)
    for _ in range(CORRECTIONS):
        change = float(curve(np.array([t]))[0]) / fit.slope(t)
        t = min(max(t - change, low), high)
    return t


def _bisected(curve: Curve, bracket: tuple[float, float]) -> float:
    """Return where a curve changes its sign first, as one that has a kink."""
    low, high = bracket
    for _ in range(ROUNDS):
        t = np.linspace(low, high, POINTS)
        values = curve(t)
        change = np.flatnonzero((values[:-1] == 0.0) | (values[:-1] * values[1:] < 0.0))
        if not len(change):
            break
        low, high = t[change[0]], t[change[0] + 1]
        if values[change[0]] == 0.0:
            return float(low)
    return 0.5 * float(low + high)

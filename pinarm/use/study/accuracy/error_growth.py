"""How fast errors of a motion grow, where they grow exponentially: the largest Lyapunov exponent, from two solutions.

Two solutions of one motion differ by errors of steps and by last digits. Where the motion is regular their difference
grows like a power of the time, at most about the second. Where it is chaotic, or falls from an unstable position, it
grows by ``exp(t / tau)``, until it is as large as the motion itself. Two solutions that are coarse, or of long motions,
are so far apart too soon to tell how they came to be; then tight ones of its beginning do.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.use.study.accuracy.common_rows import common_rows

SATURATED = 0.05
"""Difference of two motions, relative to their size, up to which it grows in proportion to itself."""

EARLY = 0.25
"""Part of the time that is left out: errors of the first steps are added to, before they grow."""

GROWN = 8.0
"""e-folds in the rest of it that no power of the time up to the fifth explains: ``5 ln 4 = 6.9``."""

STEADY = 0.25
"""Part of this that has to be grown in either half: an impact makes errors jump once."""

SMALLEST = 1e-300
"""Difference that stands for 0 in logarithms."""

FEW = 12
"""Rows below which nothing is said of growth."""


def e_folding(one: Trajectory, two: Trajectory) -> float | None:
    """Return the time in which the difference of two motions grows e-fold [s]; ``None`` where it is not exponential.

    It is the reciprocal slope of ``ln d`` over t by least squares, with d the largest difference until t. Growth has to
    last: the least difference from t on must grow as well. Errors of steps that come and go, as where steps lengthen
    after a transient, leave that where it is.
    """
    if one.parameter != "t":
        return None
    t, difference = _differences(one, two)
    largest = np.maximum.accumulate(difference)
    rows = np.flatnonzero((largest > 0.0) & (largest < SATURATED))
    if len(rows) < FEW:
        return None
    rows = rows[t[rows] >= EARLY * t[rows[-1]]]
    least = np.minimum.accumulate(difference[rows][::-1])[::-1]
    grown = np.log(largest[rows])
    if len(rows) < FEW or not _steady(grown) or not _steady(np.log(np.maximum(least, SMALLEST))):
        return None
    t, grown = t[rows] - t[rows].mean(), grown - grown.mean()
    return float(t @ t / (t @ grown))


def saturation(one: Trajectory, two: Trajectory) -> float | None:
    """Return the time until two solutions of a motion have no digit in common [s]; ``None`` where they always have."""
    if one.parameter != "t":
        return None
    t, difference = _differences(one, two)
    apart = t[difference >= SATURATED]
    return float(apart[0]) if len(apart) else None


def _steady(grown: Array) -> bool:
    """Tell whether logarithms of differences, shape (n,), grow enough as a whole and in either half."""
    first, second = np.diff(grown[[0, len(grown) // 2, -1]])
    return bool(first + second >= GROWN and min(first, second) >= STEADY * GROWN)


def _differences(one: Trajectory, two: Trajectory) -> tuple[Array, Array]:
    """Return times since the start [s] and the differences of the states there, relative to their sizes, shape (n,)."""
    first, second = common_rows(one, two)
    model = one.mechanism.model
    apart = np.zeros((len(first), model.nv))
    for row, (p, q) in enumerate(zip(one.q[first], two.q[second], strict=True)):
        apart[row] = pin.difference(model, p, q)
    parts = (apart, one.q), (one.v[first] - two.v[second], one.v)
    found = [np.abs(part).max(axis=1) / (np.abs(whole).max() or 1.0) for part, whole in parts if part.size]
    return one.grid.t[first] - one.grid.t[0], np.max(found, axis=0) if found else np.zeros(len(first))

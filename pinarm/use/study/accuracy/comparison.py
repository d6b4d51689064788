"""Comparison of two runs: rows that belong together, instants between them, their courses, growth of differences.

Two solutions of one motion differ by errors of steps and by last digits. Where the motion is regular their difference
grows like a power of the time, at most about the second. Where it is chaotic, or falls from an unstable position, it
grows by ``exp(t / tau)`` (the largest Lyapunov exponent), until it is as large as the motion itself.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.motion.trajectory import EventRecord, Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.use.result.row_lookup import Lookup

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

BETWEEN = 100
"""Instants all over a run at which two are compared beside their rows: rows at the turning points of an oscillation do
not show an error of its phase."""

GOLDEN = 0.5 * (5.0**0.5 - 1.0)


def common_rows(one: Trajectory, two: Trajectory) -> tuple[Indices, Indices]:
    """Return the rows of two runs that belong together; none where that cannot be told.

    Rows at a jump belong together by the number of the jump, however far apart it occurs in both runs; other rows by
    their instants. Runs with other numbers of jumps have only those instants in common that both have as often.
    """
    if one.parameter != "t":
        rows = np.arange(len(one) if len(one) == len(two) else 0)
        return rows, rows
    t1, t2 = one.grid.t, _moved(two.grid, one.grid.cuts)
    order = np.argsort(t2, kind="stable")
    (at1, n1), (at2, n2) = (np.unique(t, return_counts=True) for t in (t1, t2))
    shared, k1, k2 = np.intersect1d(at1, at2, return_indices=True)
    shared = shared[n1[k1] == n2[k2]]
    return np.flatnonzero(np.isin(t1, shared)), order[np.isin(t2[order], shared)]


def _moved(grid: Grid, cuts: Sequence[float]) -> Array:
    """Return the instants of a grid, those at the ends of its intervals moved to as many other cuts, shape (n,)."""
    if len(cuts) != len(grid.cuts):
        return grid.t
    t = grid.t.copy()
    for (start, end, rows), low, high in zip(grid.intervals(), cuts[:-1], cuts[1:], strict=True):
        here = grid.t[rows]
        t[rows] = np.where(here == start, low, np.where(here == end, high, here))
    return t


def between_rows(one: Lookup, two: Lookup) -> Iterator[tuple[Quantities, Quantities]]:
    """Yield the quantities of two motions at the same instants, interval by interval; none where these are others.

    Over the whole run, however many intervals it has, the instants are multiples of the golden ratio: they are not
    those of a period.
    """
    if not one.motion or not two.motion or len(one.intervals) != len(two.intervals):
        return
    low, high = sorted((float(one.run.grid.cuts[0]), float(one.run.grid.cuts[-1])))
    places = low + (high - low) * np.sort(GOLDEN * np.arange(1, BETWEEN + 1) % 1.0)
    for number, bounds in enumerate(zip(one.intervals, two.intervals, strict=True)):
        start, end = max(min(own[:2]) for own in bounds), min(max(own[:2]) for own in bounds)
        t = places[(places >= start) & (places <= end)]
        if len(t):
            yield one.quantities_at(number, t), two.quantities_at(number, t)


def different_course(one: Result, two: Result) -> str:
    """Return how the courses of two runs differ: their ends, events, or changes of contact; empty where they do not."""
    first, second = one.trajectory, two.trajectory
    if first.parameter != "t":
        return f"they have {len(first)} and {len(second)} rows" if len(first) != len(second) else ""
    ends = f"they end at t = {first.grid.t[-1]:.9g} s and {second.grid.t[-1]:.9g} s"
    if found := _different_events(one.events, two.events):
        return f"{found}; {ends}"
    if len(first.grid.cuts) != len(second.grid.cuts):
        counts = f"{len(first.grid.cuts) - 2} and {len(second.grid.cuts) - 2} times"
        return f"contacts, friction, controllers or loads change {counts}; {ends}"
    return ""


def _different_events(one: Sequence[EventRecord], two: Sequence[EventRecord]) -> str:
    """Return in which event two sequences differ; empty where they do not."""
    first, second = ([event.name for event in events] for events in (one, two))
    counts = Counter(first), Counter(second)
    for name in dict.fromkeys((*first, *second)):
        if counts[0][name] != counts[1][name]:
            return f"'{name}' takes place {counts[0][name]} and {counts[1][name]} times"
    for a, b in zip(one, two, strict=True):
        if a.name != b.name:
            return f"'{a.name}' takes place at t = {a.t:.9g} s, and '{b.name}' in its place at {b.t:.9g} s"
    return ""


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

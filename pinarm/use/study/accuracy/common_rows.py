"""Rows of two runs that belong together, and instants between them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinarm.arrays import Indices
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.use.result.row_lookup import Lookup

BETWEEN = 100
"""Instants all over a run at which two are compared beside their rows: rows at the turning points of an oscillation do
not show an error of its phase."""

GOLDEN = 0.5 * (5.0**0.5 - 1.0)


def common_rows(one: Trajectory, two: Trajectory) -> tuple[Indices, Indices]:
    """Return the rows of two runs that belong together; none where that cannot be told.

    Events may stand at other instants in either. Where there are as many rows, an event's rows belong together, however
    far apart; else only the instants that stand in both as often.
    """
    if len(one) == len(two):
        return np.arange(len(one)), np.arange(len(two))
    if one.parameter != "t":
        return np.arange(0), np.arange(0)
    (t1, n1), (t2, n2) = (np.unique(run.grid.t, return_counts=True) for run in (one, two))
    shared, k1, k2 = np.intersect1d(t1, t2, return_indices=True)
    shared = shared[n1[k1] == n2[k2]]
    return np.flatnonzero(np.isin(one.grid.t, shared)), np.flatnonzero(np.isin(two.grid.t, shared))


def between_rows(one: Lookup, two: Lookup) -> Iterator[tuple[Quantities, Quantities]]:
    """Yield the quantities of two motions at the same instants, interval by interval; none where events are others.

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

"""Rows of two runs that belong together, instants between them, and whether both runs take the same course."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

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

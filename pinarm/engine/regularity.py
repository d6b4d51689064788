"""How close a motion comes to a singular position of its loops, between the rows of its table too."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.closure import RANK
from pinarm.engine.trajectory import Trajectory
from pinarm.errors import PinarmError

NEAR = 0.1
"""Regularity at the rows from which on it is looked for between them."""

ROUNDS, POINTS = 6, 9
"""How often the instants between two rows are looked at more closely, and how many each time: to 1e-4 of a row."""


FLAT = 0.05
"""Part of the regularity by which it changes from one instant to the next where it is not looked for any closer."""


def least_regular(run: Trajectory, rows: Indices, values: Array) -> tuple[float, float]:
    """Return the least regularity that was found, and the parameter at which it is.

    Args:
        run: The motion.
        rows: Those of its rows that have been looked at, shape (n,).
        values: Singular values of the constraints there, descending, shape (n, s).
    """
    rank = max(int((values > RANK * values[:, :1]).sum(axis=1).max()), 1)
    regular = values[:, rank - 1] / values[:, 0]
    least = int(np.argmin(regular))
    best = float(regular[least]), float(run.grid.t[rows[least]])
    if run.separate or not 0 < least < len(rows) - 1 or not RANK < best[0] < NEAR:
        return best
    low, high = (float(run.grid.t[rows[least + side]]) for side in (-1, 1))
    for _ in range(ROUNDS):
        t = np.linspace(low, high, POINTS)
        try:
            found = _at(run, t, rank)
        except PinarmError:  # singular: nothing closer can be looked at
            break
        best = min(best, *zip(found.tolist(), t.tolist(), strict=True))
        beside = slice(max(int(found.argmin()) - 1, 0), int(found.argmin()) + 2)
        if np.ptp(found[beside]) < FLAT * found.min():
            break
        low, high = float(t[beside][0]), float(t[beside][-1])
    return best


def _at(run: Trajectory, t: Array, rank: int) -> Array:
    """Return the regularity at instants, shape (n,)."""
    cuts = np.array(run.grid.cuts)
    ways = cuts if cuts[0] <= cuts[-1] else -cuts
    owners = np.searchsorted(ways[1:-1], t if ways is cuts else -t)
    values = [
        run.mechanism.closure.singular_values(q)
        for stretch in np.unique(owners)
        for q in run.within(int(stretch), t[owners == stretch]).q
    ]
    return np.array([each[rank - 1] / each[0] for each in values])

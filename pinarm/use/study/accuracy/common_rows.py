"""Rows of two runs that belong together."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Indices
from pinarm.engine.motion.trajectory import Trajectory


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

"""How close a motion comes to a singular position of its loops, between the rows of its table too."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.nullspace import RANK
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import PinarmError

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import SolvedMotion

NEAR = 0.1
"""Regularity at the rows from which on it is looked for between them."""

ROUNDS, EVENLY = 10, 4
"""How often instants between rows are looked at; at first so many on either side, evenly, as rows may be far apart."""

FLAT = 0.05
"""Part of the regularity by which it changes from one instant to the next where it is not looked for any closer."""


def nearest_singularity(
    run: Trajectory, motion: SolvedMotion | None, rows: Indices, values: Array
) -> tuple[float, float]:
    """Return the least regularity that was found, and the parameter at which it is.

    It is ``s_r / max s_1``, s being the singular values of G in descending order, r its rank, and ``max s_1`` the
    largest in the run: a single row has one singular value, which vanishes at a singular position like any other.

    Args:
        run: The table of states.
        motion: What they are states of; none where nothing is looked for between rows.
        rows: Those of its rows that have been looked at, shape (n,).
        values: Singular values of the constraints there, descending, shape (n, s).
    """
    rank = run.mechanism.closure.rank(values)
    if not rank:  # a second bearing in line with the first holds nothing that could be lost
        return 1.0, float(run.grid.t[rows[0]])
    largest = float(values[:, 0].max())
    regular = values[:, rank - 1] / largest
    least = int(np.argmin(regular))
    best = float(regular[least]), float(run.grid.t[rows[least]])
    if motion is None or run.separate or not 0 < least < len(rows) - 1 or not RANK < best[0] < NEAR:
        return best
    t, here = run.grid.t[rows[least - 1 : least + 2]], regular[least - 1 : least + 2]
    if t[0] > t[2]:
        t, here = t[::-1], here[::-1]
    for round_ in range(ROUNDS):
        between = _lowest(t, here) if round_ else _evenly(t)
        if not len(between):
            break
        try:
            found = _smallest(run, motion.positions(between), rank) / largest
        except PinarmError:  # singular: nothing closer can be looked at
            break
        best = min(best, *zip(found.tolist(), between.tolist(), strict=True))
        order = np.argsort(t := np.concatenate([t, between]))
        t, here = t[order], np.concatenate([here, found])[order]
        k = int(here.argmin())
        if not 0 < k < len(t) - 1:
            break
        t, here = t[k - 1 : k + 2], here[k - 1 : k + 2]
        if best[0] <= RANK or np.ptp(here) < FLAT * best[0]:
            break
    return best


def _evenly(t: Array) -> Array:
    """Return instants between three, as many before the middle one as behind it."""
    return np.concatenate([np.linspace(*ends, EVENLY + 2)[1:-1] for ends in pairwise(t.tolist())])


def _lowest(t: Array, values: Array) -> Array:
    """Return instants at which a size may be smallest, between three of which the middle one is the smallest so far.

    Where the signed quantity goes through 0 on the one side or on the other, and where a parabola through the squares,
    which are smooth in any case, is lowest.
    """
    crossing = (t[:-1] * values[1:] + t[1:] * values[:-1]) / (values[:-1] + values[1:])
    (left, right), (falling, rising) = np.diff(t), np.diff(values**2) / np.diff(t)
    vertex = t[1] - 0.5 * (falling * right + rising * left) / (rising - falling) if rising > falling else t[1]
    inside = np.array([*crossing, vertex])
    apart = 1e-9 * (t[2] - t[0])
    return np.unique(inside[np.abs(inside[:, None] - t).min(axis=1) > apart])


def _smallest(run: Trajectory, q: Array, rank: int) -> Array:
    """Return the singular value that is lost at singular positions, at configurations of shape (n, nq), shape (n,)."""
    closure = run.mechanism.closure
    return np.asarray(closure.values_of(closure.at(q)[1])[:, rank - 1])

"""How close a motion comes to a singular position of its loops, between the rows of its table too."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.nullspace import RANK
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import PinarmError
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import SolvedMotion

NEAR = 0.1
"""Regularity at the rows from which on it is looked for between them."""

ROUNDS, PLACES = 7, 10
"""Times that the interval about the least regularity is divided, and places on either side: 1e-7 of it are resolved."""

SAME = 1e-9
"""Difference of regularities, relative to them, that is rounding: of positions that a motion takes twice the first
counts, whatever the processor."""


class NearestSingularity(Record, frozen=True):
    """Where a run is nearest to a singular position; of variants in arrays of shape (k,).

    Attributes:
        regularity: The least regularity ``s_r / max s_1`` that was found.
        at: The parameter there.
        relative: ``s_r`` there, relative to its largest value in the run: 1 where the loops transmit alike everywhere,
            however large or small the ratios of gears and arms are.
    """

    regularity: float | Array
    at: float | Array
    relative: float | Array


def nearest_singularity(
    run: Trajectory, motion: SolvedMotion | None, rows: Indices, values: Array
) -> NearestSingularity:
    """Return where a run is nearest to a singular position.

    The regularity is ``s_r / max s_1``, s being the singular values of G in descending order, r its rank, and
    ``max s_1`` the largest in the run: a single row has one singular value, which vanishes at a singular position like
    any other.

    Args:
        run: The table of states.
        motion: What they are states of; none where nothing is looked for between rows.
        rows: Those of its rows that have been looked at, shape (n,).
        values: Singular values of the constraints there, descending, shape (n, s), of variants (n, k, s): what is told
            of these has the shape (k,), and is NaN where it would have to be looked for between rows.
    """
    rank = run.mechanism.closure.rank(values)
    if not rank:  # a second bearing in line with the first holds nothing that could be lost
        one = np.ones(values.shape[1:-1])
        return NearestSingularity(one, run.grid.t[rows[0]] * one, one)
    t, largest = run.grid.t[rows], values[..., 0].max(axis=0)
    regular = values[..., rank - 1] / largest
    if values.ndim > 2:
        return _of_variants(t, regular, NEAR if not run.separate else RANK)
    between = None if motion is None or run.separate else partial(_between, run, motion, rank, float(largest))
    least, at = _least(t, regular, between)
    return NearestSingularity(least, at, least / float(regular.max()))


def _of_variants(t: Array, regular: Array, near: float) -> NearestSingularity:
    """Return the same of variants, given the parameter, shape (n,) or (n, k), and their regularity, shape (n, k)."""
    least = _first_least(regular)
    t = np.broadcast_to(t.reshape(len(t), -1), regular.shape)
    lowest, at = (np.take_along_axis(x, least[None], axis=0)[0] for x in (regular, t))
    looked_for = (least > 0) & (least < len(t) - 1) & (lowest > RANK) & (lowest < near)
    lowest = np.where(looked_for, np.nan, lowest)
    return NearestSingularity(lowest, at, lowest / regular.max(axis=0))


def _first_least(regular: Array) -> Indices:
    """Return where each regularity is least, at the first of rows that differ by rounding: shape (n, ..) to (..)."""
    return np.asarray(np.argmax(regular <= (1.0 + SAME) * regular.min(axis=0), axis=0))


def _least(t: Array, regular: Array, at: Callable[[Array], Array] | None) -> tuple[float, float]:
    """Return the least regularity, and the parameter there.

    Args:
        t: Values of the parameter at which it is known, shape (n,).
        regular: The regularity there, shape (n,).
        at: The regularity at other values of the parameter, shape (n,); ``None`` where nothing is between them.
    """
    k = int(_first_least(regular))
    best = float(regular[k]), float(t[k])
    for _ in range(ROUNDS if at else 0):
        if not 0 < k < len(t) - 1 or not RANK < best[0] < NEAR:
            break
        t = np.concatenate([np.linspace(t[k - 1], t[k], PLACES + 1), np.linspace(t[k], t[k + 1], PLACES + 1)[1:]])
        try:
            assert at
            regular = at(t)
        except PinarmError:  # singular: nothing closer can be looked at
            break
        k = int(_first_least(regular))
        best = min(best, (float(regular[k]), float(t[k])))
    return best


def _between(run: Trajectory, motion: SolvedMotion, rank: int, largest: float, t: Array) -> Array:
    """Return the regularity at values of the parameter, shape (n,)."""
    closure = run.mechanism.closure
    return np.asarray(closure.values(motion.positions(t))[:, rank - 1] / largest)

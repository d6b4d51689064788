"""How close a motion comes to a singular position of its loops, between the rows of its table too."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Indices, distinct
from pinarm.engine.constraints.nullspace import RANK
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import PinarmError
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import SolvedMotion

NEAR = 0.1
"""Regularity at the rows from which on it is looked for between them."""

ROUNDS, EVENLY = 10, np.linspace(0.0, 1.0, 10)[1:-1]
"""How often instants between rows are looked at; places of the first ones on either side, as rows may be far apart."""

SAME = 1e-9
"""Difference of regularities, relative to them, that is rounding: of positions that a motion takes twice the first
counts, whatever the processor."""

FLAT = 0.05
"""Part of the regularity by which it changes from one instant to the next where it is not looked for any closer."""

SIDES = np.array([[1.0, -1.0, -1.0], [1.0, 1.0, -1.0]])
"""Signs of a quantity at three instants that goes through 0 before the middle one, or behind it."""


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
    least = int(_first_least(regular))
    best = float(regular[least]), float(t[least])
    if at is None or not 0 < least < len(t) - 1 or not RANK < best[0] < NEAR:
        return best
    t, here = t[least - 1 : least + 2], regular[least - 1 : least + 2]
    if t[0] > t[2]:
        t, here = t[::-1], here[::-1]
    for round_ in range(ROUNDS):
        between = _lowest(t, here) if round_ else _evenly(t)
        if not len(between):
            break
        try:
            found = at(between)
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
    return np.concatenate([start + EVENLY * (end - start) for start, end in pairwise(t.tolist())])


def _lowest(t: Array, values: Array) -> Array:
    """Return instants at which a size may be smallest, between three of which the middle one is the smallest so far.

    Where the signed quantity goes through 0 on the one side or on the other, by inverse quadratic interpolation where
    that stays on its side, and where a parabola through the squares, which are smooth in any case, is lowest.
    """
    crossing, gaps = (t[:-1] * values[1:] + t[1:] * values[:-1]) / (values[:-1] + values[1:]), t[1:] - t[:-1]
    signed, squares = values * SIDES, values * values
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = gaps / (signed[:, 1:] - signed[:, :-1])
        bend = (slopes[:, 1] - slopes[:, 0]) / (signed[:, 2] - signed[:, 0])
        bent = crossing + bend * -values[:-1] * values[1:]
    crossing = np.where((t[:-1] < bent) & (bent < t[1:]), bent, crossing)
    (left, right), (falling, rising) = gaps, (squares[1:] - squares[:-1]) / gaps
    vertex = t[1] - 0.5 * (falling * right + rising * left) / (rising - falling) if rising > falling else t[1]
    inside = np.array([*crossing, vertex])
    apart = 1e-9 * (t[2] - t[0])
    return distinct(inside[np.abs(inside[:, None] - t).min(axis=1) > apart])


def _between(run: Trajectory, motion: SolvedMotion, rank: int, largest: float, t: Array) -> Array:
    """Return the regularity at values of the parameter, shape (n,)."""
    closure = run.mechanism.closure
    return np.asarray(closure.values(motion.positions(t))[:, rank - 1] / largest)

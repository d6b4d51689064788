"""Whether a step along a branch of solutions has stayed on it, or leapt onto another one."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array, Flags

ENOUGH = 1e-9
"""Correction that is the last: Newton's method doubles the digits, the next one would be below rounding."""

CROSSED, AIMED, NEARER = 5e-6, 2e-6, 0.3
"""Largest ratio of singular values of J on both sides of a singular position that a step goes through, the one that the
step before it aims at, and how much smaller than the last one it becomes at once."""


def on_branch(turned: Array, correction: Array) -> Flags:
    """Tell which solutions are on the branch of their predictions: one on another branch has another velocity.

    With an error of the predicted position ``h^3 j / 6`` that of the velocity is three times as much, over h.

    Args:
        turned: Errors of the predicted velocities, times h, shape (.., nv).
        correction: Largest errors of the predicted coordinates, shape (..).
    """
    return np.asarray(np.abs(turned).max(axis=-1) <= 10.0 * correction + ENOUGH)


def part_of_leap(rows: Array, there: Array) -> float:
    """Return how much of a step may be taken, from J before and after it: all, unless it leads past a singularity.

    The least singular value is taken to change evenly, through 0: a shorter step aims at a position nearer to that, and
    from very near one of twice the way goes through it. Where branches only all but meet, the shorter steps follow
    their own.
    """
    nv = rows.shape[1]
    if _sign(rows, there) > 0.0:
        return 1.0
    values = [np.linalg.svd(each, compute_uv=False) for each in (rows, there)]
    before, after = (float(each[nv - 1] / each[0]) for each in values)
    if max(before, after) <= CROSSED:
        return 1.0
    wanted = max(NEARER * before, AIMED) if before > CROSSED else -before
    return (before - wanted) / (before + after)


def _sign(rows: Array, there: Array) -> float:
    """Return the sign of the determinant of ``rows^T there``, shapes (m, nv); 0 where that is singular."""
    return float(np.linalg.slogdet(rows.T @ there)[0])

"""Which joints constraint rows couple to others: what moves some of them need not move the rest."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array, Flags

NOTHING = 1e-12
"""Part of the largest number in a row below which another one is rounding."""


def coupled_joints(rows: Array, right: Array, v: Array) -> Flags:
    """Return which joints move or are coupled to such, row by row, shape (nv,).

    The others can stay at rest: ``G v = b`` asks nothing of them. They would not if what is nearest to rest were chosen
    by the masses alone, as the weight of a pendulum pulls it along with what carries it.

    Args:
        rows: G, shape (m, nv).
        right: b, shape (m,).
        v: Velocities that are given, and 0, shape (nv,).
    """
    sizes = np.abs(rows)
    touched = sizes > NOTHING * sizes.max(axis=1, initial=0.0)[:, None]
    moving: Flags = v != 0.0
    before = -1
    while before != (before := int(np.count_nonzero(moving))):
        reached = (right != 0.0) | touched[:, moving].any(axis=1)
        moving = np.asarray(moving | touched[reached].any(axis=0))
    return moving

"""Direction of joints, also at an instant of rest.

The direction of a joint, which tells whether a motor drives or is driven, is the sign of its velocity. Where that is
zero but for rounding it is that of the motion about to begin, or at the end of an interval that of the motion just
ended: by the acceleration, and where this is zero as well by the velocity a little inside the interval. It is 0 where
the joint rests. It belongs to the row and to the motion that the row is of: other rows, looked at or not, have no part.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import slides

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


class Beside(NamedTuple):
    """Data on the directions of n rows beside their velocities and accelerations.

    Attributes:
        pace: Scale of rounding of v and a, shape (2, nv) of one motion, (n, 2, nv) of separate states.
        side: 1 where the motion after the row counts, -1 where the motion before it counts, shape (n,).
        inside: Velocities a little later or earlier, used where v and a are zero, shape (n, nv).
    """

    pace: Array
    side: Array
    inside: Array


STANDSTILL = 1e-12
"""Part of the pace below which a velocity or an acceleration is rounding: 1e-16 of terms as large as the pace, which
closed loops amplify some thousand times at most."""


def lossy(mechanism: Mechanism) -> list[int]:
    """Return the indices in v of the joints at which the direction matters: behind a rigid gear with losses."""
    drives = mechanism.drives.items()
    return [mechanism.driven_joint(name).v for name, drive in drives if drive.rigid and drive.efficiency < 1.0]


def row_paces(mechanism: Mechanism, v: Array, a: Array) -> Array:
    """Return the scale of rounding in rows that are states of their own, shape (n, 2, nv); of one motion the largest.

    The largest velocity, and the largest acceleration, of all joints that have the same unit.
    """
    rates, sliding = np.abs(np.stack([v, a], axis=1)), slides(mechanism.model)
    paces = np.empty_like(rates)
    for alike in (sliding, ~sliding):
        paces[..., alike] = rates[..., alike].max(axis=-1, initial=0.0, keepdims=True)
    return paces


def at_rest(v: Array, a: Array, pace: Array) -> Flags:
    """Return where velocity and acceleration are both zero but for rounding, of the shape of v."""
    return np.asarray((_significant(v, pace[..., 0, :]) == 0.0) & (_significant(a, pace[..., 1, :]) == 0.0))


def directions(v: Array, a: Array, pace: Array, side: Array, inside: Array) -> Array:
    """Return the directions of the joints, 1, 0 or -1, shape (n, nv); for the last three arguments see ``Beside``."""
    return np.sign(leading(v, a, pace, side, inside, np.abs))


def leading(v: Array, a: Array, pace: Array, side: Array, inside: Array, size: Callable[[Array], Array]) -> Array:
    """Return v, or a towards the side, or velocities inside, with the direction of the motion, shape (n, k).

    It is 0 at rest. ``size`` returns lengths, of the shape of its argument, where several components make up one
    velocity; the other arguments are those of ``directions``.
    """
    now, later = _significant(v, pace[..., 0, :]), _significant(inside, pace[..., 0, :])
    beside = side[:, None] * _significant(a, pace[..., 1, :])
    return np.where(size(now) > 0.0, now, np.where(size(beside) > 0.0, beside, later))


def _significant(x: Array, scale: Array) -> Array:
    return np.where(np.abs(x) > STANDSTILL * scale, x, 0.0)

"""Direction of joints, also at an instant of rest: whether a motor drives or is driven.

The direction of a joint at a row is the sign of its velocity. Where that is zero but for rounding it is that of the
motion about to begin, or at the end of an interval that of the motion just ended: by the acceleration, and where this
is zero as well by the velocity a little inside the interval. It is 0 where the joint rests. It belongs to the row and
to the motion that the row is of: other rows, looked at or not, have no part in it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw

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
    """Return the scale of rounding in rows that are states of their own, shape (n, 2, nv).

    The largest velocity, and the largest acceleration, or term of one, of all joints that have the same unit.
    """
    rates, sliding = np.abs(np.stack([v, a], axis=1)), _sliding(mechanism)
    paces = np.empty_like(rates)
    for alike in (sliding, ~sliding):
        paces[..., alike] = rates[..., alike].max(axis=-1, initial=0.0, keepdims=True)
    return paces


def pace_of(
    mechanism: Mechanism, v: Array, a: Array, followed: Iterable[tuple[Coordinate, MotionLaw]], grid: Grid
) -> Array:
    """Return the scale of rounding of one motion, shape (2, nv), over the rows of a grid and the laws followed."""
    sliding, pace = _sliding(mechanism), np.asarray(row_paces(mechanism, v, a).max(axis=0))
    for coordinate, law in followed:
        alike = sliding == (coordinate.unit == METRE)
        pace[:, alike] = np.maximum(pace[:, alike], law_size(law, grid)[:, None])
    return pace


def law_size(law: MotionLaw, grid: Grid) -> Array:
    """Return estimates of the largest |s'| and |s''| of a law over a grid, shape (2,)."""
    begin, end = sorted((grid.cuts[0], grid.cuts[-1]))
    passed = [piece for piece in law.smooth_pieces if piece.start <= end and piece.end >= begin]
    sizes = [piece.between(begin, end).size()[1:] for piece in passed]
    return np.asarray(np.max(sizes, axis=0))


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


def _sliding(mechanism: Mechanism) -> Flags:
    sliding = np.zeros(mechanism.model.nv, dtype=bool)
    sliding[[joint.v for joint in mechanism.joints.values() if joint.unit == METRE]] = True
    return sliding

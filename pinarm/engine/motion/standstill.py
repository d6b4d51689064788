"""Known motions, prescribed or recorded: directions of joints, efforts of drives, and notes on joints at rest.

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
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.engine.statics.actuation import Actuation
    from pinarm.mechanics.rotors import Drive


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


def with_efforts(run: Trajectory, drives: Actuation, beside: Beside, *, bands: bool = True) -> Trajectory:
    """Return rows of a known motion with the efforts of drives that carry the load, and friction of joints.

    With ``bands`` they have the columns of efforts between which joints stay at rest.
    """
    if run.mechanism.frictions:
        from pinarm.engine.motion.known_friction import KnownFriction

        known = KnownFriction(run, drives, run.demand(), beside)
        return known.solved() if bands else known.moving()
    tau, lam = drives.efforts(run.grid.t, run.q, run.demand())
    return replace(run, tau=tau, lam=lam)


def rest_notes(run: Trajectory, pace: Array | None) -> list[str]:
    """Return notes on joints of a known motion that friction holds, and on rows at which joints stand still.

    ``pace`` is that of one motion; ``None`` of separate states, none of which turns back.
    """
    mechanism = run.mechanism
    if run.no_efforts or not (mechanism.frictions or lossy(mechanism)):
        return []
    notes = list[str]()
    for name, drive in mechanism.drives.items() if run.directions is not None else ():
        if drive.joint and drive.rigid and drive.efficiency < 1.0:
            notes += _held_by_gear(run, name, drive, run.direction(mechanism.driven_joint(name).v) == 0.0)
    if not (mechanism.frictions and run.drives):
        return notes
    from pinarm.engine.motion.known_friction import notes_of

    return [*notes_of(run, row_paces(mechanism, run.v, run.a) if pace is None else pace), *notes]


def _held_by_gear(run: Trajectory, name: str, drive: Drive, rest: Flags) -> list[str]:
    """Return a note on rows at which a gear with losses, and friction behind it, hold a load at rest, if any."""
    low = high = run.drive_effort(drive.joint)
    if drive.joint in run.drives and run.mechanism.frictions:
        from pinarm.engine.friction.columns import BANDS, own_effort

        coordinates = {along: run.mechanism.coordinate(along) for along in run.drives}
        own = own_effort(run.mechanism.joints, coordinates, drive.joint)
        low, high = (run.columns[f"{own}.{part}"].values for part in BANDS)
    size = np.maximum(np.abs(low), np.abs(high))
    rows = np.flatnonzero(rest & (size > STANDSTILL * size.max(initial=0.0)))
    if not len(rows):
        return []
    least, most = (side[rows[0]] for side in drive.holding(low, high))
    friction = " and friction hold" if run.mechanism.frictions else " holds"
    return [
        f"drive.{name}.torque: at rest its gear{friction} the load with any torque of a band, in {len(rows)} of "
        f"{len(run)} rows: from {least:.4g} to {most:.4g} N*m in the first of them"
    ]

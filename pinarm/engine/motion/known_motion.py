"""Known motions, prescribed or recorded: efforts of their drives, and notes on joints at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.motion.standstill import STANDSTILL, Beside, lossy, row_paces
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.engine.statics.actuation import Actuation
    from pinarm.mechanics.rotors import Drive


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

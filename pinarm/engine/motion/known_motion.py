"""Known motions, prescribed or recorded: efforts of their drives, instants of rest, and notes on joints at rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.motion.standstill import STANDSTILL, Beside, lossy, row_paces
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.engine.statics.actuation import Actuation
    from pinarm.mechanics.rotors import Drive

Slips = Callable[[Array], tuple[Array, Array]]
"""Instants in order, shape (n,) -> slips of k joints there, and what of them is rounding, both of shape (n, k)."""

HALVINGS = 52
"""Bisections after which an instant is known to its last digit."""


def with_efforts(run: Trajectory, drives: Actuation, beside: Beside) -> Trajectory:
    """Return rows of a known motion with the efforts of drives that carry the load, and friction of joints."""
    if run.mechanism.frictions:
        from pinarm.engine.motion.known_friction import KnownFriction

        return KnownFriction(run, drives, run.demand(), beside).solved()
    tau, lam = drives.efforts(run.grid.t, run.q, run.demand())
    return replace(run, tau=tau, lam=lam)


def rest_notes(run: Trajectory, pace: Array | None) -> list[str]:
    """Return notes on joints of a known motion that friction holds, and on rows at which joints stand still.

    ``pace`` is that of ``pace_of``; ``None`` of separate states, none of which turns back.
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


def slips_between(mechanism: Mechanism, q: Array, v: Array, pace: Array | None) -> tuple[Array, Array]:
    """Return the slips of the k joints with friction, and their rounding or error, both of shape (n, k)."""
    from pinarm.mechanics.friction.contact import slip_rows

    rows = slip_rows(mechanism.model, mechanism.frictions, q)
    rounding = np.zeros(rows.shape[:2]) if pace is None else STANDSTILL * np.matvec(np.abs(rows), pace[..., 0, :])
    return np.asarray(np.matvec(rows, v)), rounding


def rests_between(slips: Slips, t: Array) -> Array:
    """Return where joints come to rest, begin to slip or turn back, and both ends, shape (m,).

    Args:
        slips: The slips.
        t: Instants at which they are looked at, in order, shape (n,): a slip that changes its sign twice between two
            of them is not seen.
    """
    exact, rounding = slips(t)
    known = np.where(np.abs(exact) > rounding, exact, 0.0)
    at = np.flatnonzero(((known[:-1] == 0.0) != (known[1:] == 0.0)).any(axis=1))
    row, joint = np.nonzero(known[:-1] * known[1:] < 0.0)
    low, high, before = t[row], t[row + 1], known[row, joint]
    for _ in range(HALVINGS if len(row) else 0):
        middle = 0.5 * (low + high)
        order, values = middle.argsort(), np.empty_like(middle)
        values[order] = slips(middle[order])[0][np.arange(len(row)), joint[order]]
        low, high = np.where(before * values > 0.0, [middle, high], [low, middle])
    return np.unique(np.concatenate([t[[0, -1]], t[at], t[at + 1], 0.5 * (low + high)]))


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

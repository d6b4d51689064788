"""Notes on rows at which joints stand still.

At rest a gear with losses holds a load with any torque of a band. Where a joint turns back, losses and friction jump; a
row has one side.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.friction.columns import BANDS, own_effort
from pinarm.engine.motion.standstill import STANDSTILL
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.drives import Drive
from pinarm.mechanics.friction.contact import slip_rows


def standstill_notes(run: Trajectory, pace: Array | None) -> list[str]:
    """Return notes on a known motion with efforts; for ``pace`` see ``standstill``, ``None`` of separate states."""
    if run.no_efforts:
        return []
    notes = [_held(run, name, drive) for name, drive in _lossy(run)]
    if pace is not None:
        notes += [_jumping(run, name, turning) for name, turning in _turning(run, pace[..., 0, :])]
    return [note for note in notes if note]


def _lossy(run: Trajectory) -> Iterator[tuple[str, Drive]]:
    """Yield the drives of joints whose gears have losses."""
    if run.directions is not None:
        yield from (
            (name, drive)
            for name, drive in run.mechanism.drives.items()
            if drive.joint and drive.rigid and drive.efficiency < 1.0
        )


def _held(run: Trajectory, name: str, drive: Drive) -> str:
    """Return a note on rows at which a gear with losses holds a load; empty where there are none."""
    effort, rest = np.abs(run.drive_effort(drive.joint)), run.direction(run.mechanism.driven_joint(name).v) == 0.0
    loaded = effort > STANDSTILL * effort.max(initial=0.0)
    if drive.joint in run.drives and run.mechanism.frictions:
        return _held_by_friction(run, name, rest, loaded)
    count = int((rest & loaded).sum())
    if not count:
        return ""
    return (f"drive.{name}.torque: at rest its gear holds the load with any torque from {drive.efficiency**2:.4g} of "
            f"the value of the table to that value, in {count} of {len(run)} rows")  # fmt: skip


def _held_by_friction(run: Trajectory, name: str, rest: Flags, loaded: Flags) -> str:
    """Return a note on rows at which a gear with losses holds a load together with friction behind it.

    ``rest`` and ``loaded`` tell at which rows its joint rests, and carries a load, shape (n,).
    """
    mechanism, drive = run.mechanism, run.mechanism.drives[name]
    own = own_effort(mechanism.joints, {along: mechanism.coordinate(along) for along in run.drives}, drive.joint)
    low, high = (run.columns[f"{own}.{part}"].values for part in BANDS)
    rows = np.flatnonzero(rest & (loaded | (high > low)))
    if not len(rows):
        return ""
    least, most = (side[rows[0]] for side in drive.holding(low, high))
    return (f"drive.{name}.torque: at rest its gear and friction hold the load with any torque of a band, by "
            f"{own}.lower and .upper and the efficiency, in {len(rows)} of {len(run)} rows: from {least:.4g} to "
            f"{most:.4g} N*m in the first of them")  # fmt: skip


def _turning(run: Trajectory, pace: Array) -> Iterator[tuple[str, Flags]]:
    """Yield quantities that jump where a joint turns back, and at which rows it does, shape (n,)."""
    still = np.abs(run.v) <= STANDSTILL * pace
    for name, _ in _lossy(run):
        joint = run.mechanism.driven_joint(name).v
        yield f"drive.{name}.torque", still[:, joint] & (run.direction(joint) != 0.0)
    if contacts := run.mechanism.frictions:
        rows = slip_rows(run.mechanism.model, contacts, run.q)
        slow = np.abs(np.matvec(rows, run.v)) <= STANDSTILL * np.matvec(np.abs(rows), pace)
        names = np.array([contact.name for contact in contacts])
        for name in dict.fromkeys(names.tolist()):
            of = names == name
            yield f"{name}.friction", slow[:, of].all(axis=1) & (run.friction[:, of] != 0.0).any(axis=1)


def _jumping(run: Trajectory, quantity: str, turning: Flags) -> str:
    """Return a note on rows within intervals at which a joint turns back; empty where there are none."""
    inside = np.zeros(len(run), dtype=bool)
    for start, end, rows in run.grid.intervals():
        inside[rows] = (run.grid.t[rows] != start) & (run.grid.t[rows] != end)
    count = int((turning & inside).sum())
    if not count:
        return ""
    return (f"{quantity} jumps where the joint turns back, in {count} of {len(run)} rows: the table has the side after "
            "it, with all that follows from it")  # fmt: skip

"""Known motions, prescribed or recorded: efforts of their drives, instants of rest, and notes on joints at rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.motion.standstill import STANDSTILL, Beside, lossy, row_paces, standstill_notes
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.engine.statics.actuation import Actuation

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
    notes = standstill_notes(run, pace)
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
    """Return where joints come to rest, begin to slip, turn back, or slip least, and both ends, shape (m,).

    Of a joint that slips least the instant is known to the root of the rounding, and its slip to the rounding: whether
    it rests there is told by the slip.

    Args:
        slips: The slips.
        t: Instants at which they are looked at, in order, shape (n,): a slip that changes its sign twice between two
            of them is not seen.
    """
    exact, rounding = slips(t)
    known = np.where(np.abs(exact) > rounding, exact, 0.0)
    ends = (known[:-1] != 0.0) & (known[1:] == 0.0) | (known[:-1] == 0.0) & (known[1:] != 0.0)
    at = np.flatnonzero(ends.any(axis=1))
    instants = [t[[0, -1]], t[at], t[at + 1], _reversals(slips, t, known), _touches(slips, t, known)]
    return np.unique(np.concatenate(instants))


def _reversals(slips: Slips, t: Array, known: Array) -> Array:
    """Return where slips change their sign between two looks."""
    row, joint = np.nonzero(known[:-1] * known[1:] < 0.0)
    low, high, before = t[row], t[row + 1], known[row, joint]
    for _ in range(HALVINGS if len(row) else 0):
        middle = 0.5 * (low + high)
        later = before * _at(slips, middle, joint) > 0.0
        low, high = np.where(later, middle, low), np.where(later, high, middle)
    return 0.5 * (low + high)


def _touches(slips: Slips, t: Array, known: Array) -> Array:
    """Return where slips are least in size between looks, and so little that they may touch zero.

    Near such a place a slip is a power of the distance, 2 or more, so that there it is at most its second difference.
    """
    size, sign = np.abs(known), np.sign(known)
    least = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & (size[1:-1] > 0.0)
    alike = (sign[1:-1] == sign[:-2]) & (sign[1:-1] == sign[2:])
    row, joint = np.nonzero(least & alike & (size[1:-1] <= np.abs(np.diff(known, 2, axis=0))))
    low, middle, high, best = t[row], t[row + 1], t[row + 2], size[row + 1, joint]
    for _ in range(HALVINGS if len(row) else 0):
        left, right = 0.5 * (low + middle), 0.5 * (middle + high)
        beside = np.abs([_at(slips, left, joint), _at(slips, right, joint)])
        before, after = (beside[0] < best) & (beside[0] <= beside[1]), (beside[1] < best) & (beside[1] < beside[0])
        low = np.where(before, low, np.where(after, middle, left))
        high = np.where(before, middle, np.where(after, high, right))
        middle = np.where(before, left, np.where(after, right, middle))
        best = np.minimum(best, beside.min(axis=0))
    return middle


def _at(slips: Slips, t: Array, joint: Indices) -> Array:
    """Return the slips of one joint each at instants in any order, shape (n,)."""
    order, values = t.argsort(), np.empty_like(t)
    values[order] = slips(t[order])[0][np.arange(len(t)), joint[order]]
    return values

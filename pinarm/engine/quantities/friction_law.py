"""Residual of the friction law, from the reactions of a run: a route that no solver takes."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import sampled
from pinarm.engine.dynamics.equation import mass_matrix
from pinarm.engine.friction.joint_friction import INSTANT, REST
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.reactions import Reactions
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.contact import sizes, slip_rows, unit_vectors

CONTRADICTED = 1e-6
"""Part of the largest friction by which the law may be missed: what rounding leaves of large reactions is less."""

SLOW, SWITCHING = 1e-9, 1e-3
"""Slips, relative to the largest of the rows, that are rest: anywhere, and where an interval of the run ends, as at
switches, whose instants are known to the tolerance of the integration. There they are also relative to what the
accelerations of the rows make in that interval: all rows may be at switches."""


def _resting_speed(run: Trajectory) -> float:
    """Return the slip that rounding leaves of joints that come to rest, in SI: see ``JointFriction.resting_speed``."""
    inertia = np.diagonal(mass_matrix(run.mechanism.model, run.q[0]))
    efforts = np.abs(slip_rows(run.mechanism.model, run.mechanism.frictions, run.q)).max(axis=0)
    alone = _largest(run.friction) * _largest(efforts[:, inertia > 0.0] ** 2 / inertia[inertia > 0.0])
    return 8.0 * (REST * _largest(run.v) + INSTANT * _largest(run.grid.t) * max(_largest(run.a), alone))


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def friction_figures(run: Trajectory) -> dict[str, float]:
    """Return ``friction``: what the law of friction misses at most, relative to the largest friction of the run.

    Of a joint that slips, ``f + s (mu N + c)``; of one at rest, by how much ``|f|`` exceeds its limit. N is that of the
    reactions of the rows, by Newton's and Euler's equations of the bodies.
    """
    contacts = run.mechanism.frictions
    if not contacts or run.no_efforts or not len(run):
        return {}
    some = run.some(sampled(len(run)))
    reactions, missed, largest = Reactions(some), 0.0, 0.0
    rows = slip_rows(run.mechanism.model, contacts, some.q)
    slips, changes = np.matvec(rows, some.v), sizes(contacts, np.matvec(rows, some.a))
    lam = {name: reactions.multipliers[:, part] for name, part in some.closure.slices.items()}
    ends = np.isin(some.grid.t, some.grid.cuts[1:-1])
    spans = np.repeat(np.diff(some.grid.cuts), np.diff(some.grid.rows))
    errors = np.zeros_like(some.v) if some.rate_errors is None else some.rate_errors
    known = np.maximum(_resting_speed(some), sizes(contacts, np.matvec(np.abs(rows), errors)))
    speeds, against, lengths = sizes(contacts, slips), unit_vectors(contacts, slips), sizes(contacts, some.friction)
    each = zip(contacts, some.friction.T, lengths.T, speeds.T, against.T, changes.T, known.T, strict=True)
    for contact, f, size, speed, s, change, rounding in each:
        normal = np.zeros(len(some))
        if contact.law.loaded:
            normal = contact.bearing.load(contact.transmitted(reactions.links, reactions.joints, lam))
        mu, constant = contact.law.slipping(speed)
        rest = contact.law.static_mu * normal + contact.law.static_constant
        slipping, stuck = np.abs(f + s * (mu * normal + constant)), np.maximum(size - rest, 0.0)
        switching = np.where(ends, SWITCHING * np.maximum(speed.max(), change.max() * spans), 0.0)
        slow = speed <= np.maximum(switching, np.maximum(SLOW * speed.max(), rounding))
        missed = max(missed, float(np.where(slow, stuck, slipping).max()))
        largest = max(largest, float(rest.max()))
    left = missed / largest if largest else 0.0
    if left > CONTRADICTED:
        raise DynamicsError(
            f"friction and the reactions that it depends on contradict each other by {left:.2g} of the friction",
            expected="loads of bearings that follow from the motion and the friction",
            hint="friction without a load: constant",
        )
    return {"friction": left}

"""Dry friction in a linearised motion: joints that stick are held, joints that slip have the slope of their law.

A joint that slips has ``f = -(u/|u|) (mu(|u|) N + c(|u|))`` with the slip u = H v and the load N of its bearing, which
depends on positions, velocities, accelerations and the forces of constraints and friction (``mechanics.friction``). One
that sticks is a constraint; one that begins to slip has no derivative.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinarm.arrays import STEP, Array, Flags, length
from pinarm.engine.constraints.constraint_rows import ConstraintRows
from pinarm.engine.friction.columns import friction_columns
from pinarm.engine.linear.derivatives import complex_kept
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.reactions import Reactions
from pinarm.errors import DynamicsError, InputError
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, PairCoordinate
from pinarm.mechanics.friction.contact import FrictionContact, same_joint, sizes
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.records import Record, replace

AT_REST = 1e-9
"""Slip and its acceleration, relative to ``1 +`` the largest in SI, that are rounding of a joint at rest."""

AT_LIMIT = 1e-6
"""Part of its limit by which friction at rest has to be away from it, to be said to hold."""


class FrictionState(Record, frozen=True):
    """Friction at one state.

    Attributes:
        f: Friction along them [N*m or N], shape (k,).
        stuck: Which of them friction holds, shape (k,).
    """

    contacts: Sequence[FrictionContact]
    f: Array
    stuck: Flags

    @property
    def note(self) -> str:
        """Note on joints that stick; empty where none does."""
        names = dict.fromkeys(contact.name for contact, stuck in zip(self.contacts, self.stuck, strict=True) if stuck)
        return f"held by dry friction in the small motion: {', '.join(names)}" if names else ""


def at_rest(contacts: Sequence[FrictionContact], slips: Array, v: Array) -> Flags:
    """Return a mask of the contacts that stick if they are held, with dry friction and no slip, shape (k,)."""
    dry = np.array([any(contact.law.resting) for contact in contacts], dtype=bool)
    return np.asarray(dry & (sizes(contacts, slips) <= AT_REST * (1.0 + np.abs(v).max(initial=0.0))))


def friction_state(state: Trajectory) -> FrictionState:
    """Return the friction of a state, a table of one row with accelerations, multipliers and friction."""
    contacts, f = state.mechanism.frictions, state.friction[0]
    slips = slips_of(state, contacts)[0]
    stuck = at_rest(contacts, slips, state.v[0])
    here = Kinematics.at(state.mechanism.model, state.q[0], state.v[0])
    begun = np.array([contact.slip.row(here) @ state.a[0] + contact.slip.drift(here) for contact in contacts])
    limits = np.array(
        [
            contact.law.static_mu * load + contact.law.static_constant
            for contact, load in zip(contacts, _loads(state, contacts)[0], strict=True)
        ]
    )
    moves = np.abs(begun) > AT_REST * (1.0 + np.abs(state.a[0]).max(initial=0.0))
    for k in np.flatnonzero(stuck & (moves | (sizes(contacts, f) > (1.0 - AT_LIMIT) * limits))).tolist():
        raise DynamicsError(
            f"{contacts[k].name} begins to slip here: friction has a kink where it does not hold a joint at rest",
            expected=f"a load along it below {limits[k]:.6g} {contacts[k].effort}, or a velocity",
        )
    return FrictionState(contacts, f, stuck)


def slip_friction(run: Trajectory, contacts: Sequence[FrictionContact]) -> Array:
    """Return the friction of contacts that slip at n states, which may be complex steps, shape (n, k)."""
    slips, loads = slips_of(run, contacts), _loads(run, contacts)
    speeds = np.sqrt((slips * slips) @ same_joint(contacts).astype(float))
    friction = np.zeros_like(slips * loads)
    for k, contact in enumerate(contacts):
        if not any(contact.law.resting):
            friction[:, k] = -contact.law.viscous * slips[:, k]
            continue
        mu, constant = contact.law.slipping(speeds[:, k])
        friction[:, k] = -slips[:, k] / speeds[:, k] * (mu * loads[:, k] + constant)
    return friction


def friction_slopes(steps: Trajectory, contacts: Sequence[FrictionContact]) -> Array:
    """Return the slopes of the friction of contacts that slip, along imaginary steps, a row each; shape (k, n)."""
    with complex_kept():
        return np.asarray(np.imag(slip_friction(steps, contacts)).T / STEP)


def slips_of(run: Trajectory, contacts: Sequence[FrictionContact]) -> Array:
    """Return the slips u of k contacts at n states, shape (n, k)."""
    model = run.mechanism.model
    rows = ConstraintRows.of(model, [measured(contact) for contact in contacts])
    return np.asarray(np.matvec(rows.at(run.q).matrices, run.v))


def with_friction(run: Trajectory, friction: Array) -> Trajectory:
    """Return states with their friction, shape (n, k)."""
    return replace(run, columns={**run.columns, **friction_columns(run.mechanism.frictions, friction)})


def measured(contact: FrictionContact) -> Coordinate:
    """Return the slip of a contact as a coordinate."""
    if isinstance(contact.slip, LinearCoordinate | PairCoordinate):
        return contact.slip
    raise InputError(
        f"the linear analysis has no derivatives of the friction of {contact.name}",
        expected="friction of joints, threads, teeth or belts",
    )


def _loads(run: Trajectory, contacts: Sequence[FrictionContact]) -> Array:
    """Return the loads N of k bearings in units of their friction, shape (n, k); 0 of friction that has none."""
    loads = np.zeros((len(run), len(contacts)), run.q.dtype)
    if not any(contact.law.loaded for contact in contacts):
        return loads
    reactions, multipliers = Reactions(run, 0), run.lam
    lam = {name: multipliers[:, rows] for name, rows in run.closure.slices.items()}
    for k, contact in enumerate(contacts):
        if contact.law.loaded:
            wrench = contact.transmitted(reactions.links, reactions.joints, lam)
            normals = np.matvec(contact.bearing.parts, wrench[..., None, :])
            try:
                loads[:, k] = length(normals).sum(axis=-1) + contact.bearing.preload
            except FloatingPointError:
                raise InputError(
                    f"the friction of {contact.name} has a kink here: a normal force of its bearing is 0",
                    expected="a state in which the bearing is loaded, or friction without a load: constant",
                ) from None
    return loads

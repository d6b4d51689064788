"""Steady motions: states at which nothing accelerates while drives hold or turn some coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.linear.force_balance import ForceBalance, Forces
from pinarm.errors import DynamicsError, InputError
from pinarm.mechanics.forces.force_element import refusals
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

LASTING = 1e-7
"""Forces left after some of the motion, relative to their terms: rounding of configurations explains as much."""

SHARED = 1e-9
"""Effort of a drive in a self-stress of length 1 that is rounding."""

TURNED = 0.7, 2.1, 3.1
"""Angles [rad] by which the fastest joint turns on, at which a steady motion is still one: almost half a turn too."""


class SteadyState(Record, frozen=True):
    """A state in which nothing accelerates.

    Attributes:
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        efforts: Efforts u of the drives along their coordinates [N*m or N], shape (k,).
    """

    q: Array
    v: Array
    efforts: Array


def steady_state(balance: ForceBalance, q: Array) -> SteadyState:
    """Return the steady state near a configuration, shape (nq,)."""
    mechanism = balance.mechanism
    q, forces = balance.solved(q, "the start")
    _require_steady(mechanism, q, forces.v)
    _require_own_efforts(balance, q)
    stiffness = float(np.abs(balance.slopes(q, forces).force_q).sum())
    _require_lasting(balance, q, forces, LASTING * (float(forces.terms.sum()) + stiffness))
    return SteadyState(q, forces.v, forces.carried[mechanism.closure.size : balance.closure.size])


def advanced(mechanism: Mechanism, q: Array, v: Array) -> list[Array]:
    """Return configurations later in a steady motion, shape (nq,) each; none of one at rest."""
    speed = float(np.abs(v).max(initial=0.0))
    return [pin.integrate(mechanism.model, q, angle / speed * v) for angle in TURNED] if speed else []


def _require_own_efforts(balance: ForceBalance, q: Array) -> None:
    """Raise where drives may work against each other: their efforts, and so the small motion, are then undetermined."""
    stresses = balance.closure.split_at(q).stresses[balance.mechanism.closure.size :]
    shared = np.abs(stresses).max(axis=1, initial=0.0) > SHARED
    if shared.any():
        names = ", ".join(name for name, shares in zip(balance.driven.names, shared, strict=True) if shares)
        raise InputError(
            f"the load does not determine the efforts of {names}, on which the small motion depends",
            expected="coordinates in hold and steady that move independently of each other",
            hint="one of them left out, or a load of its effort in loads",
        )


def _require_lasting(balance: ForceBalance, q: Array, forces: Forces, most: float) -> None:
    """Raise where the forces do not balance later in the motion, with the same efforts, but for ``most``."""
    own, size = balance.mechanism.closure.size, balance.closure.size
    for later in advanced(balance.mechanism, q, forces.v):
        if reason := refusals(balance.dynamics.forces, later):
            raise DynamicsError(f"the motion is steady for a part of a turn only{reason}")
        then = balance.at(later)
        changed = np.abs(then.carried[own:size] - forces.carried[own:size]).max(initial=0.0)
        left, slower = np.abs(then.left).max(initial=0.0), np.abs(then.v - forces.v).max(initial=0.0)
        if max(left, changed) > most or slower > LASTING * np.abs(forces.v).max(initial=0.0):
            raise DynamicsError(
                "the motion is steady for an instant only: forces balance here, and no more as it goes on",
                hint="weights that turn about an axis which is not vertical, or joints that do not turn about one axis",
            )


def _require_steady(mechanism: Mechanism, q: Array, v: Array) -> None:
    """Raise where loops do not allow a velocity, or not without acceleration."""
    closure = mechanism.closure
    state = closure.state(q, v)
    rate, drift = closure.rows(state) @ v, closure.drift(state)
    speed = float(np.abs(v).max(initial=0.0))
    torn = (np.abs(rate) > 1e-9 * speed) | (np.abs(drift) > 1e-9 * speed**2)
    if torn.any():
        names = dict.fromkeys(owner.name for (owner, _), tears in zip(closure.owners(), torn, strict=True) if tears)
        raise DynamicsError(
            f"{', '.join(names)} does not stay closed at these velocities without acceleration",
            hint="a steady motion turns the mechanism as a whole, or links about axes of their own",
        )

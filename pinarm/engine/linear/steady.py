"""Equilibria and steady motions: positions at which nothing accelerates while drives hold or turn some coordinates.

With the rows W of the coordinates that drives hold or turn, the forces balance where

    M a + nle - loads = G^T lam + W^T u,    a = 0

has a solution lam, u. Newton's method moves along the velocities that G and W leave, with the derivatives of the left
side and of ``G^T lam``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.linear.derivatives import equation_derivatives
from pinarm.engine.linear.linearisation import independent_joints
from pinarm.errors import AssemblyError, DynamicsError
from pinarm.mechanics.joints import format_configuration
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

ITERATIONS, STRIDE = 100, 0.5
"""Newton steps at most; the largest change of a joint in one of them [rad or m]."""

BALANCED = 1e-12
"""Forces left that are rounding, relative to their terms and to the stiffness times 1 rad or 1 m."""


class SteadyState(Record, frozen=True):
    """A state in which nothing accelerates.

    Attributes:
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        efforts: Efforts u of the drives along their coordinates [N*m or N], shape (k,).
        tau: The same at the joints, ``W^T u``, shape (nv,).
        lam: Multipliers of the constraints, shape (m,).
    """

    q: Array
    v: Array
    efforts: Array
    tau: Array
    lam: Array


def steady_state(
    mechanism: Mechanism, dynamics: Dynamics, held: PrescribedCoordinates, values: Array, weights: Array, q: Array,
    v: Array,
) -> SteadyState:  # fmt: skip
    """Return the steady state near a configuration.

    Args:
        mechanism: The mechanism.
        dynamics: Its equation of motion with the loads of the run.
        held: Coordinates that keep their values.
        values: These values, shape (h,).
        weights: W, of the coordinates that drives hold or turn, shape (k, nv).
        q: Configuration to start from, shape (nq,).
        v: Velocity, shape (nv,): of the coordinates that turn, 0 elsewhere.

    Raises:
        AssemblyError: Newton's method reaches none.
        DynamicsError: Loops do not allow the velocity, or not without acceleration.
    """
    closure, still = mechanism.closure, np.zeros_like(v)
    best, smallest, length, step = q, np.inf, 1.0, still
    for _ in range(ITERATIONS):
        trial = assembled(closure, held, pin.integrate(mechanism.model, best, length * step), values, 0.0)
        demand = dynamics.inverse(0.0, trial[None], v[None], still[None])[0]
        rows = np.vstack([closure.rows(closure.state(trial)), weights])
        carried = np.linalg.lstsq(rows.T, demand, rcond=None)[0]
        left = demand - rows.T @ carried
        if smallest < np.linalg.norm(left):
            length *= 0.25
            continue
        best, smallest, length = trial, float(np.linalg.norm(left)), 1.0
        lam, efforts = carried[: closure.size], carried[closure.size :]
        slopes = equation_derivatives(dynamics, closure.constraints, 0.0, best, v, still, lam).force_q
        terms = np.abs(demand).sum() + np.abs(rows.T * carried).sum() + np.abs(slopes).sum()
        if smallest <= BALANCED * terms:
            _require_steady(mechanism, best, v)
            return SteadyState(best, v, efforts, efforts @ weights, lam)
        _, free = independent_joints(rows)
        step = -free @ np.linalg.lstsq(free.T @ slopes @ free, free.T @ left, rcond=1e-12)[0]
        step *= min(1.0, STRIDE / max(float(np.abs(step).max(initial=0.0)), STRIDE))
    raise AssemblyError(
        f"no steady state is near the start: forces of {smallest:.3g} are left where "
        f"{format_configuration(mechanism.model, best)}",
        expected="a start near one", q=best,
    )  # fmt: skip


def _require_steady(mechanism: Mechanism, q: Array, v: Array) -> None:
    """Raise where loops do not allow a velocity, or not without acceleration.

    Raises:
        DynamicsError: Names the loops.
    """
    state = mechanism.closure.state(q, v)
    rate, drift = mechanism.closure.rows(state) @ v, mechanism.closure.drift(state)
    speed = float(np.abs(v).max(initial=0.0))
    torn = (np.abs(rate) > 1e-9 * speed) | (np.abs(drift) > 1e-9 * speed**2)
    if torn.any():
        names = dict.fromkeys(
            owner.name for (owner, _), tears in zip(mechanism.closure.owners(), torn, strict=True) if tears
        )
        raise DynamicsError(
            f"{', '.join(names)} does not stay closed at these velocities without acceleration",
            hint="a steady motion turns the mechanism as a whole, or links about axes of their own",
        )

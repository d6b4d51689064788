"""Equilibria and steady motions: positions at which nothing accelerates while drives hold or turn some coordinates.

With the rows W of the coordinates that drives hold or turn, and the rows H of slips, the forces balance where

    M a + nle - loads - H_slip^T f = G^T lam + W^T u + H_stuck^T f,    a = 0

has a solution lam, u, f. Newton's method moves along the velocities that G, W and joints that stick leave, with the
derivatives of the left side and of the loads on the right. Joints with dry friction that are at rest keep their place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import Measured
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.linear.derivatives import equation_derivatives
from pinarm.engine.linear.friction import at_rest, measured, slip_friction, with_friction
from pinarm.engine.linear.linearisation import independent_joints
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.errors import AssemblyError, DynamicsError, InputError
from pinarm.input.units import unit
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.forces.force_element import refusals
from pinarm.mechanics.friction.contact import slip_rows_at
from pinarm.mechanics.joints import format_configuration
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

LOOSE = 1e-12
"""Velocity of a joint, relative to that of an independent one, up to which it is rounding of 0."""

ITERATIONS, STRIDE = 100, 0.5
"""Newton steps at most; the largest change of a joint in one of them [rad or m]."""

BALANCED = 1e-12
"""Forces left that are rounding, relative to their terms and to the stiffness times 1 rad or 1 m."""

LASTING = 1e-7
"""Forces left after some of the motion, relative to their terms: rounding of configurations explains as much."""

SHARED = 1e-9
"""Effort of a drive in a self-stress of length 1 that is rounding."""

TURNED = 0.7, 2.1, 3.1
"""Angles [rad] by which the fastest joint turns on, at which a steady motion is still one: almost half a turn too."""


class Driven(Record, frozen=True):
    """Coordinates that drives hold or turn.

    Attributes:
        names: Names of the k coordinates.
        coordinates: The coordinates.
        held: Those that keep their values.
        values: These values, shape (h,).
        rates: Rates of all, 0 of those that are held [rad/s or m/s], shape (k,).
    """

    names: Sequence[str]
    coordinates: Sequence[Coordinate]
    held: PrescribedCoordinates
    values: Array
    rates: Array


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


def state_row(mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array) -> Trajectory:
    """Return a state as a table of one row, at rest and without efforts."""
    grid, still = Grid(np.full(1, t), (t, float(np.nextafter(t, np.inf))), (0, 1)), np.zeros((1, len(v)))
    closure = mechanism.closure
    return Trajectory(
        mechanism, ROW, unit("1"), grid, q[None], v[None], still, still, Multipliers.zero(1, closure.size), closure,
        dynamics, separate=True,
    )  # fmt: skip


class _Balance:
    """Forces of a steady state and the rows that carry them."""

    def __init__(self, mechanism: Mechanism, dynamics: Dynamics, driven: Driven) -> None:
        self.mechanism, self.dynamics, self.driven = mechanism, dynamics, driven
        self.closure = mechanism.closure.with_guides(driven.names, driven.coordinates)
        self.contacts = mechanism.frictions

    def at(self, q: Array) -> _Forces:
        """Return the forces at a configuration."""
        model, own = self.mechanism.model, self.mechanism.closure.size
        rows = self.closure.rows(self.closure.state(q))
        v = self._velocity(rows)
        slips = slip_rows_at(model, self.contacts, q)
        stuck = at_rest(self.contacts, slips @ v, v)
        rows = np.vstack([rows, slips[stuck]])
        demand = self.dynamics.inverse(0.0, q[None], v[None], np.zeros((1, len(v))))[0]
        f, state = np.zeros(len(self.contacts)), state_row(self.mechanism, self.dynamics, 0.0, q, v)
        sliding = [contact for contact, held in zip(self.contacts, stuck, strict=True) if not held]
        for _ in range(ITERATIONS if sliding else 1):
            carried = np.linalg.lstsq(rows.T, demand - slips[~stuck].T @ f[~stuck], rcond=None)[0]
            f[stuck] = carried[self.closure.size :]
            if not sliding:
                break
            row = replace(state, lam=Multipliers.known(carried[None, :own], own), tau=self._tau(rows, carried)[None])
            friction = slip_friction(with_friction(row, f[None]), sliding)[0]
            change, f[~stuck] = np.abs(friction - f[~stuck]).max(), friction
            if change <= BALANCED * np.abs(friction).max():
                break
        left = demand - slips[~stuck].T @ f[~stuck] - rows.T @ carried
        return _Forces(v, rows, demand, carried, f, left)

    def _tau(self, rows: Array, carried: Array) -> Array:
        """Return the efforts of the drives at joints, shape (nv,)."""
        drives = slice(self.mechanism.closure.size, self.closure.size)
        return np.asarray(rows[drives].T @ carried[drives])

    def _velocity(self, rows: Array) -> Array:
        """Return the velocity at which the drives turn, all else still, shape (nv,)."""
        driven = self.driven
        if not driven.rates.any():
            return np.zeros(rows.shape[1])
        wanted = np.concatenate([np.zeros(len(rows) - len(driven.rates)), driven.rates])
        v = np.linalg.lstsq(rows, wanted, rcond=1e-12)[0]
        speed = np.abs(v).max()
        if np.abs(rows @ v - wanted).max() > 1e-9 * speed:
            raise InputError("loops, couplings and rates contradict each other", expected="fewer rates")
        v[np.abs(v) < 1e-12 * speed] = 0.0
        _, free = independent_joints(rows)
        loose = np.flatnonzero((v != 0.0) & (np.abs(free) > LOOSE).any(axis=1))
        if len(loose):
            names = ", ".join(coordinate_name(self.mechanism.model, index) for index in loose.tolist())
            raise InputError(
                f"the rates do not determine how fast {names} move",
                expected="a rate in steady, or a value in hold, for more coordinates",
            )
        return np.asarray(v)

    def slopes(self, q: Array, forces: _Forces) -> Array:
        """Return the derivatives of the forces by q, shape (nv, nv)."""
        slips = [measured(contact) for contact in self.contacts]
        rows: list[Measured] = [*self.mechanism.constraints, *self.driven.coordinates, *slips]
        lam, still = np.concatenate([forces.carried[: self.closure.size], forces.f]), np.zeros_like(forces.v)
        return equation_derivatives(self.dynamics, rows, 0.0, q, forces.v, still, lam).force_q


class _Forces(Record, frozen=True):
    """Forces at a configuration: what is demanded, what rows carry, friction of all slips, and what is left."""

    v: Array
    rows: Array
    demand: Array
    carried: Array
    f: Array
    left: Array

    def terms(self) -> float:
        """Return the sum of the sizes of the forces."""
        return float(np.abs(self.demand).sum() + np.abs(self.rows.T * self.carried).sum())


def steady_state(mechanism: Mechanism, dynamics: Dynamics, driven: Driven, q: Array) -> SteadyState:
    """Return the steady state near a configuration.

    Args:
        mechanism: The mechanism.
        dynamics: Its equation of motion with the loads of the run.
        driven: Coordinates that drives hold or turn.
        q: Configuration to start from, shape (nq,).

    Raises:
        AssemblyError: Newton's method reaches none.
        DynamicsError: Loops do not allow the velocity, or not without acceleration.
        InputError: Rates do not determine the velocity, or the load not the efforts of the drives.
    """
    balance, smallest, length = _Balance(mechanism, dynamics, driven), np.inf, 1.0
    best, step = q, np.zeros(mechanism.model.nv)
    for _ in range(ITERATIONS):
        near = pin.integrate(mechanism.model, best, length * step)
        trial = assembled(mechanism.closure, driven.held, near, driven.values, 0.0)
        forces = balance.at(trial)
        if smallest < np.linalg.norm(forces.left):
            length *= 0.25
            continue
        best, smallest, length = trial, float(np.linalg.norm(forces.left)), 1.0
        slopes = balance.slopes(best, forces)
        if smallest <= BALANCED * (forces.terms() + np.abs(slopes).sum()):
            _require_steady(mechanism, best, forces.v)
            _require_own_efforts(balance, best)
            _require_lasting(balance, best, forces, LASTING * (forces.terms() + float(np.abs(slopes).sum())))
            drives = slice(mechanism.closure.size, balance.closure.size)
            return SteadyState(best, forces.v, forces.carried[drives])
        _, free = independent_joints(forces.rows)
        step = -free @ np.linalg.lstsq(free.T @ slopes @ free, free.T @ forces.left, rcond=1e-12)[0]
        step *= min(1.0, STRIDE / max(float(np.abs(step).max(initial=0.0)), STRIDE))
    raise AssemblyError(
        f"no steady state is near the start: forces of {smallest:.3g} are left where "
        f"{format_configuration(mechanism.model, best)}",
        expected="a start near one",
        q=best,
    )


def advanced(mechanism: Mechanism, q: Array, v: Array) -> list[Array]:
    """Return configurations later in a steady motion, shape (nq,) each; none of one at rest."""
    speed = float(np.abs(v).max(initial=0.0))
    return [pin.integrate(mechanism.model, q, angle / speed * v) for angle in TURNED] if speed else []


def _require_own_efforts(balance: _Balance, q: Array) -> None:
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


def _require_lasting(balance: _Balance, q: Array, forces: _Forces, most: float) -> None:
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
    closure: Closure = mechanism.closure
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

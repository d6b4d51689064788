"""Derivatives of the equation of motion at one state, for trees and loops.

With the rows G of the constraints and their multipliers lam,

    M a + nle - loads - G^T lam = tau,    G a + G' v = 0,    G v = 0

Pinocchio differentiates ``M a + nle`` (``computeRNEADerivatives``). Loads, ``G^T lam``, ``G a``, ``G' v`` and ``G v``
are differentiated by complex steps of the numpy evaluation: ``f'(x) = Im f(x + i h) / h`` is exact to rounding, as no
difference is taken. Derivatives by q are those along unit velocities, ``d/ds f(q + s e_k)`` on the space of
configurations.

Source: Squire and Trapp, Using complex variables to estimate derivatives of real functions, SIAM Review 40 (1998);
Carpentier and Mansard, Analytical derivatives of rigid body dynamics algorithms, RSS (2018).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import pinocchio as pin

from pinarm.arrays import STEP, Array
from pinarm.engine.constraints.constraint_rows import ConstraintRows, Measured
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import weight_bounds
from pinarm.errors import InputError
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.records import Record

KINK_STEP, KINK, ROUNDED = 2e-5, 1e-2, 1e-6
"""Step over which the slopes of a load to both sides are compared [rad or m, rad/s or m/s]; part of the slope by which
they may differ, and part of the largest stiffness or damping that is rounding of these differences."""

MOST_VELOCITIES = 250
"""Largest number of velocities: Pinocchio's whole buffers take about 60 nv^3 bytes, 1 GB."""


class EquationDerivatives(Record, frozen=True):
    """Derivatives of the equation of motion at one state; m rows of constraints.

    Attributes:
        mass: M, shape (nv, nv).
        force_q: Of ``M a + nle - loads - G^T lam`` by q, shape (nv, nv).
        force_v: The same by v, shape (nv, nv).
        rows: G, shape (m, nv).
        rows_q: Of G by q, the velocity of the step first, shape (nv, m, nv).
        acceleration_q: Of ``G a + G' v`` by q, shape (m, nv).
        acceleration_v: The same by v, shape (m, nv).
        terms_q: Sizes of the terms that ``force_q`` is the sum of, shape (nv, nv): its rounding is relative to them.
        terms_v: The same of ``force_v``.
    """

    mass: Array
    force_q: Array
    force_v: Array
    rows: Array
    rows_q: Array
    acceleration_q: Array
    acceleration_v: Array
    terms_q: Array
    terms_v: Array


def equation_derivatives(
    dynamics: Dynamics, constraints: Sequence[Measured], t: float, q: Array, v: Array, a: Array, lam: Array
) -> EquationDerivatives:
    """Return the derivatives at a state.

    Args:
        constraints: Its constraints, and coordinates along which efforts act.
        t: Instant of loads that follow laws [s].
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        a: Acceleration, shape (nv,).
        lam: Multipliers of the constraints, and these efforts, shape (m,).
    """
    mass, force_q, force_v, speed = tree_derivatives(dynamics.model, q, v, a)
    rows, rows_q, drift_q, drift_v = _row_derivatives(dynamics.model, constraints, q, v)
    pulls, levers = weight_bounds(dynamics.model, mass), np.sqrt(np.maximum(np.diag(mass), 0.0))
    whirl = speed * np.outer(levers, levers)
    terms_q = np.abs(force_q) + np.minimum.outer(pulls, pulls) + speed * whirl
    terms_q += np.einsum("kmj,m->jk", np.abs(rows_q), np.abs(lam))
    terms_v = np.abs(force_v) + whirl
    force_q -= np.einsum("kmj,m->jk", rows_q, lam)
    for force in dynamics.changing:
        load_q, load_v = element_derivatives(dynamics.model, force, t, q, v)
        force_q, terms_q = force_q - load_q, terms_q + np.abs(load_q)
        force_v, terms_v = force_v - load_v, terms_v + np.abs(load_v)
    acceleration_q = np.einsum("kmj,j->mk", rows_q, a) + drift_q
    return EquationDerivatives(mass, force_q, force_v, rows, rows_q, acceleration_q, drift_v, terms_q, terms_v)


def tree_derivatives(model: pin.Model, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array, float]:
    """Return M, the derivatives of ``M a + nle`` by q and by v, shape (nv, nv) each, and the fastest turn [rad/s]."""
    if model.nv > MOST_VELOCITIES:
        raise InputError(
            f"the linear analysis of {model.nv} velocities would take {60e-9 * model.nv**3:.0f} GB",
            expected=f"a mechanism with {MOST_VELOCITIES} velocities at most",
        )
    data = model.createData()
    pin.computeRNEADerivatives(model, data, q, v, a)
    upper = np.triu(data.M)
    speed = max(float(np.linalg.norm(twist.angular)) for twist in data.v)
    return upper + np.triu(upper, 1).T, data.dtau_dq.copy(), data.dtau_dv.copy(), speed


def element_derivatives(model: pin.Model, force: ForceElement, t: float, q: Array, v: Array) -> tuple[Array, Array]:
    """Return the derivatives of the load of one force element by q and by v, shape (nv, nv) each."""
    nv = model.nv
    q_steps, v_steps = _steps(model, q), v + 1j * STEP * np.eye(nv)
    q_many = np.concatenate([q_steps, np.broadcast_to(q, q_steps.shape)])
    v_many = np.concatenate([np.broadcast_to(v, v_steps.shape), v_steps])
    tau = np.zeros((2 * nv, nv), dtype=complex)
    with complex_kept():
        force.add_load(t, q_many, v_many, tau)
    slopes = np.imag(tau) / STEP
    return slopes[:nv].T, slopes[nv:].T


def _row_derivatives(
    model: pin.Model, constraints: Sequence[Measured], q: Array, v: Array
) -> tuple[Array, Array, Array, Array]:
    """Return G, its derivative by q, and those of ``G' v`` by q and by v."""
    rows, nv = ConstraintRows.of(model, constraints), model.nv
    steps = _steps(model, q)
    with complex_kept():
        moved, still = rows.at(steps), rows.at(np.broadcast_to(q + 0j, steps.shape))
        rows_q = np.imag(moved.matrices) / STEP
        drift_q = np.imag(moved.drifts(np.broadcast_to(v + 0j, (nv, nv)))) / STEP
        drift_v = np.imag(still.drifts(v + 1j * STEP * np.eye(nv))) / STEP
    return rows.at(q[None]).matrices[0], rows_q, drift_q.T, drift_v.T


def _steps(model: pin.Model, q: Array) -> Array:
    """Return a configuration with an imaginary step along every velocity, shape (nv, nq)."""
    return q + 1j * STEP * pin.tangentMap(model, q).T  # type: ignore[no-any-return]


def load_at_kink(dynamics: Dynamics, t: float, q: Array, v: Array, scale: Array, least: float) -> str:
    """Return the name of a load that has other slopes to both sides of a state; empty where there is none.

    The change of a slope at a kink stays as it is over half the step, that of a curve is half of it.

    Args:
        t: Instant of loads that follow laws [s].
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        scale: Size of each joint's coordinate [rad or m], shape (nv,).
        least: Size of the largest terms of stiffness and damping: a part of it is rounding.
    """
    step = KINK_STEP * np.minimum(scale, 1.0)
    for name, force in dynamics.forces.items():
        wide, near = (_slope_changes(dynamics.model, force, t, q, v, part * step) for part in (1.0, 0.5))
        slopes = KINK * wide[1].max(axis=(1, 2), keepdims=True, initial=0.0)
        if ((wide[0] > slopes + ROUNDED * least) & (near[0] > 0.75 * wide[0])).any():
            return name
    return ""


def _slope_changes(
    model: pin.Model, force: ForceElement, t: float, q: Array, v: Array, h: Array
) -> tuple[Array, Array]:
    """Return differences of the slopes of a load to both sides by q and by v, and the slopes, shape (2, nv, nv)."""
    nv = model.nv
    steps = np.concatenate([np.zeros((1, nv)), np.diag(h), -np.diag(h)])
    moved, still = np.array([pin.integrate(model, q, step) for step in steps]), np.broadcast_to(q, (len(steps), len(q)))
    tau = np.zeros((2 * len(steps), nv))
    force.add_load(t, np.concatenate([moved, still]), np.concatenate([0.0 * steps + v, v + steps]), tau)
    parts = tau.reshape(2, len(steps), nv)
    here, ahead, behind = parts[:, :1], parts[:, 1 : nv + 1], parts[:, nv + 1 :]
    return np.abs(ahead + behind - 2.0 * here) / h[:, None], np.abs(ahead - behind) / h[:, None]


@contextmanager
def complex_kept() -> Iterator[None]:
    """Raise where an imaginary part would be dropped: the derivative would be wrong without a word."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", np.exceptions.ComplexWarning)
        yield

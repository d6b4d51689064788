"""The equation of motion under constraints, its one solve, and the mass matrix M(q), armatures included.

With the rows G of all constraints (loop joints, couplings, coordinates that follow laws) the motion satisfies

    M(q) a + nle(q, v) = tau + loads + G^T lam        (1)
    G(q) a = b,    b = -G' v, plus w'' in the row of a coordinate that follows the law w(t)        (2)

Let T be a basis of the velocities that the rows allow, ``G T = 0``, and a_p the shortest solution of (2), both from the
singular values of G (``engine.constraints.nullspace``). All solutions of (2) are ``a = a_p + T u``. The multipliers do
no work along T, ``T^T G^T = 0``; so with the force ``f = tau + loads - nle`` equation (1), multiplied by T^T, gives

    T^T M T u = T^T (f - M a_p)        (3)

and what is left of (1) the multipliers, ``G^T lam = M a - f``: the least ones where rows are redundant. This is Gauss's
principle: of all accelerations that satisfy (2), a has the least ``(a - a0)^T M (a - a0)``, ``M a0 = f``. M has to be
positive along T only; an open chain has no rows, ``T = 1``. With velocities in place of accelerations the same solve
projects them onto the constraints, ``f = M v`` and ``b = w'``, and gives the velocities after an impact.

Other routes to the same numbers are faster where they apply, and tested against this one:

- ``Dynamics.forward`` (``aba``) and ``Dynamics.inverse`` (``rnea``) for open chains;
- ``engine.kernel``, in C, for one state after another of trees, loops and couplings.

Source: Udwadia and Kalaba, A new perspective on constrained motion, Proc. R. Soc. Lond. A 439 (1992), 407-410; closed
loops, Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 8.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import Decomposition, solved_positive
from pinarm.errors import DynamicsError, listed
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.geometry.kinematics import give_back, take, with_masses

if TYPE_CHECKING:
    from pinarm.engine.dynamics.dynamics import Dynamics

NUMBERS = 20_000_000
"""Numbers of the mass matrices that are computed together."""


def solve(rows: Decomposition, mass: Array, force: Array, right: Array) -> Array:
    """Return the a of (1) and (2): the one that minimises ``a^T M a / 2 - f . a`` while ``G a = b``, shape (.., nv).

    Args:
        rows: G, decomposed.
        mass: M, shape (.., nv, nv).
        force: f, shape (.., nv).
        right: b, shape (.., m).
    """
    a = rows.particular(right)
    if count := rows.free.shape[-1]:
        transposed = rows.free.swapaxes(-1, -2)
        wanted = np.matvec(transposed, force - (mass @ a[..., None])[..., 0])
        reduced = transposed @ (mass @ rows.free)
        if (rows.freedom < count).any():  # columns of T that are 0
            reduced = reduced + np.eye(count) * (np.arange(count) >= rows.freedom[..., None])[..., None]
        a = a + (rows.free @ solved_positive(reduced, wanted[..., None]))[..., 0]
    return a


def accelerations(dynamics: Dynamics, closure: Closure, t: Array | float, q: Array, v: Array, tau: Array) -> Array:
    """Return the accelerations of a mechanism under efforts of its drives, shape (n, nv).

    Args:
        t: Instants [s], shape (n,), or one for all.
        q: Configurations, shape (n, nq), at which the constraints are closed.
        v: Velocities, shape (n, nv), that they allow.
        tau: Efforts [N*m or N], shape (n, nv).
    """
    most = max(1, NUMBERS // max(1, q.shape[1] ** 2))
    if len(q) > most:
        t = np.broadcast_to(t, len(q))
        parts = (slice(start, start + most) for start in range(0, len(q), most))
        return np.concatenate([accelerations(dynamics, closure, t[k], q[k], v[k], tau[k]) for k in parts])
    rows = closure.split_at(q)
    force = tau - dynamics.inverse(t, q, v, np.zeros_like(v))
    return solve(rows, dynamics.mass_matrices(q), force, -closure.drifts(q, v))


MASSLESS = 1e-12
"""Eigenvalue of the mass matrix, scaled to a diagonal of ones, below which a direction has no mass."""

LARGE = 100
"""Velocities above which masses of bodies that all have one are not looked at as matrices."""

NOTHING = 1e-24
"""Diagonal entry of M, relative to the largest, that is rounding of 0."""


def mass_matrix(model: pin.Model, q: Array) -> Array:
    """Return M at a configuration, shape (nq,), as an array of shape (nv, nv)."""
    return np.asarray(mass_matrices(model, q[None])[0])


def mass_matrices(model: pin.Model, q: Array) -> Array:
    """Return M at configurations, shape (n, nq), as an array of shape (n, nv, nv)."""
    matrices, data = np.empty((len(q), model.nv, model.nv)), with_masses(model, take(model))
    for matrix, configuration in zip(matrices, q, strict=True):
        matrix[:] = pin.crba(model, data, configuration).reshape(matrix.shape)
    give_back(model, data)
    return matrices


def weight_bounds(model: pin.Model, mass: Array) -> Array:
    """Return the most that weights can do at joints, ``g sqrt(m M_kk)`` with the mass m of all bodies, shape (.., nv).

    By the inequality of Cauchy and Schwarz, for the masses M of shape (.., nv, nv).
    """
    total = sum(body.mass for body in model.inertias)
    levers = np.sqrt(np.maximum(mass.diagonal(axis1=-2, axis2=-1), 0.0))
    return np.asarray(np.linalg.norm(model.gravity.linear) * np.sqrt(total) * levers)


def require_masses(closure: Closure, q: Array, t: float) -> None:
    """Raise where a motion that constraints and laws leave free moves no mass, at configurations, shape (n, nq).

    With T a basis of the free motions, ``T^T M T`` must be positive definite; it is scaled to a diagonal of ones, so
    that large ratios of masses do no harm.
    """
    model = closure.model
    if model.nv > LARGE and massive(model):
        return  # M is definite in all directions; elsewhere it is looked at as a matrix
    mass = mass_matrices(model, q)
    if not closure.size:
        _require(model, np.broadcast_to(np.eye(model.nv), mass.shape), mass, q, t)
        return
    for places, free in closure.split_at(q).by_freedom():
        _require(model, free, mass[places], q[places], t)


def massive(model: pin.Model) -> bool:
    """Return whether every body has a mass and moments of inertia: then M is definite in any configuration."""
    return all(body.mass > 0.0 and np.linalg.eigvalsh(body.inertia)[0] > 0.0 for body in model.inertias[1:])


def _definite(matrices: Array) -> bool:
    """Return whether all matrices are positive definite, by Cholesky's decomposition: a tenth of eigenvalues' time."""
    try:
        return bool(np.isfinite(np.linalg.cholesky(matrices)).all())
    except np.linalg.LinAlgError:
        return False


def _require(model: pin.Model, free: Array, mass: Array, q: Array, t: float) -> None:
    """Raise where a motion moves no mass, of those whose bases are ``free``, shape (n, nv, nu)."""
    if not free.shape[-1]:
        return
    along = free.swapaxes(-2, -1) @ mass @ free
    size = np.abs(np.diagonal(along, axis1=-2, axis2=-1))
    idle = size <= NOTHING * size.max(axis=-1, keepdims=True)
    scale = np.where(idle, 1.0, 1.0 / np.sqrt(np.where(idle, 1.0, size)))
    scaled = scale[:, :, None] * along * scale[:, None]
    if _definite(scaled - MASSLESS * np.eye(scaled.shape[-1])):
        return
    values, vectors = np.linalg.eigh(scaled)
    if (values[:, 0] > MASSLESS).all():
        return
    k = int((values[:, 0] <= MASSLESS).argmax())
    ways = np.linalg.norm(free[k] @ (scale[k][:, None] * vectors[k][:, values[k] <= MASSLESS]), axis=1)
    moved = [int(index) for index in np.flatnonzero(ways > 0.1 * ways.max())]
    joints = listed("joint", [coordinate_name(model, index) for index in moved])
    how = "without mass" if values[k, 0] > -MASSLESS else "against a negative mass"
    raise DynamicsError(
        f"at t = {t:.9g} s {joints} can move {how}: accelerations are undetermined",
        expected="links beyond it with masses and moments of inertia above 1e-12 of what they carry",
        hint="an <inertial> in the model, a drive with a rotor, or a law for the joint; kind: inverse needs no masses",
        t=t,
        q=q[k],
    )

"""The mass matrix M(q) of a tree, armatures included, and whether masses determine every acceleration."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.errors import DynamicsError, listed
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.geometry.kinematics import give_back, take, with_masses

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
        f"at t = {t:.9g} s {joints} can move {how}, carrying {_carried(model, moved)}: accelerations are undetermined",
        expected="inertias of these links that bodies can have, above 1e-12 of what they carry",
        hint="an <inertial> in the model, a drive with a rotor, or a law for the joint; kind: inverse needs no masses",
        t=t,
        q=q[k],
    )


def _carried(model: pin.Model, indices: list[int]) -> str:
    """Return the links that move with the joints at some indices in v, in words."""
    owners = [
        joint.id
        for joint in model.joints
        if joint.nv and any(joint.idx_v <= k < joint.idx_v + joint.nv for k in indices)
    ]
    beyond = {int(joint) for owner in owners for joint in model.subtrees[owner]}
    links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY and frame.parentJoint in beyond]
    return listed("link", links) if links else "nothing"

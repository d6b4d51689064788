"""The mass matrix M(q) of a tree, armatures included, and whether masses determine every acceleration."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import SplitRows
from pinarm.errors import DynamicsError, listed
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.geometry.kinematics import give_back, take, with_masses

MASSLESS = 1e-12
"""Eigenvalue of the mass matrix, scaled to a diagonal of ones, below which a direction has no mass."""

LARGE = 100
"""Velocities above which masses of bodies that all have one are not looked at as matrices."""

EPSILON = float(np.finfo(float).eps)
"""Rounding of a number, relative to it."""

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


def require_masses(closure: Closure, q: Array, t: float) -> None:
    """Raise where a motion that constraints and laws leave free moves no mass.

    With T a basis of the free motions, ``T^T M T`` must be positive definite; it is scaled to a diagonal of ones, so
    that large ratios of masses do no harm.
    """
    if closure.model.nv > LARGE and massive(closure.model):
        return  # M is definite in all directions; elsewhere it is looked at as a matrix
    mass = mass_matrices(closure.model, q)
    if closure.size:
        splits = closure.splits(q)
        definite = splits.each(1, _definite_along, mass)[:, 0] > 0.0
    else:
        definite = np.full(len(q), _all_definite(mass))
    for i in np.flatnonzero(~definite):
        rows = closure.rows(closure.state(q[i]))
        _require(closure.model, closure.split(rows).free, mass[i], q[i], t)


def _definite_along(split: SplitRows, mass: Array) -> Array:
    """Return whether masses, shape (n, nv, nv), are definite along the free motions of all rows, shape (n, 1)."""
    if not split.free.shape[-1]:
        return np.ones((len(mass), 1))
    return np.full((len(mass), 1), _all_definite(split.free.swapaxes(1, 2) @ mass @ split.free), dtype=float)


def massive(model: pin.Model) -> bool:
    """Return whether every body has a mass and moments of inertia: then M is definite in any configuration."""
    return all(body.mass > 0.0 and np.linalg.eigvalsh(body.inertia)[0] > 0.0 for body in model.inertias[1:])


def _all_definite(mass: Array) -> bool:
    """Return whether matrices, shape (n, nv, nv), are as definite as masses must be, by Cholesky's decomposition."""
    with np.errstate(all="ignore"):
        scale = 1.0 / np.sqrt(np.diagonal(mass, axis1=1, axis2=2))
        scaled = scale[:, :, None] * mass * scale[:, None] - MASSLESS * np.eye(mass.shape[1])
        try:
            return bool(np.isfinite(np.linalg.cholesky(scaled)).all())
        except np.linalg.LinAlgError:
            return False


def _require(model: pin.Model, free: Array, mass: Array, q: Array, t: float) -> None:
    """Raise where a motion moves no mass, of those whose basis is ``free``, shape (nv, nu).

    The computed ``T^T M T`` is off by up to ``nv eps |T|^T |M| |T|``, its eigenvalues by no more than the norm of that:
    a smaller one is 0 but for rounding.
    """
    mass, terms = free.T @ mass @ free, np.abs(free).T @ np.abs(mass) @ np.abs(free)
    size = np.abs(np.diag(mass))
    if not len(size):
        return
    idle = size <= NOTHING * size.max()
    scale = np.where(idle, 1.0, 1.0 / np.sqrt(np.where(idle, 1.0, size)))
    values, vectors = np.linalg.eigh(scale[:, None] * mass * scale)
    if values[0] > MASSLESS:
        return
    ways = np.linalg.norm(free @ (scale[:, None] * vectors[:, values <= MASSLESS]), axis=1)
    moved = [int(index) for index in np.flatnonzero(ways > 0.1 * ways.max())]
    joints = listed("joint", [coordinate_name(model, index) for index in moved])
    rounding = len(free) * EPSILON * float(np.linalg.norm(scale[:, None] * terms * scale))
    how = "without mass" if abs(values[0]) <= rounding else f"with {values[0]:.1g} of the mass that they carry"
    how = how if values[0] > -MASSLESS else "against a negative mass"
    raise DynamicsError(
        f"at t = {t:.9g} s {joints} can move {how}, carrying {_carried(model, moved)}: accelerations are undetermined",
        expected="inertias of these links that bodies can have",
        hint="an <inertial> in the model, a drive with a rotor, or a law for the joint; kind: inverse needs no masses",
        t=t,
        q=q,
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

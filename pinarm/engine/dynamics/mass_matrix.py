"""The mass matrix M(q) of a tree by the composite rigid body algorithm; armatures are in it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.mechanics.geometry.kinematics import give_back, take
from pinarm.mechanics.geometry.pinocchio_data import with_masses

Masses = Array


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


def masses(model: pin.Model, q: Array) -> Array:
    """Return M at configurations, shape (n, nq), or at one, shape (nq,)."""
    return mass_matrices(model, q) if q.ndim > 1 else mass_matrix(model, q)


def symmetric(matrices: Array) -> Array:
    """Return the matrices: ``pin.crba`` writes both halves."""
    return np.array(matrices)

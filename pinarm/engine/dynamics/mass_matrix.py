"""The mass matrix M(q), of which Pinocchio computes the upper half only."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.mechanics.geometry.buffers import give_back, take
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.pinocchio_data import with_masses

if TYPE_CHECKING:
    from scipy.sparse import csc_array


def mass_matrix(model: pin.Model, q: Array) -> Array:
    """Return M at a configuration, shape (nq,), as an array of shape (nv, nv); armatures are in it."""
    return np.asarray(mass_matrices(model, q[None])[0])


def mass_matrices(model: pin.Model, q: Array) -> Array:
    """Return M at configurations, shape (n, nq), as an array of shape (n, nv, nv); armatures are in it."""
    upper, data = np.empty((len(q), model.nv, model.nv)), with_masses(model, take(model))
    for matrix, configuration in zip(upper, q, strict=True):
        matrix[:] = pin.crba(model, data, configuration).reshape(matrix.shape)
    give_back(model, data)
    diagonal, above = _triangle(model.nv)
    return np.asarray(upper * (diagonal + above) + (upper * above).swapaxes(1, 2))


@cache
def _triangle(n: int) -> tuple[Array, Array]:
    """Return what keeps the diagonal of a matrix, and what is above it: ``numpy.triu`` costs 10 us."""
    return np.eye(n), np.triu(np.ones((n, n)), 1)


def sparse_mass_matrix(model: pin.Model, q: Array) -> csc_array:
    """Return M at a configuration, with entries for joints on one path from the world only, shape (nv, nv)."""
    from scipy.sparse import csc_array

    data = take(model)
    upper = pin.crba(model, with_masses(model, data), q).reshape(model.nv, model.nv)
    give_back(model, data)
    before, beyond = _paths(model)
    values, apart = upper[before, beyond], before != beyond
    rows, columns = np.append(before, beyond[apart]), np.append(beyond, before[apart])
    return csc_array((np.append(values, values[apart]), (rows, columns)), shape=upper.shape)


@cached_by_model
def _paths(model: pin.Model) -> tuple[Indices, Indices]:
    """Return the pairs of velocities of which the first moves the second's joint, or is one of its own before it."""
    starts, counts = model.idx_vs.tolist(), model.nvs.tolist()
    pairs = [
        (starts[joint] + i, starts[owner] + k)
        for owner, path in enumerate(model.supports) if owner
        for joint in path.tolist()[1:] for i in range(counts[joint]) for k in range(counts[owner])
        if starts[joint] + i <= starts[owner] + k
    ]  # fmt: skip
    before, beyond = np.array(pairs, dtype=np.intp).T
    return before, beyond


def mass_times(model: pin.Model, q: Array, x: Array) -> Array:
    """Return ``M x``, of shape (nv,), or of columns, shape (nv, k), by recursion; armatures are in M."""
    weightless, data = _weightless(model), take(model)
    still = np.zeros(model.nv)
    found = [pin.rnea(weightless, data, q, still, one).copy() for one in x.reshape(model.nv, -1).T]
    give_back(model, data)
    return np.reshape(np.array(found).T, x.shape)


def mass_solved(model: pin.Model, q: Array, force: Array) -> Array:
    """Return ``M^-1 force`` of shape (nv,), by recursion."""
    data, still = take(model), np.zeros(model.nv)
    found = pin.aba(_weightless(model), data, q, still, force).copy()
    give_back(model, data)
    return np.asarray(found)


@cached_by_model
def _weightless(model: pin.Model) -> pin.Model:
    weightless = model.copy()
    weightless.gravity.vector[:] = 0.0
    return weightless


def mass_diagonal(model: pin.Model, q: Array) -> Array:
    """Return the diagonal of M, shape (nv,): that of the inertia of all that lies beyond each joint."""
    data = take(model)
    pin.forwardKinematics(model, data, q)
    composite, parents = [body.copy() for body in model.inertias], model.parents.tolist()
    diagonal = model.armature.copy()
    for k in range(model.njoints - 1, 0, -1):
        joint = model.joints[k]
        motions = np.reshape(data.joints[k].S, (6, -1))
        diagonal[joint.idx_v : joint.idx_v + joint.nv] += np.vecdot(motions.T, (composite[k].matrix() @ motions).T)
        composite[parents[k]] += data.liMi[k].act(composite[k])
    give_back(model, data)
    return np.asarray(diagonal)

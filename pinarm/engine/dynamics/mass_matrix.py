"""The mass matrix M(q), of which Pinocchio computes the upper half only."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.mechanics.geometry.buffers import give_back, take


def mass_matrix(model: pin.Model, q: Array) -> Array:
    """Return M at a configuration, shape (nq,), as an array of shape (nv, nv); armatures are in it."""
    return np.asarray(mass_matrices(model, q[None])[0])


def mass_matrices(model: pin.Model, q: Array) -> Array:
    """Return M at configurations, shape (n, nq), as an array of shape (n, nv, nv); armatures are in it."""
    upper, data = np.empty((len(q), model.nv, model.nv)), take(model)
    for matrix, configuration in zip(upper, q, strict=True):
        matrix[:] = pin.crba(model, data, configuration).reshape(matrix.shape)
    give_back(model, data)
    diagonal, above = _triangle(model.nv)
    return np.asarray(upper * (diagonal + above) + (upper * above).swapaxes(1, 2))


@cache
def _triangle(n: int) -> tuple[Array, Array]:
    """Return what keeps the diagonal of a matrix, and what is above it: ``numpy.triu`` costs 10 us."""
    return np.eye(n), np.triu(np.ones((n, n)), 1)

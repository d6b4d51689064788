"""Multipliers to the rounding of the forces at each joint."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.sparse_matrices import sizes, transposed_times

if TYPE_CHECKING:
    from pinarm.engine.constraints.sparse_matrices import Matrices

CONSISTENT = 1e-9
"""Power of forces along free motions, relative to that of their terms, that is rounding: multipliers can hold them."""

LEAST = 1e-8
"""Terms at a joint, relative to the largest, count as this much at least: joints then take no more than 1e-16 of what
rounding leaves at others, and free motions that are weighted by them stay independent, as T is orthonormal."""


def refined(multipliers: Callable[[Array], Array], rows: Matrices, free: Array, force: Array) -> Array:
    """Return multipliers with ``G^T lam = force``, improved once by what they leave of the forces.

    A decomposition by rotations errs by rounding of the largest forces everywhere: the multipliers of a light linkage
    that a heavy one moves would be nothing else. What is left at a joint is known to the rounding of the forces at this
    joint. Its part that no multipliers hold, as rounding brings it about, is taken from the joints with the largest
    forces: with S the squares of the terms ``|force| + |G|^T |lam|``, ``left - S T (T^T S T)^-1 T^T left``.

    Source: Higham, Accuracy and Stability of Numerical Algorithms, second edition (2002), section 12.1; weighted least
    squares, Björck, Numerical Methods for Least Squares Problems (1996), section 4.4.

    Args:
        multipliers: Those of forces in the sense of least squares, shape (.., nv) to (.., m), by a decomposition of G.
        rows: G, shape (.., m, nv).
        free: T, orthonormal, ``G T = 0``, shape (.., nv, f).
        force: Shape (.., nv).
    """
    lam = multipliers(force)
    left = force - transposed_times(rows, lam)
    if free.shape[-1]:
        size = np.abs(force) + transposed_times(sizes(rows), np.abs(lam))
        largest = size.max(axis=-1, keepdims=True)
        size = np.maximum(size / np.where(largest > 0.0, largest, 1.0), LEAST)
        power, most = np.vecmat(left, free), largest * np.vecmat(size, np.abs(free))
        rounding = (np.abs(power) <= CONSISTENT * most).all(axis=-1, keepdims=True)
        left = left - np.where(rounding, size * _least(size[..., None] * free, power), 0.0)
    return np.asarray(lam + multipliers(left))


def _least(ways: Array, given: Array) -> Array:
    """Return the shortest x with ``W^T x = given``, shapes (.., nv, f) and (.., f) to (.., nv): ``W (W^T W)^-1 given``.

    By the modified method of Gram and Schmidt; W has independent columns.
    """
    found, known = np.zeros(ways.shape[:-1]), list[Array]()
    for k in range(ways.shape[-1]):
        way = ways[..., k]
        wanted = given[..., k] - np.vecdot(way, found)
        for other in known:
            way = way - np.vecdot(other, way)[..., None] * other
        square = np.vecdot(way, way)
        found = found + (wanted / square)[..., None] * way
        known.append(way / np.sqrt(square)[..., None])
    return found

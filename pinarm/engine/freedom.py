"""The free motions of a mechanism with loops, at many configurations.

A basis of them is a matrix T with ``G T = 0``, orthonormal, G being the rows of the constraints. Elimination tells
dependent joints from independent ones; one of these at velocity 1, the others at rest, is a free motion.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.closure import Closure, Split
from pinarm.engine.elimination import Elimination, Order, dense
from pinarm.engine.measures import BLOCK, Measures

REGULAR = 1e-4
"""Smallest ratio of singular values of G, its rows of length 1, at which other configurations are eliminated alike."""

DEPENDENT = 1e-9
"""What a free motion of length 1 may leave of redundant rows, relative to the longest row: rounding leaves 1e-13."""


def free_motions(closure: Closure, q: Array) -> Iterator[tuple[Indices, Array]]:
    """Yield the free motions at configurations, shape (n, nq): of those together that one order of pivots serves.

    Yields:
        Places of some configurations, and T there, shape (f, places, nv).
    """
    n, nv = len(q), closure.model.nv
    if not closure.size:
        yield np.arange(n), np.broadcast_to(np.eye(nv)[:, None], (nv, n, nv))
        return
    measures = Measures.of(closure.model, closure.constraints)
    for start in range(0, n, BLOCK):
        left = np.arange(start, min(start + BLOCK, n))
        while len(left):
            found = _like_the_first(measures, np.ascontiguousarray(q[left].T)) if measures else None
            free, served = found or _of_the_first(closure, q[left])
            yield left[served], free
            left = left[~served]


def _of_the_first(closure: Closure, q: Array) -> tuple[Array, Flags]:
    """Return the free motions of the first configuration, for positions close to singular; see ``_like_the_first``."""
    closure.place(q[0])
    return Split.of(closure.rows()).free.T[:, None], np.arange(len(q)) == 0


def _like_the_first(measures: Measures, q: Array) -> tuple[Array, Flags] | None:
    """Return the free motions of the configurations that the first one's order of pivots serves.

    Args:
        measures: What the constraints measure.
        q: Configurations, shape (nv, n).

    Returns:
        T, and which configurations they are, shape (n,); ``None`` where the first one is close to singular.
    """
    nv, n = q.shape
    rows = measures.at(q).rows(range(measures.size))
    matrix = dense(rows, (measures.size, nv))
    values = Split.of(matrix).values
    if not len(values) or values[-1] < REGULAR * values[0]:
        return None
    order = Order.of(matrix, len(values))
    with np.errstate(all="ignore"):  # what the order does not serve is not used
        elimination, motions = Elimination.of(rows, order), np.zeros((nv - len(values), n, nv))
        independent = [column for column in range(nv) if column not in order.columns]
        for motion, column in zip(motions, independent, strict=True):
            for j, x in elimination.solve({}, {column: np.ones(1)}).items():
                motion[:, j] = x
        served = elimination.sound() & np.ones(n, dtype=bool)
    free = _orthonormal(motions[:, served])
    most, allowed = DEPENDENT * float(np.linalg.norm(matrix, axis=1).max()), np.ones(free.shape[1], dtype=bool)
    for row in set(rows) - set(order.rows):
        parts = [np.broadcast_to(x, n)[served] * free[:, :, j] for j, x in rows[row].items()]
        allowed &= (np.abs(sum(parts, np.zeros(1))) <= most).all(axis=0)
    served[served] = allowed
    return (free[:, allowed], served) if served[0] else None


def _orthonormal(motions: Array) -> Array:
    """Return motions of length 1, at right angles to each other, with the same span; shape (f, n, nv) each."""
    if len(motions) == 1:
        return np.asarray(motions / np.linalg.norm(motions, axis=2, keepdims=True))
    return np.asarray(np.linalg.qr(motions.transpose(1, 2, 0))[0].transpose(2, 0, 1))

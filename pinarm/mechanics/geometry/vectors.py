"""Vector algebra on the first axis: one vector, shape (3,), or many, shape (3, n), one per configuration.

Shape (3, 1) is one vector for all configurations: numpy spreads it over the others where it has to.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array

Axes = Sequence[Array] | Array
"""The three axes of a frame, each of shape (3,) or (3, n): the columns of its rotation matrix."""

Weights = Sequence[float | Array] | Array
"""The three components of a vector along axes: numbers, or arrays of shape (n,) where they differ."""

MEETING, SLANTED = 1e-12, np.array([0.48, 0.6, 0.64])
"""Distance of points that meet [m]; the unit vector that stands for the direction from one to the other then, along no
axis of any frame, so that a rod that is to come between them can push them apart."""

FEW, AROUND = 2048, np.array([0, 1, 2, 0, 1])
"""Numbers of vectors up to which calls of numpy take longer than their work; components, the first two repeated."""


def dot(a: Array, b: Array) -> Array:
    """Return ``a . b``, shape () or (n,)."""
    if a.shape == (3, 1):
        return np.asarray(a[:, 0] @ b)
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def cross(a: Array, b: Array) -> Array:
    """Return ``a x b``, shape (3,) or (3, n)."""
    if a.ndim == b.ndim and max(a.size, b.size) < FEW:
        a, b = a.take(AROUND, axis=0), b.take(AROUND, axis=0)
        return np.asarray(a[1:4] * b[2:5] - a[2:5] * b[1:4])
    (a0, a1, a2), (b0, b1, b2) = a, b
    x = a1 * b2 - a2 * b1
    product = np.empty((3, *x.shape), x.dtype)
    product[0] = x
    product[1] = a2 * b0 - a0 * b2
    product[2] = a0 * b1 - a1 * b0
    return product


def crossed(a: Array, b: Array) -> Array:
    """Return ``a x b`` of vectors along the last axis, shape (.., 3)."""
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product = components_apart(x, 3)
    product[..., 0] = x
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def rotated(turns: Array, vectors: Array) -> Array:
    """Return ``R x`` of matrices along the last two axes and vectors along the last, shapes (.., 3, 3) and (.., 3)."""
    return np.asarray(np.einsum("...ab,...b->...a", turns, vectors))


def joined(linear: Array, angular: Array) -> Array:
    """Return ``[linear; angular]`` along the last axis, shape (.., 6); other axes of length 1 are spread."""
    if linear.shape != angular.shape:
        linear, angular = np.broadcast_arrays(linear, angular)
    vectors = components_apart(angular[..., 0], 6)
    vectors[..., :3], vectors[..., 3:] = linear, angular
    return vectors


def moved(wrenches: Array, arms: Array) -> Array:
    """Return wrenches [f; m], shape (.., 6), about points from which arms, shape (.., 3), lead to where they were."""
    forces = wrenches[..., :3]
    return joined(forces, wrenches[..., 3:] + crossed(arms, forces))


def lengths(wrenches: Array) -> Array:
    """Return the lengths of both vectors of wrenches or twists, shape (.., 6), as an array of shape (.., 2)."""
    parts = wrenches.reshape(*wrenches.shape[:-1], 2, 3)
    return np.asarray(np.sqrt(np.einsum("...a,...a->...", parts, parts)))


def components_apart(like: Array, width: int) -> Array:
    """Return an array for vectors, shape (.., width), which lies in memory component by component.

    Its states have the order of another array's, shape (..): numpy then works on long rows.
    """
    order, back = _order(like.strides)
    return np.empty((width, *[like.shape[axis] for axis in order]), like.dtype).transpose(back)


@lru_cache(maxsize=256)
def _order(strides: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the axes, those with the widest steps in memory first, and what brings them back behind a first one."""
    order = sorted(range(len(strides)), key=lambda axis: -strides[axis])
    return tuple(order), (*(1 + order.index(axis) for axis in range(len(strides))), 0)


def direction(p: Array) -> Array:
    """Return ``p / |p|``, shape (3,) or (3, n); any unit vector where p is 0."""
    length = np.sqrt(dot(p, p))
    if p.ndim == 1:
        return p / length if np.real(length) >= MEETING else SLANTED
    meeting = length < MEETING
    return np.where(meeting, SLANTED.reshape(3, *(1,) * (p.ndim - 1)), p / np.where(meeting, 1.0, length))


def arctan2(y: Array, x: Array) -> Array:
    """Return the angle of ``x + i y``; complex steps continue it to first order."""
    if np.isrealobj(y) and np.isrealobj(x):
        return np.asarray(np.arctan2(y, x))
    a, b = np.real(x), np.real(y)
    return np.asarray(np.arctan2(b, a) + 1j * (a * np.imag(y) - b * np.imag(x)) / (a * a + b * b))


def combined(axes: Axes, weights: Weights) -> Array:
    """Return ``sum_k weights_k axes_k``, a vector given by its components along axes."""
    return np.asarray(weights[0] * axes[0] + weights[1] * axes[1] + weights[2] * axes[2])


def rotation_vector(axes: Axes) -> Array:
    """Return ``log R``, shape (3,) or (3, n), at most half a turn; of half a turn, either sense.

    Of one by Pinocchio. Of many, with the unit quaternion (w, u), ``w >= 0``, it is ``2 atan2(|u|, w) u / |u|``. The
    rows of ``4 (w, u) (w, u)^T`` are linear in R; the row with the largest diagonal has a length of 2 at least.

    Source: Shepperd, Quaternion from rotation matrix, Journal of Guidance and Control 1 (1978).
    """
    if axes[0].ndim == 1:
        return np.asarray(pin.log3(np.array(axes).T))
    (x0, x1, x2), (y0, y1, y2), (z0, z1, z2) = np.broadcast_arrays(*axes)
    a, b, c, d, e, f = y2 - z1, z0 - x2, x1 - y0, x1 + y0, z0 + x2, y2 + z1
    own = 1.0 + x0 + y1 + z2, 1.0 + x0 - y1 - z2, 1.0 - x0 + y1 - z2, 1.0 - x0 - y1 + z2
    rows = np.array([(own[0], a, b, c), (a, own[1], d, e), (b, d, own[2], f), (c, e, f, own[3])])
    largest = np.argmax(own, axis=0)
    w, *u = rows[largest, :, np.arange(rows.shape[2])].T
    sine = np.sqrt(dot(np.array(u), np.array(u)))
    sign = np.where(w < 0.0, -1.0, 1.0)
    half = np.arctan2(sine, sign * w) if np.isrealobj(w) else np.arctan(sine / (sign * w))  # of a complex step
    return np.asarray(sign * 2.0 * half / np.where(sine == 0.0, 1.0, sine) * np.array(u))

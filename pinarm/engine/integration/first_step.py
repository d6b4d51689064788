"""The first step of a method with variable steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pinarm.arrays import Array

NOISELESS = 1e-8
"""Smallest trial step, relative to the duration: a state that is 0 but for rounding would give a smaller one."""


def first_step(
    start: float | Array,
    end: float | Array,
    y: Array,
    slope: Array,
    rates: Callable[[Any, Array], Array],
    tolerance: float,
    order: int,
    size: float | Array = 1.0,
) -> Array:
    """Return the first steps of motions [s], shape (...,), each from the slopes at two states.

    With the norm ``|x| = rms(x / (tol (size + |y|)))``: ``h0 = 0.01 |y| / |f|``,
    ``d2 = |f(t + h0, y + h0 f) - f| / h0``, ``h1 = (0.01 / max(|f|, d2))^(1 / (order + 1))``, ``h = min(100 h0, h1)``.
    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.4.

    Args:
        start: First instant [s], or one of each motion.
        end: Last instant, likewise.
        y: Initial states, shape (..., n).
        slope: f(start, y), shape (..., n).
        rates: f, of times of shape (...,) and states.
        tolerance: Error of a step, relative to ``size + |y|``.
        order: The error behaves like ``h^(order + 1)``.
        size: See ``Interval.size``; or one of each motion, shape (..., 1).
    """
    scale = tolerance * y.shape[-1] ** 0.5 * (size + np.abs(y))

    def norm(x: Array) -> Array:
        relative = x / scale
        return np.asarray(np.sqrt(np.vecdot(relative, relative)))

    d0, d1 = norm(y), norm(slope)
    small = np.minimum(d0, d1) < 1e-5
    h0 = np.where(small, 1e-6, 0.01 * d0 / np.where(small, 1.0, d1))
    h0 = np.minimum(np.maximum(h0, NOISELESS * (end - start)), end - start)
    d2 = norm(rates(start + h0, y + h0[..., None] * slope) - slope) / h0
    steepest = np.maximum(d1, d2)
    at_rest = steepest <= 1e-15
    moving = (0.01 / np.where(at_rest, 1.0, steepest)) ** (1.0 / (order + 1))
    h1 = np.where(at_rest, np.maximum(1e-6, 1e-3 * h0), moving)
    return np.asarray(np.minimum(100.0 * h0, h1))

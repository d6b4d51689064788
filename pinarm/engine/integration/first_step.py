"""The first step of an adaptive integration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pinarm.arrays import Array

NOISELESS = 1e-8
"""Smallest trial of the first step, relative to the duration: a state that is 0 but for rounding would ask for less."""


def first_step(
    start: float,
    end: float,
    y: Array,
    slope: Array,
    rates: Callable[[Any, Array], Array],
    tolerance: float,
    order: int,
) -> Array:
    """Return the first steps of motions from two slopes each [s], shape (...,); Hairer, Norsett, Wanner, section II.4.

    Args:
        start: First instant [s].
        end: Last instant [s].
        y: Initial states, shape (..., n).
        slope: f(start, y), likewise.
        rates: f, of times of shape (...,) and states.
        tolerance: Error of a step, relative to ``1 + |y|``.
        order: Power of h that the error behaves like, less one.
    """

    def norm(x: Array) -> Array:
        return np.asarray(np.sqrt(np.mean((x / (tolerance * (1.0 + np.abs(y)))) ** 2, axis=-1)))

    d0, d1 = norm(y), norm(slope)
    small = np.minimum(d0, d1) < 1e-5
    h0 = np.where(small, 1e-6, 0.01 * d0 / np.where(small, 1.0, d1))
    h0 = np.clip(h0, NOISELESS * (end - start), end - start)
    d2 = norm(rates(start + h0, y + h0[..., None] * slope) - slope) / h0
    steepest = np.maximum(d1, d2)
    still = steepest <= 1e-15
    h1 = np.where(still, np.maximum(1e-6, 1e-3 * h0), (0.01 / np.where(still, 1.0, steepest)) ** (1.0 / (order + 1)))
    return np.asarray(np.minimum(100.0 * h0, h1))

"""The first step of an adaptive integration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinarm.arrays import Array

NOISELESS = 1e-8
"""Smallest trial of the first step, relative to the duration: a state that is 0 but for rounding would ask for less."""


def first_step(
    start: float,
    end: float,
    y: Array,
    slope: Array,
    rates: Callable[[float, Array], Array],
    tolerance: float,
    order: int,
) -> float:
    """Return a first step from two slopes; Hairer, Norsett, Wanner, section II.4.

    Args:
        start: First instant [s].
        end: Last instant [s].
        y: Initial state.
        slope: f(start, y).
        rates: f.
        tolerance: Error of a step, relative to ``1 + |y|``.
        order: Power of h that the error behaves like, less one.
    """

    def norm(x: Array) -> float:
        return float(np.sqrt(np.mean((x / (tolerance * (1.0 + np.abs(y)))) ** 2)))

    d0, d1 = norm(y), norm(slope)
    h0 = 1e-6 if min(d0, d1) < 1e-5 else 0.01 * d0 / d1
    h0 = min(max(h0, NOISELESS * (end - start)), end - start)
    d2 = norm(rates(start + h0, y + h0 * slope) - slope) / h0
    steepest = max(d1, d2)
    h1 = max(1e-6, 1e-3 * h0) if steepest <= 1e-15 else (0.01 / steepest) ** (1.0 / (order + 1))
    return min(100.0 * h0, h1)

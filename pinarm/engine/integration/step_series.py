"""Chebyshev series of values within a step, from values at the Chebyshev points."""

from __future__ import annotations

from functools import cache

import numpy as np

from pinarm.arrays import Array


@cache
def nodes(parts: int) -> Array:
    """Return the Chebyshev points of [0, 1], ends included: ``(1 - cos(pi k / n)) / 2``, n = 2 parts; (n + 1,)."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(2 * parts + 1) / (2 * parts))


def series_of(values: Array) -> Array:
    """Return the Chebyshev coefficients on [-1, 1] of values at the nodes, both of shape (.., n + 1)."""
    return np.asarray(values @ _to_series(values.shape[-1] // 2).T)


def fine_values(values: Array) -> Array:
    """Return the values of the series at ``FINE`` even places of the step, shape (.., n + 1) to (.., FINE)."""
    return np.asarray(values @ _to_fine(values.shape[-1] // 2).T)


FINE = 33
"""Places at which a series is looked at for turns: four to eight between two nodes."""


@cache
def _to_series(parts: int) -> Array:
    return np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(2.0 * nodes(parts) - 1.0, 2 * parts)))


@cache
def _to_fine(parts: int) -> Array:
    return np.asarray(np.polynomial.chebyshev.chebvander(np.linspace(-1.0, 1.0, FINE), 2 * parts) @ _to_series(parts))

"""A curve between two places as a polynomial through its values at Chebyshev points, where it is as smooth as that."""

from __future__ import annotations

from functools import cache, cached_property

import numpy as np

from pinarm.arrays import Array
from pinarm.records import Record

DEGREE = 16
NODES: Array = np.cos(np.linspace(-np.pi, 0.0, DEGREE + 1))
"""The points at which a curve is evaluated, on [-1, 1], both ends among them, shape (17,)."""

RESOLVED = 1e-8
"""Largest of the last three coefficients, relative to how far the values vary: then an extreme lies where that of the
polynomial does to 1e-8 of the bracket, and its value, which is evaluated there, is the extreme to the square of it."""

REAL = 1e-6
"""Largest imaginary part of roots that count: a double one is split by the root of the rounding."""


class BracketFit(Record, frozen=True):
    """The polynomial through the values of a curve at ``NODES``.

    Attributes:
        low: Where the bracket begins.
        high: Where it ends.
        values: Those of the curve at the nodes, shape (17,).

    Source: Trefethen, *Approximation Theory and Approximation Practice*, chapters 3 and 18.
    """

    low: float
    high: float
    values: Array

    @staticmethod
    def places(low: float, high: float) -> Array:
        """Return where the curve is to be evaluated, shape (17,); the ends are exact."""
        t = 0.5 * (low + high) + 0.5 * (high - low) * NODES
        t[0], t[-1] = low, high
        return t

    @cached_property
    def coefficients(self) -> Array:
        """Those of the Chebyshev polynomials, shape (17,)."""
        found: Array = _to_coefficients() @ self.values
        return found

    @property
    def is_resolved(self) -> bool:
        """Whether the values vary, and the last coefficients have fallen to where the polynomial is the curve."""
        return bool(np.abs(self.coefficients[-3:]).max() < RESOLVED * np.ptp(self.values))

    def _within(self, coefficients: Array) -> Array:
        """Return the places of the real roots of a series in the bracket, in order."""
        from numpy.polynomial import chebyshev

        roots = chebyshev.chebroots(coefficients)
        real = np.sort(roots.real[np.abs(roots.imag) < REAL])
        inside = real[np.abs(real) <= 1.0]
        return 0.5 * (self.low + self.high) + 0.5 * (self.high - self.low) * inside

    @cached_property
    def extremes(self) -> Array:
        """The places within the bracket where the slope is zero, in order."""
        from numpy.polynomial import chebyshev

        return self._within(np.asarray(chebyshev.chebder(self.coefficients), float))

    def crossings(self) -> Array:
        """Return the places within the bracket where the value is zero, in order."""
        return self._within(self.coefficients)

    def at(self, t: Array) -> Array:
        """Return the values of the polynomial at places, shape (n,)."""
        from numpy.polynomial import chebyshev

        return np.asarray(chebyshev.chebval(self._reduced(t), self.coefficients), float)

    def slope(self, t: float) -> float:
        """Return the derivative of the polynomial at a place."""
        from numpy.polynomial import chebyshev

        rate = chebyshev.chebval(self._reduced(np.array(t)), chebyshev.chebder(self.coefficients))
        return float(rate * 2.0 / (self.high - self.low))

    def _reduced(self, t: Array) -> Array:
        return (2.0 * t - self.low - self.high) / (self.high - self.low)


@cache
def _to_coefficients() -> Array:
    """Return the matrix from values at the nodes to coefficients of Chebyshev polynomials, shape (17, 17)."""
    from numpy.polynomial import chebyshev

    return np.asarray(np.linalg.inv(chebyshev.chebvander(NODES, DEGREE)))

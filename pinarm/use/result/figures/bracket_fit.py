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

FALLING = 0.1
"""Last coefficients relative to those of degree 6 to 8 below which they fall faster than at a kink, where they are a
fifth."""

SINGULAR = 0.35
"""Last coefficients relative to those of degree 6 to 8 from which on they may be those of a pole, which do not fall; at
a kink they are a fifth."""

CUSP = 4.0
"""Error of the polynomial relative to its estimate at a cusp such as that of the root of |x|, whose coefficients fall
as n^-1.5: what follows the last of them is twice their size times their number, and folded back it counts twice."""

FLAT = 4 * np.finfo(float).eps
"""Relative difference of values that are one value but for rounding."""

_DENSE: Array = np.cos(np.outer(np.linspace(0.0, np.pi, 65), np.arange(DEGREE + 1)))
"""Chebyshev polynomials at 65 points of [-1, 1], shape (65, 17): T_n(cos x) = cos(n x)."""

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

    @cached_property
    def tail(self) -> float:
        """Largest of the last three coefficients."""
        return float(np.abs(self.coefficients[-3:]).max())

    @cached_property
    def is_singular(self) -> bool:
        """Whether the coefficients fall as slowly as where the curve passes through infinity."""
        return self.tail > SINGULAR * float(np.abs(self.coefficients[6:9]).max())

    @cached_property
    def is_falling(self) -> bool:
        """Whether the coefficients fall faster than those of a kink."""
        return self.tail < FALLING * float(np.abs(self.coefficients[6:9]).max())

    @cached_property
    def _largest(self) -> float:
        """The largest value of the polynomial, or more.

        Between places it rises by an eighth of the second difference; twice that is allowed for.
        """
        values = _DENSE @ self.coefficients
        return float(values.max() + 0.25 * np.abs(np.diff(values, 2)).max())

    def bound(self, error: float) -> float:
        """Return what the curve does not exceed, of which the polynomial has an error, even at a cusp."""
        return self._largest + CUSP * error

    @cached_property
    def error(self) -> float:
        """Estimate of the largest difference between polynomial and curve: the last coefficients times their number."""
        return DEGREE * self.tail

    @cached_property
    def is_resolved(self) -> bool:
        """Whether the values vary, and the last coefficients have fallen to where the polynomial is the curve."""
        return bool(self.tail < RESOLVED * np.ptp(self.values))

    @cached_property
    def is_smooth(self) -> bool:
        """Whether the curve is resolved, or constant."""
        return self.is_resolved or bool(np.ptp(self.values) <= FLAT * np.abs(self.values).max())

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

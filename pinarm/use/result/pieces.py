"""Chebyshev polynomials through functions of a run on pieces of it: values, last coefficients, extremes and zeros.

Coefficients of smooth functions fall geometrically, those of a kink as 1/n², those of a jump as 1/n, and those of a
pole not at all. So the last ones are the error of the polynomial.

Source: Trefethen, *Approximation Theory and Approximation Practice*, chapters 3, 7, 8 and 18.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev

from pinarm.arrays import Array, Flags, Indices
from pinarm.records import Record

DEGREE = 16
_ORDERS = np.arange(DEGREE + 1)
_ANGLES = np.stack([np.linspace(-np.pi, 0.0, DEGREE + 1), -np.pi + np.pi * (_ORDERS + 0.5) / (DEGREE + 1)])

NODES: Array = np.cos(_ANGLES)
"""The points at which functions are evaluated, on [-1, 1]: with both ends, and without, shape (2, 17)."""

TO_COEFFICIENTS: Array = np.linalg.inv(np.cos(_ANGLES[..., None] * _ORDERS))
"""Values at the nodes -> coefficients of the Chebyshev polynomials, shape (2, 17, 17): T_n(cos x) = cos(n x)."""

WEIGHTS: Array = np.where(_ORDERS % 2, 0.0, 2.0 / (1.0 - _ORDERS**2 + _ORDERS % 2)) @ TO_COEFFICIENTS
"""Of the values in the integral of the polynomial over [-1, 1] (Clenshaw and Curtis, and Fejér), positive, shape (2,
17).
"""

_DENSE: Array = np.cos(np.outer(np.linspace(0.0, np.pi, 65), _ORDERS))
"""Chebyshev polynomials at 65 points of [-1, 1], shape (65, 17)."""

TAIL, HEAD = slice(-3, None), slice(6, 9)
"""Of the coefficients: the last ones, and those of degree 6 to 8."""

RESOLVED = 1e-8
"""Largest of the last coefficients, relative to how far the values vary: then an extreme of the polynomial is in the
place of that of the function to 1e-8 of the piece, and the value there is the extreme to the square of it."""

FALLING, SINGULAR = 0.1, 0.35
"""Last coefficients relative to those of degree 6 to 8: below the first they fall faster than at a kink, above the
other as slowly as at a pole; at a kink they are a fifth."""

CUSP = 4.0
"""Error of the polynomial relative to its estimate at the root of |x|, whose coefficients fall as n^-1.5."""

KINK, SMOOTH = 3.0, 50.0
"""Error of the integral over half the width and the last coefficients, which 96 % of kinks, corners of roots and jumps
do not exceed wherever they are; and the same over the square of the last coefficients relative to those of degree 6 to
8, where these fall."""

FLAT = 4 * np.finfo(float).eps
"""Relative difference of values that are one value but for rounding."""

REAL = 1e-6
"""Largest imaginary part of roots that count: a double root is split by the root of the rounding."""


class Pieces(Record, frozen=True):
    """Polynomials through k functions on m pieces of a run.

    Attributes:
        interval: Number of the interval of each, shape (m,).
        low: Where each begins, shape (m,).
        high: Where each ends, shape (m,).
        open: Whether the nodes are those without ends: 1 or 0, shape (m,).
        f: The functions at the nodes, shape (m, 17, k).
        off: Largest distance of values that are known elsewhere from the polynomials, shape (m, k).
        least: Error that a polynomial has at least unless its coefficients fall, as the half of another, shape (m, k).
        grown: Size that last coefficients have at least where there is a pole; 0 where nothing is known, shape (m, k).
    """

    interval: Indices
    low: Array
    high: Array
    open: Indices
    f: Array
    off: Array
    least: Array
    grown: Array

    def __len__(self) -> int:
        return len(self.low)

    def some(self, places: Indices | Flags) -> Pieces:
        """Return some of them."""
        return Pieces(*(getattr(self, name)[places] for name in self.__struct_fields__))

    def joined(self, other: Pieces) -> Pieces:
        """Return these and others, in the order of the run."""
        every = [np.concatenate([getattr(x, name) for x in (self, other)]) for name in self.__struct_fields__]
        order = np.lexsort((every[1], every[0]))
        return Pieces(*(part[order] for part in every))

    @cached_property
    def coefficients(self) -> Array:
        """Those of the Chebyshev polynomials, shape (m, 17, k)."""
        return np.asarray(np.einsum("mnp,mpk->mnk", TO_COEFFICIENTS[self.open], self.f))

    @property
    def half(self) -> Array:
        """Half the width of each, shape (m, 1)."""
        return np.asarray(0.5 * (self.high - self.low)[:, None])

    @cached_property
    def tail(self) -> Array:
        """Largest of the last coefficients, shape (m, k)."""
        return np.asarray(np.abs(self.coefficients[:, TAIL]).max(axis=1))

    @cached_property
    def head(self) -> Array:
        """Largest of the coefficients of degree 6 to 8, shape (m, k)."""
        return np.asarray(np.abs(self.coefficients[:, HEAD]).max(axis=1))

    @cached_property
    def error(self) -> Array:
        """Estimate of the largest difference between polynomials and functions, shape (m, k)."""
        return np.asarray(np.maximum(DEGREE * self.tail, self.off))

    @property
    def integrals(self) -> Array:
        """Of the polynomials, shape (m, k)."""
        return np.asarray(self.half * np.einsum("mp,mpk->mk", WEIGHTS[self.open], self.f))

    @property
    def sizes(self) -> Array:
        """Integrals of the sizes of the functions, shape (m, k)."""
        return np.asarray(self.half * np.einsum("mp,mpk->mk", WEIGHTS[self.open], np.abs(self.f)))

    @property
    def integral_errors(self) -> Array:
        """Bounds of the errors of the integrals, values that are known elsewhere left out, shape (m, k)."""
        falls = SMOOTH * self.tail / np.where(self.head > 0.0, self.head, np.inf)
        return np.asarray(self.half * self.tail * np.where(self.head > 0.0, np.minimum(KINK, falls), KINK))

    @property
    def resolved(self) -> Flags:
        """Whether the values vary, and the last coefficients have fallen to where the polynomial is the function."""
        return np.asarray(np.maximum(self.tail, self.off / DEGREE) < RESOLVED * np.ptp(self.f, axis=1))

    @property
    def constant(self) -> Flags:
        """Whether the values differ by rounding only, shape (m, k)."""
        return np.asarray((np.ptp(self.f, axis=1) <= FLAT * np.abs(self.f).max(axis=1)) & (self.off <= 0.0))

    def largest(self, sign: float) -> Array:
        """Return what the polynomials times a sign do not exceed, shape (m, k).

        Between the points of a dense grid they rise by an eighth of the second difference; twice that is allowed for.
        """
        values = sign * np.einsum("dn,mnk->mdk", _DENSE, self.coefficients)
        return np.asarray(values.max(axis=1) + 0.25 * np.abs(np.diff(values, 2, axis=1)).max(axis=1))

    def bounds(self, sign: float) -> Array:
        """Return what the functions times a sign do not exceed, as far as the polynomials tell, shape (m, k)."""
        falls = self.tail < FALLING * self.head
        return self.largest(sign) + CUSP * np.where(falls, self.error, np.maximum(self.error, self.least))

    @property
    def is_singular(self) -> Flags:
        """Whether the coefficients fall as slowly as where a function passes through infinity, shape (m, k)."""
        return np.asarray(self.tail > np.maximum(self.grown, SINGULAR * self.head))

    def at(self, piece: Indices, t: Array) -> Array:
        """Return the polynomials of pieces at places, both of shape (n,), as an array of shape (n, k)."""
        x = (2.0 * t - self.low[piece] - self.high[piece]) / (self.high[piece] - self.low[piece])
        waves = np.cos(np.arccos(np.clip(x, -1.0, 1.0))[:, None] * _ORDERS)
        return np.asarray(np.einsum("np,npk->nk", waves, self.coefficients[piece]))

    def _places(self, piece: int, coefficients: Array) -> Array:
        """Return the places in a piece where a series is zero, ascending."""
        roots = chebyshev.chebroots(coefficients)
        real = np.sort(roots.real[np.abs(roots.imag) < REAL])
        low, high = self.low[piece], self.high[piece]
        return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * real[np.abs(real) <= 1.0])

    def extremes(self, piece: int) -> Array:
        """Return the places in a piece where the slope of the first polynomial is zero, ascending."""
        return self._places(piece, np.asarray(chebyshev.chebder(self.coefficients[piece, :, 0]), float))

    def zeros(self, piece: int) -> Array:
        """Return the places in a piece where the first polynomial is zero, ascending."""
        return self._places(piece, self.coefficients[piece, :, 0])

    def slope(self, piece: int, t: float) -> float:
        """Return the derivative of the first polynomial at a place of a piece."""
        low, high = self.low[piece], self.high[piece]
        rate = chebyshev.chebval(
            (2.0 * t - low - high) / (high - low), chebyshev.chebder(self.coefficients[piece, :, 0])
        )
        return float(rate * 2.0 / (high - low))

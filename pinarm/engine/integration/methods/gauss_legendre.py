"""Coefficients of Gauss-Legendre collocation: integrals of the polynomial through values at the nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import accumulate

import numpy as np

from pinarm.arrays import Array


@dataclass(frozen=True, eq=False)
class Gauss:
    """The polynomial through values f at the s Gauss nodes of [0, 1], and its integral; order 2s at the end.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.7.

    Attributes:
        c: Nodes, shape (s,).
        b: ``sum_j b_j f_j`` is the integral over [0, 1], shape (s,).
        a: ``sum_j a_ij f_j`` is the integral from 0 to c_i, shape (s, s).
        series: Values at the nodes to coefficients of Legendre's polynomials on [0, 1], shape (s, s).
        powers: Legendre coefficients to coefficients of powers of ``z = 2x - 1``, shape (s, s).
        terms: Legendre coefficients to terms of the integral from 0 to x, see ``DenseOutput``; shape (s, s).
    """

    c: Array
    b: Array
    a: Array
    series: Array
    powers: Array
    terms: Array


@cache
def gauss(s: int) -> Gauss:
    """Return the coefficients for s nodes."""
    z, weights = np.polynomial.legendre.leggauss(s)
    values, integrals = legendre(0.5 * (1.0 + z), s)
    series = 0.5 * (2.0 * np.arange(s) + 1.0)[:, None] * (values * weights[:, None]).T
    powers = np.zeros((s, s))
    for k in range(s):
        powers[: k + 1, k] = np.polynomial.legendre.leg2poly([0.0] * k + [1.0])
    return Gauss(0.5 * (1.0 + z), 0.5 * weights, integrals @ series, series, powers, _terms(s))


def legendre(x: Array, s: int) -> tuple[Array, Array]:
    """Return the Legendre polynomials on [0, 1] of degree 0 to s - 1 at x, and their integrals from 0, each (n, s).

    ``(k + 1) P_(k+1) = (2k + 1) z P_k - k P_(k-1)`` with ``z = 2x - 1``;
    ``int_0^x P_k = (P_(k+1) - P_(k-1)) / (2 (2k + 1))``.
    """
    p = [np.ones_like(x), 2.0 * x - 1.0]
    for k in range(1, s):
        p.append(((2 * k + 1) * (2.0 * x - 1.0) * p[k] - k * p[k - 1]) / (k + 1))
    integrals = [x] + [(p[k + 1] - p[k - 1]) / (2 * (2 * k + 1)) for k in range(1, s)]
    return np.stack(p[:s], axis=-1), np.stack(integrals, axis=-1)


def _terms(s: int) -> Array:
    """Return the terms of the integrals of the Legendre polynomials, one in each column, exact up to one rounding."""
    columns = np.zeros((s, s))
    columns[0, 0] = 1.0
    for k in range(1, s):
        rest = _coefficients(k + 1)
        for power, x in enumerate(_coefficients(k - 1)):
            rest[power] -= x
        rest = rest[1:]  # divided by x
        for row in range(k + 1):
            columns[row, k], rest = _divided(rest, 0 if row % 2 else 1)
        columns[:, k] /= 2 * (2 * k + 1)
    return columns


def _coefficients(k: int) -> list[int]:
    """Return the coefficients of powers of x of the Legendre polynomial of degree k on [0, 1]."""
    return [(-1) ** (k + power) * math.comb(k, power) * math.comb(k + power, power) for power in range(k + 1)]


def _divided(p: list[int], root: int) -> tuple[int, list[int]]:
    """Return r and q with ``p = r + x q`` for a root of 0, or ``p = r + (1 - x) q`` for one of 1."""
    if not root:
        return p[0], p[1:]
    from_above = list(accumulate(reversed(p)))
    return from_above[-1], [-x for x in from_above[-2::-1]]

"""Radau IIA methods: collocation at the zeros of ``P_s - P_(s-1)`` on [0, 1], the last of which is 1."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pinarm.arrays import Array

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class RadauTableau:
    """The coefficients of a Radau IIA method of s stages.

    The first eigenvalue of the inverse of a is the real one. Of each complex pair only one is kept, since for real
    slopes the other part is its conjugate: ``x = Re(back @ (forth @ x))`` for real x, and
    ``inv(a) @ x = Re(back @ (eigenvalues * (forth @ x)))``.

    Attributes:
        c: Nodes, shape (s,).
        a: Weights of the stages, shape (s, s); the last row are those of the step.
        inverse: Inverse of a.
        eigenvalues: Eigenvalues of the inverse of a, shape (m,) with ``m = (s + 1) / 2``.
        forth: Rows of the inverse of the eigenvector matrix, shape (m, s).
        back: Eigenvectors, those of complex pairs doubled, shape (s, m).
        error: Weights of ``Z_i = Y_i - y`` in the error estimate, shape (s,).
        powers: Values at the stages to coefficients of x, x^2 ... x^s, shape (s, s).
        terms: Values at the stages to the terms of ``DenseOutput``, shape (s, s).
    """

    c: Array
    a: Array
    inverse: Array
    eigenvalues: Complex
    forth: Complex
    back: Complex
    error: Array
    powers: Array
    terms: Array


@cache
def radau(s: int) -> RadauTableau:
    """Return the method of s stages, s odd; order ``2 s - 1``.

    The error estimate is ``y^ - y_new`` of the method with the node 0, of weight ``1 / eigenvalues[0]``, and those of
    the stages, whose order is s: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.8, eq. (8.18).
    """
    c = _nodes(s)
    basis, integrals = legendre(c, s)
    a = integrals @ np.linalg.inv(basis)
    inverse = np.linalg.inv(a)
    values, vectors = np.linalg.eig(inverse)
    chosen = np.concatenate([np.flatnonzero(np.abs(values.imag) < 1e-9), np.flatnonzero(values.imag > 1e-9)])
    pairs = np.where(np.arange(len(chosen)), 2.0, 1.0)
    at_start = legendre(np.zeros(1), s)[0][0]
    weights = -np.linalg.solve(basis.T, at_start) / values[chosen[0]].real
    powers = np.asarray(np.linalg.inv(c[:, None] ** np.arange(1, s + 1)), float)
    return RadauTableau(
        c, a, inverse, values[chosen], np.linalg.inv(vectors)[chosen], vectors[:, chosen] * pairs, weights @ inverse,
        powers, _terms(powers),
    )  # fmt: skip


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


def _nodes(s: int) -> Array:
    """Return the nodes by Golub's method: eigenvalues of the Jacobi matrix of the Legendre polynomials."""
    k = np.arange(1, s)
    beside = k / np.sqrt(4.0 * k**2 - 1.0)
    matrix = np.diag(beside, 1) + np.diag(beside, -1)
    matrix[-1, -1] = s / (2.0 * s - 1.0)  # P_s(1) / P_(s-1)(1) in terms of the normalised polynomials: 1 is a node
    nodes = 0.5 * (1.0 + np.linalg.eigvalsh(matrix))
    nodes[-1] = 1.0
    return nodes


def _terms(coefficients: Array) -> Array:
    """Return r_0, r_1 ... of ``x (r_0 + (1 - x) (r_1 + x (r_2 + ...)))`` from the coefficients of x, x^2 ..., rows."""
    left, terms = coefficients, list[Array]()
    while len(left):
        if len(terms) % 2:
            terms.append(left[0])
            left = left[1:]
        else:
            terms.append(left.sum(axis=0))
            left = -left[:0:-1].cumsum(axis=0)[::-1]
    return np.array(terms)

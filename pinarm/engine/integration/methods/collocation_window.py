"""One window of the collocation: its nodes, and the sweeps over them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integration.methods.gauss_legendre import gauss

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Accelerations, Manifold


class SlopePolynomial(NamedTuple):
    """The slopes [q', v'] of a window as polynomials in ``z = 2 (t - t_0) / h - 1``.

    Attributes:
        t: Start t_0 of the window [s].
        h: Length [s].
        powers: Coefficients of the powers of z, shape (d, nq + nv).
    """

    t: float
    h: float
    powers: Array

    def at(self, t: Array) -> Array:
        """Return the slopes at times t, shape (n,) -> (n, nq + nv)."""
        z = (2.0 / self.h) * (t - self.t) - 1.0
        return np.asarray(z[:, None] ** np.arange(len(self.powers)) @ self.powers)


class Window:
    """The nodes of a window, and the slopes at them.

    ``z = [y; k_0; k_1; ...]`` stacks the state and the slopes at the nodes, so that one product with the rows
    ``[1, h a_i0, h a_i1, ...]`` gives the states at the nodes: ``on``, projected onto the manifold, and ``v``.
    """

    def __init__(self, s: int, manifold: Manifold) -> None:
        nq, nv = manifold.nq, manifold.nv
        self.table, self.manifold = gauss(s), manifold
        self.t, self.weights, self.z = np.zeros(s), np.ones((s, s + 1)), np.zeros((s + 1, nq + nv))
        self.for_q, self.for_v, self.scaled = self.z[:, :nq], self.z[:, nq:], self.weights[:, 1:]
        self.slopes, self.rates, self.accelerations = self.z[1:], self.for_q[1:], self.for_v[1:]
        self.q, self.v, self.change = np.zeros((s, nq)), np.zeros((s, nv)), np.zeros((s, nv))
        self.on = self.q

    def begin(self, t: float, h: float, y: Array, slopes: Callable[[Array], Array]) -> None:
        """Set the state y at the start of a window, and first slopes at its nodes."""
        self.t = t + h * self.table.c
        np.multiply(self.table.a, h, out=self.scaled)
        self.z[0], self.slopes[:] = y, slopes(self.t)
        self.on = self.manifold.project(np.dot(self.weights, self.for_q, out=self.q))

    def sweep(self, together: Accelerations) -> Array:
        """Compute states from the accelerations, then accelerations from the states; return these, shape (s, nv).

        ``change`` is their difference to those of the last sweep.
        """
        np.dot(self.weights, self.for_v, out=self.v)
        self.rates[:] = self.manifold.velocity(self.on, self.v)
        self.on = self.manifold.project(np.dot(self.weights, self.for_q, out=self.q))
        new = together(self.t, self.on, self.v)
        np.subtract(new, self.accelerations, out=self.change)
        self.accelerations[:] = new
        return new

    def course(self, t: float, h: float, kept: int) -> SlopePolynomial:
        """Return the polynomials of the slopes with the first ``kept`` coefficients of the Legendre series."""
        table = self.table
        return SlopePolynomial(t, h, table.powers[:kept, :kept] @ (table.series[:kept] @ self.slopes))

"""A window of collocation: its nodes, and sweeps over them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integration.integrator import Accelerations, Manifold
from pinarm.engine.integration.methods.gauss_legendre import gauss


class Course(NamedTuple):
    """The slopes of a window as polynomials in ``z = 2x - 1``.

    Attributes:
        t: Start of the window [s].
        h: Its length [s].
        powers: Coefficients of the powers of z, shape (d, nq + nv).
    """

    t: float
    h: float
    powers: Array

    def at(self, t: Array) -> Array:
        """Return the slopes at times within the window or near it."""
        z = (2.0 / self.h) * (t - self.t) - 1.0
        return np.asarray(z[:, None] ** np.arange(len(self.powers)) @ self.powers)


class Window:
    """The nodes of a window, and the slopes there.

    ``z`` stacks the state and the slopes at the nodes, so that one product with the rows ``[1, h a_i0, h a_i1, ...]``
    gives the states there, ``on`` and ``v``.
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
        """Stand at the start of a window with the state y, and with slopes that are guessed at the nodes."""
        self.t = t + h * self.table.c
        np.multiply(self.table.a, h, out=self.scaled)
        self.z[0], self.slopes[:] = y, slopes(self.t)
        self.on = self.manifold.project(np.dot(self.weights, self.for_q, out=self.q))

    def sweep(self, together: Accelerations) -> Array:
        """Put the accelerations into the states, and those into the accelerations; return these, shape (s, nv).

        Their change is ``change``.
        """
        np.dot(self.weights, self.for_v, out=self.v)
        self.rates[:] = self.manifold.velocity(self.on, self.v)
        self.on = self.manifold.project(np.dot(self.weights, self.for_q, out=self.q))
        new = together(self.t, self.on, self.v)
        np.subtract(new, self.accelerations, out=self.change)
        self.accelerations[:] = new
        return new

    def course(self, t: float, h: float, kept: int) -> Course:
        """Return the polynomials of the slopes with so many coefficients of Legendre's series."""
        table = self.table
        return Course(t, h, table.powers[:kept, :kept] @ (table.series[:kept] @ self.slopes))

"""Pull of a redundant mechanism towards a posture: the part that its path leaves free, as constraint rows.

At every instant the configuration on a path is nearest to a posture q0 where, with prescribed coordinates w,

    q(t) = argmin |W (q - q0)|^2 / 2    subject to    phi(q) = 0,  w(q) = w_d(t),  q_min <= q <= q_max.

With J the rows of phi, w and the joints at limits, and Z a basis of the null space of J, the part of the pull that no
row of J holds vanishes:

    r(q) = Z Z^T W^2 (q - q0) = 0,    dr/dq = Z Z^T H,    H = W^2 - sum_k lam_k Hess(w_k),    J^T lam = W^2 (q - q0)

With the path these rows determine the motion, which ``NewtonSolver`` continues. It is a strict minimum, and smooth,
where J has its full rank and ``Z^T H Z`` is positive definite (Nocedal and Wright, Numerical Optimization, theorem
12.6; Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, theorem 3.2.2). Limits that
hold a joint have a multiplier that presses it inwards. Derivatives of J are complex steps, exact to rounding; second
ones, of the acceleration alone, differences of order 6 of these.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.kinematics.newton import NewtonSolver
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.mechanics.coordinates import Constraint, Parts
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.records import Record

IMAGINARY, STEP, DIFFERENCES = 1e-20, 0.01, np.array([3 / 4, -3 / 20, 1 / 60])
"""Complex step; distance of the configurations between which derivatives of J are differentiated [rad, or units of
length of the mechanism]; weights of the central difference of order 6."""

TINY = 1e-300
"""Least divisor."""


class Posture(Record, frozen=True):
    """A target q0 with weights w: ``sum_i (w_i (q_i - q0_i))^2`` is to be least, with q within limits.

    Attributes:
        target: q0 [rad or m]; 0 where the weight is, shape (nv,).
        weights: w; 0 of joints that nothing pulls, shape (nv,).
        lower: Lower limits [rad or m], infinite where there is none, shape (nv,).
        upper: Upper limits, likewise.
        places: Index in q of the coordinates that have a weight or a limit, by their index in v, shape (nv,).
    """

    target: Array
    weights: Array
    lower: Array
    upper: Array
    places: Indices
    names: tuple[str, ...]

    def margins(self, q: Array) -> Array:
        """Return the margins of a configuration to the lower and upper limits, shape (2, nv)."""
        return np.stack([q[self.places] - self.lower, self.upper - q[self.places]])

    def limit(self, joint: int, side: int) -> float:
        """Return the lower (0) or the upper (1) limit of a joint, by its index in v [rad or m]."""
        return float((self.lower, self.upper)[side][joint])

    @cached_property
    def sizes(self) -> Array:
        """``1 + |limit|``, shape (2, nv)."""
        limits = np.stack([self.lower, self.upper])
        return 1.0 + np.where(np.isfinite(limits), np.abs(limits), 0.0)


class FreePull(Constraint):
    """The part r(q) of the pull towards a posture that no row of J holds, as a constraint of nv rows.

    In coordinates ``q / unit``, in which W is 1 for every joint that is pulled and 0 for the others.

    Args:
        path: The rows of J: constraints, coordinates of the path and joints at limits.
        rank: That of J in a position of no special kind.
    """

    name = "the posture"

    def __init__(self, path: NewtonSolver, posture: Posture, rank: int) -> None:
        self.path, self.posture, self.rank = path, posture, rank
        weights = posture.weights / max(float((posture.weights * path.scale).max(initial=0.0)), TINY)
        self.pulled = (weights > 0.0).astype(np.float64)
        self.units = np.where(weights > 0.0, 1.0 / np.where(weights > 0.0, weights, 1.0), path.scale)
        self._last: PullAt | None = None

    @property
    def size(self) -> int:
        return int(self.path.model.nv)

    def unit(self, row: int) -> Unit:
        return DIMENSIONLESS

    def gap(self, state: Kinematics) -> Array:
        here = self.at(state.q)
        return np.asarray(here.free @ (here.free.T @ here.whole))

    def rows(self, state: Kinematics) -> Array:
        """Return the derivative of r where it is 0, shape (nv, nv)."""
        here = self.at(state.q)
        return np.asarray(here.free @ here.bent.T / self.units)

    def drift(self, state: Kinematics) -> Array:
        """Return the second derivative of r, where it is 0, along the velocity of the state, shape (nv,)."""
        here, way = self.at(state.q), state.v / self.units
        first, second = self.rates(state.q, way[None])[0], self._second(state.q, way)
        rate = here.inverse.T @ (self.pulled * way - first.T @ here.lam)
        return np.asarray(-here.free @ (here.free.T @ (2.0 * first.T @ rate + second.T @ here.lam)))

    @property
    def parts(self) -> Parts:
        raise NotImplementedError

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        return {}

    def at(self, q: Array) -> PullAt:
        """Return the pull at a configuration, shape (nq,); the last one is kept."""
        if self._last is None or not np.array_equal(self._last.q, q):
            self._last = PullAt(self, q)
        return self._last

    def whole(self, q: Array) -> Array:
        """Return the pull W (q - q0), shape (nv,)."""
        return np.asarray(self.pulled * (q[self.posture.places] - self.posture.target) / self.units)

    def jacobian(self, q: Array) -> Array:
        return np.asarray(self.path.rows(self.path.closure.state(q)) * (self.units / self.path.scale))

    def moved(self, q: Array, step: Array) -> Array:
        return np.asarray(pin.integrate(self.path.model, q, self.units * step))

    def rates(self, q: Array, ways: Array) -> Array:
        """Return the derivatives of J along ways, shape (k, nv), as an array of shape (k, m, nv).

        At a configuration, shape (nq,), or at one for each way, shape (k, nq).
        """
        maps = np.array([pin.tangentMap(self.path.model, row) for row in np.atleast_2d(q)])
        steps = 1j * IMAGINARY * np.matvec(maps, ways * self.units)
        rows = np.imag(self.path.whole.constraint_rows.at(q + steps).matrices) / IMAGINARY
        return np.asarray(rows * (self.units / self.path.measure[:, None]))

    def _second(self, q: Array, way: Array) -> Array:
        """Return the second derivative of J along a way, shape (m, nv)."""
        h = STEP / max(float(np.abs(self.units * way / self.path.scale).max(initial=0.0)), TINY)
        steps = h * np.array([1, 2, 3, -1, -2, -3])
        after, before = np.split(self.rates(np.array([self.moved(q, s * way) for s in steps]), np.tile(way, (6, 1))), 2)
        return np.asarray(np.tensordot(DIFFERENCES, after - before, 1) / h)


class PullAt:
    """The pull at one configuration q, shape (nq,).

    Attributes:
        regularity: Least singular value of J that counts, over the largest; 1 where none counts.
        inverse: Pseudo-inverse of J, shape (nv, m).
        free: Z, shape (nv, f).
        whole: W (q - q0), shape (nv,).
        lam: Multipliers of J, shape (m,).
    """

    def __init__(self, pull: FreePull, q: Array) -> None:
        u, s, vt = np.linalg.svd(pull.jacobian(q))
        r = min(pull.rank, len(s))
        self.pull, self.q, self.whole = pull, q, pull.whole(q)
        self.regularity = 0.0 if len(s) < pull.rank else float(s[r - 1] / s[0]) if r else 1.0
        self.inverse, self.free = (vt[:r].T / np.maximum(s[:r], TINY)) @ u[:, :r].T, vt[r:].T
        self.lam = self.whole @ self.inverse

    @cached_property
    def bent(self) -> Array:
        """H Z, shape (nv, f)."""
        bend = np.einsum("fmv,m->vf", self.pull.rates(self.q, self.free.T), self.lam)
        return np.asarray(self.pull.pulled[:, None] * self.free - bend)

    @cached_property
    def stiffness(self) -> tuple[float, Array]:
        """Least eigenvalue of ``Z^T H Z``, infinite without freedom, and the motion that belongs to it, shape (nv,)."""
        reduced = self.free.T @ self.bent
        if not len(reduced):
            return np.inf, np.zeros(len(self.free))
        values, ways = np.linalg.eigh(0.5 * (reduced + reduced.T))
        return float(values[0]), self.free @ ways[:, 0]

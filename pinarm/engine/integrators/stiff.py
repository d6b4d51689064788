"""An implicit method for stiff problems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integrators.contract import Count, Manifold, Solution, Step, Stretch
from pinarm.engine.integrators.start import first_step

ROOT = 6.0**0.5
C = np.array([(4 - ROOT) / 10, (4 + ROOT) / 10, 1.0])
A = np.array([
    [(88 - 7 * ROOT) / 360, (296 - 169 * ROOT) / 1800, (-2 + 3 * ROOT) / 225],
    [(296 + 169 * ROOT) / 1800, (88 + 7 * ROOT) / 360, (-2 - 3 * ROOT) / 225],
    [(16 - ROOT) / 36, (16 + ROOT) / 36, 1 / 9],
])  # fmt: skip
REAL = 1.0 / (3.0 + 3.0 ** (2 / 3) - 3.0 ** (1 / 3))
"""The real eigenvalue of A."""
ERROR = REAL / 3 * np.array([-13 - 7 * ROOT, -13 + 7 * ROOT, -1.0])
POWERS = np.linalg.inv(C[:, None] ** np.arange(1, 4))
"""From values at the stages to the coefficients of x, x^2, x^3 of the collocation polynomial."""

ITERATIONS = 7
CONTRACTION = 1e-3
"""Convergence rate of Newton's method below which a Jacobian serves the next step too."""
SAFETY, SLOWEST, FASTEST, KEPT = 0.9, 0.2, 8.0, 1.2
"""Step control of RADAU5; a step that would grow by less than the last is kept, and its matrix with it."""


@dataclass(frozen=True)
class Radau:
    """Radau IIA with three stages: order 5, L-stable, steps by an embedded estimate of order 3.

    ``Z_i = h sum_j a_ij f(y + Z_j)``, ``y_new = y + Z_3``, by simplified Newton iterations with a Jacobian by
    differences; dense output of order 3, the collocation polynomial. For springs of 1e6 to 1e9 N*m/rad with damping,
    in open chains and in loops, and for dry friction with little creep: steps follow the slow motion, whatever decays
    quickly. A fast oscillation without damping is not followed but damped. Of no use for smooth motion, where
    ``Adaptive`` is ten times cheaper, nor for long runs without loss, whose energy it eats. It breaks where the
    acceleration is not smooth: Newton's method then forces tiny steps. Source: Hairer, Wanner, Solving Ordinary
    Differential Equations II, section IV.8 (RADAU5).

    Attributes:
        tolerance: Local error per step, relative to ``1 + |y|`` in SI; good values 1e-5 to 1e-10.
    """

    tolerance: float
    name = "Radau IIA 5"
    order = 5
    parts = 4
    remedy = "a wider tolerance"

    def prepare(self, stretches: Sequence[Stretch], q: Array, v: Array) -> Sequence[Stretch]:
        """Return the stretches as they are."""
        return stretches

    def stepper(self, manifold: Manifold, count: Count) -> RadauStepper:
        """Return the method at work."""
        return RadauStepper(self.tolerance, manifold, count)

    def interpolants(self, stretch: Stretch, manifold: Manifold, steps: Sequence[Step]) -> Array:
        """Return the terms of the collocation polynomial, from its values at the stages less that at the start."""
        stages = np.array([step.slopes for step in steps])
        coefficients = POWERS @ stages
        change, first = stages[:, -1], coefficients[:, 0]
        last = np.array([1.0, 2.0, 3.0]) @ coefficients
        return np.stack([change, first - change, 2 * change - first - last], axis=1)

    def doubts(self, solution: Solution) -> list[str]:
        """Return nothing: it may cost more than needed, but it does not break."""
        return []


class RadauStepper:
    """The method at work; ``z`` holds the stages less the state."""

    def __init__(self, tolerance: float, manifold: Manifold, count: Count) -> None:
        n = manifold.nq + manifold.nv
        self.tolerance, self.manifold, self.count = tolerance, manifold, count
        self.y, self.slope, self.new = np.zeros(n), np.zeros(n), np.zeros(n)
        self.z, self.last_z, self.last_h = np.zeros((3, n)), np.zeros((3, n)), 0.0
        self.jacobian: Array | None = None
        self.fresh, self.h = False, 0.0
        self.inverse: Array = np.zeros((3 * n, 3 * n))
        self.filter: Array = np.zeros((n, n))
        self.enough = max(10 * np.finfo(float).eps / tolerance, min(0.03, tolerance**0.5))
        self.iterations, self.rate, self.promise, self.ceiling = 0, 0.0, 1.0, FASTEST
        self.before = (0.0, 1.0)

    @property
    def finite(self) -> bool:
        """Whether the slope at the present state is finite."""
        return bool(np.isfinite(self.slope).all())

    def begin(self, stretch: Stretch, y: Array) -> None:
        """Stand at the first instant of a stretch."""
        self.stretch, self.t, self.jacobian, self.last_h = stretch, stretch.start, None, 0.0
        self.y[:] = y
        self.slope = self.rates(self.t, self.y)

    def rates(self, t: float, y: Array) -> Array:
        """Return f(t, y)."""
        nq = self.manifold.nq
        q, v = self.manifold.project(y[:nq]), y[nq:]
        self.count.evaluations += 1
        return np.concatenate([self.manifold.velocity(q, v), self.stretch.acceleration(t, q, v)])

    def first(self, h: float) -> float:
        """Return the step of the stretch before, or one from two slopes."""
        stretch = self.stretch
        return h or float(first_step(stretch.start, stretch.end, self.y, self.slope, self.rates, self.tolerance, 3))

    def attempt(self, t: float, h: float) -> float:
        """Compute a step from the present state; return its error, not a number where Newton's method fails."""
        if self.jacobian is None:
            self.jacobian, self.fresh, self.h = self.differences(t), True, 0.0
        if h != self.h:
            n = len(self.y)
            try:
                self.inverse = np.asarray(np.linalg.inv(np.eye(3 * n) - h * np.kron(A, self.jacobian)))
                self.filter = np.asarray(np.linalg.inv(np.eye(n) - h * REAL * self.jacobian))
            except np.linalg.LinAlgError:
                return np.nan
            self.h = h
        return self.estimate(t, h) if self.solve(t, h) else np.nan

    def differences(self, t: float) -> Array:
        """Return the Jacobian of f at the present state, by forward differences."""
        columns = []
        for k, value in enumerate(self.y):
            y = self.y.copy()
            y[k] += (np.finfo(float).eps * max(1e-5, abs(value))) ** 0.5
            columns.append((self.rates(t, y) - self.slope) / (y[k] - value))
        return np.array(columns).T

    def solve(self, t: float, h: float) -> bool:
        """Find the stages by Newton's method; return whether it converged."""
        scale = self.tolerance * (1.0 + np.abs(self.y))
        x = C * h / self.last_h + 1.0 if self.last_h else C
        self.z = (x[:, None] ** np.arange(1, 4)) @ POWERS @ self.last_z - self.last_z[-1]
        before, self.promise = 0.0, max(self.promise, 1e-16) ** 0.8
        for k in range(ITERATIONS):
            slopes = np.array([self.rates(t + C[i] * h, self.y + self.z[i]) for i in range(3)])
            change = (self.inverse @ (h * (A @ slopes) - self.z).ravel()).reshape(3, -1)
            self.z += change
            size = float(np.sqrt(np.mean((change / scale) ** 2)))
            self.rate = size / before if before else 0.0
            if not self.rate < 1.0 or not np.isfinite(size):
                return False
            if k:
                self.promise = self.rate / (1.0 - self.rate)
            if self.promise * size <= self.enough:
                self.iterations = k + 1
                return True
            if k and self.promise * self.rate ** (ITERATIONS - 2 - k) * size > self.enough:
                return False
            before = size
        return False

    def estimate(self, t: float, h: float) -> float:
        """Return the error relative to the tolerance: the difference to an embedded method, filtered."""
        nq = self.manifold.nq
        self.new = self.y + self.z[-1]
        self.new[:nq] = self.manifold.project(self.new[:nq])
        scale = self.tolerance * (1.0 + np.maximum(np.abs(self.y), np.abs(self.new)))
        inner = ERROR @ self.z
        error = self.filter @ (inner + h * REAL * self.slope)
        size = float(np.sqrt(np.mean((error / scale) ** 2)))
        if size > 1.0 and (self.ceiling == 1.0 or not self.last_h):  # a fast transient: filtered once more
            error = self.filter @ (inner + h * REAL * self.rates(t, self.y + error))
            size = float(np.sqrt(np.mean((error / scale) ** 2)))
        return max(size, 1e-10)

    def along(self, t: float, h: float) -> tuple[Array, Array]:
        """Return the start and the stages of the step, the last of which is its end."""
        return t + h * np.array([0.0, *C]), np.vstack([self.y, self.y + self.z])

    def retry(self, h: float, error: float) -> float:
        """Return a shorter step, with a new Jacobian."""
        self.ceiling = 1.0
        if not self.fresh:
            self.jacobian = None
        return h * (max(SLOWEST, self.careful() * error**-0.25) if np.isfinite(error) else 0.5)

    def careful(self) -> float:
        """Return a safety factor that is smaller where Newton's method had to work."""
        return SAFETY * (2 * ITERATIONS + 1) / (2 * ITERATIONS + self.iterations)

    def accept(self, t: float, h: float, error: float) -> tuple[Array, float]:
        """Move on to the end of the step; return its stages and the step to go on with."""
        nq, z = self.manifold.nq, self.z.copy()
        factor = self.careful() * error**-0.25
        if self.before[0]:  # Gustafsson's predictive controller
            factor = min(factor, factor * h / self.before[0] * (self.before[1] / error) ** 0.25)
        factor = min(self.ceiling, FASTEST, max(SLOWEST, factor))
        self.before, self.ceiling = (h, max(error, 1e-2)), FASTEST
        self.last_z, self.last_h = z, h
        self.y[:] = self.new
        if self.stretch.settle is not None:
            self.y[:] = np.concatenate(self.stretch.settle(t, self.y[:nq].copy(), self.y[nq:].copy()))
        self.t, self.slope = t, self.rates(t, self.y)
        self.fresh = False
        if self.rate > CONTRACTION:
            self.jacobian = None
        return z, h if 1.0 <= factor <= KEPT else h * factor

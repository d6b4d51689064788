"""Radau IIA: implicit methods for stiff problems, collocation at the zeros of ``P_s - P_(s-1)`` on [0, 1]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from pinarm.arrays import Array, Complex
from pinarm.engine.integration.integrator import Stepper, waves
from pinarm.engine.integration.runge_kutta import Steps, first_step
from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Interval, Manifold, Solution, StepsOver

STAGES = ((3e-5, 3), (1e-7, 5), (0.0, 7))
"""Tolerance above which a number of stages is used. Many stages take long steps: at tight tolerances they save most of
the work; at wide ones Newton's method fails over such steps, as where dry friction sticks."""

ITERATIONS = 10
CONVERGED = 1e-4
"""Error of Newton's method over the tolerance: an error of velocity has to be below the creep of dry friction."""

CONTRACTION = 1e-2
"""Convergence rate of Newton's method below which a Jacobian is used for the next step too."""

SAFETY, SLOWEST, FASTEST, KEPT = 0.9, 0.2, 8.0, 1.2
"""Step control of RADAU5: safety factor, bounds of the factor of the next step, and the factor up to which the step is
kept, so that its matrices can be used again."""

UNSOLVED = 0.5
"""Factor of the next step where Newton's method did not converge."""


@dataclass(frozen=True, eq=False)
class RadauTableau:
    """The coefficients of a Radau IIA method of s stages.

    Of each complex pair of eigenvalues of the inverse of a only one is kept, behind the real one: for real slopes
    the other part is its conjugate, ``x = Re(back @ (forth @ x))`` for real x, and ``inv(a) @ x = Re(back @
    (eigenvalues * (forth @ x)))``.

    Attributes:
        c: Nodes, shape (s,).
        a: Weights of the stages, shape (s, s); the last row are those of the step.
        eigenvalues: Of the inverse, shape (m,) with ``m = (s + 1) / 2``.
        forth: Rows of the inverse of the eigenvector matrix, shape (m, s).
        back: Eigenvectors, those of complex pairs doubled, shape (s, m).
        error: Weights of ``Z_i = Y_i - y`` in the error estimate, shape (s,).
        terms: From values at the stages to the terms of a dense output, see ``Solution``, shape (s, s).
    """

    c: Array
    a: Array
    inverse: Array
    eigenvalues: Complex
    forth: Complex
    back: Complex
    error: Array
    terms: Array


@cache
def radau(s: int) -> RadauTableau:
    """Return the method of s stages, s odd; order ``2 s - 1``.

    The error estimate is ``y^ - y_new`` of the method with the node 0, of weight ``1 / eigenvalues[0]``, and those of
    the stages, whose order is s: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.8, eq. (8.18).
    """
    c = 0.5 + 0.5 * legendre.legroots([*(s - 1) * [0.0], -1.0, 1.0])
    c[-1] = 1.0
    basis = legendre.legvander(2.0 * c - 1.0, s - 1)
    integrals = 0.5 * legendre.legvander(2.0 * c - 1.0, s) @ legendre.legint(np.eye(s), lbnd=-1.0)
    a = integrals @ np.linalg.inv(basis)
    inverse = np.linalg.inv(a)
    values, vectors = np.linalg.eig(inverse)
    chosen = np.concatenate([np.flatnonzero(np.abs(values.imag) < 1e-9), np.flatnonzero(values.imag > 1e-9)])
    pairs = np.where(np.arange(len(chosen)), 2.0, 1.0)
    weights = -np.linalg.solve(basis.T, legendre.legvander(-1.0, s - 1)[0]) / values[chosen[0]].real
    back, forth = vectors[:, chosen] * pairs, np.linalg.inv(vectors)[chosen]
    return RadauTableau(
        c, a, inverse, values[chosen], forth, back, weights @ inverse, np.asarray(np.linalg.inv(waves(c, s)), float)
    )


class Radau(ValueRecord, frozen=True):
    """Radau IIA with 3, 5 or 7 stages: order 5, 9 or 13, L-stable, steps by an embedded estimate of order s.

    ``Z_i = h sum_j a_ij f(y + Z_j)``, ``y_new = y + Z_s``, by simplified Newton iterations with a Jacobian by
    differences; dense output of order s + 1, the collocation polynomial. For springs of 1e6 to 1e9 N*m/rad with
    damping, in open chains and in loops, and for dry friction with little creep: steps follow the slow motion, whatever
    decays quickly. Fast oscillations without damping are not followed but damped. Not for smooth motions, where
    ``Adaptive`` is cheaper, nor for long runs without losses, whose energy it dissipates. It fails where the
    acceleration is not smooth: Newton's method then forces tiny steps.

    Sources: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.8 (RADAU5); Hairer, Wanner, Stiff
    differential equations solved by Radau methods, J. Comput. Appl. Math. 111 (1999), for more stages.

    Attributes:
        tolerance: Local error per step, relative to ``size + |y|``, see ``Interval.size``; good values 1e-5 to 1e-10.
        stages: Number s, odd.
    """

    tolerance: float
    stages: int
    subdivisions = 4
    tangent = False
    remedy = "a wider tolerance"

    @property
    def name(self) -> str:
        return f"Radau IIA {self.order}"

    @property
    def order(self) -> int:
        return 2 * self.stages - 1

    def stepper(self, solution: Solution, steps_over: StepsOver | None) -> Stepper:
        return RadauStepper(self, solution, steps_over)

    def step_error(self, solution: Solution, index: int) -> float:
        return self.tolerance

    def dense_output(self, interval: Interval, manifold: Manifold, steps: Steps) -> Array:
        """Return the terms of the collocation polynomial: ``terms @ Z``."""
        return radau(self.stages).terms @ steps.slopes

    def diagnose(self, solutions: Sequence[Solution]) -> list[str]:
        """Return nothing: its steps are neither limited by stability nor unchecked."""
        return []


def radau_of(tolerance: float) -> Radau:
    """Return the method with the number of stages that suits a tolerance; see ``STAGES``."""
    return Radau(tolerance, next(stages for above, stages in STAGES if tolerance > above))


class RadauStepper(Stepper):
    """The stepper of Radau IIA; ``z`` holds the stages less the state, ``Z_i = Y_i - y``, shape (s, nq + nv)."""

    def __init__(self, method: Radau, solution: Solution, steps_over: StepsOver | None) -> None:
        super().__init__(solution, steps_over)
        n, s = len(self.y), method.stages
        self.tableau, self.tolerance = radau(s), method.tolerance
        self.slope, self.new = np.zeros(n), np.zeros(n)
        self.z, self.last_z, self.last_h = np.zeros((s, n)), np.zeros((s, n)), 0.0
        self.jacobian: Array | None = None
        self.fresh, self.h = False, 0.0
        self.systems: Complex = np.zeros((len(self.tableau.eigenvalues), n, n), complex)
        self.enough = max(10 * np.finfo(float).eps / self.tolerance, CONVERGED)
        self.iterations, self.rate, self.promise, self.ceiling = 0, 0.0, 1.0, FASTEST
        self.exponent = -1.0 / (s + 1)
        self.before = (0.0, 1.0)

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.slope).all())

    def begin(self, interval: Interval, y: Array) -> None:
        self.interval, self.t, self.jacobian = interval, interval.start, None
        self.last_z, self.last_h = np.zeros_like(self.z), 0.0
        self.y[:] = y
        self.slope = self.rates(self.t, self.y)

    def rates(self, t: float, y: Array) -> Array:
        return np.asarray(self.all_rates(np.array([t]), y[None])[0])

    def all_rates(self, t: Array, y: Array) -> Array:
        """Return f of many states, both of shape (k, nq + nv), at times t, shape (k,).

        They are computed in compiled code where states need not be settled.
        """
        self.count.evaluations += len(y)
        compiled = self.interval.compiled
        if compiled is not None and not compiled.settles:
            compiled.ready()
            return compiled.all_rates(t, y)
        return np.array(
            [self.interval.slope(self.manifold, *state) for state in zip(t.tolist(), y.copy(), strict=True)]
        )

    def first(self, h: float) -> float:
        start, end, order = self.interval.start, self.interval.end, len(self.tableau.c)
        size = self.interval.size
        if h:
            return h
        state = self.y[None], self.slope[None]
        return float(first_step((start, end), *state, self.all_rates, self.tolerance, order, size)[0])

    def attempt(self, t: float, h: float) -> float:
        """Compute a step from the present state; return its error over the tolerance, NaN without convergence."""
        if self.jacobian is None:
            self.jacobian, self.fresh, self.h = self.differences(t), True, 0.0
        if h != self.h:
            scaled = self.tableau.eigenvalues[:, None, None] / h * np.eye(len(self.y))
            try:
                self.systems = np.asarray(np.linalg.inv(scaled - self.jacobian))
            except np.linalg.LinAlgError:
                return np.nan
            self.h = h
        return self.estimate(t, h) if self.solve(t, h) else np.nan

    def differences(self, t: float) -> Array:
        """Return the Jacobian of f at the present state, by forward differences."""
        moved = np.tile(self.y, (len(self.y), 1))
        moved.flat[:: len(self.y) + 1] += (np.finfo(float).eps * np.maximum(1e-5, np.abs(self.y))) ** 0.5
        apart = moved.diagonal() - self.y
        return ((self.all_rates(np.full(len(self.y), t), moved) - self.slope) / apart[:, None]).T

    def solve(self, t: float, h: float) -> bool:
        """Solve for the stages by simplified Newton iterations; return whether they converged.

        In the eigenvectors of the inverse of a each iteration solves ``(lambda_i / h - J) w_i = r_i`` with
        ``r = forth @ (f(y + Z) - inverse @ Z / h)``, and ``Z += Re(back @ w)``. The first guess extrapolates the
        collocation polynomial of the last step.
        """
        tableau, scale = self.tableau, self.tolerance * (self.interval.size + np.abs(self.y))
        x = 1.0 + tableau.c * h / self.last_h if self.last_h else tableau.c
        self.z = waves(x, len(x)) @ (tableau.terms @ self.last_z) - self.last_z[-1]
        before, self.promise = 0.0, max(self.promise, 1e-16) ** 0.8
        times, inverse = t + tableau.c * h, tableau.inverse / h
        for k in range(ITERATIONS):
            left = self.all_rates(times, self.y + self.z) - inverse @ self.z
            change = (tableau.back @ np.matmul(self.systems, (tableau.forth @ left)[:, :, None])[:, :, 0]).real
            self.z += change
            size = _size(change / scale)
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
        """Return the error over the tolerance: ``(lambda_0 / h - J)^-1 (lambda_0 / h (error @ Z) + f(y))``, rms."""
        tableau = self.tableau
        self.new = self.y + self.z[-1]
        scale = self.tolerance * (self.interval.size + np.maximum(np.abs(self.y), np.abs(self.new)))
        filtered, inner = self.systems[0].real, tableau.eigenvalues[0].real / h * (tableau.error @ self.z)
        error = filtered @ (inner + self.slope)
        size = _size(error / scale)
        if size > 1.0 and (self.ceiling == 1.0 or not self.last_h):  # a fast transient: filtered once more
            error = filtered @ (inner + self.rates(t, self.y + error))
            size = _size(error / scale)
        return max(size, 1e-10)

    def along(self, t: float, h: float) -> tuple[Array, Array]:
        return t + h * np.array([0.0, *self.tableau.c]), np.vstack([self.y, self.y + self.z])

    def retry(self, h: float, error: float) -> float:
        """Return a shorter step, with a new Jacobian."""
        self.ceiling = 1.0
        if not self.fresh:
            self.jacobian = None
        return h * (max(SLOWEST, self.safety() * error**self.exponent) if np.isfinite(error) else UNSOLVED)

    def safety(self) -> float:
        """Return the safety factor, smaller the more Newton iterations were needed."""
        return SAFETY * (2 * ITERATIONS + 1) / (2 * ITERATIONS + self.iterations)

    def accept(self, t: float, h: float, error: float) -> tuple[Array, float]:
        """Move to the end of the step; return its stages and the next step [s]."""
        nq, z = self.manifold.nq, self.z.copy()
        factor = self.safety() * error**self.exponent
        if self.before[0]:  # Gustafsson's predictive controller
            factor = min(factor, factor * h / self.before[0] * (self.before[1] / error) ** -self.exponent)
        factor = min(self.ceiling, FASTEST, max(SLOWEST, factor))
        self.before, self.ceiling = (h, max(error, 1e-2)), FASTEST
        self.last_z, self.last_h = z, h
        self.y[:nq], self.y[nq:] = self.manifold.project(self.new[:nq]), self.new[nq:]
        self.settled(t)
        self.t, self.slope = t, self.rates(t, self.y)
        self.fresh = False
        if self.rate > CONTRACTION:
            self.jacobian = None
        return z, h if 1.0 <= factor <= KEPT else h * factor


def _size(x: Array) -> float:
    return math.sqrt(float(np.vdot(x, x)) / x.size)

"""Time integration of ``q' = velocity(q, v)``, ``v' = acceleration(t, q, v)``; nothing here knows of mechanisms.

Rotations are carried as quaternions embedded in R^4 and brought back to unit length: the vector field extends smoothly
off the sphere, so every Runge-Kutta method keeps its order (``pin.integrate`` inside a classical method drops to 2).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.tableaus import DOP853, Tableau
from pinarm.errors import IntegrationError, Interrupted

Acceleration = Callable[[float, Array, Array], Array]
"""``(t, q, v) -> a``; q and v are buffers that the next call overwrites."""

Settle = Callable[[float, Array, Array], tuple[Array, Array]]
"""``(t, q, v) -> q, v``: the nearest state that meets the constraints."""

SAFETY, SLOWEST, FASTEST = 0.9, 1 / 3, 6.0
"""Step control of Hairer, Norsett and Wanner, section II.4: aim below the tolerance, change the step in bounds."""

TINY = 1e-300
"""Keeps quotients of squares that underflow finite."""

NOISE = 1e-6
"""Error of a step, relative to ``1 + |y|``, that blown-up rounding explains close to a singular position."""

NOISELESS = 1e-8
"""Smallest trial of the first step, relative to the duration: a state that is 0 but for rounding would ask for less."""

SHORTEST = 16.0
"""Smallest step in units in the last place of t: below it, adding a stage's fraction of h no longer changes t."""


class Manifold(Protocol):
    """The space of configurations."""

    @property
    def nq(self) -> int:
        """Numbers in q."""
        ...

    @property
    def nv(self) -> int:
        """Numbers in v."""
        ...

    def velocity(self, q: Array, v: Array) -> Array:
        """Return the time derivative of q, shape (nq,)."""
        ...

    def project(self, q: Array) -> Array:
        """Return q brought back onto the manifold; rows of many samples where q is (n, nq)."""
        ...


@dataclass(frozen=True)
class Flat:
    """Configurations that are plain numbers: ``q' = v``."""

    nq: int
    nv: int

    def velocity(self, q: Array, v: Array) -> Array:
        """Return v."""
        return v

    def project(self, q: Array) -> Array:
        """Return q."""
        return q


@dataclass(frozen=True)
class Stretch:
    """An interval of time on which the acceleration is smooth.

    Attributes:
        start: Its first instant [s].
        end: Its last instant [s].
        acceleration: Smooth up to both ends; at a jump each side has its own.
        settle: Brings the state back onto the constraints after every accepted step; none where there are none.
        floor: Returns the step that is taken although its error is above the tolerance, as long as it is below
            ``NOISE`` [s]: close to a singular position, where rounding is blown up, shorter steps are no better.
    """

    start: float
    end: float
    acceleration: Acceleration
    settle: Settle | None = None
    floor: Callable[[], float] = float


@dataclass(frozen=True)
class Step:
    """An accepted step, with all that its dense output needs.

    Attributes:
        t: Its start [s].
        h: Its length [s].
        y: State [q, v] at the start, shape (nq + nv,).
        slopes: Slopes at the stages and at the end, shape (s + 1, nq + nv).
        stretch: Index of the stretch that it belongs to.
    """

    t: float
    h: float
    y: Array
    slopes: Array
    stretch: int


@dataclass
class Solution:
    """What an integration gives: steps, and the state at any time between the first and the last.

    Attributes:
        tableau: The method.
        manifold: The space of configurations.
        stretches: The intervals that were integrated.
        steps: Accepted steps, in order of time.
        evaluations: Number of accelerations computed for the steps.
        rejected: Number of steps that were tried and refused.
        floored: Number of steps that were taken at their floor, with an error above the tolerance.
    """

    tableau: Tableau
    manifold: Manifold
    stretches: Sequence[Stretch]
    steps: list[Step] = field(default_factory=list)
    evaluations: int = 0
    rejected: int = 0
    floored: int = 0
    _starts: Array | None = field(default=None, repr=False)
    _interpolants: dict[int, Array] = field(default_factory=dict, repr=False)

    @property
    def end(self) -> float:
        """Return the last time reached [s]."""
        return self.steps[-1].t + self.steps[-1].h if self.steps else self.stretches[0].start

    def states(self, t: Array) -> tuple[Array, Array]:
        """Return the states at many times, to the order of the dense output.

        Args:
            t: Times [s], shape (n,), within what was integrated.

        Returns:
            q of shape (n, nq) and v of shape (n, nv).
        """
        if self._starts is None or len(self._starts) != len(self.steps):
            self._starts = np.array([step.t for step in self.steps])
        index = np.clip(np.searchsorted(self._starts, t, side="right") - 1, 0, len(self.steps) - 1)
        needed, where = np.unique(index, return_inverse=True)
        h = np.array([self.steps[i].h for i in needed])[where]
        start = self._starts[index]
        base = np.array([self.steps[i].y for i in needed])[where]
        terms = np.array([self._interpolant(i) for i in needed])[where]
        x = ((t - start) / h)[:, None]
        y = np.zeros_like(base)
        for degree in range(terms.shape[1] - 1, -1, -1):
            y = (y + terms[:, degree]) * (1.0 - x if degree % 2 else x)
        y += base
        return self.manifold.project(y[:, : self.manifold.nq]), y[:, self.manifold.nq :]

    def _interpolant(self, index: int) -> Array:
        """Return the terms of a step's interpolant, computing its further stages when first asked."""
        known = self._interpolants.get(index)
        if known is None:
            known = self._interpolants[index] = _terms(self, self.steps[index])
        return known


def _terms(solution: Solution, step: Step) -> Array:
    """Dense output of Hairer, Norsett, Wanner, section II.6: alternating products of x and 1 - x."""
    tableau, nq = solution.tableau, solution.manifold.nq
    acceleration = solution.stretches[step.stretch].acceleration
    s = tableau.stages + 1
    slopes = np.vstack([step.slopes, np.empty((len(tableau.dense_c), len(step.y)))])
    for extra, (weights, c) in enumerate(zip(tableau.dense_a, tableau.dense_c, strict=True)):
        y = step.y + step.h * (weights[: s + extra] @ slopes[: s + extra])
        q, v = solution.manifold.project(y[:nq]), y[nq:]
        slopes[s + extra, :nq] = solution.manifold.velocity(q, v)
        slopes[s + extra, nq:] = acceleration(step.t + c * step.h, q, v)
    change = step.h * (tableau.b @ slopes[: s - 1])
    first, last = step.h * slopes[0], step.h * slopes[s - 1]
    return np.vstack([change, first - change, 2 * change - first - last, step.h * (tableau.dense_d @ slopes)])


class _Stepper:
    """Buffers and inner loop of an explicit method.

    ``z`` stacks the state and the slopes, so that one product with the row ``[1, h a_i0, h a_i1, ...]`` gives a stage.
    """

    def __init__(self, tableau: Tableau, manifold: Manifold, tolerance: float) -> None:
        s, n, nq = tableau.stages, manifold.nq + manifold.nv, manifold.nq
        self.tableau, self.manifold, self.tolerance = tableau, manifold, tolerance
        self.max_steps = 0
        self.z = np.zeros((s + 2, n))
        self.y, self.slopes = self.z[0], self.z[1:]
        self.unit_weights = np.zeros((s + 1, s + 2))
        self.unit_weights[:s, 1:-1], self.unit_weights[s, 1:-1] = tableau.a, tableau.b
        self.weights = np.ones((s + 1, s + 2))
        self.stage, self.new = np.empty(n), np.empty(n)
        self.stage_q, self.stage_v = self.stage[:nq], self.stage[nq:]
        self.new_q, self.new_v = self.new[:nq], self.new[nq:]
        self.inner = [
            (self.weights[i, : i + 1], self.z[: i + 1], self.slopes[i, :nq], self.slopes[i, nq:], float(tableau.c[i]))
            for i in range(1, s)
        ]
        self.final = (self.weights[s, : s + 1], self.z[: s + 1], self.slopes[s, :nq], self.slopes[s, nq:])
        self.errors = np.empty((len(tableau.error), n))

    def begin(self, t: float, y: Array, acceleration: Acceleration) -> None:
        """Set the state and its slope."""
        nq = self.manifold.nq
        self.y[:] = y
        self.slopes[0, :nq] = self.manifold.velocity(self.y[:nq], self.y[nq:])
        self.slopes[0, nq:] = acceleration(t, self.y[:nq], self.y[nq:])

    def attempt(self, t: float, h: float, acceleration: Acceleration) -> float:
        """Compute the step from the present state; return its error, 1 being the tolerance."""
        dot, velocity, project = np.dot, self.manifold.velocity, self.manifold.project
        np.multiply(self.unit_weights[:, 1:], h, out=self.weights[:, 1:])
        stage, q, v = self.stage, self.stage_q, self.stage_v
        for weights, stack, slope_q, slope_v, c in self.inner:
            dot(weights, stack, out=stage)
            on = project(q)
            slope_q[:] = velocity(on, v)
            slope_v[:] = acceleration(t + c * h, on, v)
        weights, stack, slope_q, slope_v = self.final
        dot(weights, stack, out=self.new)
        self.new_q[:] = project(self.new_q)
        slope_q[:] = velocity(self.new_q, self.new_v)
        slope_v[:] = acceleration(t + h, self.new_q, self.new_v)
        return self.error(h)

    def error(self, h: float) -> float:
        """Return the error of the step relative to the tolerance; Hairer, Norsett, Wanner, section II.10, eq. (10.17).

        With a second, lower estimate e3 the norm is ``e5^2 / sqrt(e5^2 + 0.01 e3^2)``, which has the order of the step.
        """
        errors = np.dot(self.tableau.error, self.slopes, out=self.errors)
        errors /= self.tolerance * (1.0 + np.maximum(np.abs(self.y), np.abs(self.new)))
        squares = [float(np.dot(row, row)) for row in errors]
        if not squares[0]:
            return 0.0 if not any(squares) else abs(h) * (squares[-1] / errors.shape[1]) ** 0.5
        denominator = squares[0] + sum(0.01 * square for square in squares[1:])
        return float(abs(h) * squares[0] / max((denominator * errors.shape[1]) ** 0.5, TINY))

    def settle(self, t: float, settle: Settle, acceleration: Acceleration) -> None:
        """Bring the state onto the constraints, and its slope with it."""
        nq = self.manifold.nq
        self.y[:nq], self.y[nq:] = settle(t, self.y[:nq].copy(), self.y[nq:].copy())
        self.begin(t, self.y, acceleration)

    def accept(self) -> None:
        """Move on to the end of the step, whose slope is already known."""
        self.y[:] = self.new
        self.slopes[0] = self.slopes[-1]


def first_step(
    tableau: Tableau, stretch: Stretch, manifold: Manifold, y: Array, slope: Array, tolerance: float
) -> float:
    """Return a first step from two slopes; Hairer, Norsett, Wanner, section II.4."""
    nq = manifold.nq

    def norm(x: Array) -> float:
        return float(np.sqrt(np.mean((x / (tolerance * (1.0 + np.abs(y)))) ** 2)))

    d0, d1 = norm(y), norm(slope)
    h0 = 1e-6 if min(d0, d1) < 1e-5 else 0.01 * d0 / d1
    duration = stretch.end - stretch.start
    h0 = min(max(h0, NOISELESS * duration), duration)
    ahead = y + h0 * slope
    q, v = manifold.project(ahead[:nq]), ahead[nq:]
    further = np.concatenate([manifold.velocity(q, v), stretch.acceleration(stretch.start + h0, q, v)])
    d2 = norm(further - slope) / h0
    steepest = max(d1, d2)
    h1 = max(1e-6, 1e-3 * h0) if steepest <= 1e-15 else (0.01 / steepest) ** (1.0 / (tableau.error_order + 1))
    return min(100.0 * h0, h1)


def integrate(
    stretches: Sequence[Stretch], manifold: Manifold, q: Array, v: Array, *, tolerance: float,
    max_steps: int = 1_000_000, tableau: Tableau = DOP853,
) -> Solution:  # fmt: skip
    """Integrate with adaptive steps that end exactly where one stretch meets the next.

    Order 8 with DOP853. The right choice for smooth motion at errors below 1e-4. It breaks on stiff problems (joint
    springs with strong damping): the steps then follow the fastest decay instead of the motion.

    Args:
        stretches: Consecutive intervals with their accelerations.
        manifold: The space of configurations.
        q: Initial configuration, shape (nq,).
        v: Initial velocity, shape (nv,).
        tolerance: Local error per step, relative to ``1 + |y|`` in SI; good values 1e-6 to 1e-12.
        max_steps: Number of steps, rejected ones included, after which to give up.
        tableau: The method.

    Returns:
        The steps and their dense output.

    Raises:
        IntegrationError: The step became too small to go on, or the acceleration is not finite; ``partial`` holds the
            solution until then.
    """
    solution = Solution(tableau, manifold, stretches)
    stepper = _Stepper(tableau, manifold, tolerance)
    stepper.max_steps = max_steps
    y = np.concatenate([manifold.project(np.asarray(q, float)), np.asarray(v, float)])
    try:
        _integrate_all(solution, stepper, y)
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted at t = {solution.end:.9g} s", partial=solution) from None
    return solution


def _integrate_all(solution: Solution, stepper: _Stepper, y: Array) -> None:
    """Step through all stretches of a solution from the state y."""
    h = 0.0
    for index, stretch in enumerate(solution.stretches):
        stepper.begin(stretch.start, y, stretch.acceleration)
        solution.evaluations += 1
        if h == 0.0:
            slope, manifold = stepper.slopes[0], stepper.manifold
            if not np.isfinite(slope).all():
                raise _not_finite(solution, stretch.start, stepper.y, manifold)
            h = first_step(stepper.tableau, stretch, manifold, stepper.y, slope, stepper.tolerance)
            solution.evaluations += 1
        h = _advance(solution, stepper, stretch, index, h)
        y = stepper.y.copy()


def _advance(solution: Solution, stepper: _Stepper, stretch: Stretch, index: int, h: float) -> float:
    """Step through one stretch and return the step to begin the next one with."""
    t, end, exponent = stretch.start, stretch.end, -1.0 / (stepper.tableau.error_order + 1)
    ceiling = FASTEST
    while t < end:
        if h < SHORTEST * np.spacing(max(abs(t), end - stretch.start)):
            raise _stuck(solution, t, h, stepper)
        if len(solution.steps) + solution.rejected >= stepper.max_steps:
            raise _too_many(solution, t, h, stepper)
        last = t + 1.01 * h >= end
        taken = end - t if last else h
        error = stepper.attempt(t, taken, stretch.acceleration)
        solution.evaluations += stepper.tableau.stages
        floor = stretch.floor() if error * stepper.tolerance < NOISE else 0.0
        if error <= 1.0 or taken <= 1.001 * floor:
            solution.floored += error > 1.0
            solution.steps.append(Step(t, taken, stepper.y.copy(), stepper.slopes.copy(), index))
            stepper.accept()
            t = end if last else t + taken
            if stretch.settle is not None:
                stepper.settle(t, stretch.settle, stretch.acceleration)
                solution.evaluations += 1
            grown = taken * min(ceiling, max(SLOWEST, SAFETY * error**exponent)) if error else taken * ceiling
            h = max(h, grown) if last else grown
            ceiling = FASTEST
        else:  # a step whose error is not even a number is refused like one that is too large
            solution.rejected += 1
            h = max(taken * (max(SLOWEST, SAFETY * error**exponent) if error < 1e300 else 0.1), floor)
            ceiling = 1.0
    return h


def _not_finite(solution: Solution, t: float, y: Array, manifold: Manifold) -> IntegrationError:
    return IntegrationError(
        f"the acceleration is not finite at the start, t = {t:.9g} s, q = {np.array2string(y[: manifold.nq])}",
        hint="a body without mass that is free to move, or a load that is infinite here",
        partial=solution, t=t, q=y[: manifold.nq].copy(), v=y[manifold.nq :].copy(),
    )  # fmt: skip


def _too_many(solution: Solution, t: float, h: float, stepper: _Stepper) -> IntegrationError:
    return IntegrationError(
        f"the integration has taken {stepper.max_steps} steps and is at t = {t:.9g} s; its steps are {h:.2g} s long",
        hint="a wider tolerance, a shorter time, softer springs, dry friction of a larger creep, or accuracy.max_steps",
        partial=solution, t=t,
    )  # fmt: skip


def _stuck(solution: Solution, t: float, h: float, stepper: _Stepper) -> IntegrationError:
    nq = stepper.manifold.nq
    finite = bool(np.isfinite(stepper.slopes).all())
    reason = "the acceleration grows without bound" if finite else "the acceleration is not finite"
    return IntegrationError(
        f"the integration cannot go on at t = {t:.12g} s: the step fell to {h:.2g} s because {reason} near "
        f"q = {np.array2string(stepper.y[:nq])}",
        hint="a wider tolerance, or look for a singular position or a load that jumps there",
        partial=solution, t=t, q=stepper.y[:nq].copy(), v=stepper.y[nq:].copy(),
    )  # fmt: skip

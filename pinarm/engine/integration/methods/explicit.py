"""Explicit Runge-Kutta methods: embedded pairs with adaptive steps, and fixed steps.

Rotations are carried as quaternions embedded in R^4 and brought back to unit length: the vector field extends smoothly
off the sphere, so every Runge-Kutta method keeps its order (``pin.integrate`` inside a classical method drops to 2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integration.first_step import first_step
from pinarm.engine.integration.integrator import Count, Manifold, Solution, Step, Stretch
from pinarm.engine.integration.methods.tableaus import DOP853, RK4, Tableau
from pinarm.engine.integration.step_control import FASTEST, HUGE, LOST, TINY, growth, shrinkage

NOISE = 1e-6
"""Error of a step, relative to ``1 + |y|``, that blown-up rounding explains close to a singular position."""

STIFF = 0.3
"""Share of the steps at the stability limit from which on a problem is called stiff for an explicit method."""

LIMITED = "stiff"
"""How a note begins where that is so."""

HALVES = np.array([0.0, 0.5, 1.0])
"""Parts of a step."""

SAMPLE = 40
"""Number of fixed steps that are repeated in two halves to estimate what a step errs by."""

COARSE = 1e-3
"""Error of a fixed step, relative to ``1 + |y|``, from which on it is called too large."""


@dataclass(frozen=True)
class Adaptive:
    """An embedded pair whose steps follow the tolerance.

    Step: ``k_i = f(t + c_i h, y + h sum_j a_ij k_j)``, ``y + h sum_i b_i k_i``, with ``f = (velocity(q, v), a)``. With
    ``DOP853`` order 8, dense output of order 7: the right choice for smooth motion at errors below 1e-4. With
    ``DOPRI5`` order 5, dense output of order 4: cheaper at errors of 1e-3 to 1e-5, and where the acceleration has kinks
    (tables, friction) that a high order cannot use. Both break on stiff problems (joint springs with strong damping):
    steps then follow the fastest decay instead of the motion, which ``doubts`` finds. Sources: Hairer, Norsett, Wanner,
    Solving Ordinary Differential Equations I, sections II.4, II.5, II.6 and II.10; step control
    ``h 0.8 e^(-0.8/k)``, a damped integral controller: Soderlind, Digital filters in adaptive time-stepping, ACM TOMS
    29 (2003), section 2.

    Attributes:
        tolerance: Local error per step, relative to ``1 + |y|`` in SI; good values 1e-6 to 1e-12, for DOPRI5 1e-3 to
            1e-7.
        tableau: The coefficients.
    """

    tolerance: float
    tableau: Tableau = DOP853
    parts = 4
    remedy = "a wider tolerance"

    @property
    def name(self) -> str:
        """Name of the tableau."""
        return self.tableau.name

    @property
    def order(self) -> int:
        """Order of the step."""
        return self.tableau.order

    def prepare(self, stretches: Sequence[Stretch], q: Array, v: Array) -> Sequence[Stretch]:
        """Return the stretches as they are."""
        return stretches

    def stepper(self, manifold: Manifold, count: Count) -> AdaptiveStepper:
        """Return the method at work."""
        return AdaptiveStepper(self, manifold, count)

    def interpolants(self, stretch: Stretch, manifold: Manifold, steps: Sequence[Step]) -> Array:
        """Return the terms of the dense output."""
        return _terms(self.tableau, stretch, manifold, steps)

    def doubts(self, solution: Solution) -> list[str]:
        """Return a note where steps are limited by stability.

        The last stage and the end of the step share their time, so ``|k_s - k_(s-1)| / |y_new - Y_(s-1)|`` estimates
        the dominant eigenvalue: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.2, eq. (2.26).
        """
        steps, tableau = solution.steps, self.tableau
        if not steps:
            return []
        h, slopes = np.array([step.h for step in steps]), np.array([step.slopes for step in steps])
        s = tableau.stages
        apart = h[:, None] * np.einsum("j,njk->nk", tableau.b - tableau.a[-1], slopes[:, :s])
        change = h * np.linalg.norm(slopes[:, s] - slopes[:, s - 1], axis=1)
        limited = change > tableau.stability * np.maximum(np.linalg.norm(apart, axis=1), TINY)
        share = float(limited.mean())
        if share < STIFF:
            return []
        return [
            f"{LIMITED}: on {share:.0%} of the steps {self.name} is limited by stability, not by accuracy; "
            "accuracy.method: stiff takes longer steps"
        ]


@dataclass(frozen=True)
class FixedStep:
    """Steps of one length, whatever the error; each stretch is divided evenly into steps no longer than asked for.

    With ``RK4`` the classical method: ``y + h (k_1 + 2 k_2 + 2 k_3 + k_4) / 6``, order 4, dense output the cubic
    through both ends and their slopes, whose error is of order 4 too. Source: Hairer, Norsett, Wanner, section II.1,
    table 1.2. For runs of predictable cost, for comparisons with other programs, and where an adaptive method cannot
    judge its error. It breaks silently where the step is too long (``doubts`` repeats some of them in two halves to
    tell), and blows up beyond ``|lambda| h = 2.8``. Good values: a hundredth of the shortest period of the motion.

    Attributes:
        step: Longest step [s].
        tableau: The coefficients.
    """

    step: float
    tableau: Tableau = RK4
    parts = 4
    remedy = "a shorter accuracy.step, or an adaptive method"

    @property
    def name(self) -> str:
        """Name of the tableau."""
        return self.tableau.name

    @property
    def order(self) -> int:
        """Order of the step."""
        return self.tableau.order

    def prepare(self, stretches: Sequence[Stretch], q: Array, v: Array) -> Sequence[Stretch]:
        """Return the stretches as they are."""
        return stretches

    def stepper(self, manifold: Manifold, count: Count) -> FixedStepper:
        """Return the method at work."""
        return FixedStepper(self, manifold, count)

    def interpolants(self, stretch: Stretch, manifold: Manifold, steps: Sequence[Step]) -> Array:
        """Return the terms of the dense output."""
        return _terms(self.tableau, stretch, manifold, steps)

    def doubts(self, solution: Solution) -> list[str]:
        """Return a note where two halves of a step end elsewhere than the step."""
        error, t = 0.0, 0.0
        for index in np.unique(np.linspace(0, len(solution.steps) - 1, SAMPLE).astype(int)):
            step = solution.steps[index]
            found = self._error(solution, step)
            if not found <= error:
                error, t = found, step.t
        passing = solution.count.passing
        unseen = [f"step too large: {passing} steps go past whole pieces of a load; {self.remedy}"] if passing else []
        if error < COARSE:
            return unseen
        return [
            *unseen,
            f"step too large: at t = {t:.6g} s a step of {self.name} over {self.step:g} s errs by {error:.1e}, "
            f"relative to 1 + |y|; {self.remedy}",
        ]

    def _error(self, solution: Solution, step: Step) -> float:
        """Return the difference of a step to two halves, which is its error but for a factor near 1."""
        stretch, tableau = solution.stretches[step.stretch], self.tableau
        stages = Stages(tableau, solution.manifold)
        stages.start(step.t, step.y, stretch)
        for half in range(2):
            stages.advance(step.t + 0.5 * half * step.h, 0.5 * step.h)
            stages.move()
        whole = step.y + step.h * (tableau.b @ step.slopes[: tableau.stages])
        return float((np.abs(whole - stages.y) / (1.0 + np.abs(stages.y))).max(initial=0.0))


class Stages:
    """Buffers and inner loop of an explicit method.

    ``z`` stacks the state and the slopes, so that one product with the row ``[1, h a_i0, h a_i1, ...]`` gives a stage;
    ``ends`` are the states at the end and at the start of the step.
    """

    def __init__(self, tableau: Tableau, manifold: Manifold) -> None:
        s, n, nq = tableau.stages, manifold.nq + manifold.nv, manifold.nq
        self.manifold, self.stretch = manifold, Stretch(0.0, 0.0, lambda t, q, v: 0.0 * v)
        rows = np.zeros((s + 3, n))
        self.ends, self.z = rows[:2], rows[1:]
        self.new, self.y, self.slopes = rows[0], rows[1], rows[2:]
        self.unit_weights = np.zeros((s + 1, s + 2))
        self.unit_weights[:s, 1:-1], self.unit_weights[s, 1:-1] = tableau.a, tableau.b
        self.weights = np.ones((s + 1, s + 2))
        self.scaled, self.unscaled = self.weights[:, 1:], self.unit_weights[:, 1:]
        self.stage = np.empty(n)
        self.stage_q, self.stage_v = self.stage[:nq], self.stage[nq:]
        self.new_q, self.new_v = self.new[:nq], self.new[nq:]
        self.inner = [
            (self.weights[i, : i + 1], self.z[: i + 1], self.slopes[i, :nq], self.slopes[i, nq:], float(tableau.c[i]))
            for i in range(1, s)
        ]
        self.final = (self.weights[s, : s + 1], self.z[: s + 1], self.slopes[s, :nq], self.slopes[s, nq:])

    def start(self, t: float, y: Array, stretch: Stretch) -> None:
        """Set the state and its slope."""
        self.stretch = stretch
        self.y[:] = y
        self.slopes[0] = self.rates(t, self.y)

    def rates(self, t: float, y: Array) -> Array:
        """Return the slope of a state."""
        nq = self.manifold.nq
        q, v = self.manifold.project(y[:nq]), y[nq:]
        return np.concatenate([self.manifold.velocity(q, v), self.stretch.acceleration(t, q, v)])

    def advance(self, t: float, h: float) -> None:
        """Compute the step from the present state, and the slope at its end."""
        dot, velocity, project, acceleration = (
            np.dot, self.manifold.velocity, self.manifold.project, self.stretch.acceleration,
        )  # fmt: skip
        np.multiply(self.unscaled, h, out=self.scaled)
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

    @property
    def finite(self) -> bool:
        """Whether all slopes are finite."""
        return bool(np.isfinite(self.slopes).all())

    def along(self, t: float, h: float) -> tuple[Array, Array]:
        """Return the ends of the step and the middle of the cubic between them."""
        return t + h * HALVES, np.array([self.y, middle(h, self.y, self.new, self.slopes), self.new])

    def move(self) -> None:
        """Move on to the end of the step, whose slope is already known."""
        self.y[:] = self.new
        self.slopes[0] = self.slopes[-1]

    def settle(self, t: float) -> bool:
        """Bring the state onto the constraints, and its slope with it; return whether there are any."""
        if self.stretch.settle is None:
            return False
        nq = self.manifold.nq
        settled = self.stretch.settle(t, self.y[:nq].copy(), self.y[nq:].copy())
        self.start(t, np.concatenate(settled), self.stretch)
        return True


class AdaptiveStepper:
    """An embedded pair at work."""

    def __init__(self, method: Adaptive, manifold: Manifold, count: Count) -> None:
        self.tableau, self.tolerance, self.manifold, self.count = method.tableau, method.tolerance, manifold, count
        self.stages = Stages(method.tableau, manifold)
        self.y = self.stages.y
        self.errors, self.sizes = np.empty((len(method.tableau.error), len(self.y))), np.empty((2, len(self.y)))
        self.order = method.tableau.error_order + 1
        self.ceiling, self.floored = FASTEST, False

    @property
    def finite(self) -> bool:
        """Whether the slopes last computed are finite."""
        return self.stages.finite

    def begin(self, stretch: Stretch, y: Array) -> None:
        """Stand at the first instant of a stretch."""
        self.stages.start(stretch.start, y, stretch)
        self.count.evaluations += 1

    def first(self, h: float) -> float:
        """Return the step of the stretch before, or one from two slopes."""
        if h:
            return h
        self.count.evaluations += 1
        stretch, order = self.stages.stretch, self.tableau.error_order
        slope, rates = self.stages.slopes[0], self.stages.rates
        return float(first_step(stretch.start, stretch.end, self.y, slope, rates, self.tolerance, order))

    def attempt(self, t: float, h: float) -> float:
        """Compute a step from the present state; return its error, 1 being the tolerance."""
        self.stages.advance(t, h)
        self.count.evaluations += self.tableau.stages
        error = self._error(h)
        self.floored = 1.0 < error < NOISE / self.tolerance and h <= 1.001 * self.stages.stretch.floor()
        self.count.floored += self.floored
        return 1.0 if self.floored else error

    def _error(self, h: float) -> float:
        """Return the error of the step relative to the tolerance; Hairer, Norsett, Wanner, section II.10, eq. (10.17).

        With a second, lower estimate e3 the norm is ``e5^2 / sqrt(e5^2 + 0.01 e3^2)``, which has the order of the step.
        """
        errors = np.dot(self.tableau.error, self.stages.slopes, out=self.errors)
        scale = np.maximum(*np.abs(self.stages.ends, out=self.sizes))
        scale += 1.0
        errors /= scale
        squares = [float(row.dot(row)) for row in errors]
        factor = abs(h) / self.tolerance / len(scale) ** 0.5
        if not squares[0]:
            return float(factor * squares[-1] ** 0.5)
        return float(factor * squares[0] / max((squares[0] + 0.01 * sum(squares[1:])) ** 0.5, TINY))

    def along(self, t: float, h: float) -> tuple[Array, Array]:
        """Return the ends and the middle of the step."""
        return self.stages.along(t, h)

    def retry(self, h: float, error: float) -> float:
        """Return a shorter step; an error that is not even a number is treated like a large one."""
        self.ceiling = 1.0
        floor = self.stages.stretch.floor() if error < NOISE / self.tolerance else 0.0
        return max(h * (shrinkage(error, self.order) if error < HUGE else LOST), floor)

    def accept(self, t: float, h: float, error: float) -> tuple[Array, float]:
        """Move on to the end of the step; return its slopes and the step to go on with."""
        slopes = self.stages.slopes.copy()
        self.stages.move()
        self.count.evaluations += self.stages.settle(t)
        grown = h * growth(error, self.order, self.ceiling)
        if self.floored:
            grown = max(grown, self.stages.stretch.floor())
        self.ceiling = FASTEST
        return slopes, grown


class FixedStepper:
    """A method with steps of one length at work."""

    def __init__(self, method: FixedStep, manifold: Manifold, count: Count) -> None:
        self.longest, self.tableau, self.count, self.h = method.step, method.tableau, count, 0.0
        self.stages = Stages(method.tableau, manifold)
        self.y = self.stages.y

    @property
    def finite(self) -> bool:
        """Whether the slopes last computed are finite."""
        return self.stages.finite

    def begin(self, stretch: Stretch, y: Array) -> None:
        """Stand at the first instant of a stretch."""
        self.stages.start(stretch.start, y, stretch)
        self.count.evaluations += 1

    def first(self, h: float) -> float:
        """Return the step that divides the stretch evenly."""
        length = self.stages.stretch.end - self.stages.stretch.start
        self.h = length / math.ceil(length / self.longest * (1.0 - 1e-12))
        return self.h

    def attempt(self, t: float, h: float) -> float:
        """Compute a step; return 0, or not a number where the new slope is none."""
        self.stages.advance(t, h)
        self.count.evaluations += self.tableau.stages
        return float(0.0 * self.stages.slopes[-1].sum())

    def along(self, t: float, h: float) -> tuple[Array, Array]:
        """Return the ends and the middle of the step."""
        return self.stages.along(t, h)

    def retry(self, h: float, error: float) -> float:
        """Give up."""
        return 0.0

    def accept(self, t: float, h: float, error: float) -> tuple[Array, float]:
        """Move on to the end of the step; return its slopes and the same step."""
        slopes = self.stages.slopes.copy()
        self.stages.move()
        self.count.evaluations += self.stages.settle(t)
        return slopes, self.h


def middle(h: Array | float, y: Array, new: Array, slopes: Array) -> Array:
    """Return the middle of the cubic between two states, the first and the last of the slopes being theirs."""
    return np.asarray(0.5 * (y + new) + 0.125 * h * (slopes[0] - slopes[-1]))


def _terms(tableau: Tableau, stretch: Stretch, manifold: Manifold, steps: Sequence[Step]) -> Array:
    """Return the terms of the dense output of steps."""
    t, h = np.array([step.t for step in steps]), np.array([step.h for step in steps])
    y, slopes = np.array([step.y for step in steps]), np.array([step.slopes for step in steps])
    return terms_of(tableau, stretch, manifold, t, h, y, slopes)


def terms_of(
    tableau: Tableau, stretch: Stretch, manifold: Manifold, t: Array, h: Array, base: Array, known: Array
) -> Array:
    """Return terms of dense output; Hairer, Norsett, Wanner, section II.6: alternating products of x and 1 - x.

    Args:
        tableau: The coefficients.
        stretch: Where the steps are.
        manifold: The space of configurations.
        t: Starts of the steps [s], shape (n,).
        h: Their lengths [s], shape (n,).
        base: States at their starts, shape (n, nq + nv).
        known: Slopes at their stages, shape (n, s + 1, nq + nv).

    Returns:
        Terms, shape (n, d, nq + nv); see ``Method.interpolants``.
    """
    nq, s = manifold.nq, tableau.stages + 1
    slopes = np.empty((len(h), s + len(tableau.dense_c), base.shape[1]))
    slopes[:, :s] = known
    for k, (weights, c) in enumerate(zip(tableau.dense_a, tableau.dense_c, strict=True), s):
        y = base + h[:, None] * (weights[:k] @ slopes[:, :k])
        q, v = manifold.project(y[:, :nq]), y[:, nq:]
        slopes[:, k, :nq], slopes[:, k, nq:] = manifold.velocity(q, v), stretch.accelerations(t, t + c * h, q, v)
    slopes *= h[:, None, None]
    change, first, last = tableau.b @ slopes[:, : s - 1], slopes[:, 0], slopes[:, s - 1]
    lowest = np.stack([change, first - change, 2 * change - first - last], axis=1)
    return np.concatenate([lowest, tableau.dense_d @ slopes], axis=1)

"""Explicit Runge-Kutta methods: embedded pairs with variable steps, and methods with fixed steps.

Rotations are integrated as quaternions in R^4 and normalised after every stage: the vector field extends smoothly off
the unit sphere, so every Runge-Kutta method keeps its order (with ``pin.integrate`` in its stages it would drop to 2).
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, distinct
from pinarm.engine.integration.dense_output import DenseOutput
from pinarm.engine.integration.divided_steps import divided, terms_of
from pinarm.engine.integration.first_step import first_step
from pinarm.engine.integration.integrator import Count, Doubt, Interval, Manifold, Solution
from pinarm.engine.integration.step_control import FASTEST, HUGE, LOST, NOISE, TINY, growth, shrinkage
from pinarm.engine.integration.steps import Step, StepTable
from pinarm.engine.integration.tableaus import DOP853, DOPRI5, RK4, Tableau
from pinarm.errors import MethodError
from pinarm.records import ValueRecord, replace

STIFF = 0.3
"""Share of steps at the stability limit from which a motion is reported as stiff for an explicit method."""

LIMITED = "stiff"
"""Kind of the doubt on stiffness, with which its note begins."""

HALVES = np.array([0.0, 0.5, 1.0])
"""Fractions of a step: start, middle, end."""

SAMPLE = 40
"""Number of fixed steps that are repeated as two half steps to estimate their error."""

MOST_STEPS = 1e8
"""Largest number of fixed steps of an interval; that many take half a day."""

COARSE = 1e-3
"""Error of a fixed step, relative to ``size + |y|``, from which it is reported as too large."""


class Adaptive(ValueRecord, frozen=True):
    """An embedded Runge-Kutta pair with variable steps.

    Step: ``k_i = f(t + c_i h, y + h sum_j a_ij k_j)``, ``y + h sum_i b_i k_i``, with ``f = (velocity(q, v), a)``. With
    ``DOP853`` order 8, dense output of order 7: the right choice for smooth motion at errors below 1e-4. With
    ``DOPRI5`` order 5, dense output of order 4: cheaper at errors of 1e-3 to 1e-5, and where the acceleration has kinks
    (tables, friction) that a high order cannot use. Both fail on stiff problems (joint springs with strong damping):
    steps then follow the fastest decay instead of the motion, which ``diagnose`` reports. Sources: Hairer, Norsett,
    Wanner, Solving Ordinary Differential Equations I, sections II.4, II.5, II.6 and II.10; step control
    ``h 0.8 error^(-0.8/k)``, a damped integral controller: Soderlind, Digital filters in adaptive time-stepping, ACM
    TOMS 29 (2003), section 2.

    Attributes:
        tolerance: Local error per step, relative to ``size + |y|``, see ``Interval.size``; good values 1e-6 to 1e-12,
            for DOPRI5 1e-3 to 1e-7.
        tableau: The coefficients.
    """

    tolerance: float
    tableau: Tableau = DOP853
    subdivisions = 4
    tangent = True
    remedy = "a wider tolerance"

    @property
    def pair(self) -> Adaptive:
        """This method."""
        return self

    @property
    def name(self) -> str:
        """Name of the tableau."""
        return self.tableau.name

    @property
    def order(self) -> int:
        """Order of the step."""
        return self.tableau.order

    def stepper(self, manifold: Manifold, count: Count) -> AdaptiveStepper:
        """Return a stepper of this method."""
        return AdaptiveStepper(self, manifold, count)

    def dense_output(self, interval: Interval, manifold: Manifold, steps: StepTable) -> DenseOutput:
        """Return the dense output."""
        arrays = steps.t, steps.h, steps.y, steps.slopes
        if interval.compiled is None:
            return self.output_of(interval, manifold, *arrays)
        from pinarm.engine.integration.compiled_steps import terms

        found = terms(self.tableau.examined, interval.compiled, *arrays)
        if np.isfinite(found).all():
            return divided(self.tableau, self.tolerance, interval, manifold, *arrays[:3], found)
        # Rows that the library cannot solve for in a further stage are solved for by singular values.
        return self.output_of(replace(interval, compiled=None), manifold, *arrays)

    def output_of(
        self, interval: Interval, manifold: Manifold, t: Array, h: Array, y: Array, slopes: Array
    ) -> DenseOutput:
        """Return the dense output of steps."""
        terms = terms_of(self.tableau.examined, interval, manifold, t, t, h, y, slopes)
        return divided(self.tableau, self.tolerance, interval, manifold, t, h, y, terms)

    def diagnose(self, solution: Solution) -> list[Doubt]:
        """Return a note where the stability limit, not the error, keeps steps short.

        The last stage and the end of the step share their time, so ``|k_s - k_(s-1)| / |y_new - Y_(s-1)|`` estimates
        the dominant eigenvalue: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.2, eq. (2.26).
        """
        steps, tableau = solution.steps, self.tableau
        if not steps:
            return []
        h, slopes, s = steps.h, steps.slopes, tableau.stages
        apart = h[:, None] * np.vecmat(tableau.b - tableau.a[-1], slopes[:, :s])
        last = slopes[:, s] - slopes[:, s - 1]
        change, size = h * np.sqrt(np.vecdot(last, last)), np.sqrt(np.vecdot(apart, apart))
        limited = change > tableau.stability * np.maximum(size, TINY)
        share = np.count_nonzero(limited) / len(limited)
        if share < STIFF:
            return []
        text = (
            f"{LIMITED}: on {share:.0%} of the steps {self.name} is limited by stability, not by accuracy; "
            "accuracy.method: stiff takes longer steps"
        )
        return [Doubt(LIMITED, share, text)]


def dopri5(tolerance: float) -> Adaptive:
    """Return Dormand and Prince's pair of order 5."""
    return Adaptive(tolerance, DOPRI5)


class FixedStep(ValueRecord, frozen=True):
    """Steps of fixed length, whatever the error; each interval is divided evenly into steps of at most ``step``.

    With ``RK4`` the classical method: ``y + h (k_1 + 2 k_2 + 2 k_3 + k_4) / 6``, order 4, dense output the cubic
    through both ends and their slopes, whose error is of order 4 too. Source: Hairer, Norsett, Wanner, section II.1,
    table 1.2. For runs of predictable cost, for comparisons with other programs, and where an adaptive method cannot
    estimate its error. Steps that are too long give wrong results without failing (``diagnose`` repeats some of them as
    two half steps); beyond ``|lambda| h = 2.8`` the solution diverges. Good values: a hundredth of the shortest period
    of the motion.

    Attributes:
        step: Longest step [s].
        tableau: The coefficients.
    """

    step: float
    tableau: Tableau = RK4
    subdivisions = 4
    tangent = True
    tolerance = 0.0
    remedy = "a shorter accuracy.step, or an adaptive method"
    pair = None

    @property
    def name(self) -> str:
        """Name of the tableau."""
        return self.tableau.name

    @property
    def order(self) -> int:
        """Order of the step."""
        return self.tableau.order

    def stepper(self, manifold: Manifold, count: Count) -> FixedStepper:
        """Return a stepper of this method."""
        return FixedStepper(self, manifold, count)

    def dense_output(self, interval: Interval, manifold: Manifold, steps: StepTable) -> DenseOutput:
        """Return the dense output."""
        t, h, y, slopes = steps.t, steps.h, steps.y, steps.slopes
        return DenseOutput.whole(y, terms_of(self.tableau, interval, manifold, t, t, h, y, slopes))

    def diagnose(self, solution: Solution) -> list[Doubt]:
        """Return notes where a step and its two halves differ, or where steps may have stepped over a load."""
        error, t, size = 0.0, 0.0, min(solution.size, 1.0)
        for index in distinct(np.linspace(0, len(solution.steps) - 1, SAMPLE).astype(int)):
            step = solution.steps[index]
            difference = self._error(solution, step, size)
            if not difference <= error:  # NaN included
                error, t = difference, step.t
        over = solution.count.stepped_over
        past = f"step too large: {over} steps go past whole pieces of a load; {self.remedy}"
        stepped_over = [Doubt("stepped over", over, past)] if over else []
        if error < COARSE:
            return stepped_over
        text = (
            f"step too large: at t = {t:.6g} s a step of {self.name} over {self.step:g} s errs by {error:.1e}, "
            f"relative to {size:.3g} + |y|; {self.remedy}"
        )
        return [*stepped_over, Doubt("step too large", error if error < np.inf else np.inf, text)]

    def _error(self, solution: Solution, step: Step, size: float) -> float:
        """Return the largest difference between a step and its two halves, relative to ``size + |y|``.

        For order p it is the error of the step up to a factor ``1 - 2^-p``.
        """
        interval, tableau = solution.intervals[step.interval], self.tableau
        interval = replace(interval, acceleration=interval.of_step(step.t))
        stages = Stages(tableau, solution.manifold)
        stages.start(step.t, step.y, interval)
        for half in range(2):
            stages.advance(step.t + 0.5 * half * step.h, 0.5 * step.h)
            stages.move()
        whole = step.y + step.h * (tableau.b @ step.slopes[: tableau.stages])
        apart, scale = np.abs(whole - stages.y), size + np.abs(stages.y)
        return float((apart / scale).max(initial=0.0)) if size else 0.0


class Stages:
    """Buffers and inner loop of an explicit method.

    ``z = [y; k_0; k_1; ...]`` stacks the state and the slopes, so that one product with the row
    ``[1, h a_i0, h a_i1, ...]`` gives stage i. ``ends`` are the states at the end and at the start of the step.
    """

    def __init__(self, tableau: Tableau, manifold: Manifold) -> None:
        s, n, nq = tableau.stages, manifold.nq + manifold.nv, manifold.nq
        self.manifold, self.interval = manifold, Interval(0.0, 0.0, lambda t, q, v: 0.0 * v)
        rows = np.zeros((s + 3, n))
        self.ends, self.z = rows[:2], rows[1:]
        self.new, self.y, self.slopes = rows[0], rows[1], rows[2:]
        self.unit_weights = np.zeros((s + 1, s + 2))
        self.unit_weights[:s, 1:-1], self.unit_weights[s, 1:-1] = tableau.a, tableau.b
        self.weights = np.ones((s + 1, s + 2))
        self.scaled, self.unscaled = self.weights[:, 1:], self.unit_weights[:, 1:]
        self.stage, self.instants = np.empty(n), tableau.c
        self.stage_q, self.stage_v = self.stage[:nq], self.stage[nq:]
        self.new_q, self.new_v = self.new[:nq], self.new[nq:]

    @cached_property
    def inner(self) -> list[tuple[Array, Array, Array, Array, float]]:
        """Weights, rows of z, slopes of q and of v, and c of every stage but the first."""
        return [(*self._products(i), float(c)) for i, c in enumerate(self.instants) if i]

    @cached_property
    def final(self) -> tuple[Array, Array, Array, Array]:
        """The same of the end of the step, without c."""
        return self._products(len(self.instants))

    def _products(self, i: int) -> tuple[Array, Array, Array, Array]:
        nq = self.manifold.nq
        return self.weights[i, : i + 1], self.z[: i + 1], self.slopes[i, :nq], self.slopes[i, nq:]

    def start(self, t: float, y: Array, interval: Interval) -> None:
        """Set the state and its slope."""
        self.interval = interval
        self.y[:] = y
        self.slopes[0] = self.rates(t, self.y)

    def rates(self, t: float, y: Array) -> Array:
        """Return the slope of a state, in compiled code where states need not be settled."""
        compiled, nq = self.interval.compiled, self.manifold.nq
        if compiled is not None and not compiled.settles:
            return compiled.slope(t, y)
        q, v = self.manifold.project(y[:nq]), y[nq:]
        return np.concatenate([self.manifold.velocity(q, v), self.interval.acceleration(t, q, v)])

    def trial_rates(self, t: float, y: Array) -> Array:
        """Return the slope of a state that no step reaches, in compiled code where that can solve for it."""
        compiled = self.interval.compiled
        if compiled is not None and np.isfinite(slope := compiled.slope(t, y)).all():
            return slope
        return self.rates(t, y)

    def advance(self, t: float, h: float) -> None:
        """Compute the stages and the step from the present state, and the slope at its end."""
        dot, velocity, project, acceleration = (
            np.dot, self.manifold.velocity, self.manifold.project, self.interval.acceleration,
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
        """Return the ends of the step and the middle of the cubic Hermite interpolant."""
        return t + h * HALVES, np.array([self.y, middle(h, self.y, self.new, self.slopes), self.new])

    def move(self) -> None:
        """Move to the end of the step, whose slope is already known."""
        self.y[:] = self.new
        self.slopes[0] = self.slopes[-1]

    def settle(self, t: float) -> bool:
        """Project the state onto the constraints and update its slope; return whether there are constraints."""
        if self.interval.settle is None:
            return False
        nq = self.manifold.nq
        projected = self.interval.settle(t, self.y[:nq].copy(), self.y[nq:].copy())
        self.start(t, np.concatenate(projected), self.interval)
        return True


class AdaptiveStepper:
    """The stepper of an embedded pair."""

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

    def begin(self, interval: Interval, y: Array) -> None:
        """Set the state at the start of an interval."""
        self.stages.start(interval.start, y, interval)
        self.count.evaluations += 1

    def first(self, h: float) -> float:
        """Return the step proposed in the previous interval, or one from two slopes."""
        if h:
            return h
        self.count.evaluations += 1
        interval, order = self.stages.interval, self.tableau.error_order
        slope, rates = self.stages.slopes[0], self.stages.trial_rates
        return float(
            first_step(interval.start, interval.end, self.y, slope, rates, self.tolerance, order, interval.size)
        )

    def attempt(self, t: float, h: float) -> float:
        """Compute a step from the present state; return its error over the tolerance."""
        self.stages.advance(t, h)
        self.count.evaluations += self.tableau.stages
        error = self._error(h)
        self.floored = 1.0 < error < NOISE / self.tolerance and h <= 1.001 * self.stages.interval.floor()
        self.count.floored += self.floored
        return 1.0 if self.floored else error

    def _error(self, h: float) -> float:
        """Return the error of the step over the tolerance; Hairer, Norsett, Wanner, section II.10, eq. (10.17).

        ``e = |h| rms(error @ k / (tol (size + max(|y|, |y_new|))))``; with a second estimate e3 of lower order it is
        ``e5^2 / sqrt(e5^2 + 0.01 e3^2)``, which has the order of the step.
        """
        errors = np.dot(self.tableau.error, self.stages.slopes, out=self.errors)
        scale = np.maximum(*np.abs(self.stages.ends, out=self.sizes))
        scale += self.stages.interval.size
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
        """Return a shorter step; NaN is treated as a large error."""
        self.ceiling = 1.0
        floor = self.stages.interval.floor() if error < NOISE / self.tolerance else 0.0
        return max(h * (shrinkage(error, self.order) if error < HUGE else LOST), floor)

    def accept(self, t: float, h: float, error: float) -> tuple[Array, float]:
        """Move to the end of the step; return its slopes and the next step [s]."""
        slopes = self.stages.slopes.copy()
        self.stages.move()
        self.count.evaluations += self.stages.settle(t)
        grown = h * growth(error, self.order, self.ceiling)
        if self.floored:
            grown = max(grown, self.stages.interval.floor())
        self.ceiling = FASTEST
        return slopes, grown


class FixedStepper:
    """The stepper of a method with fixed steps."""

    def __init__(self, method: FixedStep, manifold: Manifold, count: Count) -> None:
        self.longest, self.tableau, self.count, self.h = method.step, method.tableau, count, 0.0
        self.stages = Stages(method.tableau, manifold)
        self.y = self.stages.y

    @property
    def finite(self) -> bool:
        """Whether the slopes last computed are finite."""
        return self.stages.finite

    def begin(self, interval: Interval, y: Array) -> None:
        """Set the state at the start of an interval."""
        self.stages.start(interval.start, y, interval)
        self.count.evaluations += 1

    def first(self, h: float) -> float:
        """Return the step that divides the interval evenly.

        Raises:
            MethodError: The interval takes more steps than anybody can wait for.
        """
        length = self.stages.interval.end - self.stages.interval.start
        if length > MOST_STEPS * self.longest:
            raise MethodError(
                f"steps of {self.longest:g} s are too short for {length:g} s", expected=f"at most {MOST_STEPS:g} steps",
                hint=f"step: {length / 1000.0:.1g} s, or an adaptive method",
            )  # fmt: skip
        self.h = length / math.ceil(length / self.longest * (1.0 - 1e-12))
        return self.h

    def attempt(self, t: float, h: float) -> float:
        """Compute a step; return 0, or NaN where the new slope is not finite."""
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
        """Move to the end of the step; return its slopes and the same step [s]."""
        slopes = self.stages.slopes.copy()
        self.stages.move()
        self.count.evaluations += self.stages.settle(t)
        return slopes, self.h


def middle(h: Array | float, y: Array, new: Array, slopes: Array) -> Array:
    """Return the middle of the cubic Hermite interpolant: ``(y + y_new) / 2 + h (k_0 - k_s) / 8``."""
    return np.asarray(0.5 * (y + new) + 0.125 * h * (slopes[0] - slopes[-1]))

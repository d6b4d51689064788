"""Explicit Runge-Kutta methods: embedded pairs with variable steps, and methods with fixed steps.

Rotations are integrated as quaternions in R^4 and normalised after every stage: the vector field extends smoothly off
the unit sphere, so every Runge-Kutta method keeps its order (with ``pin.integrate`` in its stages it would drop to 2).
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from functools import cache, partial

import numpy as np

from pinarm.arrays import Array, Flags, distinct
from pinarm.engine.integration.integrator import Interval, Manifold, Solution, Stepper, StepsOver, waves
from pinarm.engine.integration.runge_kutta import (
    DOP853,
    DOPRI5,
    FASTEST,
    GAIN,
    HUGE,
    LOST,
    NOISE,
    RK4,
    SAFETY,
    SHORTEST,
    SLOWEST,
    TINY,
    Rates,
    Steps,
    Tableau,
    dense_terms,
    error_of,
    first_step,
    growth,
    middle,
    shrinkage,
    stages,
)
from pinarm.engine.kernel.library import ControlStructure, CourseStructure, Flow, PairStructure, library, pointer
from pinarm.errors import MethodError
from pinarm.records import ValueRecord, replace

DEFECT, CLEARLY, PARTS = 30.0, 0.3, 8
"""Defect of the dense output in the middle of a step, over the tolerance, from which on shorter steps may tell it: it
is about 0.1, seldom above 3, and 1e4 beyond the limit of stability. The part of it that theirs may be, and their number
in a step."""

STIFF = 0.3
"""Share of steps at the stability limit from which a motion is reported as stiff for an explicit method."""

LIMITED = "stiff"
"""Beginning of the note on stiffness."""

SAMPLE = 40
"""Number of fixed steps that are repeated as two half steps to estimate their error."""

MOST_STEPS = 1e8
"""Largest number of fixed steps of an interval; that many take half a day."""

PASSED_LOADS = "steps go past whole pieces of a load"
"""Words of a note on steps of fixed length that may have stepped over loads."""

COARSE = 1e-3
"""Error of a fixed step, relative to ``size + |y|``, from which it is reported as too large."""

FEWEST, MOST = 16, 512
"""Most steps of the first call, and of later ones: each may take twice as many as one that was full. An event that ends
the motion makes the steps after it useless, and memory is taken for all of them."""


class _Explicit:
    """Stepping functions and limits that follow from the coefficients of a method."""

    tableau: Tableau
    subdivisions = 4
    tangent = True

    @property
    def name(self) -> str:
        return self.tableau.name

    @property
    def order(self) -> int:
        return self.tableau.order

    def dense_output(self, interval: Interval, manifold: Manifold, steps: Steps) -> Array:
        return dense_terms(self.tableau, partial(interval.slopes, manifold, steps.t), steps)


class Adaptive(_Explicit, ValueRecord, frozen=True):
    """An embedded Runge-Kutta pair with variable steps.

    Step: ``k_i = f(t + c_i h, y + h sum_j a_ij k_j)``, ``y + h sum_i b_i k_i``, with ``f = (velocity(q, v), a)``. With
    ``DOP853`` order 8, dense output of order 7: the right choice for smooth motion at errors below 1e-4. With
    ``DOPRI5`` order 5, dense output of order 4: cheaper at errors of 1e-3 to 1e-5, and where the acceleration has kinks
    (tables, friction) that a high order cannot use. Both fail on stiff problems (joint springs with strong damping):
    steps then follow the fastest decay instead of the motion, which ``diagnose`` reports. Sources: Hairer, Norsett,
    Wanner, Solving Ordinary Differential Equations I, sections II.4, II.5, II.6 and II.10.

    Attributes:
        tolerance: Local error per step, relative to ``size + |y|``, see ``Interval.size``; good values 1e-6 to 1e-12,
            for DOPRI5 1e-3 to 1e-7.
        tableau: The coefficients.
    """

    tolerance: float
    tableau: Tableau = DOP853
    remedy = "a wider tolerance"

    def stepper(self, solution: Solution, steps_over: StepsOver | None) -> Stepper:
        return AdaptiveStepper(self, solution, steps_over)

    def dense_output(self, interval: Interval, manifold: Manifold, steps: Steps) -> Array:
        """Return the terms of the dense output, or of polynomials through eight shorter steps where these are better.

        Once the fast part of a motion has died away a step may go far beyond the limit of stability before its end
        shows it: within, the stages blow up the rest of that part, and spoil the dense output. Those of eighths of the
        step do not. The defect ``h (f(u) - u')`` of u in the middle of the step chooses.
        """
        rates = partial(interval.slopes, manifold, steps.t)
        terms = dense_terms(self.tableau, rates, steps)
        defects = _defects(terms, rates, steps)
        scale = self.tolerance * (interval.size + np.abs(steps.y).max(axis=1))
        if len(poor := (defects > DEFECT * scale).nonzero()[0]):
            some = steps.some(poor)
            rates = partial(interval.slopes, manifold, some.t)
            others = _through_parts(self.tableau, rates, some, terms[poor])
            better = _defects(others, rates, some) < CLEARLY * defects[poor]
            terms[poor[better]] = others[better]
        return terms

    def step_error(self, solution: Solution, index: int) -> float:
        return self.tolerance

    def diagnose(self, solutions: Sequence[Solution]) -> list[str]:
        """Return a note where the stability limit, not the error, keeps steps of solutions short."""
        steps = [solution.steps for solution in solutions if solution.steps]
        share = sum(np.count_nonzero(self._limited(some)) for some in steps) / max(1, sum(map(len, steps)))
        if share < STIFF:
            return []
        return [
            f"{LIMITED}: on {share:.0%} of the steps {self.name} is limited by stability, not by accuracy; "
            "accuracy.method: stiff takes longer steps"
        ]

    def _limited(self, steps: Steps) -> Flags:
        """Return the steps that the stability limits.

        The last stage and the end of the step share their time, so ``|k_s - k_(s-1)| / |y_new - Y_(s-1)|`` estimates
        the dominant eigenvalue: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.2, eq. (2.26).
        """
        tableau, slopes = self.tableau, steps.slopes
        apart = np.vecmat(tableau.b - tableau.a[-1], slopes[:, :-1])
        change, size = np.linalg.norm(slopes[:, -1] - slopes[:, -2], axis=1), np.linalg.norm(apart, axis=1)
        return np.asarray(change > tableau.stability * np.maximum(size, TINY / steps.h))


def _through_parts(tableau: Tableau, rates: Rates, steps: Steps, terms: Array) -> Array:
    """Return terms of polynomials with the ends and their slopes of others, nearest to the ends of shorter steps."""
    h, y, ends = steps.h / PARTS, steps.y, list[Array]()
    slopes = np.empty((len(h), tableau.stages + 1, y.shape[1]))
    slopes[:, 0] = steps.slopes[:, 0]
    for part in range(PARTS - 1):
        y = stages(tableau.rows, rates, steps.t + part * h, h, y, slopes)
        slopes[:, 0] = slopes[:, -1]
        ends.append(y - steps.y)
    basis = waves(np.arange(1.0, PARTS) / PARTS, terms.shape[1])
    rest = np.stack(ends, axis=1) - basis[:, :3] @ terms[:, :3]
    return np.concatenate([terms[:, :3], np.linalg.pinv(basis[:, 3:]) @ rest], axis=1)


def _defects(terms: Array, rates: Rates, steps: Steps) -> Array:
    """Return the largest defect ``h (f(u) - u')`` of polynomials u in the middle of each step, shape (n,)."""
    change, slope = middle(terms)
    defects = steps.h[:, None] * rates(steps.t + 0.5 * steps.h, steps.y + change) - slope
    return np.asarray(np.abs(defects).max(axis=1))


def dopri5(tolerance: float) -> Adaptive:
    """Return Dormand and Prince's pair of order 5."""
    return Adaptive(tolerance, DOPRI5)


class FixedStep(_Explicit, ValueRecord, frozen=True):
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
    tolerance = 0.0
    remedy = "a shorter accuracy.step, or an adaptive method"

    def stepper(self, solution: Solution, steps_over: StepsOver | None) -> Stepper:
        return FixedStepper(self, solution, steps_over)

    def diagnose(self, solutions: Sequence[Solution]) -> list[str]:
        """Return notes where a step and its two halves differ, or where steps may have stepped over a load."""
        over, notes, worst = sum(solution.count.stepped_over for solution in solutions), list[str](), (0.0, 0.0, 0.0)
        for solution in solutions:
            for index in distinct(np.linspace(0, len(solution.steps) - 1, SAMPLE).astype(int)).tolist():
                error = self.step_error(solution, index)
                if not error <= worst[0]:  # NaN included
                    worst = error, float(solution.steps.t[index]), min(solution.size, 1.0)
        if over:
            notes.append(f"step too large: {over} {PASSED_LOADS}; {self.remedy}")
        if not worst[0] < COARSE:
            notes.append(
                f"step too large: at t = {worst[1]:.6g} s a step of {self.name} over {self.step:g} s errs by "
                f"{worst[0]:.1e}, relative to {worst[2]:.3g} + |y|; {self.remedy}"
            )
        return notes

    def step_error(self, solution: Solution, index: int) -> float:
        """Return the largest difference between a step and its two halves, relative to ``size + |y|``.

        For order p it is the error of the step up to a factor ``1 - 2^-p``; the size is that of the motion, at most 1.
        """
        steps, tableau, size = solution.steps, self.tableau, min(solution.size, 1.0)
        t, begun = float(steps.t[index]), steps.y[index]
        interval, half = solution.intervals[solution.owners(np.array([index]))[0]], 0.5 * float(steps.h[index])
        rates = partial(replace(interval, acceleration=interval.of_step(t)).slope, solution.manifold)
        y, slopes = begun.copy(), np.empty((tableau.stages + 1, len(begun)))
        slopes[0] = rates(t, y)
        for k in range(2):
            y = stages(tableau.rows, rates, t + k * half, half, y, slopes)
            slopes[0] = slopes[-1]
        whole = begun + 2.0 * half * (tableau.b @ steps.slopes[index, : tableau.stages])
        return float((np.abs(whole - y) / (size + np.abs(y))).max(initial=0.0)) if size else 0.0


class ExplicitStepper(Stepper):
    """The stepper of an explicit method in Python: slopes and end of the last attempt."""

    def __init__(self, tableau: Tableau, solution: Solution, steps_over: StepsOver | None) -> None:
        super().__init__(solution, steps_over)
        self.tableau, self.new = tableau, np.zeros_like(self.y)
        self.slopes = np.zeros((tableau.stages + 1, len(self.y)))

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.slopes).all())

    def begin(self, interval: Interval, y: Array) -> None:
        self.interval, self._rates = interval, partial(interval.slope, self.manifold)
        self.y[:] = y
        usable = interval.compiled is not None and interval.compiled.begun
        self.slopes[:] = self._trial(interval.start, self.y) if usable else self._rates(interval.start, self.y)
        self.count.evaluations += 1

    def _trial(self, t: float, y: Array) -> Array:
        """Return the slope of a state that no step reaches, in compiled code where that can solve for it."""
        compiled = self.interval.compiled
        if compiled is not None and np.isfinite(slope := compiled.slope(t, y)).all():
            return slope
        return self._rates(t, y)

    def advance(self, t: float, h: float) -> None:
        """Compute the stages and the end of a step from the present state."""
        self.new = stages(self.tableau.rows, self._rates, t, h, self.y, self.slopes)
        self.count.evaluations += self.tableau.stages

    def along(self, t: float, h: float) -> tuple[Array, Array]:
        """Return instants and states of a step, shapes (3,) and (3, n): its ends, and the middle of its cubic."""
        middle = 0.5 * (self.y + self.new) + 0.125 * h * (self.slopes[0] - self.slopes[-1])
        return t + h * np.array([0.0, 0.5, 1.0]), np.stack([self.y, middle, self.new])

    def move(self, t: float) -> Array:
        """Move to the end t of the step, projected onto the constraints; return its slopes."""
        slopes = self.slopes.copy()
        self.y[:], self.slopes[0] = self.new, self.slopes[-1]
        self.count.evaluations += self.settle(t)
        return slopes

    def settle(self, t: float) -> bool:
        """Project the state onto the constraints and update its slope; return whether there are constraints."""
        if self.settled(t):
            self.slopes[0] = self._rates(t, self.y)
            return True
        return False


class AdaptiveStepper(ExplicitStepper):
    """The stepper of an embedded pair."""

    def __init__(self, method: Adaptive, solution: Solution, steps_over: StepsOver | None) -> None:
        super().__init__(method.tableau, solution, steps_over)
        self.tolerance, self.order = method.tolerance, method.tableau.error_order + 1
        self.ceiling, self.floored = FASTEST, False
        self.compiled: CompiledSteps | None = None

    def take(self, t: float, h: float, tries: int) -> tuple[float, float]:
        if self.interval.compiled is None or self.steps_over is not None:
            return super().take(t, h, tries)
        self.compiled = self.compiled or CompiledSteps(self)
        return self.compiled.take(t, h, tries)

    def first(self, h: float) -> float:
        if h:
            return h
        self.count.evaluations += 1
        time, order, size = (self.interval.start, self.interval.end), self.order - 1, self.interval.size

        def rates(t: Array, y: Array) -> Array:
            return self._trial(float(t[0]), y[0])[None]

        return float(first_step(time, self.y[None], self.slopes[:1], rates, self.tolerance, order, size)[0])

    def attempt(self, t: float, h: float) -> float:
        self.advance(t, h)
        scale = self.tolerance, self.interval.size
        error = error_of(self.tableau, h, self.y, self.new, self.slopes, scale)
        self.floored = 1.0 < error < NOISE / self.tolerance and h <= 1.001 * self.interval.floor()
        self.count.floored += self.floored
        return 1.0 if self.floored else error

    def retry(self, h: float, error: float) -> float:
        self.ceiling = 1.0
        floor = self.interval.floor() if error < NOISE / self.tolerance else 0.0
        return max(h * shrinkage(error, self.order), floor)

    def accept(self, t: float, h: float, error: float) -> tuple[Array, float]:
        slopes = self.move(t)
        grown = h * growth(error, self.order, self.ceiling)
        self.ceiling = FASTEST
        return slopes, max(grown, self.interval.floor()) if self.floored else grown


class FixedStepper(ExplicitStepper):
    """The stepper of a method with fixed steps."""

    variable = False

    def __init__(self, method: FixedStep, solution: Solution, steps_over: StepsOver | None) -> None:
        super().__init__(method.tableau, solution, steps_over)
        self.longest, self.h = method.step, 0.0

    def first(self, h: float) -> float:
        """Return the step that divides the interval evenly; raise where nobody can wait for the steps."""
        length = self.interval.end - self.interval.start
        if length > MOST_STEPS * self.longest:
            raise MethodError(
                f"steps of {self.longest:g} s are too short for {length:g} s",
                expected=f"at most {MOST_STEPS:g} steps",
                hint=f"step: {length / 1000.0:.1g} s, or an adaptive method",
            )
        self.h = length / math.ceil(length / self.longest * (1.0 - 1e-12))
        return self.h

    def attempt(self, t: float, h: float) -> float:
        """Compute a step; return 0, or NaN where the new slope is not finite."""
        self.advance(t, h)
        return float(0.0 * self.slopes[-1].sum())

    def retry(self, h: float, error: float) -> float:
        return 0.0

    def accept(self, t: float, h: float, error: float) -> tuple[Array, float]:
        return self.move(t), self.h


@cache
def _pair_of(tableau: Tableau) -> tuple[PairStructure, list[Array]]:
    """Return the coefficients of a pair for the library, and the arrays that they point to."""
    arrays = [np.ascontiguousarray(x, np.float64) for x in (tableau.a, tableau.b, tableau.c, tableau.error)]
    return PairStructure(tableau.stages, len(tableau.error), tableau.error_order + 1, *map(pointer, arrays)), arrays


class CompiledSteps:
    """The steps of ``AdaptiveStepper`` in compiled code, many in one call."""

    def __init__(self, stepper: AdaptiveStepper) -> None:
        self.stepper, self.pair = stepper, _pair_of(stepper.tableau)[0]
        self._make_room(FEWEST)

    def _make_room(self, room: int) -> None:
        """Make room for the steps of one call.

        Starts, lengths and ends [s], shape (3, room); how many were rejected before each, and whether each was accepted
        as rounding, shape (room,); states at their starts, shape (room, n); slopes at their stages, and those of the
        step that is tried last, shape (room + 1, s + 1, n).
        """
        n, stages = len(self.stepper.y), self.stepper.tableau.stages
        self.times, self.states, self._scratch = np.empty((3, room)), np.empty((room, n)), np.empty((2, n))
        self.slopes, self.rejections = np.zeros((room + 1, stages + 1, n)), np.empty(room, np.intp)
        self.floored = np.empty(room, np.intc)
        places = self.stepper.y, self._scratch, *self.times, self.rejections, self.floored, self.states, self.slopes
        self.course = CourseStructure(*5 * [0.0], 0, room, 0, 0, 0, *map(pointer, places))

    def take(self, t: float, h: float, tries: int) -> tuple[float, float]:
        """Take as many steps in an interval as there is room for; see ``Stepper.take``."""
        course, stepper, compiled = self.course, self.stepper, library()
        interval, flow = stepper.interval, stepper.interval.compiled
        assert flow is not None and compiled is not None
        course.t, course.h, course.start, course.end = t, h, interval.start, interval.end
        course.ceiling, course.tries = stepper.ceiling, tries
        course.written = course.rejected = course.handed = 0
        flow.ready()
        self.slopes[0, 0] = stepper.slopes[0]
        control = ControlStructure(
            stepper.tolerance, interval.size, SAFETY, GAIN, SLOWEST, FASTEST, LOST, HUGE, TINY, SHORTEST, NOISE
        )
        compiled.pair_steps(*map(ctypes.byref, (self.pair, flow.structure, control, course)))
        stepper.slopes[:], stepper.ceiling = self.slopes[course.written], course.ceiling
        self._add(flow)
        settled = course.written - course.handed
        if flow.settles and settled:
            flow.advanced(self.times[2, :settled].tolist())
        if course.handed:
            stepper.settle(course.t)
            if self.floored[course.written - 1]:
                course.h = max(course.h, interval.floor())
        if course.written == course.room < MOST:
            self._make_room(2 * course.room)
        return course.t, course.h

    def _add(self, flow: Flow) -> None:
        """Add the steps that the library has written to the solution, and their cost."""
        count, written, stages = self.stepper.count, self.course.written, self.stepper.tableau.stages
        steps, rejections, floored = np.arange(1, written + 1), self.rejections[:written], self.floored[:written]
        work = np.stack([stages * (steps + rejections) + flow.settles * steps, rejections, floored.cumsum()], axis=1)
        work += [count.evaluations, count.rejected, count.floored]
        starts, lengths, ends = self.times[:, :written]
        self.stepper.solution.add(Steps(starts, lengths, ends, self.states[:written], self.slopes[:written], work))
        count.evaluations += stages * (written + self.course.rejected) + flow.settles * written
        count.rejected += self.course.rejected
        count.floored += int(floored.sum())

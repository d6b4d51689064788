"""Explicit Runge-Kutta methods: embedded pairs with variable steps, and methods with fixed steps.

Rotations are integrated as quaternions in R^4 and normalised after every stage: the vector field extends smoothly off
the unit sphere, so every Runge-Kutta method keeps its order (with ``pin.integrate`` in its stages it would drop to 2).
"""

from __future__ import annotations

import ctypes
import math
from functools import cache, partial

import numpy as np

from pinarm.arrays import Array, distinct
from pinarm.engine.integration.integrator import Count, Doubt, Interval, Manifold, Solution, Step, StepTable
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
    Tableau,
    dense_terms,
    error_of,
    first_step,
    growth,
    middle,
    shrinkage,
    stages,
)
from pinarm.engine.kernel.library import (
    ControlStructure,
    CourseStructure,
    Flow,
    PairStructure,
    contiguous,
    library,
    pointer,
)
from pinarm.errors import MethodError
from pinarm.records import ValueRecord, replace

DEFECT, CLEARLY, PARTS = 30.0, 0.3, 8
"""Defect of the dense output in the middle of a step, over the tolerance, from which on shorter steps may tell it: it
is about 0.1, seldom above 3, and 1e4 beyond the limit of stability. The part of it that theirs may be, and their number
in a step."""

STIFF = 0.3
"""Share of steps at the stability limit from which a motion is reported as stiff for an explicit method."""

LIMITED = "stiff"
"""Kind of the doubt on stiffness, with which its note begins."""

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


class Adaptive(ValueRecord, frozen=True):
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
    subdivisions = 4
    tangent = True
    remedy = "a wider tolerance"

    @property
    def name(self) -> str:
        return self.tableau.name

    @property
    def order(self) -> int:
        return self.tableau.order

    def stepper(self, manifold: Manifold, count: Count) -> AdaptiveStepper:
        return AdaptiveStepper(self, manifold, count)

    def dense_output(self, interval: Interval, manifold: Manifold, steps: StepTable) -> Array:
        """Return the terms of the dense output, or of polynomials through eight shorter steps where these are better.

        Once the fast part of a motion has died away a step may go far beyond the limit of stability before its end
        shows it: within, the stages blow up the rest of that part, and spoil the dense output. Those of eighths of the
        step do not. The defect ``h (f(u) - u')`` of u in the middle of the step chooses.
        """
        terms, rates = self._terms(interval, manifold, steps)
        scale = self.tolerance * (interval.size + np.abs(steps.y).max(axis=1))
        defects = _defects(terms, rates, steps)
        if len(poor := (defects > DEFECT * scale).nonzero()[0]):
            some = steps.some(poor)
            slopes_of = partial(interval.slopes, manifold, some.t)
            others = _through_parts(self.tableau, slopes_of, some, terms[poor])
            better = _defects(others, slopes_of, some) < CLEARLY * defects[poor]
            terms[poor[better]] = others[better]
        return terms

    def _terms(self, interval: Interval, manifold: Manifold, steps: StepTable) -> tuple[Array, Rates]:
        """Return the terms of the dense output, and the rates in the steps."""
        arrays = steps.t, steps.h, steps.y, steps.slopes
        if interval.compiled is not None:
            values = _compiled_terms(self.tableau, interval.compiled, *arrays)
            if np.isfinite(values).all():
                return values, partial(interval.slopes, manifold, steps.t)
            # Rows that the library cannot solve for in a further stage are solved for by singular values.
            interval = replace(interval, compiled=None)
        rates = partial(interval.slopes, manifold, steps.t)
        return dense_terms(self.tableau, rates, *arrays), rates

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


def _through_parts(tableau: Tableau, rates: Rates, steps: StepTable, terms: Array) -> Array:
    """Return terms of polynomials with the ends and their slopes of others, nearest to the ends of shorter steps."""
    h, y, ends = steps.h / PARTS, steps.y, list[Array]()
    slopes = np.empty((len(h), tableau.stages + 1, y.shape[1]))
    slopes[:, 0] = steps.slopes[:, 0]
    for part in range(PARTS - 1):
        y = stages(tableau.rows, rates, steps.t + part * h, h, y, slopes)
        slopes[:, 0] = slopes[:, -1]
        ends.append(y - steps.y)
    x = np.arange(1.0, PARTS) / PARTS
    waves = np.cumprod([x if k % 2 == 0 else 1.0 - x for k in range(terms.shape[1])], axis=0).T
    rest = np.stack(ends, axis=1) - waves[:, :3] @ terms[:, :3]
    return np.concatenate([terms[:, :3], np.linalg.pinv(waves[:, 3:]) @ rest], axis=1)


def _defects(terms: Array, rates: Rates, steps: StepTable) -> Array:
    """Return the largest defect ``h (f(u) - u')`` of polynomials u in the middle of each step, shape (n,)."""
    change, slope = middle(terms)
    defects = steps.h[:, None] * rates(steps.t + 0.5 * steps.h, steps.y + change) - slope
    return np.asarray(np.abs(defects).max(axis=1))


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

    @property
    def name(self) -> str:
        return self.tableau.name

    @property
    def order(self) -> int:
        return self.tableau.order

    def stepper(self, manifold: Manifold, count: Count) -> FixedStepper:
        return FixedStepper(self, manifold, count)

    def dense_output(self, interval: Interval, manifold: Manifold, steps: StepTable) -> Array:
        rates = partial(interval.slopes, manifold, steps.t)
        return dense_terms(self.tableau, rates, steps.t, steps.h, steps.y, steps.slopes)

    def diagnose(self, solution: Solution) -> list[Doubt]:
        """Return notes where a step and its two halves differ, or where steps may have stepped over a load."""
        error, t, size = 0.0, 0.0, min(solution.size, 1.0)
        for index in distinct(np.linspace(0, len(solution.steps) - 1, SAMPLE).astype(int)):
            step = solution.steps[index]
            difference = self.error(solution, step, size)
            if not difference <= error:  # NaN included
                error, t = difference, step.t
        over = solution.count.stepped_over
        past = f"step too large: {over} {PASSED_LOADS}; {self.remedy}"
        stepped_over = [Doubt("stepped over", over, past)] if over else []
        if error < COARSE:
            return stepped_over
        text = (
            f"step too large: at t = {t:.6g} s a step of {self.name} over {self.step:g} s errs by {error:.1e}, "
            f"relative to {size:.3g} + |y|; {self.remedy}"
        )
        return [*stepped_over, Doubt("step too large", error if error < np.inf else np.inf, text)]

    def error(self, solution: Solution, step: Step, size: float) -> float:
        """Return the largest difference between a step and its two halves, relative to ``size + |y|``.

        For order p it is the error of the step up to a factor ``1 - 2^-p``.
        """
        interval, tableau, half = solution.intervals[step.interval], self.tableau, 0.5 * step.h
        rates = partial(replace(interval, acceleration=interval.of_step(step.t)).slope, solution.manifold)
        y, slopes = step.y.copy(), np.empty((tableau.stages + 1, len(step.y)))
        slopes[0] = rates(step.t, y)
        for k in range(2):
            y = stages(tableau.rows, rates, step.t + k * half, half, y, slopes)
            slopes[0] = slopes[-1]
        whole = step.y + step.h * (tableau.b @ step.slopes[: tableau.stages])
        return float((np.abs(whole - y) / (size + np.abs(y))).max(initial=0.0)) if size else 0.0


class ExplicitStepper:
    """The stepper of an explicit method in Python: the present state, and slopes and end of the last attempt."""

    def __init__(self, tableau: Tableau, manifold: Manifold, count: Count) -> None:
        n = manifold.nq + manifold.nv
        self.tableau, self.manifold, self.count = tableau, manifold, count
        self.y, self.new, self.slopes = np.zeros(n), np.zeros(n), np.zeros((tableau.stages + 1, n))

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.slopes).all())

    def begin(self, interval: Interval, y: Array) -> None:
        self.interval, self._rates = interval, partial(interval.slope, self.manifold)
        self.y[:] = y
        compiled = interval.compiled
        usable = compiled is not None and not compiled.settles
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
        if self.interval.settle is None:
            return False
        nq = self.manifold.nq
        self.y[:] = np.concatenate(self.interval.settle(t, self.y[:nq].copy(), self.y[nq:].copy()))
        self.slopes[0] = self._rates(t, self.y)
        return True


class AdaptiveStepper(ExplicitStepper):
    """The stepper of an embedded pair."""

    def __init__(self, method: Adaptive, manifold: Manifold, count: Count) -> None:
        super().__init__(method.tableau, manifold, count)
        self.tolerance, self.order = method.tolerance, method.tableau.error_order + 1
        self.ceiling, self.floored = FASTEST, False

    def compiled(self, solution: Solution) -> CompiledSteps:
        return CompiledSteps(solution, self)

    def first(self, h: float) -> float:
        if h:
            return h
        self.count.evaluations += 1
        time, order, size = (self.interval.start, self.interval.end), self.order - 1, self.interval.size
        return first_step(time, self.y, self.slopes[0], self._trial, self.tolerance, order, size)

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
        if self.floored:
            grown = max(grown, self.interval.floor())
        self.ceiling = FASTEST
        return slopes, grown


class FixedStepper(ExplicitStepper):
    """The stepper of a method with fixed steps."""

    def __init__(self, method: FixedStep, manifold: Manifold, count: Count) -> None:
        super().__init__(method.tableau, manifold, count)
        self.longest, self.h = method.step, 0.0

    def compiled(self, solution: Solution) -> None:
        """Return nothing: the library knows methods with variable steps."""

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


def _kernel() -> ctypes.PyDLL:
    compiled = library()
    assert compiled is not None, "a motion is compiled"
    return compiled


@cache
def _pair_of(tableau: Tableau) -> tuple[PairStructure, list[Array]]:
    """Return the coefficients of a pair for the library, and the arrays that they point to."""
    names = ("a", "b", "c", "error", "dense_a", "dense_c", "dense_d")
    arrays = [contiguous(getattr(tableau, name)) for name in names]
    counts = tableau.stages, len(tableau.error), len(tableau.dense_c), len(tableau.dense_d)
    return PairStructure(*counts, tableau.error_order + 1, *map(pointer, arrays)), arrays


class CompiledSteps:
    """The steps of ``AdaptiveStepper``, many in one call."""

    def __init__(self, solution: Solution, stepper: AdaptiveStepper) -> None:
        self.solution, self.stepper = solution, stepper
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

    def take(self, index: int, span: Interval, t: float, h: float, tries: int) -> tuple[float, float]:
        """Take as many steps in a span as there is room for; see ``SingleSteps.take``."""
        flow, course, stepper = span.compiled, self.course, self.stepper
        assert flow is not None
        course.t, course.h, course.start, course.end = t, h, span.start, span.end
        course.ceiling, course.tries = stepper.ceiling, tries
        course.written = course.rejected = course.handed = 0
        flow.ready()
        self.slopes[0, 0] = stepper.slopes[0]
        control = ControlStructure(
            stepper.tolerance, span.size, SAFETY, GAIN, SLOWEST, FASTEST, LOST, HUGE, TINY, SHORTEST, NOISE
        )
        _kernel().pair_steps(*map(ctypes.byref, (_pair_of(stepper.tableau)[0], flow.structure, control, course)))
        stepper.slopes[:], stepper.ceiling = self.slopes[course.written], course.ceiling
        self._add(index, flow)
        self._settle(flow, span)
        return course.t, course.h

    def _add(self, index: int, flow: Flow) -> None:
        """Add the steps that the library has written to the solution, and their cost."""
        count, written, stages = self.solution.count, self.course.written, self.stepper.tableau.stages
        steps, rejections, floored = np.arange(1, written + 1), self.rejections[:written], self.floored[:written]
        work = np.stack([stages * (steps + rejections) + flow.settles * steps, rejections, floored.cumsum()], axis=1)
        work += [count.evaluations, count.rejected, count.floored]
        self.solution.steps.extend(self.times[:, :written].T, self.states[:written], self.slopes[:written], index, work)
        count.evaluations += stages * (written + self.course.rejected) + flow.settles * written
        count.rejected += self.course.rejected
        count.floored += int(floored.sum())

    def _settle(self, flow: Flow, span: Interval) -> None:
        """Let the motion know which states have been settled, let it settle the last one, and make more room."""
        course = self.course
        settled = course.written - course.handed
        if flow.settles and settled:
            flow.advanced(self.times[2, :settled].tolist())
        if course.handed:
            self.stepper.settle(course.t)
            if self.floored[course.written - 1]:
                course.h = max(course.h, span.floor())
        if course.written == course.room < MOST:
            self._make_room(2 * course.room)


def _compiled_terms(tableau: Tableau, flow: Flow, t: Array, h: Array, y: Array, slopes: Array) -> Array:
    """Return the terms of the dense output of n steps, shape (n, d, nq + nv); see ``runge_kutta.dense_terms``."""
    arrays = list(map(contiguous, (t, h, y, slopes)))
    scratch = np.empty((tableau.stages + 2 + len(tableau.dense_c), y.shape[1]))
    values = np.empty((len(y), 3 + len(tableau.dense_d), y.shape[1]))
    size = 1 if flow.changes else len(y)
    for begin in range(0, len(y), size):
        flow.within(float(t[begin]))
        some = [x[begin : begin + size] for x in arrays]
        addresses = (ctypes.c_void_p(pointer(x)) for x in (*some, scratch, values[begin:]))
        parts = map(ctypes.byref, (_pair_of(tableau)[0], flow.structure))
        _kernel().pair_terms(*parts, ctypes.c_ssize_t(size), *addresses)
    return values

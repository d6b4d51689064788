"""Integration of one motion over consecutive intervals, with any method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from pinarm.arrays import Array
from pinarm.engine.integration.events import locate_crossings, possible_crossings
from pinarm.engine.integration.integrator import Interval, Manifold, Solution, StepsOver, Watch
from pinarm.engine.integration.runge_kutta import PASSED, SHORTEST
from pinarm.errors import IntegrationError, Interrupted

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Method
    from pinarm.engine.integration.methods import Stepper
    from pinarm.engine.integration.methods.explicit import CompiledSteps

PROBED, HOPELESS = 1000, 1e4
"""Steps from which on the driver gives up where the remaining time, over that of all steps allowed, is above this, as
with huge velocities."""

NEAR = 0.1
"""Part of a first step within which a crossing is looked at again with a step that ends behind it: where a motion
begins at a stop, or at rest, errors of a dense output that leaves in another direction may be all that crosses."""

APART = 1e3
"""Distance of a crossing from the start over the rounding of instants, up to which it is where the motion begins."""


def integrate(
    intervals: Sequence[Interval],
    manifold: Manifold,
    q: Array,
    v: Array,
    method: Method,
    *,
    max_steps: int = 1_000_000,
    watches: Sequence[Watch] = (),
    steps_over: StepsOver | None = None,
    begun_with: float = 0.0,
) -> Solution:
    """Integrate over consecutive intervals; a step ends exactly at the end of each.

    Args:
        max_steps: Largest number of steps, rejected ones included.
        watches: Values whose zero crossings are located; one that stops ends the integration at its crossing.
        steps_over: Whether a step may have stepped over a piece of a load; methods with variable steps reject it.
        begun_with: Error of the initial state; see ``Solution``.

    Raises:
        IntegrationError: The step became too small, the steps too many, or the acceleration is not finite; ``partial``
            holds the solution up to there.
        Interrupted: The user interrupted it; likewise.
    """
    q, v = manifold.project(np.asarray(q, float)), np.asarray(v, float)
    solution = Solution(method, manifold, intervals, begun_with=begun_with)
    stepper = method.stepper(manifold, solution.count)
    usable = not steps_over and all(interval.compiled for interval in intervals)
    steps = (stepper.compiled(solution) if usable else None) or SingleSteps(solution, stepper, steps_over)
    try:
        _Driver(solution, stepper, steps, max_steps, watches).run(np.concatenate([q, v]))
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted at t = {solution.end:.9g} s", partial=solution) from None
    return solution


class SingleSteps(Struct, eq=False, dict=True, weakref=True):
    """Steps one at a time, by a stepper in Python; ``CompiledSteps`` takes many at a time."""

    solution: Solution
    stepper: Stepper
    steps_over: StepsOver | None

    def take(self, index: int, span: Interval, t: float, h: float, tries: int) -> tuple[float, float]:
        """Try one step in a span, or in what is left of it, and add it to the solution if accepted.

        It begins at t, with the next step h [s]; ``tries`` bounds the steps of ``CompiledSteps``. Return the
        time that is reached and the next step [s].
        """
        stepper, end, count = self.stepper, span.end, self.solution.count
        last = t + 1.01 * h >= end
        taken = end - t if last else h
        error = stepper.attempt(t, taken)
        if error <= 1.0 and self.steps_over:
            error = self.rejected_if_stepped_over(self.steps_over, error, t, taken)
        if not error <= 1.0:  # NaN included
            count.rejected += 1
            return t, stepper.retry(taken, error)
        y, until = stepper.y.copy(), end if last else t + taken
        slopes, following = stepper.accept(until, taken, error)
        work = np.array([[count.evaluations, count.rejected, count.floored]])
        self.solution.steps.extend(np.array([[t, taken, until]]), y[None], slopes[None], index, work)
        return until, max(h, following) if last else following

    def rejected_if_stepped_over(self, steps_over: StepsOver, error: float, t: float, h: float) -> float:
        """Return the error of a step, or ``PASSED`` where it may have stepped over a load and can be shorter."""
        instants, states = self.stepper.along(t, h)
        nq = self.solution.manifold.nq
        if not steps_over(instants, states[:, :nq], states[:, nq:]):
            return error
        if self.stepper.retry(h, PASSED):
            return PASSED
        self.solution.count.stepped_over += 1
        return error


class _Driver(Struct, eq=False, dict=True, weakref=True):
    """The loop over intervals and steps."""

    solution: Solution
    stepper: Stepper
    steps: SingleSteps | CompiledSteps
    max_steps: int
    watches: Sequence[Watch]
    h: float = 0.0
    stopped: bool = False

    def run(self, y: Array) -> None:
        for index, interval in enumerate(self.solution.intervals):
            t = interval.start
            while t < interval.end and not self.stopped:
                t, y = self.run_span(interval, index, t, y)
            if self.stopped:
                return
        self.solution.final = y

    def run_span(self, interval: Interval, index: int, t: float, y: Array) -> tuple[float, Array]:
        """Integrate from t [s] to the next sample or knot of an interval, or to its end; return instant and state."""
        solution, stepper = self.solution, self.stepper
        if interval.sampling:
            nq = solution.manifold.nq
            interval.sampling.act(t, y[:nq], y[nq:])
            self.stopped = bool(solution.steps) and self.ends_under_loads(t, y[:nq], y[nq:])
            if self.stopped:
                return t, y
        span, begun = interval.span(t), y.copy()
        stepper.begin(span, y)
        if not stepper.finite:
            raise _not_finite(solution, t, stepper)
        self.h = stepper.first(self.h)
        while t < span.end and not self.stopped:
            self.check_progress(t, span)
            known = len(solution.steps)
            t, self.h = self.steps.take(index, span, t, self.h, self.max_steps - self.taken)
            self.stopped = bool(self.watches) and self.locate_crossings(known)
            if self.stopped and not known and (shorter := self.shorter_first()):
                t, self.h, self.stopped = span.start, shorter, False
                solution.clear()
                stepper.begin(span, begun)
        return t, stepper.y.copy()

    def shorter_first(self) -> float:
        """Return the first step that shows a crossing in it better [s]; 0 where it is far from its start, or at it."""
        solution, steps = self.solution, self.solution.steps
        start, until = float(steps.t[0]), float(steps.until[0])
        near = len(steps) == 1 and until - start < NEAR * float(steps.h[0])
        apart = until - start > APART * math.ulp(max(abs(until), abs(start)))
        return 2.0 * (until - start) if near and apart and not solution.method.tangent else 0.0

    def ends_under_loads(self, t: float, q: Array, v: Array) -> bool:
        """Return whether loads that have jumped at t [s] end the integration; see ``Watch.loaded``."""
        state = np.array([t]), q[None], v[None]
        return any(watch.value(*state)[0] < 0.0 for watch in self.watches if watch.loaded)

    def locate_crossings(self, first: int) -> bool:
        """Record the crossings from the step of an index on; return whether one of them stops the integration."""
        steps, y = self.solution.steps, self.stepper.y
        for index in possible_crossings(self.solution, self.watches, first, y):
            end = steps.y[index + 1] if index + 1 < len(steps) else y
            if locate_crossings(self.solution, self.watches, index, end):
                self.solution.truncate(index + 1)
                return True
        return False

    @property
    def taken(self) -> int:
        return len(self.solution.steps) + self.solution.count.rejected

    def check_progress(self, t: float, span: Interval) -> None:
        """Raise where the steps have become too short or too many."""
        if not self.h >= SHORTEST * math.ulp(max(abs(t), span.end - span.start)):  # NaN included
            raise _stuck(self.solution, t, self.h, self.stepper)
        steps, left = self.solution.steps, self.solution.intervals[-1].end - t
        longest = max(self.h, (t - float(steps.t[0])) / len(steps)) if steps else self.h
        hopeless = self.taken >= PROBED and left > HOPELESS * self.max_steps * longest
        if hopeless or self.taken >= self.max_steps:
            raise _too_many(self.solution, t, self.h, self.taken)


def _failure(message: str, hint: str, solution: Solution, t: float, stepper: Stepper) -> IntegrationError:
    nq = solution.manifold.nq
    q, v = stepper.y[:nq].copy(), stepper.y[nq:].copy()
    return IntegrationError(message, hint=hint, partial=solution, t=t, q=q, v=v)


def _not_finite(solution: Solution, t: float, stepper: Stepper) -> IntegrationError:
    message = f"the acceleration is not finite at the start, t = {t:.9g} s"
    hint = "check for a body without mass that is free to move, and for a load that is infinite here"
    return _failure(message, hint, solution, t, stepper)


def _too_many(solution: Solution, t: float, h: float, most: int) -> IntegrationError:
    doubts, remedy = solution.method.diagnose(solution), solution.method.remedy
    return IntegrationError(
        f"the integration has taken {most} steps and is at t = {t:.9g} s; its steps are {h:.2g} s long",
        hint=doubts[0].text
        if doubts
        else f"{remedy}, a shorter time, softer springs, dry friction of a larger creep, or accuracy.max_steps",
        partial=solution,
        t=t,
    )


def _stuck(solution: Solution, t: float, h: float, stepper: Stepper) -> IntegrationError:
    reason = "the acceleration grows without bound" if stepper.finite else "the acceleration is not finite"
    cause = f"the step fell to {h:.2g} s because {reason}" if h else f"{reason} within one step"
    message = f"the integration cannot go on at t = {t:.12g} s: {cause}"
    hint = f"{solution.method.remedy}, or look for a singular position or a load that jumps there"
    return _failure(message, hint, solution, t, stepper)

"""Integration of one motion over consecutive intervals, with any method."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integration.events import Watch, locate_crossings
from pinarm.engine.integration.integrator import Interval, Manifold, Method, Solution, Step, Stepper, StepsOver
from pinarm.errors import IntegrationError, Interrupted

PASSED = 1e12
"""Error assigned to a step that may have stepped over a piece of a load, so that it is rejected."""

SHORTEST = 16.0
"""Smallest step, in units in the last place of t: in shorter ones ``t + c h`` of some stage equals t."""

PROBED = 20
"""Part of the largest number of steps after which the driver looks whether the rest can come to the end."""

HOPELESS = 1000.0
"""How many times the steps allowed the rest would take, with steps ten times as long, where the driver gives up."""


def integrate(
    intervals: Sequence[Interval], manifold: Manifold, q: Array, v: Array, method: Method, *,
    max_steps: int = 1_000_000, watches: Sequence[Watch] = (), steps_over: StepsOver | None = None,
) -> Solution:  # fmt: skip
    """Integrate over consecutive intervals; a step ends exactly at the end of each.

    Args:
        intervals: Consecutive intervals with their accelerations.
        manifold: The configuration space.
        q: Initial configuration, shape (nq,).
        v: Initial velocity, shape (nv,).
        method: The method.
        max_steps: Largest number of steps, rejected ones included.
        watches: Values whose zero crossings are located; one that stops ends the integration at its crossing.
        steps_over: Whether a step may have stepped over a piece of a load; methods with variable steps reject it.

    Returns:
        The steps, with dense output.

    Raises:
        IntegrationError: The step became too small, the steps too many, or the acceleration is not finite; ``partial``
            holds the solution up to there.
        Interrupted: The user interrupted it; likewise.
    """
    q, v = manifold.project(np.asarray(q, float)), np.asarray(v, float)
    solution = Solution(method, manifold, method.prepare(intervals, q, v))
    driver = _Driver(solution, method.stepper(manifold, solution.count), max_steps, watches, steps_over)
    try:
        driver.run(np.concatenate([q, v]))
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted at t = {solution.end:.9g} s", partial=solution) from None
    return solution


class _Driver:
    """The loop over intervals and steps."""

    def __init__(
        self,
        solution: Solution,
        stepper: Stepper,
        max_steps: int,
        watches: Sequence[Watch],
        steps_over: StepsOver | None,
    ) -> None:
        self.solution, self.stepper, self.max_steps = solution, stepper, max_steps
        self.watches, self.steps_over = watches, steps_over
        self.h, self.stopped = 0.0, False

    def run(self, y: Array) -> None:
        """Integrate all intervals from the state y."""
        for index, interval in enumerate(self.solution.intervals):
            self.stepper.begin(interval, y)
            if not self.stepper.finite:
                raise _not_finite(self.solution, interval.start, self.stepper.y)
            self.h = self.stepper.first(self.h)
            self.run_interval(interval, index)
            if self.stopped:
                return
            y = self.stepper.y.copy()

    def run_interval(self, interval: Interval, index: int) -> None:
        """Integrate one interval."""
        t, end, stepper = interval.start, interval.end, self.stepper
        while t < end and not self.stopped:
            self.check_progress(t, interval)
            last = t + 1.01 * self.h >= end
            taken = end - t if last else self.h
            error = stepper.attempt(t, taken)
            if error <= 1.0 and self.steps_over:
                error = self.rejected_if_stepped_over(error, t, taken)
            if error <= 1.0:
                y, until = stepper.y.copy(), end if last else t + taken
                slopes, following = stepper.accept(until, taken, error)
                self.solution.steps.append(Step(t, taken, until, y, slopes, index))
                self.h = max(self.h, following) if last else following
                t = until
                if self.watches:
                    self.stopped = locate_crossings(self.solution, self.watches, stepper.y)
            else:  # NaN included
                self.solution.count.rejected += 1
                self.h = stepper.retry(taken, error)

    def rejected_if_stepped_over(self, error: float, t: float, h: float) -> float:
        """Return the error of a step, or ``PASSED`` where it may have stepped over a load and can be shorter."""
        instants, states = self.stepper.along(t, h)
        nq = self.solution.manifold.nq
        if not (self.steps_over and self.steps_over(instants, states[:, :nq], states[:, nq:])):
            return error
        if self.stepper.retry(h, PASSED):
            return PASSED
        self.solution.count.stepped_over += 1
        return error

    def check_progress(self, t: float, interval: Interval) -> None:
        """Raise where the steps have become too short or too many.

        Raises:
            IntegrationError: See ``integrate``.
        """
        solution = self.solution
        if self.h < SHORTEST * math.ulp(max(abs(t), interval.end - interval.start)):
            raise _stuck(solution, t, self.h, self.stepper)
        taken = len(solution.steps) + solution.count.rejected
        if taken >= self.max_steps or (taken == max(self.max_steps // PROBED, 100) and self.is_hopeless(t)):
            raise _too_many(solution, t, self.h, taken)

    def is_hopeless(self, t: float) -> bool:
        """Tell whether steps ten times as long as until now would still be far too many, as with huge velocities."""
        steps = self.solution.steps
        longest = 10.0 * max(self.h, (t - steps[0].t) / len(steps)) if steps else 10.0 * self.h
        return self.solution.intervals[-1].end - t > HOPELESS * self.max_steps * longest


def _not_finite(solution: Solution, t: float, y: Array) -> IntegrationError:
    nq = solution.manifold.nq
    return IntegrationError(
        f"the acceleration is not finite at the start, t = {t:.9g} s",
        hint="check for a body without mass that is free to move, and for a load that is infinite here",
        partial=solution, t=t, q=y[:nq].copy(), v=y[nq:].copy(),
    )  # fmt: skip


def _too_many(solution: Solution, t: float, h: float, most: int) -> IntegrationError:
    notes, remedy = solution.method.diagnose(solution), solution.method.remedy
    return IntegrationError(
        f"the integration has taken {most} steps and is at t = {t:.9g} s; its steps are {h:.2g} s long",
        hint=notes[0] if notes else (
            f"{remedy}, a shorter time, softer springs, dry friction of a larger creep, or accuracy.max_steps"
        ),
        partial=solution, t=t,
    )  # fmt: skip


def _stuck(solution: Solution, t: float, h: float, stepper: Stepper) -> IntegrationError:
    nq = solution.manifold.nq
    reason = "the acceleration grows without bound" if stepper.finite else "the acceleration is not finite"
    cause = f"the step fell to {h:.2g} s because {reason}" if h else f"{reason} within one step"
    return IntegrationError(
        f"the integration cannot go on at t = {t:.12g} s: {cause}",
        hint=f"{solution.method.remedy}, or look for a singular position or a load that jumps there",
        partial=solution, t=t, q=stepper.y[:nq].copy(), v=stepper.y[nq:].copy(),
    )  # fmt: skip

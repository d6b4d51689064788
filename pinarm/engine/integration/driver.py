"""From step to step, over all intervals, with any method."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integration.events import Watch, find
from pinarm.engine.integration.integrator import Interval, Manifold, Method, Passes, Solution, Step, Stepper
from pinarm.errors import IntegrationError, Interrupted

PASSED = 1e12
"""Error that a step is taken to have where it may have gone past something unseen: large."""

SHORTEST = 16.0
"""Smallest step in units in the last place of t: below it, adding a stage's fraction of h no longer changes t."""


def integrate(
    intervals: Sequence[Interval], manifold: Manifold, q: Array, v: Array, method: Method, *,
    max_steps: int = 1_000_000, watches: Sequence[Watch] = (), passes: Passes | None = None,
) -> Solution:  # fmt: skip
    """Integrate with steps that end exactly where one interval meets the next.

    Args:
        intervals: Consecutive intervals with their accelerations.
        manifold: The space of configurations.
        q: Initial configuration, shape (nq,).
        v: Initial velocity, shape (nv,).
        method: The method.
        max_steps: Number of steps, rejected ones included, after which to give up.
        watches: What to look for on the way; one that stops ends the integration where it crosses zero.
        passes: Whether a step may have gone past something unseen; it is taken shorter then, where the method can.

    Returns:
        The steps and their dense output.

    Raises:
        IntegrationError: The step became too small to go on, or the acceleration is not finite; ``partial`` holds the
            solution until then.
    """
    q, v = manifold.project(np.asarray(q, float)), np.asarray(v, float)
    solution = Solution(method, manifold, method.prepare(intervals, q, v))
    march = _March(solution, method.stepper(manifold, solution.count), max_steps, watches, passes)
    try:
        march.through(np.concatenate([q, v]))
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted at t = {solution.end:.9g} s", partial=solution) from None
    return solution


class _March:
    """An integration on its way."""

    def __init__(
        self, solution: Solution, stepper: Stepper, max_steps: int, watches: Sequence[Watch], passes: Passes | None
    ) -> None:
        self.solution, self.stepper, self.max_steps = solution, stepper, max_steps
        self.watches, self.passes = watches, passes
        self.h, self.stopped = 0.0, False

    def through(self, y: Array) -> None:
        """Step through all intervals from the state y."""
        for index, interval in enumerate(self.solution.intervals):
            self.stepper.begin(interval, y)
            if not self.stepper.finite:
                raise _not_finite(self.solution, interval.start, self.stepper.y)
            self.h = self.stepper.first(self.h)
            self.along(interval, index)
            if self.stopped:
                return
            y = self.stepper.y.copy()

    def along(self, interval: Interval, index: int) -> None:
        """Step through one interval."""
        t, end, stepper = interval.start, interval.end, self.stepper
        while t < end and not self.stopped:
            self.check(t, interval)
            last = t + 1.01 * self.h >= end
            taken = end - t if last else self.h
            error = stepper.attempt(t, taken)
            if error <= 1.0 and self.passes:
                error = self.seen(error, t, taken)
            if error <= 1.0:
                y, until = stepper.y.copy(), end if last else t + taken
                slopes, following = stepper.accept(until, taken, error)
                self.solution.steps.append(Step(t, taken, until, y, slopes, index))
                self.h = max(self.h, following) if last else following
                t = until
                if self.watches:
                    self.stopped = find(self.solution, self.watches, stepper.y)
            else:  # a step whose error is not even a number is refused like one that is too large
                self.solution.count.rejected += 1
                self.h = stepper.retry(taken, error)

    def seen(self, error: float, t: float, h: float) -> float:
        """Return the error of a step, a large one where it may have gone past something unseen."""
        instants, states = self.stepper.along(t, h)
        nq = self.solution.manifold.nq
        if not (self.passes and self.passes(instants, states[:, :nq], states[:, nq:])):
            return error
        if self.stepper.retry(h, PASSED):
            return PASSED
        self.solution.count.passing += 1
        return error

    def check(self, t: float, interval: Interval) -> None:
        """Raise where the steps have become too short or too many."""
        solution = self.solution
        if self.h < SHORTEST * math.ulp(max(abs(t), interval.end - interval.start)):
            raise _stuck(solution, t, self.h, self.stepper)
        if len(solution.steps) + solution.count.rejected >= self.max_steps:
            raise _too_many(solution, t, self.h, self.max_steps)


def _not_finite(solution: Solution, t: float, y: Array) -> IntegrationError:
    nq = solution.manifold.nq
    return IntegrationError(
        f"the acceleration is not finite at the start, t = {t:.9g} s",
        hint="a body without mass that is free to move, or a load that is infinite here",
        partial=solution, t=t, q=y[:nq].copy(), v=y[nq:].copy(),
    )  # fmt: skip


def _too_many(solution: Solution, t: float, h: float, most: int) -> IntegrationError:
    doubts, remedy = solution.method.doubts(solution), solution.method.remedy
    return IntegrationError(
        f"the integration has taken {most} steps and is at t = {t:.9g} s; its steps are {h:.2g} s long",
        hint=doubts[0] if doubts else (
            f"{remedy}, a shorter time, softer springs, dry friction of a larger creep, or accuracy.max_steps"
        ),
        partial=solution, t=t,
    )  # fmt: skip


def _stuck(solution: Solution, t: float, h: float, stepper: Stepper) -> IntegrationError:
    nq = solution.manifold.nq
    reason = "the acceleration grows without bound" if stepper.finite else "the acceleration is not finite"
    fallen = f"the step fell to {h:.2g} s because {reason}" if h else f"{reason} within one step"
    return IntegrationError(
        f"the integration cannot go on at t = {t:.12g} s: {fallen}",
        hint=f"{solution.method.remedy}, or look for a singular position or a load that jumps there",
        partial=solution, t=t, q=stepper.y[:nq].copy(), v=stepper.y[nq:].copy(),
    )  # fmt: skip

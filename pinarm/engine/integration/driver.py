"""Integration of one motion over consecutive intervals, with any method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from pinarm.arrays import Array
from pinarm.engine.integration.events import locate_crossings, possible_crossings
from pinarm.engine.integration.integrator import Interval, Manifold, Solution, Stepper, StepsOver, Watch
from pinarm.engine.integration.runge_kutta import SHORTEST
from pinarm.errors import IntegrationError, Interrupted

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Method

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
    try:
        _Driver(solution, method.stepper(solution, steps_over), max_steps, watches).run(np.concatenate([q, v]))
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted at t = {solution.end:.9g} s", partial=solution) from None
    return solution


class _Driver(Struct, eq=False):
    """The loop over intervals and steps."""

    solution: Solution
    stepper: Stepper
    max_steps: int
    watches: Sequence[Watch]
    h: float = 0.0
    stopped: bool = False

    def run(self, y: Array) -> None:
        for interval in self.solution.intervals:
            t = interval.start
            while t < interval.end:
                t, y = self.run_span(interval, t, y)
                if self.stopped:
                    return
        self.solution.final = y

    def run_span(self, interval: Interval, t: float, y: Array) -> tuple[float, Array]:
        """Integrate from t [s] to the next sample or knot of an interval, or to its end; return instant and state."""
        solution, stepper, nq = self.solution, self.stepper, self.solution.manifold.nq
        if interval.sampling:
            interval.sampling.act(t, y[:nq], y[nq:])
            self.stopped = bool(solution.steps) and self.ends_under_loads(t, y[:nq], y[nq:])
            if self.stopped:
                return t, y
        span, begun = interval.span(t), y.copy()
        stepper.begin(span, y)
        if not stepper.finite:
            message = f"the acceleration is not finite at the start, t = {t:.9g} s"
            hint = "check for a body without mass that is free to move, and for a load that is infinite here"
            raise self.failure(message, hint, t)
        self.h = stepper.first(self.h)
        while t < span.end and not self.stopped:
            self.check_progress(t, span)
            known = len(solution.steps)
            t, self.h = stepper.take(t, self.h, self.max_steps - self.taken)
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
        solution, steps, h, taken = self.solution, self.solution.steps, self.h, self.taken
        if not h >= SHORTEST * math.ulp(max(abs(t), span.end - span.start)):  # NaN included
            reason = f"the acceleration {'grows without bound' if self.stepper.finite else 'is not finite'}"
            cause = f"the step fell to {h:.2g} s because {reason}" if h else f"{reason} within one step"
            hint = f"{solution.method.remedy}, or look for a singular position or a load that jumps there"
            raise self.failure(f"the integration cannot go on at t = {t:.12g} s: {cause}", hint, t)
        longest = max(h, (t - float(steps.t[0])) / len(steps)) if steps else h
        hopeless = taken >= PROBED and solution.intervals[-1].end - t > HOPELESS * self.max_steps * longest
        if hopeless or taken >= self.max_steps:
            notes, remedy = solution.method.diagnose([solution]), solution.method.remedy
            raise IntegrationError(
                f"the integration has taken {taken} steps and is at t = {t:.9g} s; its steps are {h:.2g} s long",
                hint=notes[0]
                if notes
                else f"{remedy}, a shorter time, softer springs, dry friction of a larger creep, or accuracy.max_steps",
                partial=solution,
                t=t,
            )

    def failure(self, message: str, hint: str, t: float) -> IntegrationError:
        """Return the error of a motion that cannot go on from the present state."""
        nq = self.solution.manifold.nq
        q, v = self.stepper.y[:nq].copy(), self.stepper.y[nq:].copy()
        return IntegrationError(message, hint=hint, partial=self.solution, t=t, q=q, v=v)

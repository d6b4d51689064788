"""Integration of many motions of one system at once, each with its own time and step length.

The motions share the evaluation of their accelerations. A motion that ends, by an event or a failure, leaves the others
unchanged. Arrays have one column for each motion, so that numpy's loops run along memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.batch_solution import ActiveMotions, BatchStep, Ensemble
from pinarm.engine.integration.events import Watch, keeps_sign, locate_crossings
from pinarm.engine.integration.first_step import first_step
from pinarm.engine.integration.integrator import EmbeddedPair, Interval, Manifold, Solution, StepsOver
from pinarm.engine.integration.methods.explicit import HALVES, middle
from pinarm.engine.integration.step_control import (
    FASTEST,
    HUGE,
    LOST,
    PASSED,
    SHORTEST,
    TINY,
    growth,
    shrinkage,
)
from pinarm.engine.integration.step_series import nodes
from pinarm.engine.integration.steps import StepTable

Advance = Callable[[ActiveMotions], tuple[ActiveMotions, Flags]]
"""Takes steps of motions: where these are then, and which of them an event ends."""


def integrate_batch(
    intervals: Sequence[Interval], manifold: Manifold, q: Array, v: Array, method: EmbeddedPair, *,
    max_steps: int = 1_000_000, watches: Sequence[Watch] = (), steps_over: StepsOver | None = None,
    threads: int = 1,
) -> Ensemble:  # fmt: skip
    """Integrate from many initial states, each with the steps that ``integrate`` takes from it.

    Args:
        intervals: Consecutive intervals with the accelerations of many states at once, without constraints.
        manifold: The configuration space.
        q: Initial configurations, shape (b, nq).
        v: Initial velocities, shape (b, nv).
        method: The embedded pair.
        max_steps: Largest number of steps of a motion, rejected ones included.
        watches: Values whose zero crossings are located; one that stops ends the motion at its crossing.
        steps_over: Whether a step may have stepped over a piece of a load; it is rejected then.
        threads: Number of threads that may take steps in compiled code.
    """
    y, zero = np.vstack([manifold.project(q).T, v.T]), np.zeros(len(q), dtype=np.intp)
    parts = [part for interval in intervals for part in interval.parts()]
    ensemble = Ensemble(method, manifold, parts, np.full(len(q), -np.inf), y.copy(), zero, zero.copy(), [[] for _ in q])
    _BatchDriver(ensemble, max_steps, watches, steps_over, threads).run(y)
    return ensemble


class _BatchDriver:
    """The loop over intervals and steps of all motions."""

    def __init__(
        self, ensemble: Ensemble, max_steps: int, watches: Sequence[Watch], steps_over: StepsOver | None, threads: int
    ) -> None:
        self.ensemble, self.manifold, self.method = ensemble, ensemble.manifold, ensemble.method
        self.max_steps, self.watches, self.steps_over, self.threads = max_steps, watches, steps_over, threads
        self.interval, self.index = Interval(0.0, 0.0, lambda t, q, v: 0.0 * v), -1
        self.tries = np.zeros_like(ensemble.rejected)

    def run(self, y: Array) -> None:
        """Integrate all intervals from the states y, shape (nq + nv, b)."""
        number, h = np.arange(y.shape[1]), np.zeros(y.shape[1])
        for index, interval in enumerate(self.ensemble.intervals):
            if not len(number):
                return
            self.index, self.interval = index, interval
            t, slope = np.full(len(number), self.interval.start), np.empty_like(y)
            self.slope_at(t, t, y, slope)
            self.ensemble.evaluations[number] += 1
            active = ActiveMotions(number, t, h, np.full(len(number), FASTEST), y, slope)
            infinite = np.asarray(~np.isfinite(slope).all(axis=0))
            active = self.without(active, infinite, "the acceleration is not finite")
            if not h.any() and len(active.number):
                active.h = self.first(active)
            number, h, y = self.run_interval(active)

    def first(self, active: ActiveMotions) -> Array:
        """Return the first steps [s]."""
        start, end, method = self.interval.start, self.interval.end, self.method

        def rates(t: Array, y: Array) -> Array:
            slope = np.empty_like(active.slope)
            self.slope_at(t, t, y.T, slope)
            return slope.T

        self.ensemble.evaluations[active.number] += 1
        order, size = method.tableau.error_order, self.interval.size
        return first_step(start, end, active.y.T, active.slope.T, rates, method.tolerance, order, size)

    def slope_at(self, start: Array, t: Array, y: Array, slope: Array) -> None:
        """Project states y at times t, and write their slopes; both of shape (nq + nv, m).

        Args:
            start: Starts of the steps that the states belong to [s], shape (m,).
            t: Times [s], shape (m,).
            y: States [q, v]; q is projected onto the manifold in place.
            slope: Where [q', v'] is written.
        """
        nq = self.manifold.nq
        q, v = self.manifold.project(y[:nq].T), y[nq:].T
        y[:nq] = q.T
        slope[:nq], slope[nq:] = self.manifold.velocity(q, v).T, self.interval.accelerations(start, t, q, v).T

    def run_interval(self, active: ActiveMotions) -> tuple[Indices, Array, Array]:
        """Integrate the interval; return the motions that reach its end, their next steps and their states."""
        arrived, advance = [active.subset(np.zeros(len(active.number), dtype=bool))], self.compiled() or self.step
        while len(active.number):
            there, stopped = advance(active)
            ending = there.t >= self.interval.end
            arrived.append(there.subset(ending & ~stopped))
            active = self.without_failed(there.subset(~(ending | stopped)))
        number, h, y = (np.concatenate([getattr(part, name) for part in arrived], -1) for name in ("number", "h", "y"))
        order = np.argsort(number)
        return number[order], h[order], y[:, order]

    def compiled(self) -> Advance | None:
        """Return what takes many steps of each motion in compiled code; ``None`` where each has to be looked at."""
        if self.watches or self.steps_over or self.interval.compiled is None:
            return None
        from pinarm.engine.integration.compiled_batch import CompiledRounds

        rounds = CompiledRounds.of(self.ensemble, self.interval, self.index, self.max_steps, self.threads)
        if rounds is None:
            return None
        return lambda active: (rounds.advance(active, self.tries), np.zeros(len(active.number), dtype=bool))

    def step(self, active: ActiveMotions) -> tuple[ActiveMotions, Flags]:
        """Try one step of each motion; return the motions behind it, and which of them an event ends."""
        end = self.interval.end
        last = active.t + 1.01 * active.h >= end
        h, until = np.where(last, end - active.t, active.h), np.where(last, end, active.t + active.h)
        new, slopes = self.attempt(active, h)
        error = self.error(h, active.y, new, slopes)
        if self.steps_over:
            error = np.where(self.stepped_over(self.steps_over, active, h, new, slopes), PASSED, error)
        done = error <= 1.0  # False for NaN
        stopped = self.record(active, done, h, until, new, slopes)
        return ActiveMotions(
            active.number, np.where(done, until, active.t), self.adapted(active, h, error, done & last),
            np.where(done, FASTEST, 1.0), np.where(done, new, active.y), np.where(done, slopes[-1], active.slope),
        ), stopped  # fmt: skip

    def attempt(self, active: ActiveMotions, h: Array) -> tuple[Array, Array]:
        """Return the states after one step of each motion, and the slopes at all stages, shape (s + 1, nq + nv, m).

        ``k_i = f(t + c_i h, y + h sum_j a_ij k_j)``, ``y_new = y + h sum_i b_i k_i``, ``k_s = f(t + h, y_new)``.
        """
        tableau, y = self.method.tableau, active.y
        slopes, new = np.empty((tableau.stages + 1, *y.shape)), np.empty(y.shape)
        slopes[0] = active.slope
        flat, line = slopes.reshape(len(slopes), -1), new.reshape(-1)
        for i, (weights, c) in enumerate(zip([*tableau.a[1:], tableau.b], [*tableau.c[1:], 1.0], strict=True), 1):
            np.dot(weights[:i], flat[:i], out=line)
            new *= h
            new += y
            self.slope_at(active.t, active.t + c * h, new, slopes[i])
        return new, slopes

    def error(self, h: Array, y: Array, new: Array, slopes: Array) -> Array:
        """Return the errors of steps over the tolerance, shape (m,); the formula is that of ``AdaptiveStepper``."""
        errors = (self.method.tableau.error @ slopes.reshape(len(slopes), -1)).reshape(-1, *y.shape)
        errors /= self.method.tolerance * (self.interval.size + np.maximum(np.abs(y), np.abs(new)))
        first, *lower = (errors * errors).sum(axis=1)
        denominator = first + sum(0.01 * square for square in lower)
        usual = first / np.sqrt(np.maximum(denominator * len(y), TINY))
        return np.asarray(np.abs(h) * np.where(first == 0.0, np.sqrt([first, *lower][-1] / len(y)), usual))

    def stepped_over(self, steps_over: StepsOver, active: ActiveMotions, h: Array, new: Array, slopes: Array) -> Flags:
        """Return which steps may have stepped over a piece of a load, shape (m,)."""
        nq = self.manifold.nq
        states = np.stack([active.y, middle(h, active.y, new, slopes), new]).transpose(2, 0, 1)
        return np.array([
            steps_over(t + step * HALVES, along[:, :nq], along[:, nq:])
            for t, step, along in zip(active.t, h, states, strict=True)
        ])  # fmt: skip

    def adapted(self, active: ActiveMotions, h: Array, error: Array, cut: Flags) -> Array:
        """Return the next steps [s], shape (m,).

        A step that the end of the interval shortened (``cut``) does not shorten the next one.
        """
        order = self.method.tableau.error_order + 1
        with np.errstate(divide="ignore", invalid="ignore"):
            grown = h * growth(error, order, active.ceiling, np.minimum, np.maximum)
            shrunk = h * np.where(error < HUGE, shrinkage(error, order, np.maximum), LOST)
        return np.where(error <= 1.0, np.where(cut, np.maximum(active.h, grown), grown), shrunk)

    def without_failed(self, active: ActiveMotions) -> ActiveMotions:
        """Return the motions whose steps are neither too short nor too many; the others are recorded as failed."""
        interval = self.interval
        smallest = SHORTEST * np.spacing(np.maximum(np.abs(active.t), interval.end - interval.start))
        active = self.without(active, active.h < smallest, "the acceleration grows without bound or is not finite")
        return self.without(active, self.tries[active.number] >= self.max_steps, f"it has taken {self.max_steps} steps")

    def without(self, active: ActiveMotions, failed: Flags, why: str) -> ActiveMotions:
        """Return the motions that have not failed, and record why the others have."""
        for number, t in zip(active.number[failed], active.t[failed], strict=True):
            self.ensemble.failures[int(number)] = f"the integration cannot go on at t = {t:.9g} s: {why}"
        return active.subset(~failed)

    def record(self, active: ActiveMotions, done: Flags, h: Array, until: Array, new: Array, slopes: Array) -> Flags:
        """Record the steps, rejected ones with length 0; return which motions an event ends, shape (m,)."""
        ensemble, number = self.ensemble, active.number
        self.tries[number] += 1
        ensemble.evaluations[number] += self.method.tableau.stages
        ensemble.rejected[number] += ~done
        taken = BatchStep(number, active.t, h, np.where(done, until, active.t), active.y, slopes, self.index)
        ensemble.steps.append(taken)
        ensemble.ends[number[done]], ensemble.last[:, number[done]] = until[done], new[:, done]
        stopped = np.zeros(len(h), dtype=bool)
        if self.watches and done.any():
            for column in np.flatnonzero(done)[self.may_cross(taken.subset(done))]:
                stopped[column] = self.locate_crossings(taken, int(column), new[:, column])
        return stopped

    def may_cross(self, taken: BatchStep) -> Flags:
        """Return in which steps a watched value may cross zero, shape (m,): bounds on its Chebyshev series decide."""
        m, x, nq = len(taken.h), nodes(self.method.subdivisions), self.manifold.nq
        base, known = taken.y.T, taken.slopes.transpose(2, 0, 1)
        output = self.method.output_of(self.interval, self.manifold, taken.t, taken.h, base, known)
        rows, fraction = np.repeat(np.arange(m), len(x)), np.tile(x, m)
        y = output.states(rows, fraction)
        states = taken.t[rows] + taken.h[rows] * fraction, self.manifold.project(y[:, :nq]), y[:, nq:]
        values = [watch.value(*states).reshape(m, len(x)) for watch in self.watches]
        return np.asarray(~np.all([keeps_sign(each) for each in values], axis=0))

    def locate_crossings(self, taken: BatchStep, column: int, new: Array) -> bool:
        """Record the crossings in the step of one motion; return whether the motion ends at one."""
        ensemble, number = self.ensemble, int(taken.number[column])
        step = taken.step(number)
        alone = Solution(self.method, self.manifold, ensemble.intervals, StepTable.of([step] if step else []))
        stops = locate_crossings(alone, self.watches, len(alone.steps) - 1, new)
        ensemble.crossings[number].extend(alone.crossings)
        if stops:
            at = alone.crossings[-1]
            taken.until[column] = ensemble.ends[number] = at.t
            ensemble.last[:, number] = np.concatenate([at.q, at.v])
        return stops

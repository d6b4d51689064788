"""Many motions of one system at once: their steps are taken together, each at its own time and of its own length.

What they share is the call that evaluates the accelerations of all. Where one ends, by an event or because it cannot go
on, the others do not notice. That call has one thread: with two, 256 to 1,024 motions took 0.7 to 1.5 of the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integrators.contract import Manifold, Passes, Solution, Step, Stretch, interpolated
from pinarm.engine.integrators.events import Watch, find, nodes, quiet
from pinarm.engine.integrators.explicit import FASTEST, GAIN, HALVES, SAFETY, SLOWEST, TINY, Adaptive, middle, terms_of
from pinarm.engine.integrators.march import PASSED, SHORTEST
from pinarm.engine.integrators.start import first_step
from pinarm.errors import IntegrationError

BLOCK, ROWS = 1024, 16384
"""Number of steps whose dense output is computed together, and of states that are taken from it together."""


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Motions from many initial states.

    Attributes:
        solutions: What each integration gives.
        failures: Why motions could not be followed to their end, by their number.
    """

    solutions: Sequence[Solution]
    failures: dict[int, str] = field(default_factory=dict)

    def solution(self, number: int) -> Solution:
        """Return one motion.

        Raises:
            IntegrationError: It could not be followed to its end; ``partial`` holds it until then.
        """
        found = self.solutions[number]
        if number in self.failures:
            raise IntegrationError(self.failures[number], hint=found.method.remedy, partial=found, t=found.end)
        return found

    def states(self, t: Array) -> tuple[Array, Array]:
        """Return the states of all motions at the same times.

        Args:
            t: Times [s], ascending, shape (n,).

        Returns:
            q of shape (b, n, nq) and v of shape (b, n, nv), not a number beyond the end of a motion.
        """
        steps: list[Step] = []
        where, reached = np.zeros((len(self.solutions), len(t)), dtype=np.intp), self.reached(t)
        for k, solution in enumerate(self.solutions):
            if solution.steps:
                index = np.searchsorted([step.t for step in solution.steps], t, side="right") - 1
                needed, places = np.unique(np.maximum(index, 0), return_inverse=True)
                where[k] = len(steps) + places
                steps += [solution.steps[i] for i in needed]
        manifold, nq = self.solutions[0].manifold, self.solutions[0].manifold.nq
        y = np.full((*where.shape, nq + manifold.nv), np.nan)
        if steps:
            y[reached] = self._interpolated(steps, where[reached], np.broadcast_to(t, where.shape)[reached])
            y[reached, :nq] = manifold.project(y[reached, :nq])
        return y[..., :nq], y[..., nq:]

    def reached(self, t: Array) -> Flags:
        """Return which motions are told at which times, shape (b, n)."""
        ends = np.array([solution.end if solution.steps else -np.inf for solution in self.solutions])
        return np.asarray(t <= ends[:, None])

    def _interpolated(self, steps: Sequence[Step], where: Indices, t: Array) -> Array:
        """Return the states at times t, each within the step of the given index, shape (n, nq + nv)."""
        start, h = (np.array(x) for x in zip(*((step.t, step.h) for step in steps), strict=True))
        base, terms, x = np.array([step.y for step in steps]), self._terms(steps), (t - start[where]) / h[where]
        parts = [slice(begin, begin + ROWS) for begin in range(0, len(t), ROWS)]
        return np.concatenate([interpolated(base[where[part]], terms[where[part]], x[part]) for part in parts])

    def _terms(self, steps: Sequence[Step]) -> Array:
        """Return the terms of the dense output of steps of any motions, those of a stretch together."""
        one, owners = self.solutions[0], np.array([step.stretch for step in steps])
        found: list[Array] = [np.zeros(0)] * len(steps)
        for owner in np.unique(owners):
            here = np.flatnonzero(owners == owner)
            for block in np.split(here, range(BLOCK, len(here), BLOCK)):
                terms = one.method.interpolants(one.stretches[owner], one.manifold, [steps[i] for i in block])
                for i, each in zip(block, terms, strict=True):
                    found[i] = each
        return np.array(found)


def advance(
    stretches: Sequence[Stretch], manifold: Manifold, q: Array, v: Array, method: Adaptive, *,
    max_steps: int = 1_000_000, watches: Sequence[Watch] = (), passes: Passes | None = None,
) -> Ensemble:  # fmt: skip
    """Integrate from many initial states; ``integrate`` does so from one, and takes the same steps.

    Args:
        stretches: Consecutive intervals with the accelerations of many states at once, and no constraints to settle on.
        manifold: The space of configurations.
        q: Initial configurations, shape (b, nq).
        v: Initial velocities, shape (b, nv).
        method: The explicit pair.
        max_steps: Number of steps, rejected ones included, after which a motion is given up.
        watches: What to look for on the way; one that stops ends the motion in which it crosses zero.
        passes: Whether a step may have gone past something unseen; it is taken shorter then.
    """
    ensemble = Ensemble([Solution(method, manifold, stretches) for _ in q])
    y = np.hstack([manifold.project(q), v])
    _Advance(ensemble, manifold, method, max_steps, watches, passes).through(stretches, y)
    return ensemble


@dataclass(eq=False)
class _Going:
    """Motions on their way through a stretch; every array has a row for each.

    Attributes:
        number: Which motions they are.
        t: Where they are [s].
        h: The steps to try next [s].
        ceiling: Factors by which these may grow.
        y: Their states.
        slope: The slopes of these.
    """

    number: Indices
    t: Array
    h: Array
    ceiling: Array
    y: Array
    slope: Array

    def only(self, which: Flags) -> _Going:
        """Return some of them."""
        return _Going(*(getattr(self, each.name)[which] for each in fields(self)))


class _Advance:
    """An ensemble on its way."""

    def __init__(
        self, ensemble: Ensemble, manifold: Manifold, method: Adaptive, max_steps: int, watches: Sequence[Watch],
        passes: Passes | None,
    ) -> None:  # fmt: skip
        self.solutions, self.failures = ensemble.solutions, ensemble.failures
        self.manifold, self.method, self.max_steps, self.watches = manifold, method, max_steps, watches
        self.passes = passes
        self.stretch, self.index, self.tries = Stretch(0.0, 0.0, lambda t, q, v: 0.0 * v), -1, 0

    def through(self, stretches: Sequence[Stretch], y: Array) -> None:
        """Step through all stretches from the states y, shape (b, nq + nv)."""
        number, h = np.arange(len(y)), np.zeros(len(y))
        for self.index, self.stretch in enumerate(stretches):
            t = np.full(len(y), self.stretch.start)
            slope = self.rates(t, y)
            going = _Going(number, t, h, np.full(len(y), FASTEST), y, slope)
            infinite = np.asarray(~np.isfinite(slope).all(axis=1))
            going = self.without(going, infinite, "the acceleration is not finite")
            if not h.any() and len(going.number):
                going.h = self.first(going)
            number, h, y = self.along(going)

    def first(self, going: _Going) -> Array:
        """Return the first steps [s]."""
        start, end, method = self.stretch.start, self.stretch.end, self.method
        return first_step(start, end, going.y, going.slope, self.rates, method.tolerance, method.tableau.error_order)

    def rates(self, t: Array, y: Array) -> Array:
        """Return the slopes of states."""
        q, v = self.manifold.project(y[:, : self.manifold.nq]), y[:, self.manifold.nq :]
        return np.hstack([self.manifold.velocity(q, v), self.stretch.accelerations(t, t, q, v)])

    def along(self, going: _Going) -> tuple[Indices, Array, Array]:
        """Step through the stretch; return the motions that reach its end, their next steps and their states."""
        arrived, end = [going.only(np.zeros(len(going.number), dtype=bool))], self.stretch.end
        self.tries = 0
        while len(going.number):
            last = going.t + 1.01 * going.h >= end
            h, until = np.where(last, end - going.t, going.h), np.where(last, end, going.t + going.h)
            new, slopes = self.attempt(going, h)
            error = self.error(h, going.y, new, slopes)
            if self.passes:
                error = np.where(self.passing(self.passes, going, h, new, slopes), PASSED, error)
            done = error <= 1.0  # one that is not even a number is refused like one that is too large
            stopped = self.accept(going, done, h, until, new, slopes)
            going.h = self.adapted(going, h, error, done & last)
            going.ceiling = np.where(done, FASTEST, 1.0)
            going.y[done], going.slope[done], going.t[done] = new[done], slopes[-1, done], until[done]
            arrived.append(going.only(done & last & ~stopped))
            going = self.able(going.only(~(done & last) & ~stopped))
        number, h, y = (np.concatenate([getattr(part, name) for part in arrived]) for name in ("number", "h", "y"))
        order = np.argsort(number)
        return number[order], h[order], y[order]

    def attempt(self, going: _Going, h: Array) -> tuple[Array, Array]:
        """Return the states after a step each, and the slopes at all stages, shape (s + 1, m, nq + nv)."""
        tableau, y, nq = self.method.tableau, going.y, self.manifold.nq
        slopes = np.empty((tableau.stages + 1, *y.shape))
        slopes[0] = going.slope
        flat, new = slopes.reshape(len(slopes), -1), y
        for i, (weights, c) in enumerate(zip([*tableau.a[1:], tableau.b], [*tableau.c[1:], 1.0], strict=True), 1):
            new = y + h[:, None] * (weights[:i] @ flat[:i]).reshape(y.shape)
            new[:, :nq] = self.manifold.project(new[:, :nq])
            q, v = new[:, :nq], new[:, nq:]
            slopes[i, :, :nq] = self.manifold.velocity(q, v)
            slopes[i, :, nq:] = self.stretch.accelerations(going.t, going.t + c * h, q, v)
        return new, slopes

    def error(self, h: Array, y: Array, new: Array, slopes: Array) -> Array:
        """Return the errors of steps relative to the tolerance, shape (m,), as ``AdaptiveStepper`` has them."""
        tableau = self.method.tableau
        errors = (tableau.error @ slopes.reshape(len(slopes), -1)).reshape(-1, *y.shape)
        errors /= self.method.tolerance * (1.0 + np.maximum(np.abs(y), np.abs(new)))
        first, *lower = np.einsum("kmn,kmn->km", errors, errors)
        denominator = first + sum(0.01 * square for square in lower)
        usual = first / np.sqrt(np.maximum(denominator * y.shape[1], TINY))
        return np.asarray(np.abs(h) * np.where(first == 0.0, np.sqrt([first, *lower][-1] / y.shape[1]), usual))

    def passing(self, passes: Passes, going: _Going, h: Array, new: Array, slopes: Array) -> Flags:
        """Return which steps may have gone past something unseen."""
        nq = self.manifold.nq
        states = np.stack([going.y, middle(h[:, None], going.y, new, slopes), new], axis=1)
        return np.array([
            passes(t + step * HALVES, along[:, :nq], along[:, nq:])
            for t, step, along in zip(going.t, h, states, strict=True)
        ])  # fmt: skip

    def adapted(self, going: _Going, h: Array, error: Array, cut: Flags) -> Array:
        """Return the next steps [s]; those that the end of the stretch has cut say little of them."""
        exponent = -1.0 / (self.method.tableau.error_order + 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            grown = h * np.minimum(going.ceiling, SAFETY * error ** (GAIN * exponent))
            shrunk = h * np.where(error < 1e300, np.maximum(SLOWEST, SAFETY * error**exponent), 0.1)
        return np.where(error <= 1.0, np.where(cut, np.maximum(going.h, grown), grown), shrunk)

    def able(self, going: _Going) -> _Going:
        """Return the motions that can go on; the others have failed."""
        stretch = self.stretch
        smallest = SHORTEST * np.spacing(np.maximum(np.abs(going.t), stretch.end - stretch.start))
        going = self.without(going, going.h < smallest, "the acceleration grows without bound or is not finite")
        self.tries += 1
        if self.tries < self.max_steps:  # no motion has taken more
            return going
        taken = [len(self.solutions[k].steps) + self.solutions[k].count.rejected for k in going.number]
        return self.without(going, np.array(taken) >= self.max_steps, f"it has taken {self.max_steps} steps")

    def without(self, going: _Going, failed: Flags, why: str) -> _Going:
        """Return the motions that have not failed."""
        for number, t in zip(going.number[failed], going.t[failed], strict=True):
            self.failures[int(number)] = f"the integration cannot go on at t = {t:.9g} s: {why}"
        return going.only(~failed) if failed.any() else going

    def accept(self, going: _Going, done: Flags, h: Array, until: Array, new: Array, slopes: Array) -> Flags:
        """Note the steps that are done and the others; return which motions an event ends."""
        evaluations, stopped = self.method.tableau.stages, np.zeros(len(h), dtype=bool)
        for i, number in enumerate(going.number):
            solution = self.solutions[number]
            solution.count.evaluations += evaluations
            solution.count.rejected += not done[i]
            if done[i]:
                step = Step(
                    float(going.t[i]), float(h[i]), float(until[i]), going.y[i].copy(), slopes[:, i], self.index
                )
                solution.steps.append(step)
        if self.watches and done.any():
            stopped[done] = self.watched(going.only(done), h[done], new[done], slopes[:, done])
        return stopped

    def watched(self, going: _Going, h: Array, new: Array, slopes: Array) -> Flags:
        """Look for crossings in the steps that are done; return which motions end at one."""
        m, x, nq = len(h), nodes(self.method.parts), self.manifold.nq
        known = slopes.swapaxes(0, 1)
        terms = terms_of(self.method.tableau, self.stretch, self.manifold, going.t, h, going.y, known)
        rows, passed = np.repeat(np.arange(m), len(x)), np.tile(x, m)
        y = interpolated(going.y[rows], terms[rows], passed)
        states = going.t[rows] + h[rows] * passed, self.manifold.project(y[:, :nq]), y[:, nq:]
        loud, stopped = np.zeros(m, dtype=bool), np.zeros(m, dtype=bool)
        for watch in self.watches:
            loud |= ~quiet(watch.value(*states).reshape(m, len(x)))
        for i in np.flatnonzero(loud):
            stopped[i] = find(self.solutions[going.number[i]], self.watches, new[i])
        return stopped

"""Many motions of one system at once: their steps are taken together, each at its own time and of its own length.

What they share is the call that evaluates the accelerations of all. Where one ends, by an event or because it cannot go
on, the others do not notice. Arrays have a column for each motion: what is done to all is done along memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.batch_solution import Ensemble, Round
from pinarm.engine.integration.driver import PASSED, SHORTEST
from pinarm.engine.integration.events import Watch, find, nodes, quiet
from pinarm.engine.integration.first_step import first_step
from pinarm.engine.integration.integrator import EmbeddedPair, Interval, Manifold, Passes, Solution, interpolated
from pinarm.engine.integration.methods.explicit import HALVES, middle, terms_of
from pinarm.engine.integration.step_control import FASTEST, HUGE, LOST, TINY, growth, shrinkage


def advance(
    intervals: Sequence[Interval], manifold: Manifold, q: Array, v: Array, method: EmbeddedPair, *,
    max_steps: int = 1_000_000, watches: Sequence[Watch] = (), passes: Passes | None = None,
) -> Ensemble:  # fmt: skip
    """Integrate from many initial states; ``integrate`` does so from one, and takes the same steps.

    Args:
        intervals: Consecutive intervals with the accelerations of many states at once, and no constraints to settle on.
        manifold: The space of configurations.
        q: Initial configurations, shape (b, nq).
        v: Initial velocities, shape (b, nv).
        method: The explicit pair.
        max_steps: Number of steps, rejected ones included, after which a motion is given up.
        watches: What to look for on the way; one that stops ends the motion in which it crosses zero.
        passes: Whether a step may have gone past something unseen; it is taken shorter then.
    """
    y, none = np.vstack([manifold.project(q).T, v.T]), np.zeros(len(q), dtype=np.intp)
    ensemble = Ensemble(
        method, manifold, intervals, np.full(len(q), -np.inf), y.copy(), none, none.copy(), [[] for _ in q]
    )
    _Advance(ensemble, max_steps, watches, passes).through(y)
    return ensemble


@dataclass(eq=False)
class _Going:
    """Motions on their way through an interval; the last axis of every array is theirs.

    Attributes:
        number: Which motions they are, ascending.
        t: Where they are [s].
        h: The steps to try next [s].
        ceiling: Factors by which these may grow.
        y: Their states, shape (nq + nv, m).
        slope: The slopes of these, likewise.
    """

    number: Indices
    t: Array
    h: Array
    ceiling: Array
    y: Array
    slope: Array

    def only(self, which: Flags) -> _Going:
        """Return some of them."""
        if which.all():
            return self
        return _Going(*(getattr(self, each.name)[..., which] for each in fields(self)))


class _Advance:
    """An ensemble on its way."""

    def __init__(self, ensemble: Ensemble, max_steps: int, watches: Sequence[Watch], passes: Passes | None) -> None:
        self.ensemble, self.manifold, self.method = ensemble, ensemble.manifold, ensemble.method
        self.max_steps, self.watches, self.passes = max_steps, watches, passes
        self.interval, self.index = Interval(0.0, 0.0, lambda t, q, v: 0.0 * v), -1
        self.tries = np.zeros_like(ensemble.rejected)

    def through(self, y: Array) -> None:
        """Step through all intervals from the states y, shape (nq + nv, b)."""
        number, h = np.arange(y.shape[1]), np.zeros(y.shape[1])
        for index, interval in enumerate(self.ensemble.intervals):
            if not len(number):
                return
            self.index, self.interval = index, interval
            t, slope = np.full(len(number), self.interval.start), np.empty_like(y)
            self.slope_at(t, t, y, slope)
            self.ensemble.evaluations[number] += 1
            going = _Going(number, t, h, np.full(len(number), FASTEST), y, slope)
            infinite = np.asarray(~np.isfinite(slope).all(axis=0))
            going = self.without(going, infinite, "the acceleration is not finite")
            if not h.any() and len(going.number):
                going.h = self.first(going)
            number, h, y = self.along(going)

    def first(self, going: _Going) -> Array:
        """Return the first steps [s]."""
        start, end, method = self.interval.start, self.interval.end, self.method

        def rates(t: Array, y: Array) -> Array:
            slope = np.empty_like(going.slope)
            self.slope_at(t, t, y.T, slope)
            return slope.T

        self.ensemble.evaluations[going.number] += 1
        return first_step(start, end, going.y.T, going.slope.T, rates, method.tolerance, method.tableau.error_order)

    def slope_at(self, start: Array, t: Array, y: Array, slope: Array) -> None:
        """Write the slopes of states in steps from ``start``, both of shape (nq + nv, m); the states are projected."""
        nq = self.manifold.nq
        q, v = self.manifold.project(y[:nq].T), y[nq:].T
        y[:nq] = q.T
        slope[:nq], slope[nq:] = self.manifold.velocity(q, v).T, self.interval.accelerations(start, t, q, v).T

    def along(self, going: _Going) -> tuple[Indices, Array, Array]:
        """Step through the interval; return the motions that reach its end, their next steps and their states."""
        arrived, end = [going.only(np.zeros(len(going.number), dtype=bool))], self.interval.end
        while len(going.number):
            last = going.t + 1.01 * going.h >= end
            h, until = np.where(last, end - going.t, going.h), np.where(last, end, going.t + going.h)
            new, slopes = self.attempt(going, h)
            error = self.error(h, going.y, new, slopes)
            if self.passes:
                error = np.where(self.passing(self.passes, going, h, new, slopes), PASSED, error)
            done = error <= 1.0  # one that is not even a number is refused like one that is too large
            stopped = self.keep(going, done, h, until, new, slopes)
            there = _Going(
                going.number, np.where(done, until, going.t), self.adapted(going, h, error, done & last),
                np.where(done, FASTEST, 1.0), np.where(done, new, going.y), np.where(done, slopes[-1], going.slope),
            )  # fmt: skip
            if (ending := done & last | stopped).any():
                arrived.append(there.only(ending & ~stopped))
                there = there.only(~ending)
            going = self.able(there)
        number, h, y = (np.concatenate([getattr(part, name) for part in arrived], -1) for name in ("number", "h", "y"))
        order = np.argsort(number)
        return number[order], h[order], y[:, order]

    def attempt(self, going: _Going, h: Array) -> tuple[Array, Array]:
        """Return the states after a step each, and the slopes at all stages, shape (s + 1, nq + nv, m)."""
        tableau, y = self.method.tableau, going.y
        slopes, new = np.empty((tableau.stages + 1, *y.shape)), np.empty(y.shape)
        slopes[0] = going.slope
        flat, line = slopes.reshape(len(slopes), -1), new.reshape(-1)
        for i, (weights, c) in enumerate(zip([*tableau.a[1:], tableau.b], [*tableau.c[1:], 1.0], strict=True), 1):
            np.dot(weights[:i], flat[:i], out=line)
            new *= h
            new += y
            self.slope_at(going.t, going.t + c * h, new, slopes[i])
        return new, slopes

    def error(self, h: Array, y: Array, new: Array, slopes: Array) -> Array:
        """Return the errors of steps relative to the tolerance, shape (m,), as ``AdaptiveStepper`` has them."""
        errors = (self.method.tableau.error @ slopes.reshape(len(slopes), -1)).reshape(-1, *y.shape)
        errors /= self.method.tolerance * (1.0 + np.maximum(np.abs(y), np.abs(new)))
        first, *lower = (errors * errors).sum(axis=1)
        denominator = first + sum(0.01 * square for square in lower)
        usual = first / np.sqrt(np.maximum(denominator * len(y), TINY))
        return np.asarray(np.abs(h) * np.where(first == 0.0, np.sqrt([first, *lower][-1] / len(y)), usual))

    def passing(self, passes: Passes, going: _Going, h: Array, new: Array, slopes: Array) -> Flags:
        """Return which steps may have gone past something unseen."""
        nq = self.manifold.nq
        states = np.stack([going.y, middle(h, going.y, new, slopes), new]).transpose(2, 0, 1)
        return np.array([
            passes(t + step * HALVES, along[:, :nq], along[:, nq:])
            for t, step, along in zip(going.t, h, states, strict=True)
        ])  # fmt: skip

    def adapted(self, going: _Going, h: Array, error: Array, cut: Flags) -> Array:
        """Return the next steps [s]; those that the end of the interval has cut say little of them."""
        order = self.method.tableau.error_order + 1
        with np.errstate(divide="ignore", invalid="ignore"):
            grown = h * growth(error, order, going.ceiling, np.minimum, np.maximum)
            shrunk = h * np.where(error < HUGE, shrinkage(error, order, np.maximum), LOST)
        return np.where(error <= 1.0, np.where(cut, np.maximum(going.h, grown), grown), shrunk)

    def able(self, going: _Going) -> _Going:
        """Return the motions that can go on; the others have failed."""
        interval = self.interval
        smallest = SHORTEST * np.spacing(np.maximum(np.abs(going.t), interval.end - interval.start))
        going = self.without(going, going.h < smallest, "the acceleration grows without bound or is not finite")
        return self.without(going, self.tries[going.number] >= self.max_steps, f"it has taken {self.max_steps} steps")

    def without(self, going: _Going, failed: Flags, why: str) -> _Going:
        """Return the motions that have not failed."""
        for number, t in zip(going.number[failed], going.t[failed], strict=True):
            self.ensemble.failures[int(number)] = f"the integration cannot go on at t = {t:.9g} s: {why}"
        return going.only(~failed)

    def keep(self, going: _Going, done: Flags, h: Array, until: Array, new: Array, slopes: Array) -> Flags:
        """Keep the steps, those refused as of no length; return which motions an event ends."""
        ensemble, number = self.ensemble, going.number
        self.tries[number] += 1
        ensemble.evaluations[number] += self.method.tableau.stages
        ensemble.rejected[number] += ~done
        taken = Round(number, going.t, h, np.where(done, until, going.t), going.y, slopes, self.index)
        ensemble.rounds.append(taken)
        ensemble.ends[number[done]], ensemble.last[:, number[done]] = until[done], new[:, done]
        stopped = np.zeros(len(h), dtype=bool)
        if self.watches and done.any():
            for place in np.flatnonzero(done)[self.loud(taken.only(done))]:
                stopped[place] = self.crossed(taken, int(place), new[:, place])
        return stopped

    def loud(self, taken: Round) -> Flags:
        """Return in which steps a watched value may cross zero."""
        m, x, nq = len(taken.h), nodes(self.method.parts), self.manifold.nq
        base, known = taken.y.T, taken.slopes.transpose(2, 0, 1)
        terms = terms_of(self.method.tableau, self.interval, self.manifold, taken.t, taken.h, base, known)
        rows, passed = np.repeat(np.arange(m), len(x)), np.tile(x, m)
        y = interpolated(base[rows], terms[rows], passed)
        states = taken.t[rows] + taken.h[rows] * passed, self.manifold.project(y[:, :nq]), y[:, nq:]
        values = [watch.value(*states).reshape(m, len(x)) for watch in self.watches]
        return np.asarray(~np.all([quiet(each) for each in values], axis=0))

    def crossed(self, taken: Round, place: int, new: Array) -> bool:
        """Look for crossings in a step; return whether its motion ends at one."""
        ensemble, number = self.ensemble, int(taken.number[place])
        step = taken.step(number)
        alone = Solution(self.method, self.manifold, ensemble.intervals, [step] if step else [])
        stops = find(alone, self.watches, new)
        ensemble.crossings[number].extend(alone.crossings)
        if stops:
            at = alone.crossings[-1]
            taken.until[place] = ensemble.ends[number] = at.t
            ensemble.last[:, number] = np.concatenate([at.q, at.v])
        return stops

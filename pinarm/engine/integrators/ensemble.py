"""Many motions of one system at once: their steps are taken together, each at its own time and of its own length.

What they share is the call that evaluates the accelerations of all. Where one ends, by an event or because it cannot go
on, the others do not notice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integrators.contract import Crossing, Manifold, Solution, Step, Stretch, interpolated
from pinarm.engine.integrators.events import Watch, find, nodes, quiet
from pinarm.engine.integrators.explicit import FASTEST, GAIN, SAFETY, SLOWEST, TINY, Adaptive, terms_of
from pinarm.engine.integrators.march import SHORTEST
from pinarm.engine.integrators.start import first_step


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Motions from b initial states at the same n instants.

    Attributes:
        t: The instants [s], shape (n,).
        q: Configurations, shape (b, n, nq); not a number beyond the end of a motion.
        v: Velocities, shape (b, n, nv), likewise.
        end: Last time that each motion reached [s], shape (b,).
        steps: Number of steps of each, shape (b,).
        rejected: Number of steps that each tried and refused, shape (b,).
        crossings: What was watched for, motion by motion, in order of time.
        failures: Why motions could not be followed to the last instant, by their number.
    """

    t: Array
    q: Array
    v: Array
    end: Array
    steps: Indices
    rejected: Indices
    crossings: list[list[Crossing]]
    failures: dict[int, str]

    @classmethod
    def empty(cls, manifold: Manifold, q: Array, v: Array, t: Array, start: float) -> Ensemble:
        """Return motions of which only the initial states are known."""
        b, n = len(q), len(t)
        found = cls(
            t, np.full((b, n, manifold.nq), np.nan), np.full((b, n, manifold.nv), np.nan), np.full(b, start),
            np.zeros(b, dtype=np.intp), np.zeros(b, dtype=np.intp), [[] for _ in range(b)], {},
        )  # fmt: skip
        first = t <= start
        found.q[:, first], found.v[:, first] = q[:, None], v[:, None]
        return found


def advance(
    stretches: Sequence[Stretch], manifold: Manifold, q: Array, v: Array, method: Adaptive, t: Array, *,
    max_steps: int = 1_000_000, watches: Sequence[Watch] = (),
) -> Ensemble:  # fmt: skip
    """Integrate from many initial states; ``integrate`` does so from one.

    Args:
        stretches: Consecutive intervals with the accelerations of many states at once.
        manifold: The space of configurations.
        q: Initial configurations, shape (b, nq).
        v: Initial velocities, shape (b, nv).
        method: The explicit pair.
        t: Instants at which the motions are wanted [s], ascending, shape (n,).
        max_steps: Number of steps, rejected ones included, after which a motion is given up.
        watches: What to look for on the way; one that stops ends the motion in which it crosses zero.
    """
    q = manifold.project(q)
    found = Ensemble.empty(manifold, q, v, t, stretches[0].start)
    _Advance(found, manifold, method, max_steps, watches).through(stretches, np.hstack([q, v]))
    return found


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
        return _Going(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


class _Advance:
    """An ensemble on its way."""

    def __init__(
        self, found: Ensemble, manifold: Manifold, method: Adaptive, max_steps: int, watches: Sequence[Watch]
    ) -> None:
        self.found, self.manifold, self.method = found, manifold, method
        self.max_steps, self.watches = max_steps, watches

    def through(self, stretches: Sequence[Stretch], y: Array) -> None:
        """Step through all stretches from the states y, shape (b, nq + nv)."""
        number, h = np.arange(len(y)), np.zeros(len(y))
        for stretch in stretches:
            t = np.full(len(y), stretch.start)
            slope = self.rates(stretch, t, y)
            going = _Going(number, t, h, np.full(len(y), FASTEST), y, slope)
            infinite = np.asarray(~np.isfinite(slope).all(axis=1))
            going = self.without(going, infinite, "the acceleration is not finite")
            if len(h) and not h.any():
                going.h = self.first(stretch, going)
            number, h, y = self.along(stretch, going)

    def first(self, stretch: Stretch, going: _Going) -> Array:
        """Return the first steps [s]."""
        method = self.method

        def rates(t: Array, y: Array) -> Array:
            return self.rates(stretch, t, y)

        return first_step(
            stretch.start, stretch.end, going.y, going.slope, rates, method.tolerance, method.tableau.error_order
        )

    def rates(self, stretch: Stretch, t: Array, y: Array) -> Array:
        """Return the slopes of states."""
        q, v = self.manifold.project(y[:, : self.manifold.nq]), y[:, self.manifold.nq :]
        return np.hstack([self.manifold.velocity(q, v), stretch.accelerations(t, q, v)])

    def along(self, stretch: Stretch, going: _Going) -> tuple[Indices, Array, Array]:
        """Step through one stretch; return the motions that reach its end, their next steps and their states."""
        arrived: list[_Going] = []
        while len(going.number):
            last = going.t + 1.01 * going.h >= stretch.end
            h = np.where(last, stretch.end - going.t, going.h)
            new, slopes = self.attempt(stretch, going, h)
            error = self.error(h, going.y, new, slopes)
            done = error <= 1.0  # one that is not even a number is refused like one that is too large
            until = np.where(last, stretch.end, going.t + h)
            stopped = np.zeros(len(h), dtype=bool)
            if done.any():
                stopped[done] = self.record(stretch, going.only(done), h[done], until[done], new[done], slopes[:, done])
            self.move(going, h, error, done & last)
            going.y[done], going.slope[done], going.t[done] = new[done], slopes[-1, done], until[done]
            ended = done & last & ~stopped
            if ended.any():
                arrived.append(going.only(ended))
            going = self.able(stretch, going.only(~ended & ~stopped))
        number = np.concatenate([np.zeros(0, dtype=np.intp), *(some.number for some in arrived)])
        order = np.argsort(number)
        if not len(order):
            return number, np.zeros(0), going.y
        h, y = np.concatenate([some.h for some in arrived]), np.concatenate([some.y for some in arrived])
        return number[order], h[order], y[order]

    def attempt(self, stretch: Stretch, going: _Going, h: Array) -> tuple[Array, Array]:
        """Return the states after a step each, and the slopes at all stages, shape (s + 1, m, nq + nv)."""
        tableau, y, nq = self.method.tableau, going.y, self.manifold.nq
        slopes = np.empty((tableau.stages + 1, *y.shape))
        slopes[0] = going.slope
        flat, scaled = slopes.reshape(len(slopes), -1), h[:, None]
        new = y
        for i, weights in enumerate([*tableau.a[1:], tableau.b], 1):
            new = y + scaled * (weights[:i] @ flat[:i]).reshape(y.shape)
            c = tableau.c[i] if i < tableau.stages else 1.0
            q, v = self.manifold.project(new[:, :nq]), new[:, nq:]
            slopes[i, :, :nq], slopes[i, :, nq:] = (
                self.manifold.velocity(q, v),
                stretch.accelerations(going.t + c * h, q, v),
            )
        new[:, :nq] = self.manifold.project(new[:, :nq])
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

    def move(self, going: _Going, h: Array, error: Array, short: Flags) -> None:
        """Choose the next steps; one that was cut short by the end of the stretch says little of them."""
        exponent = -1.0 / (self.method.tableau.error_order + 1)
        done, sound = error <= 1.0, error < 1e300
        with np.errstate(divide="ignore", invalid="ignore"):
            grown = h * np.minimum(going.ceiling, SAFETY * error ** (GAIN * exponent))
            shrunk = h * np.where(sound, np.maximum(SLOWEST, SAFETY * error**exponent), 0.1)
        going.h = np.where(done, np.where(short, np.maximum(going.h, grown), grown), shrunk)
        going.ceiling = np.where(done, FASTEST, 1.0)
        np.add.at(self.found.steps, going.number, done)
        np.add.at(self.found.rejected, going.number, ~done)

    def able(self, stretch: Stretch, going: _Going) -> _Going:
        """Return the motions that can go on; the others have failed."""
        smallest = SHORTEST * np.spacing(np.maximum(np.abs(going.t), stretch.end - stretch.start))
        going = self.without(going, going.h < smallest, "the acceleration grows without bound or is not finite")
        taken = self.found.steps[going.number] + self.found.rejected[going.number]
        return self.without(going, taken >= self.max_steps, f"it has taken {self.max_steps} steps")

    def without(self, going: _Going, failed: Flags, why: str) -> _Going:
        """Return the motions that have not failed."""
        for number, t in zip(going.number[failed], going.t[failed], strict=True):
            self.found.failures[int(number)] = f"at t = {t:.9g} s {why}"
        return going.only(~failed) if failed.any() else going

    def record(self, stretch: Stretch, going: _Going, h: Array, until: Array, new: Array, slopes: Array) -> Flags:
        """Note what accepted steps pass: instants and crossings; return which motions end within theirs."""
        found = self.found
        first = np.searchsorted(found.t, going.t, side="right")
        beyond = np.searchsorted(found.t, until, side="right")
        stopped = np.zeros(len(h), dtype=bool)
        asked = (beyond > first) | bool(self.watches)
        if asked.any():
            terms = np.full((len(h), self.method.tableau.dense_d.shape[0] + 3, new.shape[1]), np.nan)
            terms[asked] = terms_of(
                self.method.tableau, stretch, self.manifold, going.t[asked], h[asked], going.y[asked],
                slopes[:, asked].swapaxes(0, 1),
            )  # fmt: skip
            if self.watches:
                stopped = self.watched(stretch, going, h, until, new, slopes, terms)
                beyond = np.searchsorted(found.t, until, side="right")
            self.tabulate(going, h, first, beyond, terms)
        found.end[going.number] = until
        return stopped

    def watched(
        self, stretch: Stretch, going: _Going, h: Array, until: Array, new: Array, slopes: Array, terms: Array
    ) -> Flags:
        """Look for crossings; return which motions end at one, whose ``until`` is then its instant."""
        m, x, nq = len(h), nodes(), self.manifold.nq
        rows = np.repeat(np.arange(m), len(x))
        y = interpolated(going.y[rows], terms[rows], np.tile(x, m))
        state = going.t[rows] + h[rows] * np.tile(x, m), self.manifold.project(y[:, :nq]), y[:, nq:]
        loud, stopped = np.zeros(m, dtype=bool), np.zeros(m, dtype=bool)
        for watch in self.watches:
            loud |= ~quiet(watch.value(*state).reshape(m, len(x)))
        for i in np.flatnonzero(loud):
            step = Step(float(going.t[i]), float(h[i]), float(until[i]), going.y[i], slopes[:, i], 0)
            crossings = self.found.crossings[int(going.number[i])]
            alone = Solution(self.method, self.manifold, [stretch], [step], crossings, _interpolants={0: terms[i]})
            stopped[i] = find(alone, self.watches, new[i])
            until[i] = alone.steps[0].until
        return stopped

    def tabulate(self, going: _Going, h: Array, first: Indices, beyond: Indices, terms: Array) -> None:
        """Enter the states at the instants that steps pass."""
        found, nq = self.found, self.manifold.nq
        count = beyond - first
        rows = np.repeat(np.arange(len(h)), count)
        at = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)
        y = interpolated(going.y[rows], terms[rows], (found.t[at] - going.t[rows]) / h[rows])
        found.q[going.number[rows], at], found.v[going.number[rows], at] = self.manifold.project(y[:, :nq]), y[:, nq:]

"""What is integrated, what an integrator is, and what comes out; nothing here knows of mechanisms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from pinarm.arrays import Array, Indices

if TYPE_CHECKING:
    from pinarm.engine.integration.tableaus import Tableau

Acceleration = Callable[[float, Array, Array], Array]
"""``(t, q, v) -> a``; q and v are buffers that the next call overwrites."""

Accelerations = Callable[[Array, Array, Array], Array]
"""``(t, q, v) -> a`` of many states at once, shapes (n,), (n, nq), (n, nv) and (n, nv)."""

SAME = 1e-11
"""Largest relative difference between accelerations of many states at once and those of one: Pinocchio's recursion for
many works in the world's axes; far from the origin, or where links differ much in length, it loses digits that the one
in the links' own axes keeps."""

Settle = Callable[[float, Array, Array], tuple[Array, Array]]
"""``(t, q, v) -> q, v``: the nearest state that meets the constraints."""

Passes = Callable[[Array, Array, Array], bool]
"""``(t, q, v) -> whether`` a step may have gone past something unseen, from states along it, its ends included."""

Energy = Callable[[Array, Array], tuple[float, float]]
"""``(q, v) -> T, V``: kinetic and potential energy [J]; T is quadratic in v."""


class Manifold(Protocol):
    """The space of configurations."""

    @property
    def nq(self) -> int:
        """Numbers in q."""
        ...

    @property
    def nv(self) -> int:
        """Numbers in v."""
        ...

    def velocity(self, q: Array, v: Array) -> Array:
        """Return the time derivative of q, shape (nq,); rows of many samples where q is (n, nq)."""
        ...

    def project(self, q: Array) -> Array:
        """Return q brought back onto the manifold; rows of many samples where q is (n, nq)."""
        ...


@dataclass(frozen=True)
class Flat:
    """Configurations that are plain numbers: ``q' = v``."""

    nq: int
    nv: int

    def velocity(self, q: Array, v: Array) -> Array:
        """Return v."""
        return v

    def project(self, q: Array) -> Array:
        """Return q."""
        return q


@dataclass(frozen=True)
class Interval:
    """An interval of time on which the acceleration is smooth.

    Attributes:
        start: Its first instant [s].
        end: Its last instant [s].
        acceleration: Smooth up to both ends; at a jump each side has its own.
        settle: Brings the state back onto the constraints after every accepted step; none where there are none.
        floor: Returns the step that is taken although its error is above the tolerance, as long as it is below
            ``NOISE`` [s]: close to a singular position, where rounding is blown up, shorter steps are no better.
        energy: Energy of a state; none where dampers, loads over time, drives or laws of motion exchange energy.
        since: Start of a step that has been taken [s] -> the acceleration that it was taken with, where that depends on
            how close to a singular position the step began; none where it does not.
        together: The acceleration of many states at once; none where it is only known of one.
        unchecked: The same for who asks again and again, and compares some of them with ``acceleration`` himself.
    """

    start: float
    end: float
    acceleration: Acceleration
    settle: Settle | None = None
    floor: Callable[[], float] = float
    energy: Energy | None = None
    acceleration_of_step: Callable[[float], Acceleration] | None = None
    batch: Accelerations | None = None
    unchecked_batch: Accelerations | None = None

    def accelerations(self, start: Array, t: Array, q: Array, v: Array) -> Array:
        """Return the accelerations of many states, shape (n, nv), at times t in steps from ``start``, shape (n,)."""
        if self.batch is not None:
            return self.batch(t, q, v)
        found = np.empty_like(v)
        for k, (begin, instant) in enumerate(zip(start.tolist(), t.tolist(), strict=True)):
            acceleration = self.acceleration_of_step(begin) if self.acceleration_of_step else self.acceleration
            found[k] = acceleration(instant, q[k], v[k])
        return found


class Step(NamedTuple):
    """An accepted step, with all that its dense output needs.

    Attributes:
        t: Its start [s].
        h: Its length [s].
        until: Where it ends [s]: ``t + h`` to rounding, or earlier where an event cut it short.
        y: State [q, v] at the start, shape (nq + nv,).
        slopes: Slopes at the method's stages, shape (s, nq + nv).
        interval: Index of the interval that it belongs to.
    """

    t: float
    h: float
    until: float
    y: Array
    slopes: Array
    interval: int


@dataclass
class Count:
    """Work of an integration.

    Attributes:
        evaluations: Number of accelerations computed for the steps.
        rejected: Number of steps that were tried and refused.
        floored: Number of steps that were taken at their floor, with an error above the tolerance.
        passing: Number of steps of a fixed length that may have gone past something unseen.
        limited: Number of steps that an iteration keeps short which would not converge, not their error.
    """

    evaluations: int = 0
    rejected: int = 0
    floored: int = 0
    passing: int = 0
    limited: int = 0


class Stepper(Protocol):
    """A method at work: the present state, and buffers."""

    y: Array
    """Present state [q, v], shape (nq + nv,)."""

    @property
    def finite(self) -> bool:
        """Whether the slopes last computed are finite."""
        ...

    def begin(self, interval: Interval, y: Array) -> None:
        """Stand at the first instant of an interval with the state y."""
        ...

    def first(self, h: float) -> float:
        """Return the first step in the interval [s]; h is what the interval before would have gone on with, or 0."""
        ...

    def attempt(self, t: float, h: float) -> float:
        """Compute a step from the present state; return its error, up to 1 accepted, not a number where it failed."""
        ...

    def along(self, t: float, h: float) -> tuple[Array, Array]:
        """Return instants along the step attempted, its ends included, shape (n,), and states, shape (n, nq + nv)."""
        ...

    def retry(self, h: float, error: float) -> float:
        """Return the step to try after one of that error was refused [s]; 0 to give up."""
        ...

    def accept(self, t: float, h: float, error: float) -> tuple[Array, float]:
        """Move on to the end t of the step, settled; return its slopes and the step to go on with [s]."""
        ...


class Method(Protocol):
    """A method of integration."""

    @property
    def name(self) -> str:
        """Name for messages."""
        ...

    @property
    def order(self) -> int:
        """Order of the step."""
        ...

    @property
    def parts(self) -> int:
        """Parts of a step at whose ends it is looked at; its dense output has at most twice their degree."""
        ...

    @property
    def remedy(self) -> str:
        """What to try where it fails."""
        ...

    @property
    def pair(self) -> EmbeddedPair | None:
        """The method itself where it is an embedded pair, with which many motions can be integrated at once."""
        ...

    def prepare(self, intervals: Sequence[Interval], q: Array, v: Array) -> Sequence[Interval]:
        """Return the intervals as this method integrates them from an initial state."""
        ...

    def stepper(self, manifold: Manifold, count: Count) -> Stepper:
        """Return the method at work on a manifold."""
        ...

    def interpolants(self, interval: Interval, manifold: Manifold, steps: Sequence[Step]) -> Array:
        """Return the terms r of the dense output of steps in one interval, shape (n, d, nq + nv).

        With ``x = (t - step.t) / h`` it is ``y + x (r_0 + (1 - x) (r_1 + x (r_2 + (1 - x) (...))))``.
        """
        ...

    def doubts(self, solution: Solution) -> list[str]:
        """Return what says that this method was a poor choice for what it has integrated."""
        ...


class EmbeddedPair(Method, Protocol):
    """An explicit Runge-Kutta method with an error estimate, whose step follows the tolerance."""

    @property
    def tableau(self) -> Tableau:
        """Coefficients."""
        ...

    @property
    def tolerance(self) -> float:
        """Local error per step, relative to ``1 + |y|`` in SI."""
        ...


@dataclass(frozen=True)
class Crossing:
    """An instant at which a watched value crossed zero.

    Attributes:
        watch: Index of the watch.
        t: The instant [s].
        q: Configuration there, shape (nq,).
        v: Velocity there, shape (nv,).
    """

    watch: int
    t: float
    q: Array
    v: Array


@dataclass
class Solution:
    """What an integration gives: steps, and the state at any time between the first and the last.

    Attributes:
        method: The method.
        manifold: The space of configurations.
        intervals: The intervals that were integrated.
        steps: Accepted steps, in order of time.
        crossings: What was watched for, in order of time.
        count: Work done.
    """

    method: Method
    manifold: Manifold
    intervals: Sequence[Interval]
    steps: list[Step] = field(default_factory=list)
    crossings: list[Crossing] = field(default_factory=list)
    count: Count = field(default_factory=Count)
    _starts: Array | None = field(default=None, repr=False)
    _interpolants: dict[int, Array] = field(default_factory=dict, repr=False)

    @property
    def end(self) -> float:
        """Return the last time reached [s]."""
        return self.steps[-1].until if self.steps else self.intervals[0].start

    def states(self, t: Array) -> tuple[Array, Array]:
        """Return the states at many times, to the order of the dense output.

        Args:
            t: Times [s], shape (n,), within what was integrated.

        Returns:
            q of shape (n, nq) and v of shape (n, nv).
        """
        if self._starts is None or len(self._starts) != len(self.steps):
            self._starts = np.array([step.t for step in self.steps])
        index = np.clip(np.searchsorted(self._starts, t, side="right") - 1, 0, len(self.steps) - 1)
        return self.states_in(index, t)

    def states_in(self, index: Indices, t: Array) -> tuple[Array, Array]:
        """Return the states at many times, each from the step of the given index, both of shape (n,)."""
        needed, where = self._places(index)
        steps = [self.steps[i] for i in needed]
        if not steps:
            return np.empty((0, self.manifold.nq)), np.empty((0, self.manifold.nv))
        start, h = np.array([(step.t, step.h) for step in steps])[where].T
        y, passed = np.array([step.y for step in steps])[where], (t - start) / h
        inside = np.flatnonzero(passed)  # where a step begins its state is known
        if len(inside):
            needed, where = self._places(index[inside])
            self._interpolate([i for i in needed if i not in self._interpolants])
            terms = np.array([self._interpolants[i] for i in needed])[where]
            y[inside] = interpolated(y[inside], terms, passed[inside])
        return self.manifold.project(y[:, : self.manifold.nq]), y[:, self.manifold.nq :]

    def _places(self, index: Indices) -> tuple[list[int], Indices]:
        """Return the steps that occur in an array of indices, ascending, and the place of each entry among them."""
        needed = np.flatnonzero(np.bincount(index, minlength=len(self.steps)))
        return needed.tolist(), np.searchsorted(needed, index)

    @property
    def looked_into(self) -> list[int]:
        """Return the steps whose dense output is there, because states within them have been asked for."""
        return sorted(self._interpolants)

    def _interpolate(self, indices: list[int]) -> None:
        """Compute the terms of the interpolants of steps, those of an interval together."""
        for number, group in groupby(indices, lambda i: self.steps[i].interval):
            here = list(group)
            terms = self.method.interpolants(self.intervals[number], self.manifold, [self.steps[i] for i in here])
            self._interpolants.update(zip(here, terms, strict=True))


def interpolated(base: Array, terms: Array, x: Array) -> Array:
    """Return states within steps; see ``Method.interpolants``.

    Args:
        base: States at the start of each step, shape (n, nq + nv).
        terms: Terms of its interpolant, shape (n, d, nq + nv).
        x: Part of the step that has passed, shape (n,).
    """
    passed = x[:, None]
    y = np.zeros_like(base)
    for degree in range(terms.shape[1] - 1, -1, -1):
        y = (y + terms[:, degree]) * (1.0 - passed if degree % 2 else passed)
    return np.where(passed == 0.0, base, base + y)  # where a step begins, whatever becomes of it

"""Interfaces of time integration: an interval of smooth motion, the configuration space, and the cost.

No module of this package knows mechanisms. A state is ``y = [q, v]``; arrays of states have leading axes.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np
from msgspec import Struct

from pinarm.arrays import Array
from pinarm.records import ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.engine.kernel.library import Flow

Acceleration = Callable[[float, Array, Array], Array]
"""``(t, q, v) -> a`` of one state, shapes (nq,), (nv,) and (nv,); the integrator reuses the arrays q and v."""

Accelerations = Callable[[Array, Array, Array], Array]
"""``(t, q, v) -> a`` of many states at once, shapes (n,), (n, nq), (n, nv) and (n, nv)."""

Projection = Callable[[float, Array, Array], tuple[Array, Array]]
"""``(t, q, v) -> q, v``: projection of a state onto the constraints."""

StepsOver = Callable[[Array, Array, Array], bool]
"""``(t, q, v) -> bool``: whether a step may have stepped over a piece of a load, so that its error estimate missed it.

t, q and v are states along the step, its ends included, shapes (n,), (n, nq) and (n, nv)."""


class SampleTimes(Protocol):
    """Instants at which loads may change by what is measured there: no step goes past one of them."""

    def act(self, t: float, q: Array, v: Array) -> None:
        """Change the loads by the integrated state at t [s]; a second call at the same instant changes nothing."""
        ...

    def next(self, t: float) -> float:
        """Return the first instant after t [s]; infinite where there is none."""
        ...


class Manifold(Protocol):
    """The configuration space: q of nq numbers, v of nv numbers, and ``q' = velocity(q, v)``."""

    @property
    def nq(self) -> int:
        """Number of coordinates in q."""
        ...

    @property
    def nv(self) -> int:
        """Number of velocities in v."""
        ...

    def velocity(self, q: Array, v: Array) -> Array:
        """Return the time derivative of q, shape of q: (nq,) or (n, nq)."""
        ...

    def project(self, q: Array) -> Array:
        """Return q projected onto the manifold (unit quaternions), shape of q: (nq,) or (n, nq)."""
        ...


class Flat(ValueRecord, frozen=True):
    """A configuration space without rotations: ``q' = v``."""

    nq: int
    nv: int

    def velocity(self, q: Array, v: Array) -> Array:
        return v

    def project(self, q: Array) -> Array:
        return q


class Interval(ValueRecord, frozen=True):
    """A time interval on which the acceleration is smooth, but for derivatives of it at knots.

    Attributes:
        start: First instant [s].
        end: Last instant [s].
        acceleration: Acceleration of one state, smooth up to both ends; at a jump each interval has its own side.
        settle: Projection onto the constraints, applied after every accepted step; ``None`` without constraints.
        floor: Returns the smallest useful step [s]: close to a singular position, where rounding is amplified, shorter
            steps are no better. Such a step is accepted with an error above the tolerance, up to ``runge_kutta.NOISE``.
        acceleration_of_step: Start of an accepted step [s] -> the acceleration that this step used; ``None`` where it
            does not depend on the step (it does where the step began close to a singular position).
        size: Errors of a step are relative to ``size + |y|``: 1 in SI, or the size of a motion that is much smaller.
        compiled: The same motion in compiled code; ``None`` where there is none.
        knots: Instants within it at which steps have to end, since a derivative of the acceleration jumps, ascending.
        sampling: Instants at which steps have to end, since the acceleration may jump there; ``None`` for none.
        remark: A note to the user on how the motion is computed; mostly empty.
        outlook: Start of an accepted step [s] -> whether it is known to stay clear of singular positions, and the rank
            of the constraints in it; ``None`` where nothing is known.
    """

    start: float
    end: float
    acceleration: Acceleration
    settle: Projection | None = None
    floor: Callable[[], float] = float
    acceleration_of_step: Callable[[float], Acceleration] | None = None
    size: float = 1.0
    compiled: Flow | None = None
    knots: tuple[float, ...] = ()
    sampling: SampleTimes | None = None
    remark: str = ""
    outlook: Callable[[float], tuple[bool, int]] | None = None

    def span(self, t: float) -> Interval:
        """Return the part from t [s] on in which steps need not end: up to the next knot or sample."""
        end = min(self.sampling.next(t), self.end) if self.sampling else self.end
        if self.knots and (knot := bisect_right(self.knots, t)) < len(self.knots):
            end = min(end, self.knots[knot])
        if (t, end) == (self.start, self.end):
            return self
        return replace(self, start=t, end=end)

    def of_step(self, start: float) -> Acceleration:
        """Return the acceleration that an accepted step used, by its start [s]."""
        return self.acceleration_of_step(start) if self.acceleration_of_step else self.acceleration

    def slope(self, manifold: Manifold, t: float, y: Array) -> Array:
        """Return the slope [q', v'] of one state, whose q is projected onto the manifold in place."""
        nq = manifold.nq
        y[:nq] = manifold.project(y[:nq])
        q, v = y[:nq], y[nq:]
        return np.concatenate([manifold.velocity(q, v), self.acceleration(t, q, v)])

    def slopes(self, manifold: Manifold, start: Array, t: Array, y: Array) -> Array:
        """Return the slopes of states, shape (n, nq + nv), whose q are projected onto the manifold in place.

        Args:
            manifold: The configuration space.
            start: Starts of the steps that the states belong to [s], shape (n,).
            t: Instants of the states [s], shape (n,).
            y: States, shape (n, nq + nv).
        """
        nq = manifold.nq
        y[:, :nq] = manifold.project(y[:, :nq])
        if self.compiled is not None:
            return self.compiled.slopes(start, t, y)
        slopes = np.empty_like(y)
        for k, (begin, instant, state) in enumerate(zip(start.tolist(), t.tolist(), y, strict=True)):
            q, v = state[:nq], state[nq:]
            slopes[k] = [*manifold.velocity(q, v), *self.of_step(begin)(instant, q, v)]
        return slopes


class Count(Struct):
    """Cost of an integration.

    Attributes:
        evaluations: Number of accelerations computed for the steps.
        rejected: Number of rejected steps.
        floored: Number of steps accepted at ``Interval.floor``, with an error above the tolerance.
        stepped_over: Number of steps of fixed length that may have stepped over a piece of a load.
    """

    evaluations: int = 0
    rejected: int = 0
    floored: int = 0
    stepped_over: int = 0


class Doubt(ValueRecord, frozen=True):
    """A sign that a method or its step was a poor choice.

    Attributes:
        kind: Of several doubts of one kind in the segments of a motion, the largest is printed.
        size: Its size, to compare it with others of its kind.
        text: The note.
    """

    kind: str
    size: float
    text: str

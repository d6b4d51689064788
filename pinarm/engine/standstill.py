"""Loops that all but stop next to a singular position, from which several motions go on: rounding would choose one.

At a singular position motions of several kinds meet, such as those of a parallelogram and of the crossed one. Passed at
some speed it is left on the branch on which it was reached, because velocities tell the branches apart. At rest they
do not, and the least gap of a loop decides: what comes then may be far from the truth and keep its energy nevertheless.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.closure import RANK, Closure
from pinarm.engine.course import Course, Leg

REGULAR, SLOW = 1e-3, 0.07
"""Smallest singular value of the rows, relative to its largest in the run, and speed, relative to the largest, below
which both a motion is not determined. A parallelogram that turns back just beyond its singular position has errors of
order 1 where it passes this at 0.03 of its largest speed, and none at 0.1."""

WITHIN, BLOCK, USUAL = 16, 500, 32
"""Instants within a step that are looked at, steps that are looked at together, and states that tell what is usual."""


@dataclass(frozen=True)
class Standstill:
    """Where a motion is not determined.

    Attributes:
        t: The instant [s].
        regularity: Smallest singular value of the rows there, relative to its largest in the run.
    """

    t: float
    regularity: float


def undetermined_rest(closure: Closure, course: Course) -> Standstill | None:
    """Return the first instant at which a motion is slow next to a singular position.

    It may begin at rest beside one, as long as it is not there to rounding: the start itself tells the branch.

    Args:
        closure: The constraints, and the coordinates that follow laws.
        course: The motion.
    """
    legs = [leg for leg in course.legs if leg.solution.steps]
    if not closure.size or not legs:
        return None
    usual: _Usual | None = None
    for t, q, least in _slow(legs, closure.scale()):
        usual = usual or _Usual.of(closure, legs)
        regularity = usual.regularity(q)
        if regularity < least:
            return Standstill(t, regularity)
    return None


def _slow(legs: Sequence[Leg], scale: Array) -> Iterator[tuple[float, Array, float]]:
    """Yield instants at which a motion is slow, the configurations, and how regular they have to be at least."""
    starts = [np.array([step.t for step in leg.solution.steps]) for leg in legs]
    paces = [_states(leg, t, np.arange(len(t)), scale) for leg, t in zip(legs, starts, strict=True)]
    limit, since = SLOW * max(float(speed.max()) for _, speed in paces), -np.inf
    (q, speed), t = paces[0], starts[0]
    if limit and not speed[0]:
        yield float(t[0]), q[0], RANK
        since = float(min(t[speed >= limit], default=np.inf))
    for leg, t in zip(legs, starts, strict=True):
        for first in range(0, len(t), BLOCK):
            index = np.repeat(np.arange(first, min(first + BLOCK, len(t))), WITHIN)
            h = np.array([step.until - step.t for step in leg.solution.steps[first : first + BLOCK]])
            instants = t[index] + np.repeat(h, WITHIN) * np.tile(np.linspace(0.0, 1.0, WITHIN), len(h))
            q, speed = _states(leg, instants, index, scale)
            for k in np.flatnonzero((speed < limit) & (instants >= since)):
                yield float(instants[k]), q[k], REGULAR


def _states(leg: Leg, t: Array, index: Indices, scale: Array) -> tuple[Array, Array]:
    """Return configurations, shape (n, nq), and speeds, shape (n,), at instants within the steps of given indices."""
    q, v = leg.system.whole(t, *leg.solution.states_in(index, t))
    return q, np.linalg.norm(v / scale, axis=1)


@dataclass(frozen=True, eq=False)
class _Usual:
    """How regular a mechanism usually is.

    Attributes:
        closure: Its constraints.
        rank: Rank of their rows.
        value: Largest value that the smallest singular value of so many rows has in a run.
    """

    closure: Closure
    rank: int
    value: float

    @classmethod
    def of(cls, closure: Closure, legs: Sequence[Leg]) -> _Usual:
        """Return what some states of a motion tell."""
        found = []
        for leg in legs:
            t = np.linspace(leg.solution.steps[0].t, leg.solution.end, USUAL)
            found += [closure.singular_values(q) for q in leg.system.whole(t, *leg.solution.states(t))[0]]
        values = np.array(found)
        rank = int((values > RANK * values[:, :1]).sum(axis=1).max())
        return cls(closure, rank, float(values[:, rank - 1].max()))

    def regularity(self, q: Array) -> float:
        """Return the smallest singular value at a configuration, relative to the usual one."""
        return float(self.closure.singular_values(q)[self.rank - 1] / self.value)

"""Loops that all but stop next to a singular position, from which several motions go on: rounding would choose one.

At a singular position motions of several kinds meet, such as those of a parallelogram and of the crossed one. Passed at
some speed it is left on the branch on which it was reached, because velocities tell the branches apart. At rest they
do not, and the least gap of a loop decides: what comes then may be far from the truth and keep its energy nevertheless.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pinarm.arrays import Array, Indices, distinct
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import RANK
from pinarm.engine.motion.segmented.segments import MotionSegment, SegmentedMotion
from pinarm.records import Record, ValueRecord

REGULAR, SLOW = 1e-3, 0.07
"""Smallest singular value of the rows, relative to its largest in the run, and speed, relative to the largest near it,
below which both a motion is not determined. A parallelogram that turns back just beyond its singular position has
errors of order 1 where it passes this at 0.03 of its largest speed, and none at 0.1."""

NEAR = 2.0
"""Way of all joints [rad] on both sides within which speeds are compared. A heavy rocker turns its crank many times as
fast beside its dead points as in the singular position, which it passes at a speed that its masses keep."""

WITHIN, BLOCK, USUAL = np.linspace(0.0, 1.0, 16), 500, 8
"""Places within a step that are looked at, steps that are looked at together, and states that tell what is usual."""

TOGETHER = 200
"""Velocities of the configurations whose regularity is computed at once: many are skipped, of which it is in vain."""

MARGIN = 1.5
"""How much larger than it is the least speed within a step is estimated at most."""

STILL = 1e-9
"""Speed of a part, relative to that of the fastest, up to which rounding moves it: it stays where it is."""

AHEAD = 0.25
"""How far a mechanism moves before it may have become singular, over its regularity [rad]: four-bars take 1."""


class UndeterminedRest(ValueRecord, frozen=True):
    """Where a motion is not determined.

    Attributes:
        t: The instant [s].
        regularity: Smallest singular value of the rows there, relative to its largest in the run.
    """

    t: float
    regularity: float


def undetermined_rest(closure: Closure, motion: SegmentedMotion) -> UndeterminedRest | None:
    """Return the first instant at which a motion is slow next to a singular position.

    Loops that share no joint are looked at one by one: what else moves tells nothing of their branches. A motion may
    begin at rest beside a singular position, as long as it is not there to rounding: the start itself tells the branch.

    Args:
        closure: The constraints, and the coordinates that follow laws.
        motion: The motion.
    """
    segments = [segment for segment in motion.segments if segment.solution.steps]
    parts, scale = closure.parts, closure.scale
    if not parts or not segments:
        return None
    paces = [_Pace.of(segment, scale, [joints for joints, _ in parts]) for segment in segments]
    fastest = np.max([pace.speed.max(axis=0) for pace in paces], axis=0)
    rank, found = _rank_of(segments), list[UndeterminedRest]()
    for part in np.flatnonzero(fastest > STILL * fastest.max(initial=0.0)).tolist():
        own = closure if len(parts) == 1 else Closure.of(closure.model, parts[part][1])
        rest = _rest_of(own, paces, part, float(fastest[part]), rank)
        found += [rest] if rest else []
    return min(found, key=lambda rest: rest.t, default=None)


def _rest_of(closure: Closure, paces: Sequence[_Pace], part: int, fastest: float, rank: int) -> UndeterminedRest | None:
    """Return the first instant at which one part, of given constraints and largest speed, is slow next to one."""
    segments = [pace.segment for pace in paces]
    usual, looked = None, -np.inf
    some = max(1, TOGETHER // closure.model.nv)
    for times, q, least in _slow(paces, part, fastest, rank):
        while (ahead := int(times.searchsorted(looked))) < len(times):
            some_of = slice(ahead, ahead + some)
            usual, found = usual.also(q[some_of]) if usual else _Usual.of(closure, segments, q[some_of])
            for t, regularity in zip(times[some_of].tolist(), found.tolist(), strict=True):
                if t < looked:
                    continue
                if regularity < least:
                    return UndeterminedRest(t, regularity)
                looked = t + AHEAD * regularity / fastest
            times, q = times[ahead + some :], q[ahead + some :]
    return None


class _Pace(Record, frozen=True):
    """How fast the k parts of a mechanism are at the ends of the steps of a segment.

    Attributes:
        segment: The segment.
        scale: Unit of every velocity, shape (nv,).
        parts: Places of the velocities of every part.
        t: Starts of its steps, shape (n,).
        q: Configuration at its start, shape (nq,).
        speed: Speeds at the starts, shape (n, k).
        least: About the least speed within each step, shape (n, k).
    """

    segment: MotionSegment
    scale: Array
    parts: Sequence[Indices]
    t: Array
    q: Array
    speed: Array
    least: Array

    @classmethod
    def of(cls, segment: MotionSegment, scale: Array, parts: Sequence[Indices]) -> _Pace:
        """Return that of a segment."""
        steps, nq = segment.solution.steps, segment.solution.manifold.nq
        t = np.append(steps.t, steps.until[-1])
        y = np.concatenate([steps.y, segment.solution.last[None]])
        q, v = segment.system.whole(t, y[:, :nq], y[:, nq:])
        v = v / scale
        speed = np.sqrt(_of_parts(v * v, parts))
        if q.shape == v.shape:
            mean = (q[1:] - q[:-1]) / ((t[1:] - t[:-1])[:, None] * scale)
            least = _least(v[:-1], mean, v[1:], parts)
        else:  # half of the smaller one at its ends; 0 where the direction changes much
            along = _of_parts(v[:-1] * v[1:], parts) > 0.5 * speed[:-1] * speed[1:]
            least = np.where(along, 0.5 * np.minimum(speed[:-1], speed[1:]), 0.0)
        return cls(segment, scale, parts, t[:-1], q[0], speed[:-1], least)

    def within(self, steps: Indices, part: int) -> tuple[Array, Array, Array]:
        """Return instants within the steps of given indices, configurations and speeds of a part there."""
        h = self.segment.solution.steps.until[steps] - self.t[steps]
        t = (self.t[steps][:, None] + h[:, None] * WITHIN).ravel()
        q, v = self.segment.system.whole(t, *self.segment.solution.states_in(steps.repeat(len(WITHIN)), t))
        return t, q, np.linalg.norm((v / self.scale)[:, self.parts[part]], axis=1)


def _of_parts(terms: Array, parts: Sequence[Indices]) -> Array:
    """Return the sums of terms, shape (.., nv), over the velocities of k parts, shape (.., k)."""
    starts = np.cumsum([0, *(len(joints) for joints in parts)])[:-1]
    return np.asarray(np.add.reduceat(terms[..., np.concatenate(parts)], starts, axis=-1))


def _least(first: Array, mean: Array, last: Array, parts: Sequence[Indices]) -> Array:
    """Return the least speed of parabolas through velocities at both ends, with given means, each of shape (n, nv)."""
    x = WITHIN[:, None, None]
    v = first * (1.0 - x) + last * x + (6.0 * mean - 3.0 * (first + last)) * (x * (1.0 - x))
    return np.asarray(np.sqrt(_of_parts(v * v, parts).min(axis=0)))


def _slow(paces: Sequence[_Pace], part: int, fastest: float, rank: int) -> Iterator[tuple[Array, Array, float]]:
    """Yield instants at which a part is slow, shape (n,), the configurations, and how regular these are at least.

    Where it is not known to be clear of singular positions anyway, with the rank that the constraints have in the run.
    """
    first, since, clear = paces[0], -np.inf, (True, rank)
    candidates = [np.flatnonzero(pace.least[:, part] < MARGIN * SLOW * fastest) for pace in paces]
    some = [steps[[pace.segment.solution.outlook(k) != clear for k in steps.tolist()]]
            for pace, steps in zip(paces, candidates, strict=True)]  # fmt: skip
    if not any(len(steps) for steps in some):
        return
    limits = [SLOW * near for near in _fastest_near(paces, part)]
    if fastest and not first.speed[0, part]:
        if first.segment.solution.outlook(0) != clear:
            yield first.t[:1], first.q[None], RANK
        since = float(min(first.t[first.speed[:, part] >= limits[0][0]], default=np.inf))
    for pace, steps, limit in zip(paces, some, limits, strict=True):
        slowing = (pace.least[steps, part] < MARGIN * limit[steps]) & (np.append(pace.t[1:], np.inf)[steps] > since)
        steps = steps[slowing]
        for start in range(0, len(steps), BLOCK):
            block = steps[start : start + BLOCK]
            t, q, speed = pace.within(block, part)
            slow = (speed < limit[block].repeat(len(WITHIN))) & (t >= since)
            yield t[slow], q[slow], REGULAR


def _fastest_near(paces: Sequence[_Pace], part: int) -> list[Array]:
    """Return the largest speed of a part near every step, and one step beyond, of each segment, shape (n,)."""
    speed = np.concatenate([pace.speed[:, part] for pace in paces])
    lasting = np.concatenate([pace.segment.solution.steps.until - pace.t for pace in paces])
    way = np.append(0.0, np.cumsum(0.5 * (speed + np.append(speed[1:], speed[-1])) * lasting)[:-1])
    begin = np.maximum(way.searchsorted(way - NEAR) - 1, 0)
    end = np.minimum(way.searchsorted(way + NEAR, side="right") + 1, len(way))
    largest, found = speed, np.empty_like(speed)  # of 2^k steps from each on
    for k in range(len(speed).bit_length()):
        size = 2**k
        here = (end - begin >= size) & (end - begin < 2 * size)
        found[here] = np.maximum(largest[begin[here]], largest[end[here] - size])
        largest = np.maximum(largest[: max(len(largest) - size, 0)], largest[size:])
    return np.split(found, np.cumsum([len(pace.t) for pace in paces])[:-1])


def _rank_of(segments: Sequence[MotionSegment]) -> int:
    """Return the rank of the constraints if all segments tell the same one, which never falls along them; or -1."""
    ranks = {segment.solution.outlook(len(segment.solution.steps) - 1)[1] for segment in segments}
    return ranks.pop() if len(ranks) == 1 else -1


class _Usual(Record, frozen=True):
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
    def of(cls, closure: Closure, segments: Sequence[MotionSegment], q: Array) -> tuple[_Usual, Array]:
        """Return what starts of steps tell: within steps redundant rows tear, and seem independent.

        And how regular n further configurations are, shape (n, nq), which are looked at together with these.
        """
        found = []
        for segment in segments:
            steps, nq = segment.solution.steps, segment.solution.manifold.nq
            some = distinct(np.linspace(0, len(steps) - 1, USUAL).astype(int))
            t, y = steps.t[some], steps.y[some]
            found.append(segment.system.whole(t, y[:, :nq], y[:, nq:])[0])
        begun = np.concatenate(found)
        values, further = np.split(closure.values(np.concatenate([begun, q])), [len(begun)])
        rank = closure.rank(values)
        usual = cls(closure, rank, float(values[:, rank - 1].max()) if rank else 1.0)
        return usual, usual._relative(further)

    def also(self, q: Array) -> tuple[_Usual, Array]:
        """Return itself, and how regular n further configurations are."""
        return self, self._relative(self.closure.values(q))

    def _relative(self, values: Array) -> Array:
        """Return the smallest singular value of each configuration, relative to the usual one, shape (n,)."""
        return values[:, self.rank - 1] / self.value if self.rank else np.ones(len(values))

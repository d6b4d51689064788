"""Loops that all but stop next to a singular position, from which several motions go on: rounding would choose one.

At a singular position motions of several kinds meet, such as those of a parallelogram and of the crossed one. Passed at
some speed it is left on the branch on which it was reached, because velocities tell the branches apart. At rest they
do not, and the least gap of a loop decides: the motion after may be far from the truth and yet keep its energy.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import RANK
from pinarm.engine.motion.segmented.segments import MotionSegment, SegmentedMotion
from pinarm.records import ValueRecord

REGULAR, SLOW = 1e-3, 0.07
"""Smallest singular value of the rows, relative to its largest in the run, and speed, relative to the largest near it,
below which both a motion is not determined. A parallelogram that turns back just beyond its singular position has
errors of order 1 where it passes this at 0.03 of its largest speed, and none at 0.1."""

NEAR = 2.0
"""Way of all joints [rad] on both sides within which speeds are compared. A heavy rocker turns its crank many times as
fast beside its dead points as in the singular position, which it passes at a speed that its masses keep."""

WITHIN = np.linspace(0.0, 1.0, 16)
"""Places within a slow step that are looked at."""

USUAL = 16
"""States that tell how regular the loops usually are."""

STILL = 1e-9
"""Speed of a part, relative to that of the fastest, up to which rounding moves it: it stays where it is."""


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

    Loops that share no joint are looked at one by one: other parts tell nothing of their branches. A motion may begin
    at rest beside a singular position, but not in one: the start itself tells the branch.

    Args:
        closure: The constraints, and the coordinates that follow laws.
        motion: The motion.
    """
    segments = [segment for segment in motion.segments if segment.solution.steps]
    if not closure.parts or not segments:
        return None
    ends = [_ends(segment) for segment in segments]
    speeds = [
        [np.linalg.norm((v / closure.scale)[:, joints], axis=1) for joints, _ in closure.parts] for _, _, v in ends
    ]
    fastest = np.max([[speed.max() for speed in parts] for parts in speeds], axis=0)
    rests = []
    for part in np.flatnonzero(fastest > STILL * fastest.max(initial=0.0)).tolist():
        joints, constraints = closure.parts[part]
        own = closure if len(closure.parts) == 1 else Closure.of(closure.model, constraints)
        rests += _rests(own, joints, segments, ends, [parts[part] for parts in speeds])
    return min(rests, key=lambda rest: rest.t, default=None)


def _ends(segment: MotionSegment) -> tuple[Array, Array, Array]:
    """Return instants, configurations and velocities at the starts of all steps and at the end of the last."""
    steps, nq = segment.solution.steps, segment.solution.manifold.nq
    t, y = np.append(steps.t, steps.until[-1]), np.concatenate([steps.y, segment.solution.last[None]])
    return t, *segment.system.whole(t, y[:, :nq], y[:, nq:])


def _rests(
    closure: Closure, joints: Indices, segments: Sequence[MotionSegment], ends: Sequence[tuple[Array, Array, Array]],
    speeds: Sequence[Array],
) -> list[UndeterminedRest]:  # fmt: skip
    """Return the first instant at which one part of the mechanism is slow next to a singular position, if any."""
    every = np.concatenate([q for _, q, _ in ends])
    values = closure.values(every[np.linspace(0, len(every) - 1, USUAL).astype(int)])
    if not (rank := closure.rank(values)):
        return []
    usual, since = float(values[:, rank - 1].max()), -np.inf
    limits = [SLOW * near for near in _fastest_near([t for t, _, _ in ends], speeds)]
    if not speeds[0][0]:
        if values[0, rank - 1] < RANK * usual:
            return [UndeterminedRest(float(ends[0][0][0]), float(values[0, rank - 1] / usual))]
        since = float(ends[0][0][speeds[0] >= limits[0]].min(initial=np.inf))
    for segment, (t, _, v), speed, limit in zip(segments, ends, speeds, limits, strict=True):
        slowing = _slow(v[:, joints] / closure.scale[joints], speed, limit) & (t[1:] > since)
        near = [k for k in np.flatnonzero(slowing).tolist() if not segment.solution.outlook(k)[0]]
        if not near:
            continue
        steps = np.array(near)
        times = (t[steps][:, None] + np.diff(t)[steps][:, None] * WITHIN).ravel()
        q, rates = segment.system.whole(times, *segment.solution.states_in(steps.repeat(len(WITHIN)), times))
        slow = np.linalg.norm((rates / closure.scale)[:, joints], axis=1) < limit[steps].repeat(len(WITHIN))
        slow &= times >= since
        regular = closure.values(q[slow])[:, rank - 1] / usual
        if (regular < REGULAR).any():
            first = int((regular < REGULAR).argmax())
            return [UndeterminedRest(float(times[slow][first]), float(regular[first]))]
    return []


def _slow(v: Array, speed: Array, limit: Array) -> Flags:
    """Tell which steps may fall below a limit: at an end they do nearly, or their direction changes much.

    Args:
        v: Velocities of one part at the ends of the steps, shape (n + 1, k).
        speed: Their size, shape (n + 1,).
        limit: Shape (n + 1,).
    """
    least, turned = np.minimum(speed[:-1], speed[1:]), np.vecdot(v[:-1], v[1:]) < 0.5 * speed[:-1] * speed[1:]
    return np.asarray((least < 3.0 * limit[:-1]) | turned)


def _fastest_near(times: Sequence[Array], speeds: Sequence[Array]) -> list[Array]:
    """Return the largest speed within ``NEAR`` of every end of a step, in all segments, shape (n + 1,) each."""
    t, speed = np.concatenate(times), np.concatenate(speeds)
    way = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))
    begin = np.maximum(way.searchsorted(way - NEAR) - 1, 0)
    end = np.minimum(way.searchsorted(way + NEAR, side="right") + 1, len(way))
    places = np.stack([begin, end], axis=1).ravel()
    largest = np.maximum.reduceat(np.append(speed, 0.0), places)[::2]
    return np.split(largest, np.cumsum([len(part) for part in speeds])[:-1])

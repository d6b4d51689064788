"""Motions that are refused: those that rest next to a singular position, and angles that leap where something acts.

At a singular position motions of several kinds meet, such as those of a parallelogram and of the crossed one. Passed at
some speed it is left on the branch on which it was reached. At rest rounding would choose one, and keep the energy.

An angle of a loop in space that no joint counts leaps by a turn at 180 deg, a rotation vector leaps at half a turn, and
roll and yaw of a ball joint leap by half a turn at a pitch of 90 deg: springs, drives and controllers with them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import joint_ties
from pinarm.engine.constraints.nullspace import RANK
from pinarm.errors import DynamicsError
from pinarm.mechanics.ball_joints import BallAngle, BallCoordinate, roll_pitch_yaw
from pinarm.mechanics.coordinates import Coordinate, PairCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.pairs import RotationVectorRow
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.segmented.segments import MotionSegment, SegmentedMotion
    from pinarm.mechanics.control.controller import Controller
    from pinarm.mechanics.coordinates import Constraint
    from pinarm.mechanics.forces.force_element import ForceElement

REGULAR, SLOW = 1e-3, 0.07
"""Smallest singular value of the rows, relative to its largest in the run, and speed, relative to the largest near it,
below which both a motion is not determined. A parallelogram that turns back just beyond its singular position has
errors of order 1 where it passes this at 0.03 of its largest speed, and none at 0.1."""

NEAR = 2.0
"""Way of all joints [rad] on both sides within which speeds are compared: a heavy rocker turns its crank many times as
fast beside its dead points."""

WITHIN, USUAL = np.linspace(0.0, 1.0, 16), 16
"""Places within a slow step that are looked at; and states that tell how regular the loops usually are."""

STILL = 1e-9
"""Speed of a part, relative to that of the fastest, up to which it is at rest but for rounding."""

PARTS, TURN = 8, 2.0 * np.pi
"""Parts of a step that are looked at: within one a motion that steps resolve turns by much less than a quarter."""


class UndeterminedRest(NamedTuple):
    """The instant at which a motion is not determined [s], and the regularity there, relative to its largest."""

    t: float
    regularity: float


def undetermined_rest(closure: Closure, motion: SegmentedMotion) -> UndeterminedRest | None:
    """Return the first instant at which a motion is slow next to a singular position.

    Loops that share no joint are looked at one by one. A motion may begin at rest beside a singular position, but not
    in one: the start itself tells the branch. ``closure`` has the constraints, and the coordinates that follow laws.
    """
    segments = [segment for segment in motion.segments if segment.solution.steps]
    if not closure.parts or not any(interval.near() for part in segments for interval in part.solution.intervals):
        return None
    ends = [_ends(segment) for segment in segments]
    q, v = (np.concatenate([state[k] for state in ends]) for k in (1, 2))
    speeds = [np.linalg.norm((v / closure.scale)[:, joints], axis=1) for joints, _ in closure.parts]
    fastest, rests = max(float(speed.max()) for speed in speeds), list[UndeterminedRest]()
    for (joints, constraints), speed in zip(closure.parts, speeds, strict=True):
        own = closure if len(closure.parts) == 1 else Closure.of(closure.model, constraints)
        values = own.values(q[np.linspace(0, len(q) - 1, USUAL).astype(int)])
        rank = own.rank(values)
        if rank and speed.max() > STILL * fastest:
            rests += _rests(own, (joints, rank, float(values[:, rank - 1].max())), segments, ends, speed)
    return min(rests, default=None)


def _ends(segment: MotionSegment) -> tuple[Array, Array, Array]:
    """Return instants, configurations and velocities at the starts of all steps and at the end of the last."""
    steps, nq = segment.solution.steps, segment.solution.manifold.nq
    t, y = np.append(steps.t, steps.until[-1]), np.concatenate([steps.y, segment.solution.last[None]])
    return t, *segment.system.whole(t, y[:, :nq], y[:, nq:])


def _rests(
    closure: Closure,
    part: tuple[Indices, int, float],
    segments: Sequence[MotionSegment],
    ends: Sequence[tuple[Array, Array, Array]],
    speed: Array,
) -> list[UndeterminedRest]:
    """Return the first instant at which one part of the mechanism is slow next to a singular position, if any."""
    (joints, rank, usual), since = part, -np.inf
    cuts = np.cumsum([len(t) for t, _, _ in ends])[:-1]
    limits = np.split(SLOW * _fastest_near(np.concatenate([t for t, _, _ in ends]), speed), cuts)
    speeds = np.split(speed, cuts)
    if not speed[0]:
        if (regularity := float(closure.values(ends[0][1][:1])[0, rank - 1] / usual)) < RANK:
            return [UndeterminedRest(float(ends[0][0][0]), regularity)]
        since = float(ends[0][0][speeds[0] >= limits[0]].min(initial=np.inf))
    for segment, (t, _, v), own, limit in zip(segments, ends, speeds, limits, strict=True):
        along = v[:, joints] / closure.scale[joints]
        turned = np.vecdot(along[:-1], along[1:]) < 0.5 * own[:-1] * own[1:]
        slowing = ((np.minimum(own[:-1], own[1:]) < 3.0 * limit[:-1]) | turned) & (t[1:] > since)
        if not slowing.any():
            continue
        index = np.flatnonzero(slowing).repeat(len(WITHIN))
        times = t[index] + np.diff(t)[index] * np.tile(WITHIN, np.count_nonzero(slowing))
        q, rates = segment.system.whole(times, *segment.solution.states_in(index, times))
        slow = np.linalg.norm((rates / closure.scale)[:, joints], axis=1) < limit[index]
        slow &= times >= since
        regular = closure.values(q[slow])[:, rank - 1] / usual if slow.any() else np.ones(1)
        if (regular < REGULAR).any():
            first = int((regular < REGULAR).argmax())
            return [UndeterminedRest(float(times[slow][first]), float(regular[first]))]
    return []


def _fastest_near(t: Array, speed: Array) -> Array:
    """Return the largest speed within ``NEAR`` of every end of a step, shape (n,)."""
    way = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))
    begin = np.maximum(way.searchsorted(way - NEAR) - 1, 0)
    end = np.minimum(way.searchsorted(way + NEAR, side="right") + 1, len(way))
    places = np.stack([begin, end], axis=1).ravel()
    return np.asarray(np.maximum.reduceat(np.append(speed, 0.0), places)[::2])


POLE = (
    "roll and yaw leap by half a turn where the pitch passes 90 deg",
    "three revolute joints in place of the ball joint",
)
VECTOR = "a rotation vector leaps where it passes half a turn", "a revolute joint, or a reference that is turned"
UNCOUNTED = (
    "it is told from -180 to 180 deg and leaps by a turn there",
    "in the mechanism file: turns: [{angle}], which counts them",
)
BUSHING = (
    "there its frames are half a turn apart, and a bushing acts up to 170 deg",
    "a joint_spring, or a coordinate_spring along an angle whose turns are counted",
)
"""Why an angle leaps, and what to write instead."""


class Acting(NamedTuple):
    """A force, drive or controller along an angle that is known up to half a turn only.

    ``user`` and ``name`` of the angle are for messages; ``counted``: whole turns do not matter, as a joint counts
    them. ``vector`` tells why it leaps where it is part of a rotation vector, and what to write instead.
    """

    user: str
    angle: Coordinate
    name: str = "NAME"
    counted: bool = False
    vector: tuple[str, str] = VECTOR

    def leap(self, before: Kinematics, after: Kinematics) -> tuple[str, str] | None:
        """Return why the angle leaps between two states, and what to write instead; ``None`` where it does not."""
        angle = self.angle
        if isinstance(angle, BallAngle):
            ends = [roll_pitch_yaw(angle.ball.quaternion(state.q))[[0, 2]] for state in (before, after)]
            turned = (ends[1] - ends[0]) / TURN
            if np.abs(turned - np.round(turned)).max() > 0.25:
                return POLE
        elif _is_turn(angle):
            way = np.linalg.norm(_vector(angle, after) - _vector(angle, before))
            return self.vector if way > np.pi else None
        leaps = not self.counted and abs(angle.value(after) - angle.value(before)) > np.pi
        return UNCOUNTED if leaps else None


def acting_on_angles(
    constraints: Iterable[Constraint],
    forces: Mapping[str, ForceElement],
    controllers: Iterable[Controller] = (),
    coordinates: Mapping[str, Coordinate] = MappingProxyType({}),
) -> list[Acting]:
    """Return the forces, drives and controllers that act along an angle that may leap.

    A loop angle whose turns a joint counts does not leap. ``constraints`` include ties of drives and of joints that
    count turns; ``controllers`` are those of a run already built: their functions have named the coordinates they read.
    """
    names_of = {id(coordinate): name for name, coordinate in coordinates.items()}
    acting = [(f"'{name}'", force.coordinate) for name, force in forces.items() if hasattr(force, "coordinate")]
    for controller in controllers:
        names = [name.removeprefix("loop.") for name in getattr(controller, "readers", ())]
        measured = [signal.coordinate for signal in controller.signals if hasattr(signal, "coordinate")]
        measured += [coordinates[name] for name in names if name in coordinates]
        acting += [(f"the controller of {', '.join(controller.drives)}", coordinate) for coordinate in measured]
    angles = [Acting(f"'{tie.name}'", tie.coordinate, counted=tie.coordinate.wraps) for tie in joint_ties(constraints)]
    angles += [Acting(user, angle, names_of.get(id(angle), "NAME")) for user, angle in acting]
    return [some for some in angles if _leaps(some.angle) or (some.angle.wraps and not some.counted)]


def _leaps(angle: Coordinate) -> bool:
    return isinstance(angle, BallCoordinate) or _is_turn(angle)


def _is_turn(angle: Coordinate) -> bool:
    return isinstance(angle, PairCoordinate) and isinstance(angle.way.pair, RotationVectorRow)


def _vector(angle: Coordinate, state: Kinematics) -> Array:
    """Return the rotation vector of which an angle is a component [rad], shape (3,)."""
    assert isinstance(angle, PairCoordinate) and isinstance(angle.way.pair, RotationVectorRow)
    rows = (replace(angle.way, pair=replace(angle.way.pair, component=k)) for k in range(3))
    return np.array([row.gap(state)[0] for row in rows])


def turned_between(forces: Mapping[str, ForceElement], q: Array) -> list[Acting]:
    """Return the bushings whose frames may pass half a turn between two rows of a motion, shape (n, nq)."""
    angles = {name: force.turned_between(q) for name, force in forces.items()}
    return [Acting(f"'{name}'", angle, vector=BUSHING) for name, angle in angles.items() if angle is not None]


def require_turns(
    model: pin.Model, acting: Sequence[Acting], t: Array, q: Array, parameter: str = "t", measured: str = "s"
) -> None:
    """Raise where an angle along which something acts leaps between two of n configurations, shape (n, nq).

    They belong to values t of the parameter, so close that an angle turns by less than a quarter in between.
    """
    states = (Kinematics.at(model, place) for place in q)
    for to, (before, after) in zip(t[1:].tolist(), pairwise(states), strict=True):
        for some in acting:
            if (leap := some.leap(before, after)) is not None:
                raise DynamicsError(
                    f"{some.user} acts along an angle that does not go on at {parameter} = {to:.6g} {measured}: "
                    f"{leap[0]}",
                    expected="an angle that goes on without a leap",
                    hint=leap[1].format(angle=some.name),
                    t=to,
                )


def between(t: Array) -> Array:
    """Return values of a parameter with ``PARTS`` parts between each two, ascending or descending as they are."""
    parts = t[:-1, None] + np.diff(t)[:, None] * (np.arange(PARTS) / PARTS)
    return np.append(parts[np.diff(t) != 0.0].reshape(-1), t[-1:])

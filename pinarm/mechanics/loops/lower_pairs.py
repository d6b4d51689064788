"""Lower pairs and screws: joints whose free motions have fixed directions in frame 1, with their coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import ClassVar, get_args

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.input.yaml.schema import Lead, Pitch
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, PairCoordinate
from pinarm.mechanics.geometry.frame_pairs import Path
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.pairs import (
    ALL,
    NOTHING,
    AngleAbout,
    LowerPair,
    Pair,
    RotationGap,
    TiedFrames,
    angle_about,
    whole_turns,
)
from pinarm.mechanics.geometry.vectors import Axes, combined, dot, rotation_vector
from pinarm.mechanics.joints import METRE, RADIAN, Direction, screw_of, unit_vector
from pinarm.mechanics.loops.loop_joints import LoopDefinition, LoopJoint
from pinarm.records import Record

MEETING, TINY = 1e-8, 1e-300
"""Sine of an angle below which the direction of its axis is rounding; smallest divisor."""


def turned(p: Array, axes: Axes) -> Array:
    """Return ``log R``."""
    return rotation_vector(axes)


def normals(axis: Array) -> Array:
    """Return two unit vectors at right angles to an axis and to each other, shape (2, 3)."""
    least = np.eye(3)[int(np.abs(axis).argmin())]
    across = np.cross(axis, least)
    across /= np.linalg.norm(across)
    return np.array([across, np.cross(axis, across)])


class Tilt(Record, frozen=True):
    """The rotation vector of least length that brings an axis of frame 1 onto the same axis of frame 2.

    Unlike components of ``log R`` it does not change sign where the rotation about the axis passes half a turn.

    Attributes:
        normal: Any unit vector at right angles to it, for frames that are turned over, shape (3,).
    """

    axis: Array
    normal: Array

    def __call__(self, p: Array, axes: Axes) -> Array:
        other = self._turned @ combined(axes, self.axis)
        normal, cosine = other[:3], other[3]
        sine = np.sqrt(dot(normal, normal))
        tilt = normal * (np.arctan2(sine, cosine) / np.maximum(sine, TINY))
        if not (cosine < 0.0).any():
            return np.asarray(tilt)
        over = (sine <= MEETING) & (cosine < 0.0)
        return np.where(over, np.pi * self.normal.reshape(3, *(1,) * (p.ndim - 1)), tilt)

    @cached_property
    def _turned(self) -> Array:
        """From a vector to its product with the axis, ``axis x``, and its component along it, shape (4, 3)."""
        return np.vstack([pin.skew(self.axis), self.axis])


class Thread(Record, frozen=True):
    """The open rotation of a screw.

    Attributes:
        across: Two normals u, v of the axis, with it right-handed, shape (2, 3).
        pitch: h, way per angle [m/rad].
        offset: z where the angle is 0 [m].
    """

    tilt: Tilt
    across: Array
    pitch: float
    offset: float

    def angle(self, p: Array) -> Array:
        """Return the angle that a place asks, whole turns counted: ``(z - offset) / h`` [rad], shape (..)."""
        return np.asarray((self.tilt.axis @ p - self.offset) / self.pitch)

    def __call__(self, p: Array, axes: Axes) -> Array:
        missing = angle_about(self.across, axes) - self.angle(p)
        return self.tilt(p, axes) + np.multiply.outer(self.tilt.axis, missing - whole_turns(missing))


def _directions(count: int, axis: Array) -> Array:
    """Return as many directions: all, two normals of an axis, the axis, or none."""
    return (NOTHING, axis[None], normals(axis), ALL)[count]


class LowerDefinition(LoopDefinition, frozen=True):
    """A lower pair, as files give it.

    Attributes:
        holds: Number of directions in which it holds, and about which: 3 all, 2 across the axis, 1 along it.
    """

    holds: ClassVar[tuple[int, int]]

    def pair(self) -> LowerPair:
        return self.around(ALL[2])

    @classmethod
    def around(cls, axis: Array) -> LowerPair:
        """Return the pair about a unit vector, shape (3,)."""
        held, aligned = (_directions(count, axis) for count in cls.holds)
        e, w = np.vstack([held, np.zeros_like(aligned)]), np.vstack([np.zeros_like(held), aligned])
        rotations: dict[int, RotationGap] = {2: Tilt(axis, normals(axis)[0]), 3: turned}
        return LowerPair(e, w, axis, rotations.get(cls.holds[1]))


class AxisDefinition(LowerDefinition, frozen=True):
    """A lower pair about an axis.

    Attributes:
        axis: The axis, the same in both frames.
    """

    axis: Direction = "z"

    def pair(self) -> LowerPair:
        return self.around(unit_vector(self.axis))


class Fixed(LowerDefinition, frozen=True, tag_field="kind", tag="fixed"):
    """The frames coincide."""

    holds: ClassVar[tuple[int, int]] = 3, 3


class Revolute(AxisDefinition, frozen=True, tag_field="kind", tag="revolute"):
    """The frames turn against each other about a common axis; the origins coincide."""

    holds: ClassVar[tuple[int, int]] = 3, 2


class Prismatic(AxisDefinition, frozen=True, tag_field="kind", tag="prismatic"):
    """Frame 2 slides along an axis without turning."""

    holds: ClassVar[tuple[int, int]] = 2, 3


class Cylindrical(AxisDefinition, frozen=True, tag_field="kind", tag="cylindrical"):
    """Frame 2 slides along an axis and turns about it."""

    holds: ClassVar[tuple[int, int]] = 2, 2


class Spherical(LowerDefinition, frozen=True, tag_field="kind", tag="spherical"):
    """A ball joint: the origins coincide."""

    holds: ClassVar[tuple[int, int]] = 3, 0


class Planar(AxisDefinition, frozen=True, tag_field="kind", tag="planar"):
    """Two planes slide on each other; the axis is their normal."""

    holds: ClassVar[tuple[int, int]] = 1, 2


class PointOnLine(AxisDefinition, frozen=True, tag_field="kind", tag="point_on_line"):
    """The origin of frame 2 stays on a line through that of frame 1."""

    holds: ClassVar[tuple[int, int]] = 2, 0


class Pin(AxisDefinition, frozen=True, tag_field="kind", tag="pin"):
    """A pin of a mechanism that moves in a plane: frame 2 turns about the axis, on which the two origins stay.

    It holds what ``point_on_line`` holds, the place in the plane alone, so that a planar loop is not hyperstatic. It
    has the angle of a ``revolute`` joint, with its friction, springs and drives.
    """

    holds: ClassVar[tuple[int, int]] = 2, 0


class PointOnPlane(AxisDefinition, frozen=True, tag_field="kind", tag="point_on_plane"):
    """The origin of frame 2 stays in a plane through that of frame 1; the axis is its normal."""

    holds: ClassVar[tuple[int, int]] = 1, 0


LowerKind = Fixed | Revolute | Prismatic | Cylindrical | Spherical | Planar | PointOnLine | Pin | PointOnPlane
"""Kinds that need at most an axis. A new one is one class above and one entry here."""


class Helical(LoopDefinition, frozen=True, tag_field="kind", tag="screw", kw_only=True):
    """Frame 2 slides along an axis by ``lead`` per turn about it.

    The place z of frame 2 along the axis counts the turns: ``z = offset + lead * angle / (2 pi)`` for any number of
    them. Placements tell the angle but for whole turns, so a nut may sit on its thread in places that are whole leads
    apart. It begins in the one that is nearest to the start, as with any assembly, and stays on it.

    Attributes:
        lead: Way per turn [m]; positive for a right-handed thread.
        axis: The common axis, the same in both frames.
        offset: z where the frames have the same axes [m].
    """

    lead: Pitch
    axis: Direction = "z"
    offset: Lead = 0.0

    def pair(self) -> LowerPair:
        """Return the constraints: two distances, two angles, and ``z' - h omega_z = 0`` with h = lead / (2 pi)."""
        axis, pitch = unit_vector(self.axis), float(self.lead) / (2.0 * np.pi)
        across, nothing = normals(axis), np.zeros((2, 3))
        e, w = np.vstack([across, nothing, axis]), np.vstack([nothing, across, -pitch * axis])
        return LowerPair(e, w, axis, Thread(Tilt(axis, across[0]), across, pitch, float(self.offset)))


def looser(pair: Pair) -> list[tuple[str, Array]]:
    """Return the kinds about the same axis whose rows are fewer than those of a lower pair, and follow from them.

    With each what the pair gives up that is replaced by it, as directions of its m multipliers, shape (m, c): the rows
    of the other are ``A`` times its own, so that it holds ``A^T mu``, and c directions are at right angles to these. A
    ``pin`` is left out: it holds what ``point_on_line`` does.
    """
    if not isinstance(pair, LowerPair):
        return []
    own, kinds = np.hstack([pair.e, pair.w]), []
    for kind in (kind for kind in get_args(LowerKind) if kind is not Pin):
        other = kind.around(pair.axis)
        rows = np.hstack([other.e, other.w])
        combined = np.linalg.lstsq(own.T, rows.T, rcond=None)[0]
        if len(rows) < len(own) and np.abs(rows - combined.T @ own).max() < 1e-9:
            given_up = np.linalg.qr(combined, mode="complete")[0][:, len(rows) :]
            kinds.append((str(kind.__struct_config__.tag), given_up))
    return kinds


PARALLEL = 1e-9
"""Sine of the angle between axes that are parallel but for rounding."""

TURNING = ("revolute", "pin", "cylindrical", "planar", "screw")
"""Kinds with a coordinate ``angle``, about their axis."""
SLIDING = ("prismatic", "cylindrical", "screw", "point_on_line")
"""Kinds with a coordinate ``position``, along their axis."""


class TurnedAbout(PairCoordinate, frozen=True):
    """Angle of frame 2 against frame 1 about the axis of a loop joint.

    Turns are counted where something says how many there are: the place along a screw, or, where all joints between the
    frames turn about parallel axes, the sum of their angles. Elsewhere it is from -pi to pi.

    Attributes:
        turns: Sum of the angles of the joints between the frames, which tells the turns; ``None`` where it does not.
        offset: What the angle is more than that, but for whole turns [rad].
    """

    turns: LinearCoordinate | None = None
    offset: float = 0.0
    threaded: bool = False

    @property
    def wraps(self) -> bool:  # type: ignore[override]
        return self.turns is None and not self.threaded

    @property
    def turning(self) -> TurnedAbout:
        return self

    def missing_turns(self, angle: Array, q: Array) -> Array:
        counted = angle if self.turns is None else self.turns.at(q) + self.offset
        return whole_turns(counted - angle)


def loop_coordinates(model: pin.Model, loops: Sequence[LoopJoint]) -> dict[str, Coordinate]:
    """Return the coordinates of loop joints that have an axis: ``L.angle`` and ``L.position``."""
    return {name: coordinate for loop in loops for name, coordinate in _own(model, loop).items()}


def _own(model: pin.Model, loop: LoopJoint) -> Mapping[str, Coordinate]:
    pair, own, nothing = loop.pair, dict[str, Coordinate](), np.zeros(3)
    if not isinstance(pair, LowerPair):
        return own
    if loop.kind in TURNING:
        thread = pair.rotation if isinstance(pair.rotation, Thread) else None
        about = LowerPair.row(
            nothing, pair.axis, AngleAbout(pair.axis, normals(pair.axis), thread.angle if thread else None)
        )
        way = TiedFrames(loop.first, loop.second, about)
        turns, offset = (None, 0.0) if thread else _counting(model, way, pair.axis)
        own[f"{loop.name}.angle"] = TurnedAbout(way, RADIAN, loop.name, turns, offset, thread is not None)
    if loop.kind in SLIDING:
        way = TiedFrames(loop.first, loop.second, LowerPair.row(pair.axis, nothing))
        own[f"{loop.name}.position"] = PairCoordinate(way, METRE, loop.name)
    return own


def _counting(model: pin.Model, way: TiedFrames, axis: Array) -> tuple[LinearCoordinate | None, float]:
    """Return the sum of the joint angles between the frames that counts the turns, and what it misses at q = 0."""
    state = Kinematics.at(model, pin.neutral(model))
    axis = state.data.oMf[way.first].rotation @ axis
    weights, places = np.zeros(model.nv), np.zeros(model.nv, dtype=np.intp)
    for index, sense in Path.between(model, way.first, way.second).senses:
        joint, screw = model.joints[index], screw_of(model.joints[index])
        if screw is None:
            return None, 0.0
        turns, own = screw
        along = state.data.oMi[index].rotation @ own
        if turns and np.linalg.norm(np.cross(along, axis)) > PARALLEL:
            return None, 0.0
        weights[joint.idx_v] = sense * round(float(along @ axis)) if turns else 0.0
        places[joint.idx_v] = joint.idx_q
    return LinearCoordinate(RADIAN, weights, places), float(way.gap(state)[0])

"""Loop joints: joints of any kind between two links that the tree has already joined another way.

With frame 1 on the first link and frame 2 on the second, ``p`` is the place of frame 2's origin and R its orientation,
both seen from frame 1, and ``omega`` the angular velocity of 2 in 1. A row of the constraint is
``e . p' + w . omega = 0``, with a direction e of translation and a direction w of rotation, in the axes of frame 1. Its
multiplier lam is a force ``lam e`` at the origin of frame 2 and a moment ``lam w``, of the first link on the second.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.schema import Model, Span
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import METRE, RADIAN, Direction, frame_of, unit_vector
from pinarm.mechanics.vectors import MEETING, Axes, combined, cross, direction, dot, rotation_vector

LOCAL = pin.ReferenceFrame.LOCAL


class Pair(Protocol):
    """What a kind of joint allows between its two frames, in one configuration or in n of them.

    All vectors are in the axes of frame 1; (..) stands for nothing or for n. ``axes`` are those of frame 2. Rows that
    measure lengths come first, then those that measure angles.
    """

    @property
    def size(self) -> int:
        """Number m of rows."""
        ...

    @property
    def lengths(self) -> int:
        """Number k of rows that measure lengths."""
        ...

    @property
    def points(self) -> Array | None:
        """Points that coincide in both frames and say the same as the rows, shape (k, 3); none if no points can."""
        ...

    def gap(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return what is not closed: lengths [m], shape (k, ..), and angles [rad], shape (m - k, ..)."""
        ...

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return the directions e of the lengths, shape (k, 3, ..), and w of the angles, shape (m - k, 3, ..).

        Without their last axis where they are the same in all configurations.
        """
        ...

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> tuple[Array, Array]:
        """Return what the change of the directions does: ``e' . p'``, shape (k, ..), and ``w' . omega``, likewise."""
        ...


def _zeros(rows: int, p: Array) -> Array:
    """Return zeros for some rows, shape (rows,), or (rows, 1) for many configurations."""
    return np.zeros((rows, 1)[: p.ndim])


@dataclass(frozen=True)
class LowerPair:
    """A joint whose free motions have fixed directions in frame 1, as all the lower pairs have.

    Attributes:
        held: Directions in which the origins stay together, shape (k, 3).
        aligned: Directions about which the frames do not turn against each other, shape (l, 3), l = 0, 2 or 3.
        axis: The common axis where l = 2, shape (3,).
        points: See ``Pair``.
    """

    held: Array
    aligned: Array
    axis: Array
    points: Array | None = None

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.held) + len(self.aligned)

    @property
    def lengths(self) -> int:
        """Number of rows that measure lengths."""
        return len(self.held)

    def gap(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return the open distances and the angles.

        Two angles are those of the cross product of the axes, scaled to the full angle, which unlike components of
        ``log R`` does not change sign where the free rotation passes half a turn.
        """
        if not len(self.aligned):
            return self.held @ p, _zeros(0, p)
        if len(self.aligned) == 3:
            return self.held @ p, self.aligned @ rotation_vector(axes)
        other = combined(axes, self.axis)
        across, cosine = self.aligned @ cross(self.axis, other), self.axis @ other
        sine = np.sqrt((across * across).sum(axis=0))
        meeting = sine <= 1e-8
        full = np.where(meeting, 1.0, np.arctan2(sine, cosine) / np.where(meeting, 1.0, sine))
        return self.held @ p, np.where(meeting & (cosine < 0.0), np.pi, across * full)  # turned over, about any axis

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return the constant directions."""
        return self.held, self.aligned

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> tuple[Array, Array]:
        """Return zeros."""
        return _zeros(len(self.held), p), _zeros(len(self.aligned), p)


@dataclass(frozen=True)
class Cross:
    """A universal joint: the origins stay together, an axis of frame 1 and one of frame 2 stay at right angles.

    Attributes:
        first: Axis in frame 1, shape (3,).
        second: Axis in frame 2, shape (3,).
    """

    first: Array
    second: Array
    size: int = 4
    lengths: int = 3
    points: Array | None = None

    def gap(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return the distance, and the angle by which the axes miss a right one."""
        return p, np.arcsin(np.clip(self.first @ combined(axes, self.second), -1.0, 1.0))[None]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return the directions; rotation is held about the normal of both axes."""
        return np.eye(3), cross(combined(axes, self.second), self.first)[None]

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> tuple[Array, Array]:
        """Return what the turning of the second axis does."""
        turning = cross(cross(omega, combined(axes, self.second)), self.first)
        return _zeros(3, p), dot(turning, omega)[None]


@dataclass(frozen=True)
class Tie:
    """A rod without mass, ball joints at both ends.

    Attributes:
        length: [m].
    """

    length: float
    size: int = 1
    lengths: int = 1
    points: Array | None = None

    def gap(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return by how much the distance differs from the length."""
        return (np.sqrt(dot(p, p)) - self.length)[None], _zeros(0, p)

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return the direction of the rod."""
        return direction(p)[None], NOTHING

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> tuple[Array, Array]:
        """Return the centripetal term ``(|p'|^2 - (u . p')^2) / |p|``."""
        along = dot(direction(p), dp)
        return ((dot(dp, dp) - along * along) / np.maximum(np.sqrt(dot(p, p)), MEETING))[None], _zeros(0, p)


@dataclass(frozen=True, eq=False)
class LoopJoint:
    """A loop joint of one mechanism, ready for evaluation.

    Attributes:
        name: Its name.
        kind: Its kind, as files call it.
        first: Index of frame 1.
        second: Index of frame 2.
        pair: What the joint allows.
    """

    name: str
    kind: str
    first: int
    second: int
    pair: Pair = field(repr=False)

    @property
    def size(self) -> int:
        """Number m of rows."""
        return self.pair.size

    def unit(self, row: int) -> Unit:
        """Return the unit of the gap in a row: m or rad."""
        return METRE if row < self.pair.lengths else RADIAN

    def gap(self, data: pin.Data, q: Array) -> Array:
        """Return what is not closed [m or rad], shape (m,); the placements of frames in ``data`` are those of q."""
        return np.concatenate(self.pair.gap(*_placed(data.oMf[self.first], data.oMf[self.second])))

    def rows(self, model: pin.Model, data: pin.Data) -> Array:
        """Return G, shape (m, nv); the joint Jacobians in ``data`` are those of q."""
        between = data.oMf[self.first].actInv(data.oMf[self.second])
        one, two = (
            pin.getFrameJacobian(model, data, frame, LOCAL).reshape(6, -1) for frame in (self.first, self.second)
        )
        p, relative = between.translation, between.action @ two - one
        e, w = self.pair.directions(p, np.asarray(between.rotation.T))
        return np.concatenate([e @ (relative[:3] - pin.skew(p) @ relative[3:]), w @ relative[3:]])

    def drift(self, model: pin.Model, data: pin.Data) -> Array:
        """Return G' v, shape (m,); ``data`` holds the forward kinematics of (q, v, 0) and the placements of frames."""
        one, two = self.first, self.second
        between = data.oMf[one].actInv(data.oMf[two])
        own, twist = (pin.getFrameVelocity(model, data, frame, LOCAL) for frame in (one, two))
        drift, other = (pin.getFrameAcceleration(model, data, frame, LOCAL) for frame in (one, two))
        relative = between.act(twist) - own
        change = between.act(other) - drift + relative.cross(own)  # of the relative twist, in the axes of frame 1
        p, axes = between.translation, np.asarray(between.rotation.T)
        omega, domega = relative.angular, change.angular
        dp = relative.linear + cross(omega, p)
        ddp = change.linear + cross(domega, p) + cross(omega, dp)
        e, w = self.pair.directions(p, axes)
        return np.asarray(np.concatenate([e @ ddp, w @ domega]) + np.concatenate(self.pair.bend(p, axes, dp, omega)))

    def wrenches(self, model: pin.Model, data: pin.Data, lam: Array) -> dict[int, Array]:
        """Return what the multipliers do to the links: joint index -> [f; m] at the world's origin, world axes."""
        wrench = self.wrench(data, lam)
        place = data.oMf[self.second].translation
        moved = np.concatenate([wrench[:3], wrench[3:] + cross(place, wrench[:3])])
        joints = model.frames[self.second].parentJoint, model.frames[self.first].parentJoint
        return {joints[0]: moved, joints[1]: -moved}

    def wrench(self, data: pin.Data, lam: Array) -> Array:
        """Return [f; m] of the first link on the second, at the origin of frame 2, world axes [N, N*m], shape (6,)."""
        one = data.oMf[self.first]
        e, w = self.pair.directions(*_placed(one, data.oMf[self.second]))
        k = self.pair.lengths
        return np.concatenate([one.rotation @ (lam[:k] @ e), one.rotation @ (lam[k:] @ w)])


def _placed(one: pin.SE3, two: pin.SE3) -> tuple[Array, Array]:
    """Return the place of frame 2 in frame 1, and its axes as the rows of an array, shape (3, 3)."""
    between = one.actInv(two)
    return between.translation, np.asarray(between.rotation.T)


def _across(axis: Array) -> Array:
    """Return two unit vectors at right angles to an axis and to each other, shape (2, 3)."""
    least = np.eye(3)[int(np.abs(axis).argmin())]
    one = np.cross(axis, least)
    one /= np.linalg.norm(one)
    return np.array([one, np.cross(axis, one)])


NOTHING, ALL = np.zeros((0, 3)), np.eye(3)


class LoopDefinition(Model, frozen=True):
    """What every loop joint says.

    Attributes:
        between: The two links whose frames the joint ties; a fixed link without mass serves as a named frame.
    """

    between: tuple[str, str]

    def bound(self, model: pin.Model, name: str, pair: Pair) -> LoopJoint:
        """Return the loop joint of one model.

        Raises:
            InputError: A link does not exist, or both belong to one rigid body.
        """
        first, second = (frame_of(model, link) for link in self.between)
        if model.frames[first].parentJoint == model.frames[second].parentJoint:
            raise InputError(
                f"{' and '.join(self.between)} belong to one rigid body: a joint between them closes no loop",
                expected="links that move against each other",
            )
        return LoopJoint(name, str(self.__struct_config__.tag), first, second, pair)


class Fixed(LoopDefinition, frozen=True, tag_field="kind", tag="fixed"):
    """The frames coincide."""

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        points = np.vstack([np.zeros(3), ALL[:2]])
        return self.bound(model, name, LowerPair(ALL, ALL, ALL[2], points))


class Revolute(LoopDefinition, frozen=True, tag_field="kind", tag="revolute"):
    """The frames turn against each other about a common axis; the origins coincide."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(ALL, _across(axis), axis, np.array([np.zeros(3), axis])))


class Prismatic(LoopDefinition, frozen=True, tag_field="kind", tag="prismatic"):
    """Frame 2 slides along an axis without turning."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(_across(axis), ALL, axis))


class Cylindrical(LoopDefinition, frozen=True, tag_field="kind", tag="cylindrical"):
    """Frame 2 slides along an axis and turns about it."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(_across(axis), _across(axis), axis))


class Spherical(LoopDefinition, frozen=True, tag_field="kind", tag="spherical"):
    """A ball joint: the origins coincide."""

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        return self.bound(model, name, LowerPair(ALL, NOTHING, ALL[2], np.zeros((1, 3))))


class Universal(LoopDefinition, frozen=True, tag_field="kind", tag="universal"):
    """The origins coincide; an axis of frame 1 and an axis of frame 2, those of the cross, stay at right angles.

    Attributes:
        axes: The axis of the cross in frame 1, and that in frame 2.
    """

    axes: tuple[Direction, Direction] = ("x", "y")

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        return self.bound(model, name, Cross(unit_vector(self.axes[0]), unit_vector(self.axes[1])))


class Planar(LoopDefinition, frozen=True, tag_field="kind", tag="planar"):
    """Two planes slide on each other; the axis is their normal."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(axis[None], _across(axis), axis))


class PointOnLine(LoopDefinition, frozen=True, tag_field="kind", tag="point_on_line"):
    """The origin of frame 2 stays on a line through that of frame 1."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(_across(axis), NOTHING, axis))


class PointOnPlane(LoopDefinition, frozen=True, tag_field="kind", tag="point_on_plane"):
    """The origin of frame 2 stays in a plane through that of frame 1; the axis is its normal."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(axis[None], NOTHING, axis))


class Rod(LoopDefinition, frozen=True, tag_field="kind", tag="rod", kw_only=True):
    """The origins keep their distance, as by a rod without mass with ball joints at its ends."""

    length: Span

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        return self.bound(model, name, Tie(float(self.length)))


Loop = Fixed | Revolute | Prismatic | Cylindrical | Spherical | Universal | Planar | PointOnLine | PointOnPlane | Rod
"""Any loop joint. A new kind is one class above, with a ``Pair`` that says what it holds, and one entry here."""


def looser(pair: Pair) -> list[tuple[str, Pair]]:
    """Return the lower pairs about the same axis that hold part of what a lower pair holds, by their kind."""
    if not isinstance(pair, LowerPair):
        return []
    across, along = _across(pair.axis), pair.axis[None]
    kinds = {
        "revolute": (ALL, across), "prismatic": (across, ALL), "cylindrical": (across, across),
        "spherical": (ALL, NOTHING), "planar": (along, across), "point_on_line": (across, NOTHING),
        "point_on_plane": (along, NOTHING),
    }  # fmt: skip
    return [
        (kind, LowerPair(held, aligned, pair.axis))
        for kind, (held, aligned) in kinds.items()
        if len(held) + len(aligned) < pair.size and _within(held, pair.held) and _within(aligned, pair.aligned)
    ]


def _within(some: Array, all_: Array) -> bool:
    """Tell whether directions lie in the span of others; both are orthonormal."""
    return bool(np.abs(some - some @ all_.T @ all_).max(initial=0.0) < 1e-9)

"""Lower pairs, whose free motions have fixed directions in frame 1, and joints that hold less in the same way."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Protocol, get_args

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.mechanics.geometry.vectors import Axes, combined, dot, rotation_vector
from pinarm.mechanics.joints import Direction, unit_vector
from pinarm.mechanics.loops.loop_joints import LoopDefinition
from pinarm.mechanics.loops.pair import ALL, NOTHING, Pair
from pinarm.records import Record

MEETING, TINY = 1e-8, 1e-300
"""Sine of an angle below which the direction of its axis is rounding; what keeps a quotient finite."""


class RotationGap(Protocol):
    """How far the rotation of frame 2 against frame 1 is from the one that a pair asks at p."""

    def __call__(self, p: Array, axes: Axes) -> Array:
        """Return a rotation vector [rad], shape (3, ..)."""
        ...


class LowerPair(Record, frozen=True):
    """A pair whose rows have constant directions, those without a direction of rotation first.

    The gap of these is ``e . p``, that of the others ``w . rotation``.

    Attributes:
        e: Directions of translation, shape (m, 3).
        w: Directions of rotation, shape (m, 3).
        axis: The common axis, shape (3,).
        rotation: The open rotation; none where no row has a direction of rotation.
    """

    e: Array
    w: Array
    axis: Array
    rotation: RotationGap | None

    @cached_property
    def along(self) -> list[bool]:
        return [bool(row.any()) for row in self.e]

    @cached_property
    def about(self) -> list[bool]:
        return [bool(row.any()) for row in self.w]

    @property
    def constant(self) -> tuple[Array, Array]:
        return self.e, self.w

    @cached_property
    def _held(self) -> Array:
        return self.e[np.logical_not(self.about)]

    @cached_property
    def _aligned(self) -> Array:
        return self.w[self.about]

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        if self.rotation is None:
            return list(self._held @ p)
        return [*(self._held @ p), *(self._aligned @ self.rotation(p, axes))]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        return self.e, self.w

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        return np.zeros((len(self.e), 1)[: p.ndim])


def turned(p: Array, axes: Axes) -> Array:
    """Return ``log R``."""
    return rotation_vector(axes)


class Tilt(Record, frozen=True):
    """The rotation vector of least length that brings an axis of frame 1 onto the same axis of frame 2.

    Unlike components of ``log R`` it does not change sign where the rotation about the axis passes half a turn.

    Attributes:
        axis: Shape (3,).
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


def holding(held: Array, aligned: Array, axis: Array) -> LowerPair:
    """Return the pair whose rows measure lengths or angles, not both.

    Args:
        held: Directions in which the origins stay together, shape (k, 3).
        aligned: Directions about which the frames do not turn against each other: none, all, or two normals of the
            axis, shape (l, 3).
        axis: The common axis, shape (3,).
    """
    e, w = np.vstack([held, np.zeros_like(aligned)]), np.vstack([np.zeros_like(held), aligned])
    rotations: dict[int, RotationGap] = {2: Tilt(axis, normals(axis)[0]), 3: turned}
    return LowerPair(e, w, axis, rotations.get(len(aligned)))


def normals(axis: Array) -> Array:
    """Return two unit vectors at right angles to an axis and to each other, shape (2, 3)."""
    least = np.eye(3)[int(np.abs(axis).argmin())]
    one = np.cross(axis, least)
    one /= np.linalg.norm(one)
    return np.array([one, np.cross(axis, one)])


class LowerDefinition(LoopDefinition, frozen=True):
    """A lower pair, as files give it; ``around`` says what the kind holds about a unit vector."""

    def pair(self) -> LowerPair:
        return self.around(ALL[2])

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair about a unit vector, shape (3,)."""
        raise NotImplementedError


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

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair."""
        return holding(ALL, ALL, axis)


class Revolute(AxisDefinition, frozen=True, tag_field="kind", tag="revolute"):
    """The frames turn against each other about a common axis; the origins coincide."""

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair."""
        return holding(ALL, normals(axis), axis)


class Prismatic(AxisDefinition, frozen=True, tag_field="kind", tag="prismatic"):
    """Frame 2 slides along an axis without turning."""

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair."""
        return holding(normals(axis), ALL, axis)


class Cylindrical(AxisDefinition, frozen=True, tag_field="kind", tag="cylindrical"):
    """Frame 2 slides along an axis and turns about it."""

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair."""
        return holding(normals(axis), normals(axis), axis)


class Spherical(LowerDefinition, frozen=True, tag_field="kind", tag="spherical"):
    """A ball joint: the origins coincide."""

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair."""
        return holding(ALL, NOTHING, axis)


class Planar(AxisDefinition, frozen=True, tag_field="kind", tag="planar"):
    """Two planes slide on each other; the axis is their normal."""

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair."""
        return holding(axis[None], normals(axis), axis)


class PointOnLine(AxisDefinition, frozen=True, tag_field="kind", tag="point_on_line"):
    """The origin of frame 2 stays on a line through that of frame 1."""

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair."""
        return holding(normals(axis), NOTHING, axis)


class Pin(AxisDefinition, frozen=True, tag_field="kind", tag="pin"):
    """A pin of a mechanism that moves in a plane: frame 2 turns about the axis, on which the two origins stay.

    It holds what ``point_on_line`` holds, the place in the plane alone, so that a planar loop is not hyperstatic. It
    has the angle of a ``revolute`` joint, with its friction, springs and drives.
    """

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair."""
        return holding(normals(axis), NOTHING, axis)


class PointOnPlane(AxisDefinition, frozen=True, tag_field="kind", tag="point_on_plane"):
    """The origin of frame 2 stays in a plane through that of frame 1; the axis is its normal."""

    @staticmethod
    def around(axis: Array) -> LowerPair:
        """Return the pair."""
        return holding(axis[None], NOTHING, axis)


LowerKind = Fixed | Revolute | Prismatic | Cylindrical | Spherical | Planar | PointOnLine | Pin | PointOnPlane
"""Kinds that need at most an axis. A new one is one class above and one entry here."""

LOWER_KINDS: Mapping[str, type[LowerDefinition]] = {
    str(kind.__struct_config__.tag): kind for kind in get_args(LowerKind)
}
"""These kinds by the name that files call them by."""


def looser(pair: Pair) -> list[tuple[str, Array]]:
    """Return the kinds about the same axis whose rows are fewer than those of a lower pair, and follow from them.

    With each what the pair gives up that is replaced by it, as directions of its m multipliers, shape (m, c): the rows
    of the other are ``A`` times its own, so that it holds ``A^T mu``, and c directions are at right angles to these. A
    ``pin`` is left out: it holds what ``point_on_line`` does.
    """
    if not isinstance(pair, LowerPair):
        return []
    own, found = np.hstack([pair.e, pair.w]), []
    for kind in (kind for kind in get_args(LowerKind) if kind is not Pin):
        other = kind.around(pair.axis)
        rows = np.hstack([other.e, other.w])
        combined = np.linalg.lstsq(own.T, rows.T, rcond=None)[0]
        if len(rows) < len(own) and np.abs(rows - combined.T @ own).max() < 1e-9:
            given_up = np.linalg.qr(combined, mode="complete")[0][:, len(rows) :]
            found.append((str(kind.__struct_config__.tag), given_up))
    return found

"""What kinds of joints allow between their two frames: the rows that hold a pair of links together.

With frame 1 on the first link and frame 2 on the second, ``p`` is the place of frame 2's origin and R its orientation,
both seen from frame 1, and ``omega`` the angular velocity of 2 in 1. A row of the constraint is
``e . p' + w . omega = 0``, with a direction e of translation and a direction w of rotation, in the axes of frame 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinarm.arrays import Array
from pinarm.mechanics.geometry.vectors import MEETING, Axes, combined, cross, direction, dot, rotation_vector

NOTHING, ALL = np.zeros((0, 3)), np.eye(3)
"""No directions, and all three."""


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


def normals(axis: Array) -> Array:
    """Return two unit vectors at right angles to an axis and to each other, shape (2, 3)."""
    least = np.eye(3)[int(np.abs(axis).argmin())]
    one = np.cross(axis, least)
    one /= np.linalg.norm(one)
    return np.array([one, np.cross(axis, one)])


def looser(pair: Pair) -> list[tuple[str, Pair]]:
    """Return the lower pairs about the same axis that hold part of what a lower pair holds, by their kind."""
    if not isinstance(pair, LowerPair):
        return []
    across, along = normals(pair.axis), pair.axis[None]
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

"""The universal joint."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.mechanics.geometry.vectors import Axes, combined, cross, dot
from pinarm.mechanics.joints import Direction, unit_vector
from pinarm.mechanics.loops.loop_joints import LoopDefinition
from pinarm.records import Record

ORIGINS = np.eye(4, 3)
"""Directions of translation: the origins stay together, the last row holds an angle."""


class Universal(LoopDefinition, frozen=True, tag_field="kind", tag="universal"):
    """The origins coincide; an axis of frame 1 and an axis of frame 2, those of the cross, stay at right angles.

    Attributes:
        axes: The axis of the cross in frame 1, and that in frame 2.
    """

    axes: tuple[Direction, Direction] = ("x", "y")

    def pair(self) -> Cross:
        return Cross(unit_vector(self.axes[0]), unit_vector(self.axes[1]))


class Cross(Record, frozen=True):
    """A universal joint's rows, with u an axis of frame 1 and v one of frame 2: ``p' = 0`` and ``(v x u) . omega = 0``.

    Attributes:
        first: u in frame 1, shape (3,).
        second: v in frame 2, shape (3,).
    """

    first: Array
    second: Array
    along: tuple[bool, ...] = (True, True, True, False)
    about: tuple[bool, ...] = (False, False, False, True)
    constant: tuple[Array, Array] | None = None

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        return [*p, np.arcsin(np.clip(self.first @ combined(axes, self.second), -1.0, 1.0))]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        normal = cross(combined(axes, self.second), self.first)
        w = np.zeros((4, *normal.shape), normal.dtype)
        w[3] = normal
        return ORIGINS, w

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        turning = dot(cross(cross(omega, combined(axes, self.second)), self.first), omega)
        bend = np.zeros((4, *turning.shape), turning.dtype)
        bend[3] = turning
        return bend

"""The rod without mass."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.input.yaml.schema import Span
from pinarm.mechanics.geometry.vectors import MEETING, Axes, direction, dot
from pinarm.mechanics.loops.loop_joints import LoopDefinition
from pinarm.records import Record

UNTURNED = np.zeros((1, 3))
"""Direction of rotation: no angle is held."""


class Rod(LoopDefinition, frozen=True, tag_field="kind", tag="rod", kw_only=True):
    """The origins keep their distance, as by a rod without mass with ball joints at its ends.

    Attributes:
        length: Distance of the origins.
    """

    length: Span

    def pair(self) -> Tie:
        return Tie(float(self.length))


class Tie(Record, frozen=True):
    """A rod's row, with u the direction of p: ``u . p' = 0``.

    Attributes:
        length: [m].
    """

    length: float
    along: tuple[bool, ...] = (True,)
    about: tuple[bool, ...] = (False,)
    constant: tuple[Array, Array] | None = None

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        return [np.sqrt(dot(p, p)) - self.length]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        return direction(p)[None], UNTURNED

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        """Return the centripetal term ``(|p'|^2 - (u . p')^2) / |p|``."""
        along = dot(direction(p), dp)
        return np.asarray((dot(dp, dp) - along * along) / np.maximum(np.sqrt(dot(p, p)), MEETING))[None]

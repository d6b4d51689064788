"""The screw, or helical pair."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.yaml.schema import Lead
from pinarm.mechanics.geometry.vectors import Axes, combined, dot
from pinarm.mechanics.joints import Direction, unit_vector
from pinarm.mechanics.loops.loop_joints import LoopDefinition
from pinarm.mechanics.loops.lower_pairs import LowerPair, Tilt, normals
from pinarm.records import Record


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

    lead: Lead
    axis: Direction = "z"
    offset: Lead = 0.0

    def check(self) -> None:
        """Refuse a lead that ties no rotation to a way."""
        if self.lead == 0.0:
            raise InputError(
                "a screw of lead 0 does not advance", expected="a length other than 0", hint="kind: revolute"
            )

    def pair(self) -> LowerPair:
        """Return what it holds: two distances, two angles, and with h = lead / (2 pi) ``z' - h omega_z = 0``."""
        axis, pitch = unit_vector(self.axis), float(self.lead) / (2.0 * np.pi)
        across, nothing = normals(axis), np.zeros((2, 3))
        e, w = np.vstack([across, nothing, axis]), np.vstack([nothing, across, -pitch * axis])
        thread = Thread(Tilt(axis, across[0]), across, pitch, float(self.offset))
        return LowerPair(e, w, axis, thread)


class Thread(Record, frozen=True):
    """The open rotation of a screw.

    Attributes:
        tilt: That of the axes.
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
        """Return the tilt, and about the axis the angle less the one that p asks, but for whole turns.

        The angle is that of R without its tilt, ``atan2(v . R u - u . R v, u . R u + v . R v)``.
        """
        (u, v), (ru, rv) = self._at(p), (combined(axes, one) for one in self.across)
        missing = np.arctan2(dot(v, ru) - dot(u, rv), dot(u, ru) + dot(v, rv)) - self.angle(p)
        turns = np.round(missing / (2.0 * np.pi))
        return self.tilt(p, axes) + np.multiply.outer(self.tilt.axis, missing - 2.0 * np.pi * turns)

    def _at(self, p: Array) -> Array:
        """Return u and v, each of shape (3,), or (3, 1) for many configurations."""
        return self.across.reshape(2, 3, *(1,) * (p.ndim - 1))

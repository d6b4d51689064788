"""State of friction between two switches: which joints slip, and which groups of joints stick."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from pinarm.arrays import Array
from pinarm.records import Record, ValueRecord


class SlipGroup(Record, frozen=True):
    """Slips that can only take place together, such as those of the pins of a four-bar linkage.

    Attributes:
        ratios: c, slips per slip of the first member, 0 of slips that are no members, shape (k,).
        units: Directions of the members as the first one slips forwards: 1 or -1, or components of a unit vector; 0 of
            others, shape (k,).
    """

    ratios: Array
    units: Array

    @cached_property
    def members(self) -> tuple[int, ...]:
        """Indices of the members."""
        return tuple(np.flatnonzero(self.units).tolist())

    @property
    def first(self) -> int:
        """Index of the slip that stands for all."""
        return self.members[0]


class Slip(ValueRecord, frozen=True):
    """Slipping and stuck joints on a stretch of the motion; empty without friction.

    Attributes:
        direction: 1 or -1 of a joint that slips, 0 of one at rest, for each of k joints; of a slip with several
            components a unit vector, the direction from which it does not turn away by more than 60 deg.
        stuck: Groups of joints that friction keeps at rest.
        begun: Start of the stretch [s].
        rest: Slips [rad/s or m/s] that rounding of the instant of a switch leaves, shape (k,).
        slack: Friction [N*m or N] of the groups that rounding leaves; see ``joint_friction.NOTHING``, shape (g,).
    """

    direction: tuple[float, ...] = ()
    stuck: tuple[SlipGroup, ...] = ()
    begun: float = 0.0
    rest: tuple[float, ...] = ()
    slack: tuple[float, ...] = ()

"""State of friction between two switches, and friction in the tables of a run: of joints, and bands of efforts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.joints import Joint, effort_unit
from pinarm.records import Record, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.engine.statics.actuation import Actuation
    from pinarm.mechanics.friction.contact import FrictionContact


BANDS = ("lower", "upper")
"""Parts of a band: the efforts that begin to move a drive's coordinate down and up."""


def friction_columns(contacts: Sequence[FrictionContact], friction: Array) -> dict[str, Series]:
    """Return friction along k slips, shape (n, k) [N*m or N], as columns ``joint.J.friction``, ``loop.L.friction``."""
    pairs = zip(contacts, friction.T, strict=True) if contacts else ()
    return {contact.quantity: Series(contact.quantity, contact.effort, values) for contact, values in pairs}


class EffortBand(Record, frozen=True):
    """The efforts that friction holds at rest, of a quantity.

    Attributes:
        quantity: ``joint.J.effort`` or ``coordinate.C.effort``.
        coordinate: Name of the coordinate that moves where the effort leaves the band.
        shares: Of the efforts of all d drives in the quantity, shape (d,).
    """

    quantity: str
    coordinate: str
    shares: Array
    unit: Unit

    def side(self, part: str, values: Array) -> Series:
        """Return one part of ``BANDS``, ``joint.J.effort.lower``; infinite where friction holds any effort."""
        return Series(f"{self.quantity}.{part}", self.unit, values, unbounded=True)


def bands_of(joints: Mapping[str, Joint], coordinates: Mapping[str, Coordinate]) -> list[EffortBand]:
    """Return the band of every drive, and of joints through which several act that of their sum as well.

    The effort of a joint through which only its own drive acts is that drive's.

    Args:
        joints: The mechanism's joints.
        coordinates: Coordinates that the d drives act along, by name.
    """
    bands = list[EffortBand]()
    for name, own in zip(coordinates, np.eye(len(coordinates)), strict=True):
        of = effort_unit(coordinates[name].unit)
        bands.append(EffortBand(own_effort(joints, coordinates, name), name, own, of))
        if name in joints and ((through := _through(joints[name], coordinates)) != own).any():
            bands.append(EffortBand(f"joint.{name}.effort", name, through, of))
    return bands


def own_effort(joints: Mapping[str, Joint], coordinates: Mapping[str, Coordinate], name: str) -> str:
    """Return the quantity that is the effort of one drive alone: of a joint where no other drive acts through it."""
    alone = name in joints and np.count_nonzero(_through(joints[name], coordinates)) == 1
    return f"{'joint' if alone else 'coordinate'}.{name}.effort"


def _through(joint: Joint, coordinates: Mapping[str, Coordinate]) -> Array:
    each = coordinates.values()
    return np.array([along.weights[joint.v] if isinstance(along, LinearCoordinate) else 0.0 for along in each])


def with_friction_columns(row: Trajectory, drives: Actuation) -> Trajectory:
    """Return a row of a known motion with the columns that friction adds to it, 0: enough to see which there are."""
    mechanism = row.mechanism
    if not mechanism.frictions:
        return row
    bands = bands_of(mechanism.joints, drives.coordinates(mechanism))
    sides = [band.side(part, np.zeros(len(row))) for band in bands for part in BANDS]
    friction = friction_columns(mechanism.frictions, np.zeros((len(row), len(mechanism.frictions))))
    return replace(row, columns={**row.columns, **friction, **{side.name: side for side in sides}})


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

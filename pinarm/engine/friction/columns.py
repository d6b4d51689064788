"""Friction in the tables of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.input.units import Unit, unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.joints import METRE, Joint
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.engine.statics.actuation import Actuation
    from pinarm.mechanics.friction.contact import FrictionContact

BANDS = ("lower", "upper")
"""Parts of a band: the efforts that begin to move a drive's coordinate down and up."""


def friction_columns(contacts: Sequence[FrictionContact], friction: Array) -> dict[str, Series]:
    """Return the friction of joints as columns ``joint.J.friction`` and ``loop.L.friction``.

    Args:
        contacts: The k joints.
        friction: Along their slips [N*m or N], shape (n, k).
    """
    names = [contact.quantity for contact in contacts]
    return {name: Series(name, contact.effort, values)
            for name, contact, values in zip(names, contacts, friction.T, strict=True)} if contacts else {}  # fmt: skip


class EffortBand(Record, frozen=True):
    """The efforts that friction holds at rest, of a quantity.

    Attributes:
        quantity: ``joint.J.effort`` or ``coordinate.C.effort``.
        coordinate: Name of the coordinate that moves where the effort leaves the band.
        shares: Of the efforts of all d drives in the quantity, shape (d,).
        unit: Of the effort.
    """

    quantity: str
    coordinate: str
    shares: Array
    unit: Unit

    def side(self, part: str, values: Array) -> Series:
        """Return one side of the band, ``joint.J.effort.lower``.

        Args:
            part: Of ``BANDS``.
            values: [N*m or N], infinite where friction holds any effort, shape (n,).
        """
        return Series(f"{self.quantity}.{part}", self.unit, values, unbounded=True)


def bands_of(joints: Mapping[str, Joint], coordinates: Mapping[str, Coordinate]) -> list[EffortBand]:
    """Return what has a band: the effort of every drive, and at joints through which several act their sum as well.

    The effort of a joint through which only its own drive acts is that drive's.

    Args:
        joints: The mechanism's joints.
        coordinates: What the d drives act along, by name.
    """
    found = []
    for name, own in zip(coordinates, np.eye(len(coordinates)), strict=True):
        of = unit("N" if coordinates[name].unit == METRE else "N*m")
        through = _through(joints[name], coordinates) if name in joints else None
        found.append(EffortBand(own_effort(joints, coordinates, name), name, own, of))
        if through is not None and (through != own).any():
            found.append(EffortBand(f"joint.{name}.effort", name, through, of))
    return found


def own_effort(joints: Mapping[str, Joint], coordinates: Mapping[str, Coordinate], name: str) -> str:
    """Return the quantity that is the effort of one drive alone: of a joint where no other drive acts through it."""
    alone = name in joints and np.count_nonzero(_through(joints[name], coordinates)) == 1
    return f"{'joint' if alone else 'coordinate'}.{name}.effort"


def _through(joint: Joint, coordinates: Mapping[str, Coordinate]) -> Array:
    """Return the parts that the drives have in the effort of a joint, shape (d,)."""
    return np.array([one.weights[joint.v] if isinstance(one, LinearCoordinate) else 0.0
                     for one in coordinates.values()])  # fmt: skip


def with_friction_columns(row: Trajectory, drives: Actuation) -> Trajectory:
    """Return a row of a known motion with the columns that friction adds to it, 0: enough to see which there are."""
    mechanism = row.mechanism
    if not mechanism.frictions:
        return row
    none = np.zeros(len(row))
    bands = bands_of(mechanism.joints, drives.coordinates(mechanism))
    sides = [band.side(part, none) for band in bands for part in BANDS]
    friction = friction_columns(mechanism.frictions, np.zeros((len(row), len(mechanism.frictions))))
    return replace(row, columns={**row.columns, **friction, **{side.name: side for side in sides}})

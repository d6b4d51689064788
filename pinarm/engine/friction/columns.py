"""Friction in the tables of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.joints import METRE, Joint
from pinarm.records import replace

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


def band_column(joints: Mapping[str, Joint], name: str, coordinate: Coordinate, part: str, values: Array) -> Series:
    """Return one side of the band of a drive's effort at rest, ``joint.J.effort.lower``.

    Args:
        joints: The mechanism's joints.
        name: Of the coordinate that the drive acts along.
        coordinate: The coordinate.
        part: Of ``BANDS``.
        values: [N*m or N], infinite where friction holds any effort, shape (n,).
    """
    kind = "joint" if name in joints else "coordinate"
    return Series(f"{kind}.{name}.effort.{part}", unit("N" if coordinate.unit == METRE else "N*m"), values,
                  unbounded=True)  # fmt: skip


def with_friction_columns(row: Trajectory, drives: Actuation) -> Trajectory:
    """Return a row of a known motion with the columns that friction adds to it, 0: enough to see which there are."""
    mechanism = row.mechanism
    if not mechanism.frictions:
        return row
    none = np.zeros(len(row))
    sides = [band_column(mechanism.joints, name, coordinate, part, none)
             for name, coordinate in drives.coordinates(mechanism).items() for part in BANDS]  # fmt: skip
    friction = friction_columns(mechanism.frictions, np.zeros((len(row), len(mechanism.frictions))))
    return replace(row, columns={**row.columns, **friction, **{side.name: side for side in sides}})

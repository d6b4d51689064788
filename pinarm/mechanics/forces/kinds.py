"""The kinds of force element, and their binding to a mechanism."""

from __future__ import annotations

from collections.abc import Mapping

import pinocchio as pin

from pinarm.errors import InputError, within
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.forces.along_coordinate import (
    CoordinateEffort,
    CoordinateSpring,
    JointEffort,
    JointSpring,
    RegularisedFriction,
    TorqueSpeed,
)
from pinarm.mechanics.forces.bushing import Bushing
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.forces.points import ElasticCable, PointSpring, Wrench
from pinarm.mechanics.joints import Joint

Force = (
    JointSpring
    | JointEffort
    | RegularisedFriction
    | TorqueSpeed
    | PointSpring
    | ElasticCable
    | Bushing
    | Wrench
    | CoordinateSpring
    | CoordinateEffort
)
"""Any force element. A new one is a module or class beside these and one entry here."""


def bound(
    force: Force, model: pin.Model, joints: Mapping[str, Joint], coordinates: Mapping[str, Coordinate]
) -> ForceElement:
    """Return the element of one model that a file gives."""
    if isinstance(force, JointSpring | JointEffort) and force.joint not in joints:
        _refuse_coordinate(force, coordinates)
    return force.bind(model, joints, coordinates)


def _refuse_coordinate(force: JointSpring | JointEffort, coordinates: Mapping[str, Coordinate]) -> None:
    named = force.joint, f"{force.joint}.angle", f"{force.joint}.position"
    along = [name for name in named if name in coordinates]
    if not along:
        return
    kind = (CoordinateSpring if isinstance(force, JointSpring) else CoordinateEffort).__struct_config__.tag
    what = "a coordinate" if along[0] == force.joint else "a joint that closes a loop"
    with within("joint"):
        raise InputError(
            f"'{force.joint}' is {what}, no joint of the model",
            expected=f"a force along {' or '.join(along)}",
            hint=f"kind: {kind}, coordinate: {along[0]}",
        )

"""The kinds of force element, and their binding to a mechanism."""

from __future__ import annotations

from collections.abc import Mapping

import pinocchio as pin

from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.forces.along_coordinate import CoordinateEffort, CoordinateSpring
from pinarm.mechanics.forces.bushing import Bushing
from pinarm.mechanics.forces.cable import ElasticCable
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.forces.joint_definitions import JointEffort, JointSpring, RegularisedFriction, TorqueSpeed
from pinarm.mechanics.forces.point import PointSpring, Wrench
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
    """Return the element of one model that a file gives.

    Raises:
        InputError: A joint, link or coordinate does not exist, or a unit is another.
    """
    if isinstance(force, CoordinateSpring | CoordinateEffort):
        return force.bind(model, coordinates)
    return force.bind(model, joints)

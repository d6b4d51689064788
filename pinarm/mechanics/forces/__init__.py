"""Force elements: what acts on a mechanism besides gravity and its drives, one family a module."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import pinocchio as pin

from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.forces.along_coordinate import CoordinateEffort, CoordinateSpring
from pinarm.mechanics.forces.bushing import Bushing
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
    | Bushing
    | Wrench
    | CoordinateSpring
    | CoordinateEffort
)
"""Any force element. A new one is a module or class beside these and one entry here."""

__all__ = ["Force", "ForceElement", "bound", "summed"]


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


def summed(forces: Iterable[ForceElement]) -> tuple[ForceElement, ...]:
    """Return elements with the same load in all, the springs and dampers at joints as one."""
    if not (known := tuple(forces)):
        return ()
    from pinarm.mechanics.forces.joint_springs import SpringDamper

    springs = [one for one in known if isinstance(one, SpringDamper)]
    others = tuple(one for one in known if not isinstance(one, SpringDamper))
    return (SpringDamper.sum(springs), *others) if springs else others

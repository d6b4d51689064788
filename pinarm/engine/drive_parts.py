"""Drives of a mechanism file, bound to the model: where their rotors are, and what is between these and the joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import pinocchio as pin

from pinarm.engine.mechanism_parts import Locate
from pinarm.errors import InputError, within
from pinarm.mechanics.coordinates import Coordinate, coordinate_of
from pinarm.mechanics.description import MechanismDescription
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.joints import Joint, joint_of, joints_of

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint import Constraint


def mount_drives(
    model: pin.Model, joints: Mapping[str, Joint], description: MechanismDescription, here: Locate
) -> None:
    """Give the inertias of rotors to the joints of their drives.

    Raises:
        InputError: A joint does not exist, or has a drive already.
    """
    mounted: dict[str, str] = {}
    armature: Any = model.armature
    for name, drive in description.drives.items():
        driven, key = drive.coordinate, "joint" if drive.joint else "along"
        with here("drives", name), within(key):
            joint = joint_of(joints, driven) if drive.joint else None
            if driven in mounted:
                raise InputError(f"the {key} '{driven}' has two drives, '{mounted[driven]}' and '{name}'",
                                 expected="one drive at each joint")  # fmt: skip
        mounted[driven] = name
        if joint is not None and not drive.turns_rotor:
            armature[joint.v] += drive.armature


def rotors_along(
    model: pin.Model, description: MechanismDescription, coordinates: Mapping[str, Coordinate], here: Locate
) -> pin.Model:
    """Return the model with a joint for the rotor of every drive that turns one of its own; itself without any.

    Raises:
        InputError: A coordinate does not exist, or is a joint's own.
    """
    turning = {name: drive for name, drive in description.drives.items() if drive.turns_rotor}
    if not turning:
        return model
    from pinarm.mechanics.rotors import with_rotors

    for name, drive in turning.items():
        if drive.joint:
            with here("drives", name), within("joint"):
                joint_of(joints_of(model), drive.joint)
            continue
        with here("drives", name), within("along"):
            coordinate_of(model, coordinates, drive.along)
            if drive.along in joints_of(model):
                raise InputError(f"'{drive.along}' is a joint", expected=f"joint: {drive.along}")
    with here("drives"):
        return with_rotors(model, turning, coordinates)


def geared_rotors(
    joints: Mapping[str, Joint], description: MechanismDescription, coordinates: Mapping[str, Coordinate]
) -> list[Constraint]:
    """Return what ties the joints of drives to each other, and to what the drives act along."""
    turning = {name: drive for name, drive in description.drives.items() if drive.turns_rotor}
    if not turning:
        return []
    from pinarm.mechanics.rotors import DriveTrain

    return [
        tie
        for name, drive in turning.items()
        for tie in DriveTrain.of(name, drive, coordinates[drive.coordinate]).ties(drive, joints, coordinates)
    ]


def elastic_gears(
    model: pin.Model, description: MechanismDescription, coordinates: Mapping[str, Coordinate], here: Locate
) -> dict[str, ForceElement]:
    """Return the elasticities between rotors and what their drives act along, by name.

    Raises:
        InputError: A unit is another.
    """
    elastic = {name: drive for name, drive in description.drives.items() if drive.elasticity is not None}
    if not elastic:
        return {}
    from pinarm.mechanics.forces.flanks import elastic_gear
    from pinarm.mechanics.rotors import DriveTrain

    found = dict[str, ForceElement]()
    for name, drive in elastic.items():
        assert drive.elasticity is not None
        with here("drives", name):
            train = DriveTrain.of(name, drive, coordinates[drive.coordinate])
            deflection = train.deflection(drive, coordinates)
            found[f"elasticity of {name}"] = elastic_gear(model, deflection, drive.elasticity, drive.backlash)
    return found

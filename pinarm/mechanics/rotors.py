"""Rotors that are joints of their own: of motors along a coordinate which is no joint's, or behind a gear with losses.

An angle that configurations tell up to whole turns is counted by a joint in the same way, one without inertia.

A rotor of inertia J behind a gear of ratio N, which turns with ``N w``, has the energy ``N^2 J w'^2 / 2``. It is a
joint of the model with the armature ``N^2 J`` and no body, whose coordinate x is reflected to the driven side and tied
to it, ``x - w(q) = 0``. As armatures of joints, rotors have no weight, and their bearings carry nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.drives import Drive
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.rotation_rows import whole_turns
from pinarm.mechanics.joints import METRE, RADIAN, Joint
from pinarm.records import replace

ENDLESS = np.array([np.inf])


@dataclass(frozen=True, eq=False)
class GearedRotor:
    """What ties a rotor, or another joint without a body, to a coordinate; the multiplier is the effort that moves it.

    Attributes:
        name: ``gear of D``, ``shaft of D``, or ``turns of L.angle``.
        rotor: The joint, whose coordinate is that of the driven side.
        coordinate: What it moves as.
        size: One row.
        side: It holds both ways.
    """

    name: str
    rotor: Joint
    coordinate: Coordinate
    size: int = 1
    side: float = 0.0

    @property
    def follower(self) -> int | None:
        """Index in v of the rotor where the tie is the same in all configurations: it has no drive of its own."""
        return self.rotor.v if isinstance(self.coordinate, LinearCoordinate) else None

    def helical(self, row: int) -> bool:
        """Tell whether its gap is known but for whole turns."""
        return self.coordinate.wraps

    def unit(self, row: int) -> Unit:
        return self.coordinate.unit

    def gap(self, state: Kinematics) -> Array:
        """Return ``x - w(q)``, shape (1,); but for whole turns where w is told up to these: x counts them."""
        apart = np.array([state.q[self.rotor.q] - self.coordinate.value(state)])
        return apart + self.missing_turns(apart, state.q) if self.coordinate.wraps else apart

    def missing_turns(self, gap: Array, q: Array) -> Array:
        """Return the whole turns that gaps of an angle lack [rad]."""
        return -whole_turns(gap)

    def rows(self, state: Kinematics) -> Array:
        """Return the row of ``x' - w'``, shape (1, nv)."""
        row = -np.asarray(self.coordinate.row(state), dtype=np.float64)
        row[self.rotor.v] += 1.0
        return row[None]

    def drift(self, state: Kinematics) -> Array:
        return np.array([-self.coordinate.drift(state)])

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return what moving the rotor does to links; see ``Constraint``. Nothing where it acts as joint efforts."""
        found = self.coordinate.wrenches(links, -lam[:, 0])
        return {**found, self.rotor.index: np.multiply.outer(lam[:, 0], self._axis)} if found else {}

    @cached_property
    def _axis(self) -> Array:
        """Wrench of a unit effort along the rotor's joint at the world's origin, shape (6,)."""
        axis = np.zeros(6)
        axis[0 if self.coordinate.unit == METRE else 3] = 1.0
        return axis


def deflection_of(front: LinearCoordinate, back: LinearCoordinate) -> LinearCoordinate:
    """Return the deflection of an elastic shaft between two coordinates, the first less the second."""
    return replace(front, weights=np.asarray(front.weights - back.weights, dtype=np.float64))


def rotor_name(drive: str) -> str:
    """Return the name of the joint of a drive's rotor."""
    return f"{drive}.rotor"


def gear_name(drive: str) -> str:
    """Return the name of what ties both sides of the gear of a drive."""
    return f"gear of {drive}"


def wheel_name(drive: str) -> str:
    """Return the name of the joint of the wheel of a drive, at which an elastic output shaft begins."""
    return f"{drive}.wheel"


def shaft_name(drive: str) -> str:
    """Return the name of the joint at the end of the elastic shaft of a drive."""
    return f"{drive}.shaft"


class DriveTrain(NamedTuple):
    """The joints of its own between the motor of a drive and what it drives; none of them but the rotor has an inertia.

    Attributes:
        drive: Name of the drive.
        wheel: Whether the wheel of a gear with losses is one, ``D.wheel``: an elastic output shaft begins there.
        shaft: Whether the end of an elastic shaft is one, ``D.shaft``: it ends in teeth with losses, or drives a
            coordinate that is no sum of joints.
        losses_behind: Whether teeth with losses come behind the shaft.
    """

    drive: str
    wheel: bool
    shaft: bool
    losses_behind: bool

    @classmethod
    def of(cls, name: str, drive: Drive, coordinate: Coordinate) -> DriveTrain:
        """Return the train of a drive whose rotor is a joint of its own."""
        if drive.elasticity is None:
            return cls(name, False, False, False)
        lossy, output = drive.efficiency < 1.0, drive.elasticity.shaft == "output"
        behind = lossy and not output
        return cls(name, lossy and output, behind or not isinstance(coordinate, LinearCoordinate), behind)

    def joints(self, armature: float) -> dict[str, float]:
        others = ((wheel_name(self.drive), self.wheel), (shaft_name(self.drive), self.shaft))
        return {rotor_name(self.drive): armature, **{name: 0.0 for name, exists in others if exists}}

    def ties(
        self, drive: Drive, joints: Mapping[str, Joint], coordinates: Mapping[str, Coordinate]
    ) -> Iterator[GearedRotor]:
        """Yield what ties the joints to each other, and to what the drive acts along."""
        driven, gear = coordinates[drive.coordinate], gear_name(self.drive)
        if drive.elasticity is None:
            yield GearedRotor(gear, joints[rotor_name(self.drive)], driven)
        if self.wheel:
            yield GearedRotor(gear, joints[wheel_name(self.drive)], coordinates[rotor_name(self.drive)])
        if self.shaft:
            yield GearedRotor(
                gear if self.losses_behind else f"shaft of {self.drive}", joints[shaft_name(self.drive)], driven
            )

    def deflection(self, drive: Drive, coordinates: Mapping[str, Coordinate]) -> LinearCoordinate:
        """Return the deflection of the elastic shaft."""
        front = coordinates[wheel_name(self.drive) if self.wheel else rotor_name(self.drive)]
        back = coordinates[shaft_name(self.drive) if self.shaft else drive.coordinate]
        assert isinstance(front, LinearCoordinate) and isinstance(back, LinearCoordinate)
        return deflection_of(front, back)


def with_rotors(model: pin.Model, drives: Mapping[str, Drive], coordinates: Mapping[str, Coordinate]) -> pin.Model:
    """Return a copy of the model with the joints of drives at the end.

    Args:
        model: Pinocchio's model.
        drives: Drives whose rotors are joints of their own.
        coordinates: The mechanism's.

    Raises:
        InputError: A joint has the name of one of them.
    """
    found = pin.Model(model)
    for name, drive in drives.items():
        driven = coordinates[drive.coordinate]
        for joint, armature in DriveTrain.of(name, drive, driven).joints(drive.armature).items():
            _add_joint(found, f"part of the drive '{name}'", joint, driven.unit, armature)
    return found


def counter_name(angle: str) -> str:
    """Return the name of the joint that counts the turns of an angle."""
    return f"{angle}.counter"


def counted_angle(joint: str) -> str | None:
    """Return the angle whose turns a joint counts, by its name; ``None`` of other joints."""
    angle = joint.removesuffix(counter_name(""))
    return angle if angle != joint else None


def with_counters(model: pin.Model, angles: Sequence[str]) -> pin.Model:
    """Return a copy of the model with joints at the end that count the turns of angles.

    Raises:
        InputError: A joint has the name of one of them.
    """
    found = pin.Model(model)
    for angle in angles:
        _add_joint(found, f"counter of '{angle}'", counter_name(angle), RADIAN, 0.0)
    return found


def _add_joint(model: pin.Model, part: str, name: str, unit: Unit, armature: float) -> None:
    """Add a joint to a model, without a body, that is known to people as some part.

    Raises:
        InputError: A joint has its name.
    """
    if model.existJointName(name):
        raise InputError(f"the model has a joint '{name}', as the {part} is named", expected="another name of one")
    kind = pin.JointModelPX() if unit == METRE else pin.JointModelRX()
    index = model.addJoint(0, kind, pin.SE3.Identity(), name, ENDLESS, ENDLESS, -ENDLESS, ENDLESS)
    model.armature[model.joints[index].idx_v] = armature

"""Rotors that are joints of their own: of motors along a coordinate which is no joint's, or behind a gear with losses.

A rotor of inertia J behind a gear of ratio N, which turns with ``N w``, has the energy ``N^2 J w'^2 / 2``. It is a
joint of the model with the armature ``N^2 J`` and no body, whose coordinate x is reflected to the driven side and tied
to it, ``x - w(q) = 0``. As armatures of joints, rotors have no weight, and their bearings carry nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.drives import Drive
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE, Joint
from pinarm.records import replace

ENDLESS = np.array([np.inf])


@dataclass(frozen=True, eq=False)
class GearedRotor:
    """What ties a rotor to the coordinate that its motor drives; the multiplier is the effort that moves the rotor.

    Attributes:
        name: ``gear of D``.
        rotor: Its joint, whose coordinate is that of the driven side.
        coordinate: What the motor drives.
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

    def unit(self, row: int) -> Unit:
        """Return the coordinate's unit."""
        return self.coordinate.unit

    def gap(self, state: Kinematics) -> Array:
        """Return ``x - w(q)``, shape (1,)."""
        return np.array([state.q[self.rotor.q] - self.coordinate.value(state)])

    def rows(self, state: Kinematics) -> Array:
        """Return the row of ``x' - w'``, shape (1, nv)."""
        row = -np.asarray(self.coordinate.row(state), dtype=np.float64)
        row[self.rotor.v] += 1.0
        return row[None]

    def drift(self, state: Kinematics) -> Array:
        """Return minus the drift of the coordinate, shape (1,)."""
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


def deflection_of(rotor: Joint, coordinate: Coordinate) -> LinearCoordinate:
    """Return the deflection of an elastic gear, ``x - w(q)``.

    Args:
        rotor: Joint of the rotor, whose coordinate x is that of the driven side.
        coordinate: What the motor drives, w.

    Raises:
        InputError: It is no sum of joints.
    """
    if not isinstance(coordinate, LinearCoordinate):
        with within("elasticity"):
            raise InputError("an elastic gear drives a joint, or a sum of joints", expected="a joint, or a coordinate "
                             "of the kind sum", hint="a joint of the model between motor and loop")  # fmt: skip
    weights = -np.asarray(coordinate.weights, dtype=np.float64)
    weights[rotor.v] += 1.0
    return replace(coordinate, weights=weights)


def rotor_name(drive: str) -> str:
    """Return the name of the joint of a drive's rotor."""
    return f"{drive}.rotor"


def with_rotors(model: pin.Model, drives: Mapping[str, Drive], units: Mapping[str, Unit]) -> pin.Model:
    """Return a copy of the model with a joint at the end for every rotor.

    Args:
        model: Pinocchio's model.
        drives: Drives whose rotors are joints of their own.
        units: Units of what they drive, by the name of the drive.

    Raises:
        InputError: A joint has the name of a rotor.
    """
    found = model.copy()
    for name, drive in drives.items():
        if found.existJointName(rotor_name(name)):
            raise InputError(f"the model has a joint '{rotor_name(name)}', as the rotor of the drive '{name}' is named",
                             expected="another name of the drive")  # fmt: skip
        kind = pin.JointModelPX() if units[name] == METRE else pin.JointModelRX()
        limits = ENDLESS, ENDLESS, -ENDLESS, ENDLESS
        index = found.addJoint(0, kind, pin.SE3.Identity(), rotor_name(name), *limits)
        found.armature[found.joints[index].idx_v] = drive.armature
    return found

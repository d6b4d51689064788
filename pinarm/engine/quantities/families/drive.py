"""Motors: torque, speed and power in front of their gears."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.families.coordinate import CoordinateQuantities
from pinarm.engine.quantities.family import NEWTON_METRE, WATT, Asked, Family, Offered
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.drives import Drive
from pinarm.mechanics.forces.along_coordinate import AlongCoordinate

PARTS = ("torque", "speed", "power", "deflection")


class DriveQuantities(Family, frozen=True):
    """``drive.D...``: of the motor of drive D."""

    element: ClassVar[str] = "D"
    of_variants: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "torque": "torque of the motor, its rotor's share and the losses of the gear included",
        "speed": "speed of the motor: that of the joint times the ratio",
        "power": "torque times speed",
        "deflection": "of an elastic gear, at the joint: of the rotor over the ratio, less that of the joint",
    }

    def entries(self) -> Iterator[Offered]:
        """Yield the quantities of the motors."""
        for name, drive in self.run.mechanism.drives.items():
            yield from (Offered(name, part) for part in self.meanings if part != "deflection" or drive.elasticity)

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        run, drive = self.run, self.run.mechanism.drives.get(asked.of)
        if drive is None or len(asked.words) != 2 or asked.part not in PARTS:
            raise asked.unknown
        if asked.part == "deflection":
            return self._deflection(asked, drive)
        index = run.mechanism.driven_joint(asked.of).v
        speed = drive.speed(run.v[..., index])
        if asked.part == "speed":
            return Series(asked.name, unit("rad/s"), speed)
        self.require_efforts(asked)
        torque = self._torque(asked, drive, index)
        if asked.part == "torque":
            return Series(asked.name, NEWTON_METRE, torque)
        return Series(asked.name, WATT, torque * speed)

    def _torque(self, asked: Asked, drive: Drive, index: int) -> Array:
        """Return the torque of the motor, by the index of the joint that it moves, shape (n,)."""
        run = self.run
        if not drive.rigid and drive.efficiency < 1.0:
            self._require_losses(asked, index)
        if drive.turns_rotor and run.driven is not None and run.driven[index]:  # losses come behind the rotor
            return run.supplied[..., index] / float(drive.ratio)
        if drive.elasticity is not None:
            return self._elastic_torque(asked, drive, index)
        a, effort = run.a[..., index], self._effort(asked, drive)
        torque = drive.torque(effort - drive.armature * a, run.direction(index), a)
        return np.where(effort == 0.0, 0.0, torque)  # off: what moves its rotor loses nothing

    def _require_losses(self, asked: Asked, index: int) -> None:
        """Raise where the rotor of an elastic gear has a torque, and its losses do not act in the motion.

        Raises:
            InputError: They do in forward motions with a controller of the drive.
        """
        run = self.run
        if f"drive.{asked.of}.friction" not in run.columns and run.tau[..., index].any():
            raise InputError(
                f"'{asked.name}': the losses of an elastic gear follow from the motion under a controller",
                expected="a controller of the drive in a forward problem, or an efficiency of 1",
            )

    def _elastic_torque(self, asked: Asked, drive: Drive, index: int) -> Array:
        """Return the torque of a motor behind an elastic gear: that of its rotor.

        Raises:
            InputError: The joint is driven itself, past its motor.
        """
        run = self.run
        joint = run.mechanism.joints[drive.joint].v if drive.joint else None
        if run.driven is not None and (joint is None or run.driven[joint]):
            raise InputError(
                f"'{asked.name}': what drives '{drive.coordinate}' here is not the motor behind its elastic gear",
                expected="a controller of the drive in a forward problem, or a drive without elasticity",
            )
        return run.supplied[..., index] / float(drive.ratio)

    def _deflection(self, asked: Asked, drive: Drive) -> Series:
        """Return the deflection of an elastic gear.

        Raises:
            InputError: The gear is rigid.
        """
        mechanism = self.run.mechanism
        element = mechanism.forces.get(f"elasticity of {asked.of}")
        if not isinstance(element, AlongCoordinate) or not isinstance(element.coordinate, LinearCoordinate):
            raise asked.unknown
        values = self.run.q[..., element.coordinate.places] @ element.coordinate.weights
        return Series(asked.name, element.coordinate.unit, values)

    def _effort(self, asked: Asked, drive: Drive) -> Array:
        """Return the effort of what drives the joint or the coordinate, the rotor's share included, shape (n,)."""
        if drive.joint:
            return self.run.drive_effort(drive.joint)
        along = CoordinateQuantities(self.evaluation)
        return along.series(Asked(f"coordinate.{drive.coordinate}.effort", (drive.coordinate, "effort"))).values

"""Motors: torque, speed and power in front of their gears."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.families.coordinate import CoordinateQuantities
from pinarm.engine.quantities.family import NEWTON_METRE, WATT, Asked, Family, Offered
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.mechanics.drives import Drive

PARTS = ("torque", "speed", "power")


@dataclass(frozen=True, eq=False)
class DriveQuantities(Family):
    """``drive.D...``: of the motor of drive D."""

    element: ClassVar[str] = "D"
    of_variants: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "torque": "torque of the motor, its rotor's share and the losses of the gear included",
        "speed": "speed of the motor: that of the joint times the ratio",
        "power": "torque times speed",
    }

    def entries(self) -> Iterator[Offered]:
        """Yield the quantities of the motors."""
        return (Offered(name, part) for name in self.run.mechanism.drives for part in self.meanings)

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        run, drive = self.run, self.run.mechanism.drives.get(asked.of)
        if drive is None or len(asked.words) != 2 or asked.part not in PARTS:
            raise asked.unknown
        index = run.mechanism.driven_joint(asked.of).v
        speed = drive.speed(run.v[..., index])
        if asked.part == "speed":
            return Series(asked.name, unit("rad/s"), speed)
        self.require_efforts(asked)
        a, effort = run.a[..., index], self._effort(asked, drive)
        torque = drive.torque(effort - drive.armature * a, run.direction(index), a)
        torque = np.where(effort == 0.0, 0.0, torque)  # off: what moves its rotor loses nothing
        if asked.part == "torque":
            return Series(asked.name, NEWTON_METRE, torque)
        return Series(asked.name, WATT, torque * speed)

    def _effort(self, asked: Asked, drive: Drive) -> Array:
        """Return the effort of what drives the joint or the coordinate, the rotor's share included, shape (n,)."""
        if drive.joint:
            return self.run.tau[..., self.run.mechanism.joints[drive.joint].v]
        along = CoordinateQuantities(self.evaluation)
        return along.series(Asked(f"coordinate.{drive.coordinate}.effort", (drive.coordinate, "effort"))).values

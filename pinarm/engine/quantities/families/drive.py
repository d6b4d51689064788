"""Motors: torque, speed and power in front of their gears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.engine.quantities.family import NEWTON_METRE, WATT, Asked, Family
from pinarm.engine.series import Series
from pinarm.input.units import unit

PARTS = ("torque", "speed", "power")


@dataclass(frozen=True, eq=False)
class DriveQuantities(Family):
    """``drive.D...``: of the motor of drive D."""

    def names(self) -> list[str]:
        """Return the names of its quantities."""
        return [f"{name}.{part}" for name in self.run.mechanism.drives for part in PARTS]

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        run, drive = self.run, self.run.mechanism.drives.get(asked.of)
        if drive is None or len(asked.words) != 2 or asked.part not in PARTS:
            raise asked.unknown
        index = run.mechanism.joints[drive.joint].v
        speed = drive.speed(run.v[:, index])
        if asked.part == "speed":
            return Series(asked.name, unit("rad/s"), speed)
        self.require_efforts(asked)
        a, effort = run.a[:, index], run.tau[:, index]
        torque = drive.torque(effort - drive.armature * a, run.direction(index), a)
        torque = np.where(effort == 0.0, 0.0, torque)  # off: what moves its rotor loses nothing
        if asked.part == "torque":
            return Series(asked.name, NEWTON_METRE, torque)
        return Series(asked.name, WATT, torque * speed)

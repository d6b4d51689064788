"""Motors: from the voltage at their terminals to the torque of their shaft."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.yaml.schema import Inductance, InputStruct, Resistance, TorqueConstant


class DcMotor(InputStruct, frozen=True, tag_field="kind", tag="dc"):
    """A motor with brushes, or a brushless one with its electronics: ``L i' = V - R i - k w``, torque ``k i``.

    At rest it gives the stall torque ``k V / R``; without load it turns at ``V / k``. What its rotor takes, and its
    speed ratio, are the drive's: ``rotor_inertia``, ``ratio``.

    Attributes:
        resistance: R of the winding [ohm].
        constant: k, torque per current [N*m/A], which is voltage per speed [V*s/rad] too.
        inductance: L of the winding [H]; without one the current follows the voltage at once.
    """

    resistance: Resistance
    constant: TorqueConstant
    inductance: Inductance = 0.0

    def check(self) -> None:
        """Refuse a constant of 0."""
        if self.constant == 0.0:
            with within("constant"):
                raise InputError("a motor of constant 0 has no torque", expected="k in N*m/A")


@dataclass(frozen=True)
class Winding:
    """A DC motor behind its gear, by the speed of the joint that it drives.

    Attributes:
        motor: The motor.
        ratio: N, turns of the motor per turn of the joint, or radians per metre.
    """

    motor: DcMotor
    ratio: float

    @property
    def states(self) -> int:
        """Number of states: the current where there is an inductance."""
        return 1 if self.motor.inductance else 0

    def current(self, voltage: Array, v: Array) -> Array:
        """Return the current without inductance, ``(V - k N v) / R`` [A], at joint velocities v."""
        return np.asarray((voltage - self.motor.constant * self.ratio * v) / self.motor.resistance)

    def rate(self, voltage: Array, current: Array, v: Array) -> Array:
        """Return the rate of the current, ``(V - R i - k N v) / L`` [A/s]."""
        motor = self.motor
        return np.asarray((voltage - motor.resistance * current - motor.constant * self.ratio * v) / motor.inductance)

    def effort(self, current: Array) -> Array:
        """Return the effort at the joint, ``N k i`` [N*m or N]; a gear of a motor has no losses here."""
        return np.asarray(self.ratio * self.motor.constant * current)

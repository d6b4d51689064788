"""Motors as files give them; their equations are those of ``mechanics.control.motor_control``."""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar, NamedTuple

from pinarm.errors import InputError, within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import (
    Current,
    Inductance,
    InputStruct,
    MotorSpeed,
    MotorTorque,
    Resistance,
    TorqueConstant,
)


class CommandOfEffort(NamedTuple):
    """The command that gives an effort at the joint at a velocity: ``per_effort effort + per_velocity v``."""

    per_effort: float
    per_velocity: float


class DcMotor(InputStruct, frozen=True, tag_field="kind", tag="dc"):
    """A motor with brushes, or a brushless one with its electronics: ``L i' = V - R i - k w``, torque ``k i``.

    At rest it gives the stall torque ``k V / R``; without load it turns at ``V / k``. What its rotor takes, and its
    speed ratio, are the drive's: ``rotor_inertia``, ``ratio``. At the limit of the current its electronics lower the
    voltage to what holds it, ``R i + k w``, until the commanded voltage would take the current back.

    Attributes:
        resistance: R of the winding [ohm].
        constant: k, torque per current [N*m/A], which is voltage per speed [V*s/rad] too.
        inductance: L of the winding [H]; without one the current follows the voltage at once.
        current_limit: Largest current of its electronics in both directions [A]; no limit where it is left out.
    """

    supply: ClassVar[str] = "voltage"
    command: ClassVar[Unit] = unit("V")
    resistance: Resistance
    constant: TorqueConstant
    inductance: Inductance = 0.0
    current_limit: Current | None = None

    def inverse(self, ratio: float) -> CommandOfEffort | None:
        """Return the voltage of an effort T, ``V = R T / (N k) + k N v``; ``None`` with an inductance."""
        behind = self.constant * ratio
        return None if self.inductance else CommandOfEffort(self.resistance / behind, behind)


class IdealMotor(InputStruct, frozen=True, tag_field="kind", tag="ideal"):
    """A motor with fast electronics: its torque is the commanded one, up to its peak torque at its speed.

    Curves are pairs of speed and torque, straight between them, and hold for both directions of speed and of torque.
    Field weakening is a part of the curve that falls as ``P / w``, in points close enough for the wanted accuracy.

    Attributes:
        peak: Largest torque over speed, such as ``[[0 rpm, 2 N*m], [3000 rpm, 2 N*m], [6000 rpm, 0 N*m]]``; it begins
            at standstill, and ends with 0 at the speed beyond which there is none. No limit where it is left out.
        continuous: Torque that it may give for ever, over speed; it limits nothing, but is compared.
    """

    supply: ClassVar[str] = "torque"
    command: ClassVar[Unit] = unit("N*m")
    peak: list[tuple[MotorSpeed, MotorTorque]] | None = None
    continuous: list[tuple[MotorSpeed, MotorTorque]] | None = None

    def check(self) -> None:
        for key, points in (("peak", self.peak), ("continuous", self.continuous)):
            with within(key):
                if points is None:
                    continue
                if len(points) < 2 or points[0][0] != 0.0 or any(b <= a for (a, _), (b, _) in pairwise(points)):
                    raise InputError(
                        "the speeds of the curve do not ascend from 0",
                        expected="two points or more, the first at 0 rpm, ascending",
                    )
        if self.peak is not None and (self.peak[-1][1] != 0.0 or not self.peak[0][1]):
            with within("peak"):
                raise InputError(
                    f"the peak torque begins with {self.peak[0][1]:g} N*m and ends with {self.peak[-1][1]:g} N*m",
                    expected="a torque at standstill, and 0 at the end",
                    hint="a last point at the speed beyond which the motor gives none",
                )

    def inverse(self, ratio: float) -> CommandOfEffort | None:
        return CommandOfEffort(1.0 / ratio, 0.0)


AnyMotor = DcMotor | IdealMotor
"""Any motor. A new one is a struct beside these with their members, an entry here, and its ``MotorController``."""

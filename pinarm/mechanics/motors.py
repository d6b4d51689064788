"""Motors: from what is commanded, a voltage or a torque, to the torque of their shaft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar, Protocol

import numpy as np

from pinarm.arrays import Array
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


class Actuator(Protocol):
    """A motor behind its gear, by the velocity v of the joint that it drives; arrays have any shape (...)."""

    @property
    def states(self) -> int:
        """Number s of its own states."""
        ...

    def effort(self, command: Array, state: Array, v: Array) -> Array:
        """Return the effort at the joint [N*m or N], shape (...), for commands and states of shape (..., s)."""
        ...

    def rates(self, command: Array, state: Array, v: Array) -> Array:
        """Return the rates of the states, shape (..., s)."""
        ...

    def parts(self, command: Array, state: Array, v: Array) -> dict[str, Array]:
        """Return the effort and what else is told of the motor, by name, shape (...) each."""
        ...

    def kinks(self, command: Array, state: Array, v: Array) -> list[Array]:
        """Return values of shape (...) whose zeros are where the effort stops being smooth; always as many."""
        ...

    def excess(self, command: Array, state: Array, v: Array) -> Array:
        """Return the part of the command that a limit of the motor keeps from its effect, shape (...); else 0."""
        ...


class MotorDefinition(Protocol):
    """A motor as a file describes it."""

    supply: ClassVar[str]
    """Name of what is commanded: ``voltage`` or ``torque``."""

    command: ClassVar[Unit]
    """Its unit."""

    def behind(self, ratio: float) -> Actuator:
        """Return the motor with a gear, by N, its turns per turn of the joint, or radians per metre."""
        ...


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

    def check(self) -> None:
        """Refuse a constant of 0."""
        if self.constant == 0.0:
            with within("constant"):
                raise InputError("a motor of constant 0 has no torque", expected="k in N*m/A")

    def behind(self, ratio: float) -> Actuator:
        """Return the motor with a gear."""
        return Winding(self, ratio)


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
        """Refuse curves that are no functions of the speed from 0 on, and a peak torque that does not end with 0."""
        for key, points in (("peak", self.peak), ("continuous", self.continuous)):
            with within(key):
                if points is None:
                    continue
                if len(points) < 2 or points[0][0] != 0.0 or any(b <= a for (a, _), (b, _) in pairwise(points)):
                    raise InputError("the speeds of the curve do not ascend from 0",
                                     expected="two points or more, the first at 0 rpm, ascending")  # fmt: skip
        if self.peak is not None and (self.peak[-1][1] != 0.0 or not self.peak[0][1]):
            with within("peak"):
                raise InputError(f"the peak torque begins with {self.peak[0][1]:g} N*m and ends with "
                                 f"{self.peak[-1][1]:g} N*m", expected="a torque at standstill, and 0 at the end",
                                 hint="a last point at the speed beyond which the motor gives none")  # fmt: skip

    def behind(self, ratio: float) -> Actuator:
        """Return the motor with a gear."""
        return TorqueSource(ratio, *(None if x is None else TorqueCurve.of(x) for x in (self.peak, self.continuous)))


AnyMotor = DcMotor | IdealMotor
"""Any motor. A new one is a struct beside these with ``MotorDefinition``'s members, and one entry here."""


@dataclass(frozen=True)
class Winding:
    """A DC motor behind its gear; see ``Actuator``.

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

    @property
    def most(self) -> float:
        """Largest current [A]; infinite for no limit."""
        return np.inf if self.motor.current_limit is None else float(self.motor.current_limit)

    def current(self, voltage: Array, state: Array, v: Array) -> Array:
        """Return the current, without inductance ``(V - k N v) / R`` within its limit [A]."""
        if self.states:
            return np.asarray(state[..., 0])
        return np.asarray(np.clip(self._over(voltage, 0.0, v) / self.motor.resistance, -self.most, self.most))

    def _over(self, voltage: Array, current: Array | float, v: Array) -> Array:
        """Return the voltage that is left to change a current, ``V - R i - k N v`` [V]."""
        return np.asarray(voltage - self.motor.resistance * current - self.motor.constant * self.ratio * v)

    def excess(self, command: Array, state: Array, v: Array) -> Array:
        """Return the commanded voltage less the one that holds the current at its limit, else 0 [V]."""
        current = self.current(command, state, v)
        over = self._over(command, current, v)
        held = ((current >= self.most) & (over > 0.0)) | ((current <= -self.most) & (over < 0.0))
        return np.asarray(np.where(held, over, 0.0))

    def rates(self, command: Array, state: Array, v: Array) -> Array:
        """Return the rate of the current, ``(V - R i - k N v) / L``, 0 at its limit [A/s], shape (..., s)."""
        if not self.states:
            return np.zeros((*np.shape(command), 0))
        over = self._over(command, state[..., 0], v) - self.excess(command, state, v)
        return np.asarray(over / self.motor.inductance)[..., None]

    def effort(self, command: Array, state: Array, v: Array) -> Array:
        """Return the effort at the joint, ``N k i`` [N*m or N]."""
        return np.asarray(self.ratio * self.motor.constant * self.current(command, state, v))

    def parts(self, command: Array, state: Array, v: Array) -> dict[str, Array]:
        """Return effort, voltage and current, and the distance of this to its limit, ``current_margin`` [A]."""
        current = self.current(command, state, v)
        found = {
            "effort": self.effort(command, state, v),
            "voltage": np.asarray(command - self.excess(command, state, v)),
            "current": current,
        }
        return found if np.isinf(self.most) else {**found, "current_margin": self.most - np.abs(current)}

    def kinks(self, command: Array, state: Array, v: Array) -> list[Array]:
        """Return the voltages that are left at both limits of the current, and its distances to them."""
        if np.isinf(self.most):
            return []
        left = [self._over(command, limit, v) for limit in (self.most, -self.most)]
        return [*left, *(state[..., 0] - limit for limit in (self.most, -self.most))] if self.states else left


@dataclass(frozen=True, eq=False)
class TorqueCurve:
    """A torque over the amount of the speed, straight between points.

    Attributes:
        speeds: From 0 on, ascending [rad/s], shape (k,).
        torques: There [N*m], shape (k,); the last one holds beyond.
    """

    speeds: Array = field(repr=False)
    torques: Array = field(repr=False)

    @classmethod
    def of(cls, points: Sequence[tuple[float, float]]) -> TorqueCurve:
        """Return the curve through points."""
        speeds, torques = np.array(points, float).T
        return cls(speeds, torques)

    def at(self, speed: Array) -> Array:
        """Return the torques at speeds of either direction [rad/s], in their shape."""
        return np.asarray(np.interp(np.abs(speed), self.speeds, self.torques))


@dataclass(frozen=True, eq=False)
class TorqueSource:
    """An ideal motor behind its gear; see ``Actuator``.

    Attributes:
        ratio: N, turns of the motor per turn of the joint, or radians per metre.
        peak: Its largest torque; ``None`` for no limit.
        continuous: The torque that it may give for ever; ``None`` where it is not known.
    """

    ratio: float
    peak: TorqueCurve | None
    continuous: TorqueCurve | None
    states: ClassVar[int] = 0

    def torque(self, command: Array, v: Array) -> Array:
        """Return the torque of the motor [N*m]."""
        if self.peak is None:
            return command
        most = self.peak.at(self.ratio * v)
        return np.asarray(np.minimum(np.maximum(command, -most), most))

    def effort(self, command: Array, state: Array, v: Array) -> Array:
        """Return N times the torque."""
        return np.asarray(self.ratio * self.torque(command, v))

    def rates(self, command: Array, state: Array, v: Array) -> Array:
        """Return nothing: it has no states."""
        return np.zeros((*np.shape(command), 0))

    def parts(self, command: Array, state: Array, v: Array) -> dict[str, Array]:
        """Return effort, torque, and its distance to the curves: ``margin`` and ``continuous_margin`` [N*m]."""
        torque, speed = self.torque(command, v), self.ratio * v
        found = {"effort": np.asarray(self.ratio * torque), "torque": torque}
        for name, curve in (("margin", self.peak), ("continuous_margin", self.continuous)):
            if curve is not None:
                found[name] = curve.at(speed) - np.abs(torque)
        return found

    def excess(self, command: Array, state: Array, v: Array) -> Array:
        """Return the commanded torque less the one that it gives [N*m]."""
        return np.asarray(command - self.torque(command, v))

    def kinks(self, command: Array, state: Array, v: Array) -> list[Array]:
        """Return the distances of the command to the peak torque, and of the speed to the bends of its curve."""
        if self.peak is None:
            return []
        speed = np.abs(self.ratio * v)
        most = self.peak.at(speed)
        return [command - most, command + most, *(speed - bend for bend in self.peak.speeds[1:])]

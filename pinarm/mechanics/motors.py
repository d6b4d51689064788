"""Motors: from what is commanded, a voltage or a torque, to the torque of their shaft."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np

from pinarm.arrays import Array, Indices
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
from pinarm.mechanics.limited_states import FREE, StateLimits, Switch
from pinarm.records import Record


class MotorInput(NamedTuple):
    """Inputs of a motor, in any number of states (...).

    Attributes:
        command: Voltages [V] or torques [N*m], shape (...).
        state: States of the motor, shape (..., s).
        v: Velocities of the joint that it drives [rad/s or m/s], shape (...).
        mode: Modes of the motor, see ``mechanics.limited_states``, shape (...).
    """

    command: Array
    state: Array
    v: Array
    mode: Indices | int = FREE


class CommandOfEffort(NamedTuple):
    """The command that gives an effort at the joint at a velocity: ``per_effort effort + per_velocity v``."""

    per_effort: float
    per_velocity: float


class Actuator(Record, frozen=True):
    """A motor behind its gear, without states of its own."""

    states: ClassVar[int] = 0

    def effort(self, given: MotorInput) -> Array:
        """Return the effort at the joint [N*m or N], shape (...)."""
        raise NotImplementedError

    def parts(self, given: MotorInput) -> dict[str, Array]:
        """Return the effort and what else is known of the motor, by name, shape (...) each."""
        raise NotImplementedError

    def excess(self, given: MotorInput) -> Array:
        """Return the part of the command that a limit of the motor keeps from its effect, shape (...); else 0."""
        raise NotImplementedError

    def switches(self, mode: int) -> list[Switch[MotorInput]]:
        raise NotImplementedError

    def rates(self, given: MotorInput) -> Array:
        """Return the rates of the states, shape (..., s)."""
        return np.zeros((*np.shape(given.command), 0))

    def mode(self, given: MotorInput) -> int:
        """Return the mode in one state, by the one until then in ``given``."""
        return FREE


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
        if self.constant == 0.0:
            with within("constant"):
                raise InputError("a motor of constant 0 has no torque", expected="k in N*m/A")

    def behind(self, ratio: float) -> Actuator:
        return (InductiveWinding if self.inductance else Winding)(self, ratio)

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

    def behind(self, ratio: float) -> Actuator:
        curves = (None if points is None else np.array(points, float).T for points in (self.peak, self.continuous))
        return TorqueSource(ratio, *curves)

    def inverse(self, ratio: float) -> CommandOfEffort | None:
        return CommandOfEffort(1.0 / ratio, 0.0)


AnyMotor = DcMotor | IdealMotor
"""Any motor. A new one is a struct beside these with their members, and one entry here."""


class Winding(Actuator, frozen=True):
    """A DC motor without inductance behind its gear: voltage and velocity determine the current."""

    motor: DcMotor
    ratio: float

    @property
    def limit(self) -> float:
        """Largest current [A]; infinite for no limit."""
        return np.inf if self.motor.current_limit is None else float(self.motor.current_limit)

    def current(self, given: MotorInput) -> Array:
        """Return the current ``(V - k N v) / R`` within its limit [A]."""
        return np.asarray(np.clip(self.voltage_left(given, 0.0) / self.motor.resistance, -self.limit, self.limit))

    def voltage_left(self, given: MotorInput, current: Array | float) -> Array:
        """Return the voltage that is left to change a current, ``V - R i - k N v`` [V]."""
        held = self.motor.resistance * current + self.motor.constant * self.ratio * given.v
        return np.asarray(given.command - held)

    def excess(self, given: MotorInput) -> Array:
        """Return the commanded voltage less the one that drives the current, which differs at the limit [V]."""
        return self.voltage_left(given, self.current(given)) if np.isfinite(self.limit) else np.zeros(np.shape(given.v))

    def effort(self, given: MotorInput) -> Array:
        """Return the effort at the joint, ``N k i`` [N*m or N]."""
        return np.asarray(self.ratio * self.motor.constant * self.current(given))

    def parts(self, given: MotorInput) -> dict[str, Array]:
        """Return effort, voltage and current, and the distance of this to its limit, ``current_margin`` [A]."""
        current = self.current(given)
        voltage = np.asarray(given.command - self.excess(given))
        known = {"effort": self.effort(given), "voltage": voltage, "current": current}
        return known if np.isinf(self.limit) else {**known, "current_margin": self.limit - np.abs(current)}

    def switches(self, mode: int) -> list[Switch[MotorInput]]:
        ends = () if np.isinf(self.limit) else (self.limit, -self.limit)
        return [Switch(partial(self.voltage_left, current=at)) for at in ends]


class InductiveWinding(Winding, frozen=True):
    """A DC motor whose current is a state; at its limit it is held, see ``mechanics.limited_states`` for its modes."""

    states: ClassVar[int] = 1

    def current(self, given: MotorInput) -> Array:
        """Return the current, less what its integration misses the limit by [A]."""
        return np.asarray(np.clip(given.state[..., 0], -self.limit, self.limit))

    def excess(self, given: MotorInput) -> Array:
        return np.where(np.equal(given.mode, FREE), 0.0, self.excess_if_held(given))

    def excess_if_held(self, given: MotorInput) -> Array:
        """Return the voltage that would be left if the present current were held [V]."""
        return self.voltage_left(given, self.current(given))

    def rates(self, given: MotorInput) -> Array:
        """Return the rate of the current, ``(V - R i - k N v) / L``, 0 where it is held [A/s], shape (..., 1)."""
        left = self.voltage_left(given, given.state[..., 0])
        return np.asarray(np.where(np.equal(given.mode, FREE), left, 0.0) / self.motor.inductance)[..., None]

    def mode(self, given: MotorInput) -> int:
        assert isinstance(given.mode, int)
        scale = self.motor.resistance * abs(float(self.current(given)))
        return self._limits.mode(float(given.state[..., 0]), float(self.excess_if_held(given)), scale, given.mode)

    def switches(self, mode: int) -> list[Switch[MotorInput]]:
        return self._limits.switches(mode, lambda given: given.state[..., 0], self.excess_if_held)

    @property
    def _limits(self) -> StateLimits:
        return StateLimits(-self.limit, self.limit)


class TorqueSource(Actuator, frozen=True):
    """An ideal motor behind its gear: command and velocity determine the torque.

    Attributes:
        peak: Amounts of the speed, ascending from 0 [rad/s], and its largest torques there [N*m], shape (2, k).
        continuous: The same of the torque that it may give for ever.
    """

    ratio: float
    peak: Array | None
    continuous: Array | None

    def torque(self, given: MotorInput) -> Array:
        """Return the torque of the motor [N*m]."""
        if self.peak is None:
            return given.command
        most = self._most(self.peak, given)
        return np.asarray(np.minimum(np.maximum(given.command, -most), most))

    def _most(self, curve: Array, given: MotorInput) -> Array:
        """Return the torque of a curve, the last one beyond it, at the speeds of the motor [N*m]."""
        return np.asarray(np.interp(np.abs(self.ratio * given.v), *curve))

    def effort(self, given: MotorInput) -> Array:
        return np.asarray(self.ratio * self.torque(given))

    def parts(self, given: MotorInput) -> dict[str, Array]:
        """Return effort, torque, and its distance to the curves: ``margin`` and ``continuous_margin`` [N*m]."""
        torque = self.torque(given)
        known = {"effort": np.asarray(self.ratio * torque), "torque": torque}
        curves = {"margin": self.peak, "continuous_margin": self.continuous}
        known |= {name: self._most(x, given) - np.abs(torque) for name, x in curves.items() if x is not None}
        return known

    def excess(self, given: MotorInput) -> Array:
        return np.asarray(given.command - self.torque(given))

    def switches(self, mode: int) -> list[Switch[MotorInput]]:
        if (peak := self.peak) is None:
            return []
        bends = [Switch(lambda given, at=bend: np.abs(self.ratio * given.v) - at) for bend in peak[0, 1:]]  # type: ignore[misc]
        return [
            Switch(lambda given: given.command - self._most(peak, given)),
            Switch(lambda given: given.command + self._most(peak, given)),
            *bends,
        ]

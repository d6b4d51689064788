"""Motors behind controllers: from the voltage or torque that is commanded to the effort at the joint."""

from __future__ import annotations

from abc import abstractmethod
from functools import partial
from typing import Any

import numpy as np

from pinarm.arrays import Array
from pinarm.mechanics.control.controller import Controller, Given
from pinarm.mechanics.limited_states import FREE, StateLimits, Switch
from pinarm.mechanics.motors import AnyMotor, DcMotor, IdealMotor


class MotorController(Controller, frozen=True, kw_only=True):
    """The motor of one drive with its gear, behind a controller: a controller whose states are those of the motor.

    Attributes:
        source: The controller that commands it.
        number: Number of its drive among those of the source.
        ratio: N, of the gear.
    """

    source: Controller
    number: int
    ratio: float

    @abstractmethod
    def torque(self, given: Given) -> Array:
        """Return the torque of the motor [N*m], shape (...)."""

    @abstractmethod
    def excess(self, given: Given) -> Array:
        """Return the part of the command that a limit of the motor keeps from its effect, shape (...); else 0."""

    @abstractmethod
    def figures(self, given: Given) -> dict[str, Array]:
        """Return the quantities of the motor beside its effort, by name, shape (...) each."""

    def commanded(self, given: Given) -> Array:
        """Return the voltage [V] or the torque [N*m] that is commanded, shape (...)."""
        return np.asarray(given.commands[..., self.number])

    def speed(self, given: Given) -> Array:
        """Return the speed of the motor, ``N v`` [rad/s], shape (...)."""
        return np.asarray(self.ratio * given.v[..., self.joints[0].v])

    def command(self, given: Given) -> Array:
        return np.asarray(self.ratio * self.torque(given))[..., None]

    def parts(self, given: Given) -> dict[str, Array]:
        return {"effort": self.command(given)} | {name: x[..., None] for name, x in self.figures(given).items()}


class Winding(MotorController, frozen=True, kw_only=True):
    """A DC motor without inductance: voltage and velocity determine the current."""

    motor: DcMotor

    @property
    def limit(self) -> float:
        """Largest current [A]; infinite for no limit."""
        return np.inf if self.motor.current_limit is None else float(self.motor.current_limit)

    def current(self, given: Given) -> Array:
        """Return the current ``(V - k N v) / R`` within its limit [A]."""
        return np.asarray(np.clip(self.voltage_left(given, 0.0) / self.motor.resistance, -self.limit, self.limit))

    def voltage_left(self, given: Given, current: Array | float) -> Array:
        """Return the voltage that is left to change a current, ``V - R i - k N v`` [V]."""
        held = self.motor.resistance * current + self.motor.constant * self.speed(given)
        return np.asarray(self.commanded(given) - held)

    def excess(self, given: Given) -> Array:
        """Return the commanded voltage less the one that drives the current, which differs at the limit [V]."""
        return self.voltage_left(given, self.current(given)) if np.isfinite(self.limit) else np.zeros(np.shape(given.t))

    def torque(self, given: Given) -> Array:
        return np.asarray(self.motor.constant * self.current(given))

    def figures(self, given: Given) -> dict[str, Array]:
        """Return voltage and current, and the distance of this to its limit, ``current_margin`` [A]."""
        current = self.current(given)
        known = {"voltage": np.asarray(self.commanded(given) - self.excess(given)), "current": current}
        return known if np.isinf(self.limit) else {**known, "current_margin": self.limit - np.abs(current)}

    def switches(self, mode: int) -> list[Switch[Given]]:
        ends = () if np.isinf(self.limit) else (self.limit, -self.limit)
        return [Switch(partial(self.voltage_left, current=at)) for at in ends]


class InductiveWinding(Winding, frozen=True, kw_only=True):
    """A DC motor whose current is a state; at its limit it is held, see ``mechanics.limited_states`` for its modes."""

    @property
    def integrals(self) -> int:
        return 1

    def current(self, given: Given) -> Array:
        """Return the current, less what its integration misses the limit by [A]."""
        return np.asarray(np.clip(given.integral[..., 0], -self.limit, self.limit))

    def excess(self, given: Given) -> Array:
        return np.where(np.equal(given.mode, FREE), 0.0, self._excess_if_held(given))

    def _excess_if_held(self, given: Given) -> Array:
        """Return the voltage that would be left if the present current were held [V]."""
        return self.voltage_left(given, self.current(given))

    def rates(self, given: Given) -> Array:
        """Return the rate of the current, ``(V - R i - k N v) / L``, 0 where it is held [A/s], shape (..., 1)."""
        left = self.voltage_left(given, given.integral[..., 0])
        return np.asarray(np.where(np.equal(given.mode, FREE), left, 0.0) / self.motor.inductance)[..., None]

    def mode(self, given: Given, before: int | None) -> int:
        scale, left = self.motor.resistance * abs(float(self.current(given))), float(self._excess_if_held(given))
        return StateLimits(-self.limit, self.limit).mode(float(given.integral[0]), left, scale, before or FREE)

    def switches(self, mode: int) -> list[Switch[Given]]:
        limits = StateLimits(-self.limit, self.limit)
        return limits.switches(mode, lambda given: given.integral[..., 0], self._excess_if_held)


class TorqueSource(MotorController, frozen=True, kw_only=True):
    """An ideal motor: command and velocity determine the torque.

    Attributes:
        peak: Amounts of the speed, ascending from 0 [rad/s], and its largest torques there [N*m], shape (2, k).
        continuous: The same of the torque that it may give for ever.
    """

    peak: Array | None
    continuous: Array | None

    def torque(self, given: Given) -> Array:
        command = self.commanded(given)
        if self.peak is None:
            return command
        most = self._most(self.peak, given)
        return np.asarray(np.minimum(np.maximum(command, -most), most))

    def _most(self, curve: Array, given: Given) -> Array:
        """Return the torque of a curve, the last one beyond it, at the speeds of the motor [N*m]."""
        return np.asarray(np.interp(np.abs(self.speed(given)), *curve))

    def excess(self, given: Given) -> Array:
        return np.asarray(self.commanded(given) - self.torque(given))

    def figures(self, given: Given) -> dict[str, Array]:
        """Return the torque, and its distance to the curves: ``margin`` and ``continuous_margin`` [N*m]."""
        torque, curves = self.torque(given), {"margin": self.peak, "continuous_margin": self.continuous}
        margins = {name: self._most(x, given) - np.abs(torque) for name, x in curves.items() if x is not None}
        return {"torque": torque, **margins}

    def switches(self, mode: int) -> list[Switch[Given]]:
        if (peak := self.peak) is None:
            return []
        reached = [
            Switch(lambda given, sign=sign: self.commanded(given) - sign * self._most(peak, given))  # type: ignore[misc]
            for sign in (1.0, -1.0)
        ]
        bends = [Switch(lambda given, at=bend: np.abs(self.speed(given)) - at) for bend in peak[0, 1:]]  # type: ignore[misc]
        return [*reached, *bends]


def motor_behind(source: Controller, number: int, motor: AnyMotor, ratio: float) -> MotorController:
    """Return the motor of one drive of a controller."""
    endless, drives, joints = np.full(1, np.inf), (source.drives[number],), (source.joints[number],)
    wired: dict[str, Any] = {"drives": drives, "joints": joints, "lower": -endless, "upper": endless}
    wired |= {"source": source, "number": number, "ratio": ratio}
    if isinstance(motor, IdealMotor):
        curves = (None if points is None else np.array(points, float).T for points in (motor.peak, motor.continuous))
        peak, continuous = curves
        return TorqueSource(**wired, peak=peak, continuous=continuous)
    return (InductiveWinding if motor.inductance else Winding)(**wired, motor=motor)

"""Proportional, integral and derivative control of drives, each on a measured coordinate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, UnitError, within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import Duration, Gain, IntegralGain, RateGain, check_unit
from pinarm.mechanics.control.controller import Controller, Given, Plant, Signal
from pinarm.mechanics.control.definition import OneDriveDefinition, References
from pinarm.mechanics.limited_states import FREE, StateLimits, Switch, mode_of, number_of


class Pid(OneDriveDefinition, frozen=True, kw_only=True, tag_field="kind", tag="pid"):
    """``u = kp e + ki integral of e + kd e'``, with the error ``e = r - y`` of a coordinate y that follows r(t).

    The derivative is that of the error, so that a moving reference is followed without lag of the damping. The part of
    the integral, ``ki integral of e``, is kept within the limits of the effort (clamp): it does not wind up. Sampled,
    the integral is the sum of the errors times the period, the present one included.

    Where a limit of the drive's motor, its peak torque or its largest current, keeps a part of the command from its
    effect, the integral follows what is given (back-calculation): ``x' = e - (u - u_given) / (ki T_t)`` with the
    tracking time T_t. With T_t = kp/ki the integral's part tends to ``u_given - kd e'`` as ``exp(-t / T_t)``, and does
    not wind up. Source: Åström, Hägglund, PID Controllers, 1995, section 3.5.

    Good values for an inertia J: ``kp = J w^2``, ``kd = 2 d J w``, with the pulsation w of the closed loop and its
    damping ratio d, 0.7 to 1; ``ki`` at most ``0.1 kp w``; a period below ``0.1 / w``.

    Attributes:
        follows: The law of the reference r.
        kp: Effort per error.
        ki: Effort per error and second.
        kd: Effort per rate of the error.
        tracking_time: Time T_t in which the integral follows a command that is cut off at its limit, such as ``50 ms``;
            kp/ki where it is left out.
    """

    follows: References
    kp: Gain
    ki: IntegralGain = 0.0
    kd: RateGain = 0.0
    tracking_time: Duration | None = None

    def bind(self, plant: Plant) -> Controller:
        (commanded,), signals = self.units(plant), self.signals(plant)
        laws = self.follows.laws([self.measures or self.drives[0]], signals)
        gains = []
        for key, per in (("kp", "1"), ("ki", "s"), ("kd", "1/s")):
            with within(key):
                _check_gain(getattr(self, key), commanded, signals[0], per)
            gains.append(np.array([float(getattr(self, key))]))
        kp, ki, kd = gains
        return PidController(*self.wired(plant, signals, laws), kp, ki, kd, self._tracking())

    def _tracking(self) -> float:
        """Return T_t [s]; infinite where it is not given and kp is 0."""
        if self.tracking_time is None:
            kp, ki = float(self.kp), float(self.ki)
            return abs(kp / ki) if kp and ki else np.inf
        if self.period and not float(self.tracking_time) > float(self.period) / 2:  # the integral would not settle
            with within("tracking_time"):
                raise InputError(
                    f"a tracking time of {float(self.tracking_time):g} s and a period of {float(self.period):g} s",
                    expected="more than half of the period",
                )
        return float(self.tracking_time)


def _check_gain(gain: float, commanded: Unit, measured: Signal, per: str) -> None:
    """Check the unit of a gain; ``per`` is that of the time in it."""
    try:
        check_unit(gain, commanded / measured.unit / unit(per))
    except UnitError as error:
        time = {"1": "", "s": "/s", "1/s": "*s"}[per]
        raise UnitError(
            error.message,
            expected=f"{commanded}{time}/{measured.unit}: the drive takes {commanded}, and '{measured.name}' is in "
            f"{measured.unit}",
            hint=f"20 {commanded}{time}/{measured.unit}",
        ) from None


@dataclass(frozen=True, eq=False)
class PidController(Controller):
    """A PID controller of one mechanism.

    Attributes:
        kp: Effort per error, shape (k,).
        ki: Effort per error and second, shape (k,).
        kd: Effort per rate of the error, shape (k,).
        tracking_time: Time in which the integral follows a motor at its limit [s].
    """

    kp: Array = field(repr=False)
    ki: Array = field(repr=False)
    kd: Array = field(repr=False)
    tracking_time: float = np.inf

    def command(self, given: Given) -> Array:
        """Return ``kp e + ki x + kd e'``."""
        error = given.error
        u = self.kp * error[..., 0] + self.kd * error[..., 1]
        return np.asarray(u + self.ki * given.integral if self.integrals else u)

    @property
    def integrals(self) -> int:
        return self._integrals

    @cached_property
    def _integrals(self) -> int:
        return len(self.joints) if self.ki.any() else 0

    def rates(self, given: Given) -> Array:
        if not self.integrals:
            return super().rates(given)
        free = self._free_rates(given)
        modes = np.stack([mode_of(given.mode, k) for k in range(len(self.joints))], axis=-1)
        return np.where(modes == FREE, free, 0.0)

    def _free_rates(self, given: Given) -> Array:
        """Return the rates of integrals that are within their limits, shape (..., k)."""
        error = given.error[..., 0]
        return error - given.excess / (self.ki * self.tracking_time) if given.excess.size else error

    def clamped(self, integral: Array) -> Array:
        return np.asarray(np.minimum(np.maximum(integral, self._ends[0]), self._ends[1]))

    @cached_property
    def _ends(self) -> Array:
        """Least and largest integrals, shape (2, k)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort(np.array([self.lower, self.upper]) / self.ki, axis=0)
        endless = np.array([[-np.inf], [np.inf]])
        return np.asarray(np.where(self.ki == 0.0, endless, ends), dtype=np.float64)

    def _limits(self, k: int) -> StateLimits:
        """Return the limits of an integral's part; none without an integral."""
        limited = self.integrals and self.ki[k]
        return StateLimits(float(self.lower[k]), float(self.upper[k])) if limited else StateLimits(-np.inf, np.inf)

    def mode(self, given: Given, before: int | None) -> int:
        if not self.integrals:
            return 0
        parts, rates = self.ki * given.integral, self.ki * self._free_rates(given)
        terms = np.abs(self.ki) * (np.abs(given.reference[..., 0]) + np.abs(given.measured[..., 0]))
        return number_of(
            self._limits(k).mode(float(parts[k]), float(rates[k]), float(terms[k]), mode_of(before or 0, k))
            for k in range(len(self.joints))
        )

    def switches(self, mode: int) -> list[Switch[Given]]:
        own, modes = super().switches(mode), [mode_of(mode, k) for k in range(len(self.joints))]
        for k, present in enumerate(modes):
            for switch in self._limits(k).switches(present, self._part(k), self._rate_of_part(k)):
                assert switch.mode is not None
                own.append(switch._replace(mode=number_of([*modes[:k], switch.mode, *modes[k + 1 :]])))
        return own

    def _part(self, k: int) -> Callable[[Given], Array]:
        return lambda given: np.asarray(self.ki[k] * given.integral[..., k])

    def _rate_of_part(self, k: int) -> Callable[[Given], Array]:
        return lambda given: np.asarray(self.ki[k] * self._free_rates(given)[..., k])

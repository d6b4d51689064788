"""A controller whose commands go to motors, with these motors behind it: their currents are states of the run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.mechanics.control.controller import Controller, Given
from pinarm.mechanics.limited_states import MODES, Modes, Switch, mode_of, number_of
from pinarm.mechanics.motors import Actuator, MotorInput


@dataclass(frozen=True, eq=False)
class MotorController(Controller):
    """A continuous controller that gives the efforts of motors, by the voltages or torques of another controller.

    The integrals are those of the other controller where that is continuous, then the states of the motors. The mode is
    that of the other controller, followed by a digit for each motor.
    """

    source: Controller
    actuators: tuple[Actuator, ...] = field(repr=False)
    place: int = 0

    @classmethod
    def of(cls, source: Controller, actuators: Sequence[Actuator], place: int) -> MotorController:
        endless, sampled = np.full(len(source.joints), np.inf), source.sampling is not None
        signals, laws = ((), ()) if sampled else (source.signals, source.references)
        motors = tuple(actuators)
        ends = -endless, endless
        return cls(
            source.drives, source.joints, signals, laws, *ends, None, source, motors, place, supply=source.supply
        )

    @property
    def own(self) -> int:
        """Number of integrals of the controller of the motors."""
        return 0 if self.source.sampling else self.source.integrals

    @property
    def integrals(self) -> int:
        return self.own + sum(motor.states for motor in self.actuators)

    @cached_property
    def _velocities(self) -> Indices:
        return np.array([joint.v for joint in self.joints], dtype=np.intp)

    @cached_property
    def _states(self) -> list[slice]:
        ends = list(accumulate((motor.states for motor in self.actuators), initial=self.own))
        return [slice(*pair) for pair in pairwise(ends)]

    def _of_source(self, given: Given) -> Given:
        return given._replace(integral=given.integral[..., : self.own], mode=self._mode_of_source(given.mode))

    def _of_limited(self, given: Given) -> Given:
        return self._of_source(given)._replace(excess=self.excess(given))

    def commands(self, given: Given) -> Array:
        """Return the voltages [V] or torques [N*m] that are commanded, within the limits, shape (..., k)."""
        if self.source.sampling:
            return np.asarray(given.applied[..., self.place : self.place + len(self.joints)])
        return self.source.limited(self.source.command(self._of_source(given)))

    def inputs(self, given: Given) -> list[MotorInput]:
        v, commands = given.v[..., self._velocities], self.commands(given)
        return [
            MotorInput(commands[..., k], given.integral[..., place], v[..., k], mode_of(given.mode, k))
            for k, place in enumerate(self._states)
        ]

    def _pairs(self, given: Given) -> Iterable[tuple[Actuator, MotorInput]]:
        return zip(self.actuators, self.inputs(given), strict=True)

    def excess(self, given: Given) -> Array:
        """Return the part of the commands that limits of the motors cut off, shape (..., k)."""
        return np.stack([motor.excess(own) for motor, own in self._pairs(given)], axis=-1)

    def command(self, given: Given) -> Array:
        return np.stack([motor.effort(own) for motor, own in self._pairs(given)], axis=-1)

    def parts(self, given: Given) -> dict[str, Array]:
        """Return quantities of the motors by name, and the command of a continuous controller, shape (..., k) each."""
        each = [motor.parts(own) for motor, own in self._pairs(given)]
        names = dict.fromkeys(name for part in each for name in part)
        unknown = np.full(np.shape(given.t), np.nan)
        known = {name: np.stack([part.get(name, unknown) for part in each], axis=-1) for name in names}
        if self.source.sampling:
            return known
        return {"command": self.source.command(self._of_source(given)), **known}

    def rates(self, given: Given) -> Array:
        """Return the rates of the integrals and of the motors' states, shape (..., m)."""
        own = np.zeros((*np.shape(given.t), 0))
        if self.own:
            own = self.source.rates(self._of_limited(given))
        if self.own == self.integrals:
            return own
        return np.concatenate([own, *(motor.rates(each) for motor, each in self._pairs(given))], axis=-1)

    def mode(self, given: Given, before: int | None) -> int:
        given = given._replace(mode=before or 0)
        source = 0
        if not self.source.sampling:
            source = self.source.mode(self._of_limited(given), None if before is None else self._mode_of_source(before))
        before_motors = (mode_of(before or 0, k) for k in range(len(self.actuators)))
        given = given._replace(mode=number_of(before_motors, source))
        return number_of((motor.mode(own) for motor, own in self._pairs(given)), source)

    def _mode_of_source(self, mode: Modes) -> Modes:
        return mode // int(MODES ** len(self.actuators))

    def switches(self, mode: int) -> list[Switch[Given]]:
        source, motors = self._mode_of_source(mode), [mode_of(mode, k) for k in range(len(self.actuators))]
        own = (
            []
            if self.source.sampling
            else [
                switch._replace(
                    value=lambda given, value=switch.value: value(self._of_limited(given)),  # type: ignore[misc]
                    mode=None if switch.mode is None else number_of(motors, switch.mode),
                )
                for switch in self.source.switches(source)
            ]
        )
        for k, motor in enumerate(self.actuators):
            for switch in motor.switches(motors[k]):
                modes = motors if switch.mode is None else [*motors[:k], switch.mode, *motors[k + 1 :]]
                value, mode = self._value_of(k, switch), number_of(modes, source)
                own.append(Switch(value, switch.direction, mode, switch.jumps))
        return own

    def _value_of(self, k: int, switch: Switch[MotorInput]) -> Callable[[Given], Array]:
        return lambda given: switch.value(self.inputs(given)[k])

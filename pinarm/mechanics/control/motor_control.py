"""A controller whose commands go to motors, with these motors behind it: their currents are states of the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.mechanics.control.controller import Controller, Given, Switch
from pinarm.mechanics.motors import Actuator


@dataclass(frozen=True, eq=False)
class MotorController(Controller):
    """A continuous controller that gives the efforts of motors, by the voltages or torques of another controller.

    The integrals are those of the other controller where that is continuous, then the states of the motors.

    Attributes:
        source: The controller that commands the motors.
        actuators: The motors of its k drives.
        place: Place of the first command among the commands of sampled controllers.
    """

    source: Controller
    actuators: tuple[Actuator, ...] = field(repr=False)
    place: int = 0

    @classmethod
    def of(cls, source: Controller, actuators: Sequence[Actuator], place: int) -> MotorController:
        """Return the controller of motors behind another controller."""
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
        """Number of integrals, the states of the motors included."""
        return self.own + sum(motor.states for motor in self.actuators)

    @cached_property
    def _velocities(self) -> Indices:
        return np.array([joint.v for joint in self.joints], dtype=np.intp)

    @cached_property
    def _states(self) -> list[slice]:
        """Places of the states of every motor among the integrals."""
        ends = list(accumulate((motor.states for motor in self.actuators), initial=self.own))
        return [slice(*pair) for pair in pairwise(ends)]

    def _of_source(self, given: Given) -> Given:
        """Return what the controller of the motors knows."""
        return given._replace(integral=given.integral[..., : self.own])

    def commands(self, given: Given) -> Array:
        """Return the voltages [V] or torques [N*m] that are commanded, within the limits, shape (..., k)."""
        if self.source.sampling:
            return np.asarray(given.applied[..., self.place : self.place + len(self.joints)])
        return self.source.limited(self.source.command(self._of_source(given)))

    def inputs(self, given: Given) -> list[tuple[Array, Array, Array]]:
        """Return command, states and joint velocity of every motor; see ``Actuator``."""
        v, commands = given.v[..., self._velocities], self.commands(given)
        return [(commands[..., k], given.integral[..., place], v[..., k]) for k, place in enumerate(self._states)]

    def excess(self, given: Given) -> Array:
        """Return what limits of the motors keep of the commands from their effect, shape (..., k)."""
        each = zip(self.actuators, self.inputs(given), strict=True)
        return np.stack([motor.excess(*inputs) for motor, inputs in each], axis=-1)

    def command(self, given: Given) -> Array:
        """Return the efforts at the joints, shape (..., k)."""
        each = zip(self.actuators, self.inputs(given), strict=True)
        return np.stack([motor.effort(*inputs) for motor, inputs in each], axis=-1)

    def parts(self, given: Given) -> dict[str, Array]:
        """Return what the motors do, and the command of a continuous controller, shape (..., k) each."""
        each = [motor.parts(*inputs) for motor, inputs in zip(self.actuators, self.inputs(given), strict=True)]
        names = dict.fromkeys(name for part in each for name in part)
        unknown = np.full(np.shape(given.t), np.nan)
        found = {name: np.stack([part.get(name, unknown) for part in each], axis=-1) for name in names}
        if self.source.sampling:
            return found
        return {"command": self.source.command(self._of_source(given)), **found}

    def rates(self, given: Given) -> Array:
        """Return the rates of the integrals and of the motors' states, shape (..., m)."""
        own = np.zeros((*np.shape(given.t), 0))
        if self.own:
            own = self.source.rates(self._of_source(given)._replace(excess=self.excess(given)))
        if self.own == self.integrals:
            return own
        each = zip(self.actuators, self.inputs(given), strict=True)
        return np.concatenate([own, *(motor.rates(*inputs) for motor, inputs in each)], axis=-1)

    def mode(self, given: Given, before: int | None) -> int:
        """Return the state of the controller of the motors."""
        return 0 if self.source.sampling else self.source.mode(given, before)

    def switches(self, mode: int) -> list[Switch]:
        """Return where the controller of the motors changes its way, and where an effort stops being smooth."""
        found = [] if self.source.sampling else [
            switch._replace(value=lambda given, value=switch.value: value(self._of_source(given)))  # type: ignore[misc]
            for switch in self.source.switches(mode)
        ]  # fmt: skip
        for k, motor in enumerate(self.actuators):
            for number in range(len(motor.kinks(*(np.zeros(1), np.zeros((1, motor.states)), np.zeros(1))))):
                found.append(Switch(
                    lambda given, k=k, number=number: self.actuators[k].kinks(*self.inputs(given)[k])[number], 0  # type: ignore[misc]
                ))  # fmt: skip
        return found

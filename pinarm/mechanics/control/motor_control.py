"""A controller whose commands are voltages, with the motor behind it: the current is a state of the run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.mechanics.control.controller import Controller, Given, Switch
from pinarm.mechanics.motors import Winding


@dataclass(frozen=True, eq=False)
class MotorController(Controller):
    """A continuous controller that gives the effort of a motor, by the voltage that another controller commands.

    The integrals are those of the other controller where that is continuous, then the current.

    Attributes:
        source: The controller of the voltage, of one drive.
        winding: The motor.
        place: Place of the voltage among the commands of sampled controllers.
    """

    source: Controller
    winding: Winding = field(repr=False)
    place: int = 0

    @classmethod
    def of(cls, source: Controller, winding: Winding, place: int) -> MotorController:
        """Return the controller of a motor behind another controller."""
        endless, sampled = np.array([np.inf]), source.sampling is not None
        signals, laws = ((), ()) if sampled else (source.signals, source.references)
        return cls(source.drives, source.joints, signals, laws, -endless, endless, None, source, winding, place)

    @property
    def own(self) -> int:
        """Number of integrals of the controller of the voltage."""
        return 0 if self.source.sampling else self.source.integrals

    @property
    def integrals(self) -> int:
        """Number of integrals, the current included."""
        return self.own + self.winding.states

    def supply(self, given: Given) -> Array:
        """Return the voltage [V], shape (...)."""
        if self.source.sampling:
            return np.asarray(given.applied[..., self.place])
        inner = given._replace(integral=given.integral[..., : self.own])
        return np.asarray(self.source.limited(self.source.command(inner))[..., 0])

    def current(self, given: Given) -> Array:
        """Return the current [A], shape (...)."""
        if self.winding.states:
            return np.asarray(given.integral[..., -1])
        return self.winding.current(self.supply(given), given.v[..., self.joints[0].v])

    def command(self, given: Given) -> Array:
        """Return the effort at the joint, shape (..., 1)."""
        return np.asarray(self.winding.effort(self.current(given)))[..., None]

    def parts(self, given: Given) -> dict[str, Array]:
        """Return effort and current, and the voltage that a continuous controller commands."""
        found = {"effort": self.command(given), "current": self.current(given)[..., None]}
        if self.source.sampling:
            return found
        inner = given._replace(integral=given.integral[..., : self.own])
        return {"command": self.source.command(inner), "voltage": self.supply(given)[..., None], **found}

    def rates(self, given: Given) -> Array:
        """Return the rates of the integrals and of the current, shape (..., m)."""
        inner = given._replace(integral=given.integral[..., : self.own])
        own = self.source.rates(inner) if self.own else np.zeros((*np.shape(given.t), 0))
        if not self.winding.states:
            return own
        rate = self.winding.rate(self.supply(given), given.integral[..., -1], given.v[..., self.joints[0].v])
        return np.concatenate([own, np.asarray(rate)[..., None]], axis=-1)

    def mode(self, given: Given, before: int | None) -> int:
        """Return the state of the controller of the voltage."""
        return 0 if self.source.sampling else self.source.mode(given, before)

    def switches(self, mode: int) -> list[Switch]:
        """Return where the controller of the voltage changes its way."""
        if self.source.sampling:
            return []
        own = slice(0, self.own)
        return [
            switch._replace(value=lambda given, value=switch.value: value(  # type: ignore[misc]
                given._replace(integral=given.integral[..., own])))
            for switch in self.source.switches(mode)
        ]  # fmt: skip

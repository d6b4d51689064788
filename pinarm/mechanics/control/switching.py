"""Switching control: one of two efforts, by the sign of an error, with hysteresis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.yaml.schema import AnyQuantity, Pause, check_unit
from pinarm.mechanics.control.controller import Controller, Given, Plant
from pinarm.mechanics.control.definition import OneDriveDefinition
from pinarm.mechanics.control.references import References
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.limited_states import Switch

LOW, HIGH = 0, 1
"""States of the relay: the effort below and above."""


class Switching(OneDriveDefinition, frozen=True, kw_only=True, tag_field="kind", tag="switching"):
    """A relay on ``s = e + lead e'``: the effort ``above`` once s reaches the hysteresis, ``below`` once its negative.

    In between it keeps the effort that it has; at the start it takes the one of the sign of s. ``lead`` makes it switch
    before the error vanishes (bang-bang control along a line in the phase plane). A continuous relay switches at
    events and needs a hysteresis: without one it would switch without end.

    Attributes:
        follows: Law of the reference r of the measured coordinate y, such as ``{law: constant, value: 20 deg}``, ``e =
            r - y``; 0 where it is left out.
        above: Effort while s is above, mostly positive.
        below: Effort while s is below.
        hysteresis: Half the width within which the relay keeps its effort, in the unit of y.
        lead: Time by which rates count [s].
    """

    follows: References | None = None
    above: AnyQuantity
    below: AnyQuantity
    hysteresis: AnyQuantity = 0.0
    lead: Pause = 0.0

    def check(self) -> None:
        """Refuse several drives, and a continuous relay without hysteresis."""
        super().check()
        if self.hysteresis < 0.0 or (self.period is None and not self.hysteresis):
            with within("hysteresis"):
                raise InputError(f"the hysteresis is {self.hysteresis:g}: a continuous relay would switch without end",
                                 expected="a positive one", hint="period: 1 ms for a sampled relay")  # fmt: skip

    def bind(self, plant: Plant) -> Controller:
        """Return the controller of one mechanism.

        Raises:
            InputError: The drive or the coordinate does not exist, or a unit is another.
        """
        joints, (commanded,) = self.joints(plant), self.units(plant)
        signals = self.signals(plant)
        laws = (self.follows or References(Constant(value=0.0))).laws([self.measures or self.drives[0]], signals)
        for key, measure in (("above", commanded), ("below", commanded),
                             ("hysteresis", signals[0].unit)):  # fmt: skip
            with within(key):
                check_unit(getattr(self, key), measure)
        lower, upper = self.bounds([commanded])
        numbers = float(self.above), float(self.below), float(self.hysteresis), float(self.lead)
        return Relay(tuple(self.drives), joints, signals, laws, lower, upper, self.sampling(signals), *numbers)


@dataclass(frozen=True, eq=False)
class Relay(Controller):
    """A relay of one mechanism; see ``Switching`` for its numbers, in SI."""

    above: float
    below: float
    hysteresis: float
    lead: float

    def command(self, given: Given) -> Array:
        efforts = np.where(np.equal(given.mode, HIGH), self.above, self.below)
        return np.broadcast_to(efforts, np.shape(given.t))[..., None]

    def deviation(self, given: Given) -> Array:
        """Return ``s = e + lead e'``, shape (...)."""
        error = given.error[..., 0, :]
        return np.asarray(error[..., 0] + self.lead * error[..., 1])

    def mode(self, given: Given, before: int | None) -> int:
        """Return the state: the one of s beyond the hysteresis, and the one before within."""
        s = float(self.deviation(given))
        if before is None:
            return HIGH if s >= 0.0 else LOW
        if s >= self.hysteresis:
            return HIGH
        return LOW if s <= -self.hysteresis else before

    def switches(self, mode: int) -> list[Switch[Given]]:
        if mode == HIGH:
            return [Switch(lambda given: self.deviation(given) + self.hysteresis, -1, LOW, leaps=True)]
        return [Switch(lambda given: self.deviation(given) - self.hysteresis, 1, HIGH, leaps=True)]

"""State feedback: efforts from the errors of several coordinates and of their rates, by a matrix of gains."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import unit
from pinarm.input.yaml.schema import AnyQuantity, check_unit
from pinarm.mechanics.control.controller import Controller, Given, Plant
from pinarm.mechanics.control.definition import ControlDefinition, measured
from pinarm.mechanics.control.references import References
from pinarm.mechanics.laws import Constant


class StateFeedback(ControlDefinition, frozen=True, kw_only=True, tag_field="kind", tag="state_feedback"):
    """``u = u_0 + K (x_r - x)``, x being coordinates and their rates, x_r what they should be.

    Gains as of a linear-quadratic regulator, or of placed poles: K is designed elsewhere, for the linearised mechanism.

    Attributes:
        states: The coordinates in x; their rates follow all of them: ``x = [y_1 .. y_s, y_1' .. y_s']``.
        gains: K, a row for each drive with 2 s columns: efforts per coordinate, then efforts per rate.
        follows: Laws of the references, whose derivatives are those of the rates, such as ``{x: {law: constant, value:
            0.2 m}}``: coordinate -> law, 0 where one is left out; or a list of laws, one for each state.
        bias: u_0, an effort for each drive, such as the one that holds the mechanism at the reference.
    """

    states: Annotated[list[str], msgspec.Meta(min_length=1)]
    gains: list[list[AnyQuantity]]
    follows: References | None = None
    bias: list[AnyQuantity] = []

    @property
    def names(self) -> list[str]:
        """Names of the drives and of the states."""
        return [*self.drives, *self.states]

    def bind(self, plant: Plant) -> Controller:
        """Return the controller of one mechanism.

        Raises:
            InputError: A drive or a coordinate does not exist, a unit is another, or the matrix has another shape.
        """
        joints, units = self.joints(plant), self.units(plant)
        with within("states"):
            if len(set(self.states)) < len(self.states):
                raise InputError("a state is named twice", expected="each coordinate once")
            signals = measured(plant, self.states)
        rest = Constant(value=0.0)
        laws = (self.follows or References({})).laws(self.states, signals, rest)
        shape = len(joints), 2 * len(signals)
        with within("gains"):
            if len(self.gains) != shape[0] or any(len(row) != shape[1] for row in self.gains):
                raise InputError(f"the matrix has not {shape[0]} rows of {shape[1]} gains",
                                 expected="a row for each drive: gains of the states, then of their rates")  # fmt: skip
            for k, (row, commanded) in enumerate(zip(self.gains, units, strict=True)):
                for i, gain in enumerate(row):
                    rated = unit("1/s") if i >= len(signals) else unit("1")
                    with within(k, i):
                        check_unit(gain, commanded / signals[i % len(signals)].unit / rated)
        with within("bias"):
            if len(self.bias) not in (0, len(joints)):
                raise InputError(f"there are {len(self.bias)} efforts", expected=f"{len(joints)}, one for each drive")
            for command, commanded in zip(self.bias, units, strict=False):
                check_unit(command, commanded)
        lower, upper = self.bounds(units)
        return StateFeedbackController(
            tuple(self.drives), joints, signals, laws, lower, upper, self.sampling(signals),
            np.array(self.gains, float), np.array(self.bias or [0.0] * len(joints), float),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class StateFeedbackController(Controller):
    """State feedback of one mechanism.

    Attributes:
        gains: K, shape (k, 2 s).
        bias: u_0, shape (k,).
    """

    gains: Array = field(repr=False)
    bias: Array = field(repr=False)

    def command(self, given: Given) -> Array:
        """Return ``u_0 + K (x_r - x)``."""
        error = given.error
        x = np.concatenate([error[..., 0], error[..., 1]], axis=-1)
        return np.asarray(self.bias + x @ self.gains.T)

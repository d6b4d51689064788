"""Efforts along coordinates given as functions in Python: ``f(t, state)``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.mechanics.control.controller import Plant, Reader
from pinarm.mechanics.control.function import ControlFunction, MeasuredState, returned
from pinarm.mechanics.coordinates import Coordinate, coordinate_of
from pinarm.mechanics.forces.along_coordinate import AlongCoordinate


class FunctionEffort(AlongCoordinate, frozen=True):
    """A torque or force along a coordinate that a function of the state gives; all of its power is supplied.

    Attributes:
        function: ``(t, state) -> effort`` [N*m or N]. It is called in states in no order of time.
    """

    unshown = ("model", "plant", "readers")

    function: ControlFunction
    words: str
    plant: Plant
    readers: dict[str, Reader]

    def acting(self, t: Array | float, q: Array, v: Array) -> tuple[Array, Array]:
        if np.iscomplexobj(q) or np.iscomplexobj(v):
            raise InputError(
                f"{self.words} has no exact derivatives, which this question needs",
                expected="a load by a law, or a spring and damper",
            )
        states = q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1])
        instants = np.broadcast_to(np.asarray(t, float), len(states[0])).tolist()
        efforts = [self._at(*state) for state in zip(instants, *states, strict=True)]
        return np.array(efforts).reshape(q.shape[:-1]), self.evaluated(q)[1]

    def _at(self, t: float, q: Array, v: Array) -> float:
        return float(returned(self.function, self.words, MeasuredState(t, q, v, self.plant, self.readers), 1)[0])

    @property
    def description(self) -> str:
        return f"{self.words}, in Python"


@dataclass(frozen=True)
class FunctionForce:
    """A load given as a function, of any mechanism.

    Attributes:
        function: ``(t, state) -> effort`` [N*m or N].
    """

    name: str
    along: str
    function: ControlFunction

    def bind(self, model: pin.Model, coordinates: Mapping[str, Coordinate], plant: Plant) -> FunctionEffort:
        with within("forces", self.name):
            along = coordinate_of(model, coordinates, self.along)
        return FunctionEffort(model, along, self.function, f"the force function '{self.name}'", plant, {})


def function_forces(forces: Mapping[str, tuple[str, ControlFunction]]) -> list[FunctionForce]:
    """Return loads by their names.

    Args:
        forces: Name -> coordinate, and its function.
    """
    elements = []
    for name, force in forces.items():
        if not (isinstance(force, tuple) and len(force) == 2 and isinstance(force[0], str) and callable(force[1])):
            raise InputError(
                f"the force '{name}' is {force!r}",
                expected="a coordinate and a function f(t, state)",
                hint="forces={'brake': ('knee', f)}",
            )
        elements.append(FunctionForce(name, *force))
    return elements

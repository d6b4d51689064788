"""Statics: the efforts that hold a mechanism still, position by position."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from pinarm.engine.assembly import Imposed
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.trajectory import Trajectory
from pinarm.errors import InputError
from pinarm.input.schema import Level, Model
from pinarm.mechanics.forces import Force
from pinarm.mechanics.laws import Constant, ConstantSpeed
from pinarm.mechanics.motion import Grid, MotionLaw
from pinarm.problems.common import Accuracy, Place, bind_loads, check_levels, check_motion
from pinarm.problems.inverse import driven


class Range(Model):
    """Evenly spaced values of a coordinate.

    Attributes:
        start: First value, ``from`` in files.
        end: Last value, ``to`` in files.
        samples: Number of values.
    """

    start: Level = Field(alias="from")
    end: Level = Field(alias="to")
    samples: int = Field(default=201, ge=2, le=10_000_000)

    @model_validator(mode="after")
    def _goes_somewhere(self) -> Range:
        if self.start == self.end:
            raise ValueError("the range begins and ends at the same value")
        return self


class Statics(Model):
    """Holding efforts while one coordinate is swept and the others are held.

    Attributes:
        over: The coordinate that is swept, with its range.
        hold: Coordinate -> value, for all the others.
        start: Rough joint coordinates at the first position: they choose the branch where there are several.
        loads: Applied forces and springs of this run.
    """

    kind: Literal["statics"]
    over: dict[str, Range] = Field(min_length=1, max_length=1)
    hold: dict[str, Level] = {}
    start: dict[str, Level] = {}
    loads: dict[str, Force] = {}

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Trajectory:
        """Return the positions, at rest, and the efforts of the drives."""
        (swept, values), *_ = self.over.items()
        with place("over", swept):
            coordinate = mechanism.coordinate(swept)
            for bound in (values.start, values.end):
                Constant(value=bound).check_units(coordinate.unit)
        held = {name: Constant(value=value) for name, value in self.hold.items()}
        with place("hold"):
            check_motion(mechanism, held, lambda _, name: place("hold", name))
        check_levels(mechanism, self.start, place, "start")
        forces = bind_loads(mechanism, self.loads, place)
        for law in (law for force in forces for law in force.laws()):
            if not isinstance(law, Constant):
                raise InputError("a load that follows a law over time has no value at rest", expected="law: constant")
        motion: dict[str, MotionLaw] = {swept: ConstantSpeed(speed=1.0), **held}
        with place():
            imposed = Imposed.of(mechanism, motion)
            grid = Grid.cover(np.linspace(values.start, values.end, values.samples), [])
            return driven(mechanism, imposed, grid, self.start, forces, swept, coordinate.unit, speed=0.0)

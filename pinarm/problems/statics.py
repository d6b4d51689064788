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
from pinarm.input.units import Unit
from pinarm.mechanics.forces import Force, ForceElement
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

    def parameter(self, mechanism: Mechanism) -> tuple[str, Unit]:
        """Return the name and unit of what runs along the rows."""
        (swept,) = self.over
        return swept, mechanism.coordinate(swept).unit

    def prepare(self, mechanism: Mechanism, place: Place) -> tuple[Imposed, list[ForceElement]]:
        """Check all names and units; return the imposed coordinates and the forces."""
        ((swept, values),) = self.over.items()
        with place("over", swept):
            measured = mechanism.coordinate(swept).unit
            for key, bound in (("from", values.start), ("to", values.end)):
                with place("over", swept, key):
                    Constant(value=bound).check_units(measured)
        held = {name: Constant(value=value) for name, value in self.hold.items()}
        check_motion(mechanism, held, lambda _, name: place("hold", name))
        check_levels(mechanism, self.start, place, "start")
        forces = bind_loads(mechanism, self.loads, place)
        for law in (law for force in forces for law in force.laws()):
            if not isinstance(law, Constant):
                with place("loads"):
                    raise InputError("a load that follows a law over time has no value at rest", hint="law: constant")
        motion: dict[str, MotionLaw] = {swept: ConstantSpeed(speed=1.0), **held}
        with place():
            return Imposed.of(mechanism, motion), forces

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Trajectory:
        """Return the positions, at rest, and the efforts of the drives."""
        imposed, forces = self.prepare(mechanism, place)
        (values,) = self.over.values()
        grid = Grid.cover(np.linspace(values.start, values.end, values.samples), [])
        with place():
            return driven(mechanism, imposed, grid, self.start, forces, *self.parameter(mechanism), speed=0.0)

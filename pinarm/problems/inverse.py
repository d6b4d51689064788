"""Inverse dynamics: the motion is known, the efforts of the drives are wanted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.equation import Dynamics
from pinarm.engine.kinematics.joint_motion import follow, joint_rates
from pinarm.engine.kinematics.newton import start_configuration
from pinarm.engine.kinematics.prescribed import Imposed
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.statics.actuation import Actuation, actuation
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import InputStruct, Level
from pinarm.mechanics.forces import Force, ForceElement
from pinarm.mechanics.laws import Motion
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.common import Accuracy, Place, TimeGrid, bind_loads, check_levels, laws_of, still

Rates = tuple[Array, Array]


class Inverse(InputStruct, frozen=True, tag_field="kind", tag="inverse"):
    """Efforts for a motion that laws impose on as many coordinates as the mechanism has degrees of freedom.

    Attributes:
        time: Instants of the table.
        motion: Coordinate -> law over time, or over another one of these coordinates.
        drives: Coordinates that the drives act along, as many as there are degrees of freedom; every joint of an open
            chain where none is named, and the coordinates of ``motion`` where there are loops.
        start: Rough joint coordinates at the first instant: they choose the branch where there are several.
        loads: Applied forces, springs and dampers of this run.
    """

    kind: ClassVar[str] = "inverse"
    time: TimeGrid
    motion: Annotated[dict[str, Motion], msgspec.Meta(min_length=1)]
    drives: list[str] = []
    start: dict[str, Level] = {}
    loads: dict[str, Force] = {}

    def still(self, mechanism: Mechanism) -> Trajectory:
        """Return one row at the neutral configuration: enough to see which quantities there are."""
        return still(mechanism, self.loads, "t", unit("s"), actuation(mechanism, self.drives, [*self.motion]).closure)

    def prepare(self, mechanism: Mechanism, place: Place) -> tuple[Imposed, Actuation, dict[str, ForceElement]]:
        """Check all names and units; return the imposed coordinates, the drives and the forces."""
        motion = laws_of(mechanism, self.motion, place, (self.time.start, self.time.end))
        check_levels(mechanism, self.start, place, "start")
        forces = bind_loads(mechanism, self.loads, place)
        with place("drives"):
            drives = actuation(mechanism, self.drives, list(self.motion))
        with place("motion"):
            return Imposed.of(mechanism, motion), drives, forces

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Trajectory:
        """Return the motion of the joints and the efforts of the drives."""
        imposed, drives, forces = self.prepare(mechanism, place)
        laws = [*imposed.laws, *(law for force in forces.values() for law in force.laws())]
        grid = Grid.cover(self.time.instants(), laws)
        with place("motion"):
            return driven(mechanism, imposed, drives, grid, self.start, forces, "t", unit("s"))


def driven(
    mechanism: Mechanism, imposed: Imposed, drives: Actuation | None, grid: Grid, start: Mapping[str, float],
    forces: Mapping[str, ForceElement], parameter: str, measured: Unit, *, rates: Rates | None = None,
) -> Trajectory:  # fmt: skip
    """Return an imposed motion with the efforts that it takes.

    Args:
        mechanism: The mechanism.
        imposed: Coordinates and their laws.
        drives: What carries the load; ``None`` where only the motion is wanted.
        grid: Instants.
        start: Rough joint coordinates at the first of them.
        forces: All force elements of the run.
        parameter: Name of what runs along the grid.
        measured: Its unit.
        rates: Velocities and accelerations of the coordinates, each of shape (k,), that hold at every row in place of
            those of the laws: the rows are then states of their own, not one motion.
    """
    dynamics = Dynamics.of(mechanism.model, forces)
    closure = drives.closure if drives else mechanism.closure

    def on(part: Grid, near: Array) -> Trajectory:
        q, v, a = follow(mechanism, imposed, part, near)
        if rates is not None:
            v, a = joint_rates(mechanism, imposed, q, *rates)
        idle = Multipliers.zero(len(q), mechanism.closure.size)
        # at another instant the branch is that of the nearest row, which the first pass has found
        draft = Trajectory(
            mechanism, parameter, measured, part, q, v, a, np.zeros_like(v), idle, closure, dynamics,
            lambda other: on(other, q[abs(part.t - other.t[0]).argmin()]), separate=rates is not None,
        )  # fmt: skip
        if drives is None:
            return draft
        demand = draft.gather(lambda local, rows: local.inverse(part.t[rows], q[rows], v[rows], a[rows]))
        tau, lam = drives.efforts(part.t, q, demand)
        return replace(draft, tau=tau, lam=lam)

    return on(grid, start_configuration(mechanism, start))

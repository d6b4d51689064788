"""Kinematics: the motion is imposed, and only the motion is wanted."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar

import msgspec

from pinarm.engine.kinematics.prescribed import Imposed
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.input.units import unit
from pinarm.input.yaml.schema import InputStruct, Level
from pinarm.mechanics.laws import Motion
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.common import Accuracy, Place, TimeGrid, check_levels, laws_of
from pinarm.problems.inverse import driven

UNASKED = "the problem is kinematic and asks for no forces"


class Kinematics(InputStruct, frozen=True, tag_field="kind", tag="kinematics"):
    """Motion under laws on as many coordinates as the mechanism has degrees of freedom; masses play no part.

    With the imposed coordinates w: ``w(q) = w_d(t)``, ``J v = w_d'`` and ``J a = w_d'' - J' v``. Models without any
    mass will do. Singular positions, where J loses rank, are refused.

    Attributes:
        time: Instants of the table.
        motion: Coordinate of a joint or of a task -> law over time, or over another one of these coordinates.
        start: Rough joint coordinates at the first instant: they choose the branch where there are several.
    """

    kind: ClassVar[str] = "kinematics"
    time: TimeGrid
    motion: Annotated[dict[str, Motion], msgspec.Meta(min_length=1)]
    start: dict[str, Level] = {}

    def still(self, mechanism: Mechanism) -> Trajectory:
        """Return one row at the neutral configuration: enough to see which quantities there are."""
        return _without_efforts(Trajectory.still(mechanism, "t", unit("s")))

    def prepare(self, mechanism: Mechanism, place: Place) -> Imposed:
        """Check all names and units; return the imposed coordinates."""
        motion = laws_of(mechanism, self.motion, place, (self.time.start, self.time.end))
        check_levels(mechanism, self.start, place, "start")
        with place("motion"):
            return Imposed.of(mechanism, motion)

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Trajectory:
        """Return the motion of the joints."""
        imposed = self.prepare(mechanism, place)
        laws = [*imposed.laws, *(law for force in mechanism.forces.values() for law in force.laws())]
        grid = Grid.cover(self.time.instants(), laws)
        with place("motion"):
            run = driven(mechanism, imposed, None, grid, self.start, mechanism.forces, "t", unit("s"))
        return _without_efforts(run)


def _without_efforts(run: Trajectory) -> Trajectory:
    """Return the motion alone: efforts would be zeros or noise for a model whose masses play no part."""
    return replace(run, unasked=UNASKED, again=lambda grid: _without_efforts(run.again(grid)))

"""Kinematics: the motion is prescribed, and only the motion is wanted."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Annotated, ClassVar

import msgspec
from msgspec.structs import replace as replace_fields

from pinarm.engine.kinematics.assembly import generic_near
from pinarm.engine.kinematics.joint_motion import JointMotion
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.prescribed_motion import KINEMATIC, PrescribedTable, Prescription
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import Place
from pinarm.input.units import unit
from pinarm.input.yaml.schema import InputStruct, Level
from pinarm.mechanics.laws import Motion
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.declaration import Declaration, others
from pinarm.problems.joint_values import check_levels
from pinarm.problems.laws import NearestPosture, grid_of, joint_motion, laws_of, rough_start
from pinarm.problems.time_grid import TimeGrid
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import Outcome


class KinematicMotion(InputStruct, frozen=True, tag_field="kind", tag="kinematics"):
    """Motion under laws on as many coordinates as the mechanism has degrees of freedom, or on fewer and a posture.

    Masses play no part.

    With the prescribed coordinates w: ``w(q) = w_d(t)``, ``J v = w_d'`` and ``J a = w_d'' - J' v``. Models without any
    mass will do. Singular positions, where J loses rank, are refused.

    Attributes:
        time: Instants of the table.
        motion: Coordinate of a joint or of a task -> law over time, or over another one of these coordinates.
        resolve: Which of its motions a mechanism makes that has more degrees of freedom than laws, as an arm of seven
            joints whose hand follows a path: the one nearest to a posture, such as ``{nearest_to: {elbow: 90 deg}}``.
        start: Rough joint coordinates at the first instant: they choose the branch where there are several.
    """

    kind: ClassVar[str] = "kinematics"
    time: TimeGrid
    motion: Annotated[dict[str, Motion], msgspec.Meta(min_length=1)]
    resolve: NearestPosture | None = None
    start: dict[str, Level] = {}

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        """Return one row near the start: enough to see which quantities there are, and which are determined."""
        q = generic_near(mechanism, self.start)
        return replace(Trajectory.schema_row(mechanism, q, "t", unit("s")), no_efforts=KINEMATIC)

    def declaration(self) -> Declaration | None:
        """Return the declaration about coordinates; ``None`` where a posture chooses: joints depend on all."""
        if self.resolve is not None:
            return None
        return Declaration(self._without, laws=self.motion)

    def _without(self, names: Collection[str]) -> KinematicMotion:
        return replace_fields(self, motion=others(self.motion, names), start=others(self.start, names))

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> JointMotion:
        motion = laws_of(mechanism, self.motion, place, (self.time.start, self.time.end))
        check_levels(mechanism, self.start, place, "start")
        return joint_motion(mechanism, motion, self.resolve, place)

    def table(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: JointMotion | None = None
    ) -> PrescribedTable:
        motion = prepared or self.prepare(mechanism, accuracy, place)
        laws = [*motion.laws, *(law for force in mechanism.forces.values() for law in force.laws())]
        grid = grid_of(mechanism, motion, self.time.instants(), laws)
        known = Prescription(mechanism, motion, None, mechanism.dynamics, "t", unit("s"))
        with place("motion"):
            return PrescribedTable(known, grid, rough_start(mechanism, self.start, self.resolve, motion, grid))

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: JointMotion | None = None
    ) -> Outcome:
        table = self.table(mechanism, accuracy, place, prepared)
        with place("motion"):
            return table.outcome()

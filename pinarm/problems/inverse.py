"""Inverse dynamics, whose efforts are wanted, and kinematics, whose motion alone is: laws prescribe the motion."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import msgspec
from msgspec.structs import replace as replace_fields

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.columns import with_friction_columns
from pinarm.engine.kinematics.assembly import generic_near
from pinarm.engine.kinematics.joint_motion import JointMotion
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.prescribed_motion import KINEMATIC, PrescribedTable, Prescription
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.statics.actuation import Actuation, actuation
from pinarm.errors import Place, locating_drives
from pinarm.input.units import unit
from pinarm.input.yaml.schema import Deferred, InputStruct, Level
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.laws import Motion
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.declaration import Declaration, others
from pinarm.problems.drives import Share, drives_of, omitted_drives_remarks
from pinarm.problems.joint_values import check_levels
from pinarm.problems.laws import NearestPosture, grid_of, joint_motion, laws_of, profile_remarks, rough_start
from pinarm.problems.loads import LOADS, bind_loads, schema_row
from pinarm.problems.time_grid import TimeGrid
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import Outcome
    from pinarm.mechanics.forces.kinds import Force
else:  # imported where a file has loads, see LOADS
    Force = Any

Prepared = tuple[JointMotion, Actuation, dict[str, ForceElement]]
"""Motion of the joints by the laws, the drives, and the forces."""


class Inverse(InputStruct, frozen=True, tag_field="kind", tag="inverse"):
    """Efforts for a motion that laws impose on as many coordinates as the mechanism has degrees of freedom.

    On fewer where ``resolve`` chooses the rest.

    Attributes:
        time: Instants of the table.
        motion: Coordinate -> law over time, or over another one of these coordinates.
        resolve: Which of its motions a mechanism makes that has more degrees of freedom than laws, such as an arm of
            seven joints whose hand follows a path: the one nearest to a posture.
        drives: Coordinates that the drives act along, as many as there are degrees of freedom, or more that ``share``;
            where the key is left out, every joint of an open chain, and the coordinates of ``motion`` where there are
            loops.
        share: How drives share the load where there are more of them than degrees of freedom: ``least_squares`` (the
            least sum of squares of their efforts), ``bounded`` (the same within the effort limits of the model), or
            ``weights`` and ``limits`` by drive. With as many drives as degrees of freedom it changes nothing, but for
            limits, which are kept or refused.
        start: Rough joint coordinates at the first instant: they choose the branch where there are several.
        loads: Applied forces, springs and dampers of this run.
    """

    kind: ClassVar[str] = "inverse"
    deferred: ClassVar[Deferred] = LOADS
    time: TimeGrid
    motion: Annotated[dict[str, Motion], msgspec.Meta(min_length=1)]
    resolve: NearestPosture | None = None
    drives: Annotated[list[str], msgspec.Meta(min_length=1)] = []
    share: Share | None = None
    start: dict[str, Level] = {}
    loads: dict[str, Force] = {}

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        drives = actuation(mechanism, self.drives, [*self.motion])
        return with_friction_columns(schema_row(mechanism, self.start, self.loads, "t", unit("s"), drives), drives)

    def declaration(self) -> Declaration | None:
        """Return the declaration about coordinates.

        ``None`` where drives share, or a posture chooses: each effort, or each joint, depends on all.
        """
        if self.share is not None or self.resolve is not None:
            return None
        return Declaration(self._without, laws=self.motion, drives=self.drives, loads=self.loads)

    def _without(self, names: Collection[str]) -> Inverse:
        drives = [name for name in self.drives if name not in names]
        return replace_fields(
            self, motion=others(self.motion, names), start=others(self.start, names), drives=drives, loads={}
        )

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Prepared:
        motion = laws_of(mechanism, self.motion, place, (self.time.start, self.time.end))
        check_levels(mechanism, self.start, place, "start")
        forces = bind_loads(mechanism, self.loads, place)
        drives = drives_of(mechanism, self.drives, list(self.motion), self.share, place)
        return joint_motion(mechanism, motion, self.resolve, place), drives, forces

    def table(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Prepared | None = None
    ) -> PrescribedTable:
        motion, drives, forces = prepared or self.prepare(mechanism, accuracy, place)
        laws = [*motion.laws, *(law for force in forces.values() for law in force.laws())]
        grid = grid_of(mechanism, motion, self.time.instants(), laws, forces.values())
        known = Prescription(mechanism, motion, drives, Dynamics.of(mechanism.model, forces), "t", unit("s"))
        with place("motion"):
            return PrescribedTable(known, grid, rough_start(mechanism, self.start, self.resolve, motion, grid))

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Prepared | None = None
    ) -> Outcome:
        table = self.table(mechanism, accuracy, place, prepared)
        with place("motion"), locating_drives(place, "drives" if self.drives else "motion"):
            outcome = table.outcome()
        remarks = [
            *omitted_drives_remarks(mechanism, self.drives, [*self.motion]),
            *profile_remarks(mechanism, self.motion),
        ]
        return replace(outcome, notes=(*outcome.notes, *remarks))


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

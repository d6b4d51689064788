"""Motions that laws prescribe: the efforts that they take, over time or state by state, or the motion alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar

import msgspec
import numpy as np

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.columns import with_friction_columns
from pinarm.engine.kinematics.assembly import determining, generic_near, start_near
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.prescribed_motion import KINEMATIC, PrescribedTable, Prescription
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.engine.statics.actuation import Actuation, actuation
from pinarm.errors import InputError, Key, Place, choices, locating_drives
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import Deferred, InputStruct, Level, Rate, SecondRate
from pinarm.mechanics.ball_joints import positions_of
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.laws import Constant, ConstantSpeed, Motion
from pinarm.mechanics.laws.motion_law import FILE_KEYS, Grid, MotionLaw
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.drives import Share, drives_of, omitted_drives_remarks
from pinarm.problems.laws import NearestPosture, grid_of, joint_motion, laws_of, profile_remarks, rough_start
from pinarm.problems.loads import LOADS, Force, bind_constant_loads, bind_loads, schema_row
from pinarm.problems.time_grid import TimeGrid
from pinarm.problems.values import check_levels, coordinates_of
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
        q = generic_near(mechanism, self.start)
        return replace(Trajectory.schema_row(mechanism, q, "t", unit("s")), no_efforts=KINEMATIC)

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> PrescribedTable:
        laws = laws_of(mechanism, self.motion, place, (self.time.start, self.time.end))
        check_levels(mechanism, self.start, place, "start")
        forces = self._forces(mechanism, place)
        drives = self._acting(mechanism, place)
        motion = joint_motion(mechanism, laws, self.resolve, place)
        grid = grid_of(mechanism, motion, self.time.instants(), forces.values())
        known = Prescription(mechanism, motion, drives, Dynamics.of(mechanism.model, forces), "t", unit("s"))
        with place("motion"):
            return PrescribedTable(known, grid, rough_start(mechanism, self.start, self.resolve, motion, grid))

    def _forces(self, mechanism: Mechanism, place: Place) -> Mapping[str, ForceElement]:
        return mechanism.forces

    def _acting(self, mechanism: Mechanism, place: Place) -> Actuation | None:
        return None

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: PrescribedTable | None = None
    ) -> Outcome:
        table = prepared or self.prepare(mechanism, accuracy, place)
        with place("motion"):
            return table.outcome()


class Inverse(KinematicMotion, frozen=True, tag_field="kind", tag="inverse"):
    """Efforts for a motion that laws impose on as many coordinates as the mechanism has degrees of freedom.

    On fewer where ``resolve`` chooses the rest.

    Attributes:
        drives: Coordinates that the drives act along, as many as there are degrees of freedom, or more that ``share``;
            where the key is left out, every joint of an open chain, and the coordinates of ``motion`` where there are
            loops.
        share: How drives share the load where there are more of them than degrees of freedom: ``least_squares`` (the
            least sum of squares of their efforts), ``bounded`` (the same within the effort limits of the model), or
            ``weights`` and ``limits`` by drive. With as many drives as degrees of freedom it changes nothing, but for
            limits, which are kept or refused.
        loads: Applied forces, springs and dampers of this run.
    """

    kind: ClassVar[str] = "inverse"
    deferred: ClassVar[Deferred] = LOADS
    drives: Annotated[list[str], msgspec.Meta(min_length=1)] = []
    share: Share | None = None
    loads: dict[str, Force] = {}

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        drives = actuation(mechanism, self.drives, [*self.motion])
        return with_friction_columns(schema_row(mechanism, self.start, self.loads, "t", unit("s"), drives), drives)

    def _forces(self, mechanism: Mechanism, place: Place) -> Mapping[str, ForceElement]:
        return bind_loads(mechanism, self.loads, place)

    def _acting(self, mechanism: Mechanism, place: Place) -> Actuation:
        return drives_of(mechanism, self.drives, [*self.motion], self.share, place)

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: PrescribedTable | None = None
    ) -> Outcome:
        table = prepared or self.prepare(mechanism, accuracy, place)
        with place("motion"), locating_drives(place, "drives" if self.drives else "motion"):
            outcome = table.outcome()
        omitted = omitted_drives_remarks(mechanism, self.drives, [*self.motion])
        return replace(outcome, notes=(*outcome.notes, *omitted, *profile_remarks(mechanism, self.motion)))


class Range(InputStruct, frozen=True, rename=FILE_KEYS):
    """Evenly spaced values of a coordinate.

    Attributes:
        start: First value, ``from`` in files.
        end: Last value, ``to`` in files.
        samples: Number of values.
    """

    start: Level
    end: Level
    samples: Annotated[int, msgspec.Meta(ge=2, le=10_000_000)] = 201

    def check(self) -> None:
        if self.start == self.end:
            raise InputError("the range begins and ends at the same value")


class Statics(InputStruct, frozen=True, tag_field="kind", tag="statics"):
    """Holding efforts, at rest: over the range of one coordinate, or at one position.

    Attributes:
        over: The coordinate that is swept, with its range; none for a single position.
        hold: Coordinate -> value, for all the others.
        drives: Coordinates that the drives act along, such as ``[knee]``; the kind ``inverse`` has the same key.
        share: How drives share the load where there are more of them than degrees of freedom, such as
            ``least_squares``; the kind ``inverse`` has the same key.
        start: Rough joint coordinates at the first position: they choose the branch where there are several.
        loads: Applied forces and springs of this run.
    """

    kind: ClassVar[str] = "statics"
    deferred: ClassVar[Deferred] = LOADS
    over: Annotated[dict[str, Range], msgspec.Meta(max_length=1)] = {}
    hold: dict[str, Level] = {}
    drives: Annotated[list[str], msgspec.Meta(min_length=1)] = []
    share: Share | None = None
    start: dict[str, Level] = {}
    loads: dict[str, Force] = {}

    @property
    def rates(self) -> Mapping[str, Mapping[str, float]]:
        """Key -> coordinate -> rate, of velocities, then of accelerations."""
        return {}

    @property
    def _prescribed(self) -> list[str]:
        return [*self.over, *self.hold]

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        drives = actuation(mechanism, self.drives, self._prescribed)
        first = {**{swept: values.start for swept, values in self.over.items()}, **self.hold}
        known = positions_of(mechanism.joints, mechanism.balls)
        start = {**self.start, **{name: value for name, value in first.items() if name in known}}
        row = schema_row(mechanism, start, self.loads, *self._parameter(mechanism), drives)
        return with_friction_columns(replace(row, separate=True), drives)

    def _parameter(self, mechanism: Mechanism) -> tuple[str, Unit]:
        for swept in self.over:
            return swept, mechanism.coordinate(swept).unit
        return ROW, unit("1")

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> PrescribedTable:
        laws = self._laws(mechanism, place)
        with place():
            motion = DeterminedMotion(mechanism, determining(mechanism, laws))
        names, rates, grid = self._prescribed, np.zeros((2, len(self._prescribed))), Grid.cover(np.zeros(1), [])
        for order, (key, values) in enumerate(self.rates.items()):
            for name in values.keys() - {*names}:
                with place(key, Key(name)):
                    expected, hint = choices(name, names)
                    raise InputError(f"the position does not say '{name}'", expected=expected, hint=hint)
            coordinates_of(mechanism, values, place, key, order=order + 1)
            rates[order] = [values.get(name, 0.0) for name in names]
        drives = drives_of(mechanism, self.drives, names, self.share, place)
        check_levels(mechanism, self.start, place, "start")
        forces = bind_constant_loads(mechanism, self.loads, place, moving=bool(rates[0].any()))
        for swept in self.over.values():
            grid = Grid.cover(np.linspace(swept.start, swept.end, swept.samples), [])
        with place():
            dynamics, parameter = Dynamics.of(mechanism.model, forces), self._parameter(mechanism)
            known = Prescription(mechanism, motion, drives, dynamics, *parameter, (rates[0], rates[1]))
            return PrescribedTable(known, grid, start_near(mechanism, self.start, motion.prescribed, grid))

    def _laws(self, mechanism: Mechanism, place: Place) -> dict[str, MotionLaw]:
        for swept, values in self.over.items():
            with place("over", swept):
                measured = mechanism.coordinate(swept).unit
            for key, bound in (("from", values.start), ("to", values.end)):
                with place("over", swept, key):
                    Constant(value=bound).check_units(measured)
        for name in self.hold:
            if name in self.over:
                with place("hold", Key(name)):
                    raise InputError(f"'{name}' is held and swept", expected="one of the two for each coordinate")
        coordinates_of(mechanism, self.hold, place, "hold")
        held = {name: Constant(value=value) for name, value in self.hold.items()}
        return {**{swept: ConstantSpeed(speed=1.0) for swept in self.over}, **held}

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: PrescribedTable | None = None
    ) -> Outcome:
        table = prepared or self.prepare(mechanism, accuracy, place)
        with place(), locating_drives(place):
            outcome = table.outcome()
        remarks = omitted_drives_remarks(mechanism, self.drives, self._prescribed)
        return replace(outcome, notes=(*outcome.notes, *remarks))


class State(Statics, frozen=True, tag_field="kind", tag="state"):
    """Efforts at given velocities and accelerations: over the range of one coordinate, or at one position.

    Every row is a state of its own. What is not given is 0.

    Attributes:
        velocity: Coordinate -> velocity, at every row.
        acceleration: Coordinate -> acceleration, at every row.
        loads: Applied forces, springs and dampers of this run.
    """

    kind: ClassVar[str] = "state"
    velocity: dict[str, Rate] = {}
    acceleration: dict[str, SecondRate] = {}

    @property
    def rates(self) -> Mapping[str, Mapping[str, float]]:
        return {"velocity": self.velocity, "acceleration": self.acceleration}

"""States one by one: the efforts that hold a mechanism still, or that given velocities and accelerations take."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import msgspec
import numpy as np
from msgspec.structs import replace as replace_fields

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.columns import with_friction_columns
from pinarm.engine.kinematics.assembly import start_near
from pinarm.engine.kinematics.closed_configurations import determining
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.prescribed_motion import PrescribedTable, Prescription, Rates
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.engine.statics.actuation import Actuation, actuation
from pinarm.errors import InputError, Key, Place, choices, locating_drives
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.deferred import Deferred
from pinarm.input.yaml.schema import InputStruct, Level, Rate, SecondRate, check_unit
from pinarm.mechanics.ball_joints import positions_of
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.laws import Constant, ConstantSpeed
from pinarm.mechanics.laws.motion_law import FILE_KEYS, Grid, MotionLaw
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.actuation.effort_sharing import Share, drives_of
from pinarm.problems.actuation.omitted_drives import omitted_drives_remarks
from pinarm.problems.declaration import Declaration, others
from pinarm.problems.joint_values import check_levels
from pinarm.problems.loads import LOADS, bind_constant_loads, schema_row
from pinarm.problems.prescription.prescribed_laws import laws_of
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import Outcome
    from pinarm.mechanics.forces.kinds import Force
else:  # imported where a file has loads, see LOADS
    Force = Any

PreparedStatics = tuple[PrescribedCoordinates, Actuation, dict[str, ForceElement]]
"""The prescribed coordinates, the drives and the forces."""

PreparedState = tuple[PrescribedCoordinates, Actuation, dict[str, ForceElement], Rates]
"""The same, and the given rates."""


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
        """Refuse a range that goes nowhere."""
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

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        """Return one row near the start: enough to see which quantities there are, and which are determined."""
        return _schema_row(self, mechanism, actuation(mechanism, self.drives, [*self.over, *self.hold]))

    def declaration(self) -> Declaration | None:
        """Return what the problem says about coordinates; nothing where drives share: each effort depends on all."""
        if self.share is not None:
            return None
        return Declaration(self._without, held=self.hold, moved=self.over, drives=self.drives, loads=self.loads)

    def _without(self, names: Collection[str]) -> Statics:
        drives = [name for name in self.drives if name not in names]
        return replace_fields(
            self, hold=others(self.hold, names), start=others(self.start, names), drives=drives, loads={}
        )

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> PreparedStatics:
        """Check all names and units; return the prescribed coordinates, the drives and the forces."""
        prescribed = _prescribed(mechanism, self.over, self.hold, place)
        drives = drives_of(mechanism, self.drives, prescribed.names, self.share, place)
        return prescribed, drives, _forces(self.start, self.loads, mechanism, place)

    def table(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: PreparedStatics | None = None
    ) -> PrescribedTable:
        prescribed, drives, forces = prepared or self.prepare(mechanism, accuracy, place)
        rest = np.zeros(len(prescribed.names))
        return _table(self, mechanism, prescribed, drives, forces, (rest, rest), place)

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: PreparedStatics | None = None
    ) -> Outcome:
        return _outcome(self, self.table(mechanism, accuracy, place, prepared), place)


class State(InputStruct, frozen=True, tag_field="kind", tag="state"):
    """Efforts at given velocities and accelerations: over the range of one coordinate, or at one position.

    Every row is a state of its own. What is not given is 0.

    Attributes:
        over: The coordinate that is swept, with its range; none for a single position.
        hold: Coordinate -> value, for all the others.
        velocity: Coordinate -> velocity, at every row.
        acceleration: Coordinate -> acceleration, at every row.
        drives: Coordinates that the drives act along, such as ``[knee]``; the kind ``inverse`` has the same key.
        share: How drives share the load where there are more of them than degrees of freedom, such as
            ``least_squares``; the kind ``inverse`` has the same key.
        start: Rough joint coordinates at the first position: they choose the branch where there are several.
        loads: Applied forces, springs and dampers of this run.
    """

    kind: ClassVar[str] = "state"
    deferred: ClassVar[Deferred] = LOADS
    over: Annotated[dict[str, Range], msgspec.Meta(max_length=1)] = {}
    hold: dict[str, Level] = {}
    velocity: dict[str, Rate] = {}
    acceleration: dict[str, SecondRate] = {}
    drives: Annotated[list[str], msgspec.Meta(min_length=1)] = []
    share: Share | None = None
    start: dict[str, Level] = {}
    loads: dict[str, Force] = {}

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        """Return one row near the start: enough to see which quantities there are, and which are determined."""
        return _schema_row(self, mechanism, actuation(mechanism, self.drives, [*self.over, *self.hold]))

    def declaration(self) -> Declaration | None:
        """Return what the problem says about coordinates; nothing where drives share: each effort depends on all."""
        if self.share is not None:
            return None
        rates = (*self.velocity.items(), *self.acceleration.items())
        moving = [name for name in self.hold if any(rate for given, rate in rates if given == name)]
        return Declaration(
            self._without, held=others(self.hold, moving), moved=[*self.over, *moving], drives=self.drives,
            loads=self.loads,
        )  # fmt: skip

    def _without(self, names: Collection[str]) -> State:
        hold, velocity, acceleration, start = (
            others(given, names) for given in (self.hold, self.velocity, self.acceleration, self.start)
        )
        drives = [name for name in self.drives if name not in names]
        return replace_fields(
            self, hold=hold, velocity=velocity, acceleration=acceleration, start=start, drives=drives, loads={}
        )

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> PreparedState:
        """Check all names and units; return the prescribed coordinates, the drives, the forces, and the given rates."""
        prescribed = _prescribed(mechanism, self.over, self.hold, place)
        rates = np.zeros((2, len(prescribed.names)))
        for order, key, given in ((1, "velocity", self.velocity), (2, "acceleration", self.acceleration)):
            for name, value in given.items():
                with place(key, Key(name)):
                    if name not in prescribed.names:
                        expected, hint = choices(name, prescribed.names)
                        raise InputError(f"the position does not say '{name}'", expected=expected, hint=hint)
                with place(key, name):
                    check_unit(value, mechanism.coordinate(name).unit / unit("s") ** order)
                    rates[order - 1, prescribed.names.index(name)] = value
        drives = drives_of(mechanism, self.drives, prescribed.names, self.share, place)
        return prescribed, drives, _forces(self.start, self.loads, mechanism, place), (rates[0], rates[1])

    def table(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: PreparedState | None = None
    ) -> PrescribedTable:
        prescribed, drives, forces, rates = prepared or self.prepare(mechanism, accuracy, place)
        return _table(self, mechanism, prescribed, drives, forces, rates, place)

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: PreparedState | None = None
    ) -> Outcome:
        return _outcome(self, self.table(mechanism, accuracy, place, prepared), place)


def _schema_row(problem: Statics | State, mechanism: Mechanism, drives: Actuation) -> Trajectory:
    """Return one row near the first position."""
    first = {**{swept: values.start for swept, values in problem.over.items()}, **problem.hold}
    known = positions_of(mechanism.joints, mechanism.balls)
    start = {**problem.start, **{name: value for name, value in first.items() if name in known}}
    row = schema_row(mechanism, start, problem.loads, *_parameter(problem.over, mechanism), drives)
    return with_friction_columns(replace(row, separate=True), drives)


def _table(
    problem: Statics | State, mechanism: Mechanism, prescribed: PrescribedCoordinates, drives: Actuation,
    forces: Mapping[str, ForceElement], rates: Rates, place: Place,
) -> PrescribedTable:  # fmt: skip
    motion, dynamics = DeterminedMotion(mechanism, prescribed), Dynamics.of(mechanism.model, forces)
    with place():
        parameter = _parameter(problem.over, mechanism)
        known = Prescription(mechanism, motion, drives, dynamics, *parameter, rates)
        grid = _grid(problem.over)
        return PrescribedTable(known, grid, start_near(mechanism, problem.start, prescribed, grid))


def _outcome(problem: Statics | State, table: PrescribedTable, place: Place) -> Outcome:
    """Return the states of a problem, and what is to be said of its drives."""
    mechanism = table.prescription.mechanism
    with place(), locating_drives(place):
        found = table.outcome()
        remarks = omitted_drives_remarks(mechanism, problem.drives, [*problem.over, *problem.hold])
        return replace(found, notes=(*found.notes, *remarks))


def _parameter(over: Mapping[str, Range], mechanism: Mechanism) -> tuple[str, Unit]:
    for swept in over:
        return swept, mechanism.coordinate(swept).unit
    return ROW, unit("1")


def _grid(over: Mapping[str, Range]) -> Grid:
    for values in over.values():
        return Grid.cover(np.linspace(values.start, values.end, values.samples), [])
    return Grid.cover(np.zeros(1), [])


def _prescribed(
    mechanism: Mechanism, over: Mapping[str, Range], hold: Mapping[str, float], place: Place
) -> PrescribedCoordinates:
    """Return the coordinates that are swept and held, their names and units checked."""
    for swept, values in over.items():
        with place("over", swept):
            measured = mechanism.coordinate(swept).unit
        for key, bound in (("from", values.start), ("to", values.end)):
            with place("over", swept, key):
                Constant(value=bound).check_units(measured)
    for name in hold:
        if name in over:
            with place("hold", Key(name)):
                raise InputError(f"'{name}' is held and swept", expected="one of the two for each coordinate")
    held = {name: Constant(value=value) for name, value in hold.items()}
    laws_of(mechanism, held, lambda _, name: place("hold", name))
    motion: dict[str, MotionLaw] = {**{swept: ConstantSpeed(speed=1.0) for swept in over}, **held}
    with place():
        return determining(mechanism, motion)


def _forces(
    start: Mapping[str, float], loads: Mapping[str, Force], mechanism: Mechanism, place: Place
) -> dict[str, ForceElement]:
    """Return the forces of states without time."""
    check_levels(mechanism, start, place, "start")
    return bind_constant_loads(mechanism, loads, place)

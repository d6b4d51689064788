"""States one by one: the efforts that hold a mechanism still, or that given velocities and accelerations take."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import msgspec
import numpy as np
from msgspec.structs import replace as replace_fields

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.columns import with_friction_columns
from pinarm.engine.kinematics.assembly import determining, start_near
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.prescribed_motion import PrescribedTable, Prescription, Rates
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.engine.statics.actuation import Actuation, actuation
from pinarm.errors import InputError, Key, Place, choices, locating_drives
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import Deferred, InputStruct, Level, Rate, SecondRate, check_unit
from pinarm.mechanics.ball_joints import positions_of
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.laws import Constant, ConstantSpeed
from pinarm.mechanics.laws.motion_law import FILE_KEYS, Grid, MotionLaw
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.declaration import Declaration, others
from pinarm.problems.drives import Share, drives_of, omitted_drives_remarks
from pinarm.problems.joint_values import check_levels
from pinarm.problems.laws import laws_of
from pinarm.problems.loads import LOADS, bind_constant_loads, schema_row
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import Outcome
    from pinarm.mechanics.forces.kinds import Force
else:  # imported where a file has loads, see LOADS
    Force = Any

Prepared = tuple[PrescribedCoordinates, Actuation, dict[str, ForceElement], Rates]
"""The prescribed coordinates, the drives, the forces and the given rates."""


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


class StateByState:
    """Methods of problems whose rows are states of their own."""

    __slots__ = ()
    over: dict[str, Range]
    hold: dict[str, Level]
    drives: list[str]
    share: Share | None
    start: dict[str, Level]
    loads: dict[str, Force]

    @property
    def rates(self) -> tuple[Mapping[str, float], Mapping[str, float]]:
        return {}, {}

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        drives = actuation(mechanism, self.drives, [*self.over, *self.hold])
        first = {**{swept: values.start for swept, values in self.over.items()}, **self.hold}
        known = positions_of(mechanism.joints, mechanism.balls)
        start = {**self.start, **{name: value for name, value in first.items() if name in known}}
        row = schema_row(mechanism, start, self.loads, *_parameter(self.over, mechanism), drives)
        return with_friction_columns(replace(row, separate=True), drives)

    def declaration(self) -> Declaration | None:
        """Return the declaration about coordinates; ``None`` where drives share: each effort depends on all."""
        if self.share is not None:
            return None
        rates = [value for rates_of_order in self.rates for value in rates_of_order.items()]
        moving = [name for name in self.hold if any(rate for rates_of_order, rate in rates if rates_of_order == name)]
        return Declaration(
            self._without,
            held=others(self.hold, moving),
            moved=[*self.over, *moving],
            drives=self.drives,
            loads=self.loads,
        )

    def _without(self, names: Collection[str]) -> Any:
        fields: Any = self
        keys = {"hold", "velocity", "acceleration", "start"} & {*fields.__struct_fields__}
        changes = {key: others(getattr(self, key), names) for key in keys}
        drives = [name for name in self.drives if name not in names]
        return replace_fields(fields, **changes, drives=drives, loads={})

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Prepared:
        prescribed = _prescribed(mechanism, self.over, self.hold, place)
        rates = np.zeros((2, len(prescribed.names)))
        for order, (key, values) in enumerate(zip(("velocity", "acceleration"), self.rates, strict=True)):
            for name, value in values.items():
                with place(key, Key(name)):
                    if name not in prescribed.names:
                        expected, hint = choices(name, prescribed.names)
                        raise InputError(f"the position does not say '{name}'", expected=expected, hint=hint)
                with place(key, name):
                    check_unit(value, mechanism.coordinate(name).unit / unit("s") ** (order + 1))
                    rates[order, prescribed.names.index(name)] = value
        drives = drives_of(mechanism, self.drives, prescribed.names, self.share, place)
        check_levels(mechanism, self.start, place, "start")
        forces = bind_constant_loads(mechanism, self.loads, place, moving=bool(rates[0].any()))
        return prescribed, drives, forces, (rates[0], rates[1])

    def table(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Prepared | None = None
    ) -> PrescribedTable:
        prescribed, drives, forces, rates = prepared or self.prepare(mechanism, accuracy, place)
        motion, dynamics = DeterminedMotion(mechanism, prescribed), Dynamics.of(mechanism.model, forces)
        with place():
            known = Prescription(mechanism, motion, drives, dynamics, *_parameter(self.over, mechanism), rates)
            grid = _grid(self.over)
            return PrescribedTable(known, grid, start_near(mechanism, self.start, prescribed, grid))

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Prepared | None = None
    ) -> Outcome:
        table = self.table(mechanism, accuracy, place, prepared)
        with place(), locating_drives(place):
            outcome = table.outcome()
            remarks = omitted_drives_remarks(mechanism, self.drives, [*self.over, *self.hold])
            return replace(outcome, notes=(*outcome.notes, *remarks))


class Statics(StateByState, InputStruct, frozen=True, tag_field="kind", tag="statics"):
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


class State(StateByState, InputStruct, frozen=True, tag_field="kind", tag="state"):
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

    @property
    def rates(self) -> tuple[Mapping[str, float], Mapping[str, float]]:
        return self.velocity, self.acceleration


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

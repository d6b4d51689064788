"""A recorded motion: measured, or of another program. Nothing is solved for but the efforts that belong to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.columns import with_friction_columns
from pinarm.engine.kinematics.assembly import generic_near
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.recorded_motion import RecordedRows, Recording
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.state_arrays import LeadingAxes, check_quaternions
from pinarm.engine.statics.actuation import Actuation, everywhere
from pinarm.errors import InputError, Key, Place, UnitError, choices, nowhere, several, within
from pinarm.input.csv_tables import split_heading
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.input.yaml.schema import Deferred, InputStruct, named_file
from pinarm.mechanics.joints import effort_unit
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.drives import Share, drives_of
from pinarm.problems.loads import LOADS, bind_loads
from pinarm.problems.time_grid import require_memory
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import Outcome
    from pinarm.mechanics.forces.kinds import Force
else:  # imported where a file has loads, see LOADS
    Force = Any

Prepared = tuple[Recording, RecordedRows, tuple[str, ...]]
"""Recording, which makes the table, its rows, and the headings that are not read."""


class Recorded(InputStruct, frozen=True, tag_field="kind", tag="recorded"):
    """A motion that is given row by row, with all that can be said of it.

    What is not given is not invented. Without velocities and accelerations quantities that depend on them are refused,
    unless ``derivatives: spline`` takes both from the spline of degree 5 through the positions, which tells its error.
    Given efforts are taken as they are, 0 at joints without a column, and how far they are from the equation of motion
    is told as a residual; without any, they are those of inverse dynamics.

    Attributes:
        file: CSV table with a heading such as ``t [s],joint.knee.position [deg],joint.knee.velocity [deg/s]``: one
            column for every joint, by the names of quantities; other columns are not read.
        columns: The same in place of a file: heading -> numbers, in a list or as text, such as ``{'t [s]': [0, 0.1,
            0.2], 'knee [deg]': [10, 12, 15]}``.
        derivatives: ``given``, as far as there are columns of them, or those of a ``spline``.
        drives: Coordinates that the drives act along, such as ``[knee]``, where no efforts are given; every joint of an
            open chain where none is named. A mechanism with loops has no forces in its answer without any.
        share: How drives share the load where there are more of them than degrees of freedom, such as
            ``least_squares``; the kind ``inverse`` has the same key.
        loads: Applied forces, springs and dampers of this run, such as ``{spring: {kind: joint_spring, joint: O,
            stiffness: 20 N*m/rad}}``.
    """

    kind: ClassVar[str] = "recorded"
    deferred: ClassVar[Deferred] = LOADS
    file: str = ""
    columns: dict[str, list[float] | str] = {}
    derivatives: Literal["given", "spline"] = "given"
    drives: Annotated[list[str], msgspec.Meta(min_length=1)] = []
    share: Share | None = None
    loads: dict[str, Force] = {}

    def check(self) -> None:
        if bool(self.file) == bool(self.columns):
            raise InputError(
                "the motion has two sources, 'file' and 'columns'" if self.file else "there is no motion",
                expected="file: a CSV table, or columns: heading -> numbers",
            )
        if self.file:
            with within("file"):
                msgspec.structs.force_setattr(self, "file", str(named_file(self.file)))

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        rows, _ = self._read(mechanism)
        drives = None if rows.tau is not None else self._drives(mechanism, nowhere)
        start = {name: float(rows.q[0, joint.q]) for name, joint in mechanism.joints.items()}
        dynamics = Dynamics.of(mechanism.model, bind_loads(mechanism, self.loads, nowhere))
        still = np.zeros((1, mechanism.model.nv))
        known = self.derivatives == "spline"
        v, a = (still if known or x is not None else None for x in (rows.v, rows.a))
        tau = None if rows.tau is None else still
        first = RecordedRows(np.zeros(1), generic_near(mechanism, start)[None], v, a, tau)
        row = Recording(mechanism, drives, dynamics).schema_row(first)
        if drives is not None:
            row = with_friction_columns(row, drives)
        return replace(row, sampled=not known or rows.tau is not None)

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Prepared:
        with place("file" if self.file else "columns"):
            rows, unread = self.rows(mechanism)
        for key, value in (("drives", self.drives), ("share", self.share)):
            if rows.tau is not None and value:
                with place(key):
                    raise InputError(
                        "efforts are given, and drives whose efforts are to be found", expected="one of them"
                    )
        drives = None if rows.tau is not None else self._drives(mechanism, place)
        forces = bind_loads(mechanism, self.loads, place)
        return Recording(mechanism, drives, Dynamics.of(mechanism.model, forces)), rows, unread

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Prepared | None = None
    ) -> Outcome:
        recording, rows, unread = prepared or self.prepare(mechanism, accuracy, place)
        rows = deepcopy(rows)  # what is prepared serves further runs
        with place("file" if self.file else "columns"):
            outcome = recording.splined(rows) if self.derivatives == "spline" else recording.outcome(rows)
        notes = (f"columns that are not read: {', '.join(unread)}",) if unread else ()
        return replace(outcome, notes=(*notes, *_doubts(mechanism, outcome.figures), *outcome.notes))

    def rows(self, mechanism: Mechanism) -> tuple[RecordedRows, tuple[str, ...]]:
        rows, unread = self._read(mechanism)
        require_memory(len(rows.t), mechanism.model, 0, "file" if self.file else "table")
        check_rows(mechanism, rows)
        return rows, unread

    def _read(self, mechanism: Mechanism) -> tuple[RecordedRows, tuple[str, ...]]:
        rows, unread = _recorded_rows(mechanism, self._columns(mechanism))
        self._check_known(mechanism, rows)
        return rows, unread

    def _check_known(self, mechanism: Mechanism, rows: RecordedRows) -> None:
        """Refuse what does not go together of the question and of the arrays that there are columns of."""
        if self.derivatives == "spline" and not (rows.v is None and rows.a is None):
            raise InputError(
                "velocities or accelerations are given, and those of a spline are asked for",
                expected="derivatives: given, or positions only",
            )
        if self.derivatives == "given" and rows.tau is not None and rows.unknown:
            raise InputError(f"efforts are given, but {rows.unknown}", hint="derivatives: spline")
        if rows.tau is not None and mechanism.frictions:
            sticking = ", ".join(dict.fromkeys(contact.name for contact in mechanism.frictions))
            raise InputError(
                f"efforts are given, and {sticking} has friction of its own: the two are not told apart",
                expected="no efforts: they follow from the motion and the friction",
            )
        if rows.a is not None and rows.v is None:
            raise InputError("accelerations are given without velocities", expected="both, or none")

    def _columns(self, mechanism: Mechanism) -> Mapping[str, Sequence[float] | str]:
        if not self.file:
            return self.columns
        from pinarm.input.csv_tables import read_columns

        return read_columns(Path(self.file), {"t", *_state_columns(mechanism), *_aliases(mechanism)})

    def _drives(self, mechanism: Mechanism, place: Place) -> Actuation | None:
        if not self.drives and self.share is None:
            return everywhere(mechanism)
        return drives_of(mechanism, self.drives, [], self.share, place)


DOUBTFUL = 1e-2
"""Relative difference of a derivative from the rate of the rows that a note tells."""


def _doubts(mechanism: Mechanism, figures: Mapping[str, float]) -> tuple[str, ...]:
    """Return notes on given derivatives that are not the rates of the rows, with a likely cause."""
    doubts = []
    for derivative, of in (("velocity", "positions"), ("acceleration", "velocities")):
        left = figures.get(f"{derivative} consistency", 0.0)
        if left > DOUBTFUL:
            doubts.append(
                f"{derivative} consistency {left:.2g}: the given {derivative} is not the rate of the {of}, "
                "or the rows are too far apart to tell"
            )
    if doubts and mechanism.balls:
        doubts.append(
            "of a floating base v has the velocity in the axes of the world, where Pinocchio has it in those "
            "of the base: Mechanism.from_pinocchio converts"
        )
    return tuple(doubts)


class StateColumn(NamedTuple):
    """Place of a column in the arrays of states: ``q``, ``v``, ``a`` or ``tau``, index, unit in SI."""

    array: str
    place: int
    unit: Unit


def _state_columns(mechanism: Mechanism) -> dict[str, StateColumn]:
    """Return the columns that hold a motion of a mechanism, by the names of its quantities, in the order of q and v."""
    columns: dict[str, StateColumn] = {}
    rates = {
        "angular_velocity": ("v", unit("rad/s")),
        "angular_acceleration": ("a", unit("rad/s^2")),
        "effort": ("tau", unit("N*m")),
    }
    for name, joint in mechanism.joints.items():
        base, own = f"joint.{name}", joint.unit
        columns[f"{base}.position"] = StateColumn("q", joint.q, own)
        columns[f"{base}.velocity"] = StateColumn("v", joint.v, unit(f"{own}/s"))
        columns[f"{base}.acceleration"] = StateColumn("a", joint.v, unit(f"{own}/s^2"))
        columns[f"{base}.effort"] = StateColumn("tau", joint.v, effort_unit(joint.unit))
    for name, ball in mechanism.balls.items():
        for k, axis in enumerate("xyzw"):
            columns[f"joint.{name}.quaternion.{axis}"] = StateColumn("q", ball.q + k, DIMENSIONLESS)
        for rate, (array, measured) in rates.items():
            for k, axis in enumerate("xyz"):
                columns[f"joint.{name}.{rate}.{axis}"] = StateColumn(array, ball.v + k, measured)
    return columns


def _aliases(mechanism: Mechanism) -> dict[str, str]:
    """Return other headings of the columns of positions -> their names."""
    return {
        alias: f"joint.{name}.position" for name in mechanism.joints for alias in (name, f"coordinate.{name}.position")
    }


def named_columns(mechanism: Mechanism, rows: RecordedRows) -> dict[str, str]:
    """Return rows as columns of the problem: headings with SI units, numbers as text with all their digits."""
    arrays = {"q": rows.q, "v": rows.v, "a": rows.a, "tau": rows.tau}
    text = {"t [s]": _text(rows.t)}
    for name, (array, place, measured) in _state_columns(mechanism).items():
        if (values := arrays[array]) is not None:
            text[name if str(measured) == "1" else f"{name} [{measured}]"] = _text(values[:, place])
    return text


def _text(values: Array) -> str:
    return " ".join(map(repr, values.tolist()))


def _recorded_rows(
    mechanism: Mechanism, columns: Mapping[str, Sequence[float] | str]
) -> tuple[RecordedRows, tuple[str, ...]]:
    """Return the rows in columns, and the headings that are not read.

    Headings are such as ``joint.knee.velocity [deg/s]``; a joint's own name is its position.
    """
    known, aliases = _state_columns(mechanism), _aliases(mechanism)
    wanted = {"t": unit("s"), **{name: column.unit for name, column in known.items()}}
    values, unread = dict[str, Array](), list[str]()
    for heading, column in columns.items():
        with within(Key(heading)):
            if (parts := split_heading(heading)) is None:
                expected = "a name and a unit, such as joint.knee.position [deg]"
                raise InputError(f"'{heading}' is no heading", expected=expected)
            name = aliases.get(parts[0], parts[0])
            if name in values:
                raise InputError(f"two columns are '{name}'", expected="one for each")
            if name in wanted:
                values[name] = _values(column) * _factor(name, parts[1], wanted[name])
            else:
                unread.append(heading)
    if "t" not in values:
        expected, hint = choices("t", columns)
        raise InputError("there is no column 't'", expected=f"t [s] beside {expected}", hint=hint)
    _require_complete(known, values)
    model = mechanism.model
    states = dict[str, Array]()
    for array, width in {"q": model.nq, "v": model.nv, "a": model.nv, "tau": model.nv}.items():
        given = {
            known[name].place: column for name, column in values.items() if name != "t" and known[name][0] == array
        }
        if given:
            states[array] = np.zeros((len(values["t"]), width))  # efforts that are not given beside others are 0
            states[array][:, [*given]] = np.column_stack([*given.values()])
    return RecordedRows(values["t"], **states), tuple(unread)


def _require_complete(known: Mapping[str, StateColumn], columns: Mapping[str, Array]) -> None:
    """Refuse columns of different lengths, and some columns of q, v or a without all; efforts may be missing."""
    for array in ("q", "v", "a"):
        wanted = [name for name, column in known.items() if column.array == array]
        missing = [name for name in wanted if name not in columns]
        if missing and len(missing) < len(wanted):
            raise InputError(
                f"the columns {several(missing, 3)} are missing",
                expected="one for every joint, by the names of quantities, such as "
                f"{wanted[0]} [{known[wanted[0]].unit}]",
            )
        if missing and array == "q":
            raise InputError("there are no columns of positions", expected=f"such as {wanted[0]}")
    rows = len(columns["t"])
    for name, values in columns.items():
        if len(values) != rows:
            raise InputError(f"the column '{name}' has {len(values)} rows, 't' has {rows}", expected="as many")


def _factor(name: str, written: str | None, wanted: Unit) -> float:
    """Return the factor from the unit of a heading to SI."""
    measured = unit(written) if written is not None else DIMENSIONLESS
    if measured.dimension != wanted.dimension or (written is None and str(wanted) != "1"):
        raise UnitError(
            f"the column '{name}' is in {measured}" if written else f"the column '{name}' has no unit",
            expected=f"{name} [{wanted}], or another unit of that kind",
        )
    return measured.factor


def _values(numbers: Sequence[float] | str) -> Array:
    try:
        return np.array(numbers.split() if isinstance(numbers, str) else numbers, float)
    except ValueError as error:
        raise InputError(f"a number is expected ({error})", expected="numbers with blanks between them") from None


def check_rows(mechanism: Mechanism, rows: RecordedRows) -> None:
    """Refuse rows that are no motion: without rows, instants that ascend, finite numbers or unit quaternions."""
    if not len(rows.t):
        raise InputError("the motion has no rows", expected="one at least")
    for name, values in (("t", rows.t), ("q", rows.q), ("v", rows.v), ("a", rows.a), ("tau", rows.tau)):
        if values is not None and not np.isfinite(values).all():
            row = int((~np.isfinite(values)).reshape(len(values), -1).any(axis=1).argmax())
            raise InputError(f"{name} is not finite in row {row}", expected="finite numbers")
    for row in np.flatnonzero(np.diff(rows.t) < 0.0)[:1]:
        raise InputError(f"the instants descend: {rows.t[row]:.9g} s, then {rows.t[row + 1]:.9g} s (row {row + 1})")
    least = np.finfo(float).tiny  # what is between two rows is divided by the time between them
    for row in np.flatnonzero((np.diff(rows.t) > 0.0) & (np.diff(rows.t) < least))[:1]:
        raise InputError(
            f"the instants {rows.t[row]:.9g} s and {rows.t[row + 1]:.9g} s (row {row + 1}) are too close",
            expected=f"the same instant, or at least {least:.2g} s between",
        )
    check_quaternions(mechanism, LeadingAxes(rows.t.shape), rows.q)

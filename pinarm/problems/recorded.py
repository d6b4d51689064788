"""A recorded motion: measured, or of another program. Nothing is solved for but the efforts that belong to it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Set
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
from pinarm.engine.statics.actuation import Actuation, everywhere
from pinarm.errors import InputError, Key, Place, UnitError, choices, nowhere, several, within
from pinarm.input.csv_tables import split_heading
from pinarm.input.roots import contained_file, root_of
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.input.yaml.schema import Deferred, InputStruct, current_folder
from pinarm.mechanics.joints import effort_unit
from pinarm.mechanics.loading.pinocchio_layout import UNIT
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
        """Refuse a motion without rows, or with two sources of them; keep the file by its whole path."""
        if bool(self.file) == bool(self.columns):
            raise InputError(
                "the motion has two sources, 'file' and 'columns'" if self.file else "there is no motion",
                expected="file: a CSV table, or columns: heading -> numbers",
            )
        if self.file:
            folder = current_folder() or Path()
            with within("file"):
                path = contained_file((folder / self.file).absolute(), root_of(folder))
            msgspec.structs.force_setattr(self, "file", str(path))

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        rows, _ = self._read(mechanism, most=1)
        drives = None if rows.tau is not None else self._drives(mechanism, nowhere)
        start = {name: float(rows.q[0, joint.q]) for name, joint in mechanism.joints.items()}
        dynamics = Dynamics.of(mechanism.model, bind_loads(mechanism, self.loads, nowhere))
        still = np.zeros((1, mechanism.model.nv))
        known = self.derivatives == "spline"
        v, a = (still if known or x is not None else None for x in (rows.v, rows.a))
        tau = None if rows.tau is None else still
        first = RecordedRows(np.zeros(1), generic_near(mechanism, start)[None], v, a, tau)
        recording = Recording(mechanism, drives, dynamics)
        row = recording.schema_row(first)
        if drives is not None:
            row = with_friction_columns(row, drives)
        return replace(row, sampled=not known or rows.tau is not None)

    def declaration(self) -> None:
        """Return nothing: the whole mechanism is given."""

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Prepared:
        """Check all names and units; return what makes the table, the rows, and the headings that are not read."""
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
        """Return the rows that are given, and the headings of columns that are not read.

        Raises:
            InputError: They are no motion of this mechanism.
        """
        rows, unread = self._read(mechanism)
        require_memory(len(rows.t), mechanism.model, 0, "file" if self.file else "table")
        check_rows(mechanism, rows)
        return rows, unread

    def _read(self, mechanism: Mechanism, most: int | None = None) -> tuple[RecordedRows, tuple[str, ...]]:
        """Return the rows, or the first ones of them, and the headings that are not read; headings are checked first.

        Raises:
            InputError: See ``rows``.
        """
        headings = recorded_headings(mechanism, self._headings())
        self._check_known(mechanism, headings.arrays)
        return recorded_rows(mechanism, headings, self._columns(mechanism, most)), headings.unread

    def _check_known(self, mechanism: Mechanism, arrays: Set[str]) -> None:
        """Refuse what does not go together of the question and of the arrays that there are columns of.

        Raises:
            InputError: See ``rows``.
        """
        if self.derivatives == "spline" and arrays & {"v", "a"}:
            raise InputError(
                "velocities or accelerations are given, and those of a spline are asked for",
                expected="derivatives: given, or positions only",
            )
        if self.derivatives == "given" and "tau" in arrays and not {"v", "a"} <= arrays:
            lacking = "accelerations" if "v" in arrays else "velocities"
            raise InputError(
                f"efforts are given, but the {lacking} of this motion are not given", hint="derivatives: spline"
            )
        if "tau" in arrays and mechanism.frictions:
            sticking = ", ".join(dict.fromkeys(contact.name for contact in mechanism.frictions))
            raise InputError(
                f"efforts are given, and {sticking} has friction of its own: the two are not told apart",
                expected="no efforts: they follow from the motion and the friction",
            )
        if "a" in arrays and "v" not in arrays:
            raise InputError("accelerations are given without velocities", expected="both, or none")

    def _headings(self) -> Iterable[str]:
        if not self.file:
            return self.columns
        from pinarm.input.csv_tables import read_headings

        return read_headings(self.file)

    def _columns(self, mechanism: Mechanism, most: int | None) -> Mapping[str, Sequence[float] | str]:
        if not self.file:
            return self.columns if most is None else {heading: x[:most] for heading, x in _apart(self.columns)}
        from pinarm.input.csv_tables import read_columns

        state = Path(self.file).stat()
        return read_columns(self.file, names_read(mechanism), (state.st_mtime_ns, state.st_size), most)

    def _drives(self, mechanism: Mechanism, place: Place) -> Actuation | None:
        if not self.drives and self.share is None:
            return everywhere(mechanism)
        return drives_of(mechanism, self.drives, [], self.share, place)


def _apart(columns: Mapping[str, list[float] | str]) -> Iterator[tuple[str, Sequence[Any]]]:
    """Yield headings with their numbers, those of texts still as texts."""
    for heading, numbers in columns.items():
        yield heading, numbers.split() if isinstance(numbers, str) else numbers


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


DOUBTFUL = 1e-2
"""Relative difference of a derivative from the rate of the rows that a note tells."""


AXES = "xyzw"


class StateColumn(NamedTuple):
    """Where a column stands in the arrays of states.

    Attributes:
        array: ``q``, ``v``, ``a`` or ``tau``.
        place: Index of its column there.
        unit: Its unit in SI.
    """

    array: str
    place: int
    unit: Unit


def state_columns(mechanism: Mechanism) -> dict[str, StateColumn]:
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
        columns[f"{base}.effort"] = StateColumn("tau", joint.v, effort_unit(joint))
    for name, ball in mechanism.balls.items():
        for k, axis in enumerate(AXES):
            columns[f"joint.{name}.quaternion.{axis}"] = StateColumn("q", ball.q + k, DIMENSIONLESS)
        for rate, (array, measured) in rates.items():
            for k, axis in enumerate(AXES[:3]):
                columns[f"joint.{name}.{rate}.{axis}"] = StateColumn(array, ball.v + k, measured)
    return columns


def named_columns(mechanism: Mechanism, rows: RecordedRows) -> dict[str, str]:
    """Return the columns that ``recorded_rows`` makes the same rows of: headings with SI units, numbers as text.

    A text a column takes a reader less than a list of numbers; every digit is there.
    """
    arrays = {"q": rows.q, "v": rows.v, "a": rows.a, "tau": rows.tau}
    text = {"t [s]": _text(rows.t)}
    for name, (array, place, measured) in state_columns(mechanism).items():
        if (values := arrays[array]) is not None:
            text[name if str(measured) == "1" else f"{name} [{measured}]"] = _text(values[:, place])
    return text


def names_read(mechanism: Mechanism) -> frozenset[str]:
    """Return the names of all columns that are read."""
    return frozenset({"t", *state_columns(mechanism), *_aliases(mechanism)})


def _aliases(mechanism: Mechanism) -> dict[str, str]:
    """Return other headings of the columns of positions -> their names."""
    return {
        alias: f"joint.{name}.position" for name in mechanism.joints for alias in (name, f"coordinate.{name}.position")
    }


class RecordedHeadings(NamedTuple):
    """The headings of a recorded motion, understood before its numbers are read.

    Attributes:
        columns: Name of the column, see ``state_columns``, or ``t`` -> its heading, and its unit in SI.
        arrays: Which of ``q``, ``v``, ``a`` and ``tau`` there are columns of.
        unread: Headings of columns that are none of a state.
    """

    columns: Mapping[str, tuple[str, float]]
    arrays: Set[str]
    unread: tuple[str, ...]


def recorded_headings(mechanism: Mechanism, headings: Iterable[str]) -> RecordedHeadings:
    """Return the columns of headings such as ``joint.knee.velocity [deg/s]``; a joint's own name is its position.

    Args:
        mechanism: What moves.
        headings: Of the columns.

    Raises:
        InputError: A column is missing or occurs twice.
        UnitError: A unit does not fit.
    """
    known, aliases = state_columns(mechanism), _aliases(mechanism)
    headings_read: dict[str, tuple[str, float]] = {}
    unread, names = list[str](), list[str]()
    for heading in headings:
        with within(Key(heading)):
            name, measured = _split(heading)
            names.append(name)
            name = aliases.get(name, name)
            if name in headings_read:
                raise InputError(f"two columns are '{name}'", expected="one for each")
            if name == "t" or name in known:
                headings_read[name] = heading, _factor(name, measured, unit("s") if name == "t" else known[name].unit)
            else:
                unread.append(heading)
    if "t" not in headings_read:
        expected, hint = choices("t", names)
        raise InputError("there is no column 't'", expected=f"t [s] beside {expected}", hint=hint)
    _require_complete(known, headings_read)
    return RecordedHeadings(headings_read, {known[name].array for name in headings_read if name != "t"}, tuple(unread))


def recorded_rows(
    mechanism: Mechanism, headings: RecordedHeadings, columns: Mapping[str, Sequence[float] | str]
) -> RecordedRows:
    """Return the rows that columns hold.

    Args:
        mechanism: What moves.
        headings: What the headings say.
        columns: Heading -> numbers, or a text of them with blanks between.

    Raises:
        InputError: Something is no finite number, or two columns have not the same length.
    """
    arrays = dict[str, Array]()
    for name, (heading, factor) in headings.columns.items():
        with within(Key(heading)):
            arrays[name] = _values(columns[heading]) * factor
    _require_one_length(arrays)
    known, model = state_columns(mechanism), mechanism.model
    sizes = {"q": model.nq, "v": model.nv, "a": model.nv, "tau": model.nv}
    states = {array: _states(array, sizes[array], known, arrays) for array in headings.arrays}
    return RecordedRows(arrays["t"], **states)


def check_rows(mechanism: Mechanism, rows: RecordedRows) -> None:
    """Refuse rows that are no motion.

    Raises:
        InputError: There are none, instants descend or are too close to divide by what is between them, a number is
            not finite, or a quaternion has not the length 1.
    """
    if not len(rows.t):
        raise InputError("the motion has no rows", expected="one at least")
    for name, values in (("t", rows.t), ("q", rows.q), ("v", rows.v), ("a", rows.a), ("tau", rows.tau)):
        if values is not None and not np.isfinite(values).all():
            row = int((~np.isfinite(values)).reshape(len(values), -1).any(axis=1).argmax())
            raise InputError(f"{name} is not finite in row {row}", expected="finite numbers")
    steps = np.diff(rows.t)
    if (steps < 0.0).any():
        row = int((steps < 0.0).argmax())
        raise InputError(f"the instants descend: {rows.t[row]:.9g} s, then {rows.t[row + 1]:.9g} s (row {row + 1})")
    if (close := (steps > 0.0) & (steps < np.finfo(float).tiny)).any():
        row = int(close.argmax())
        raise InputError(
            f"the instants {rows.t[row]:.9g} s and {rows.t[row + 1]:.9g} s (row {row + 1}) are too close",
            expected=f"the same instant, or at least {np.finfo(float).tiny:.2g} s between",
        )
    for ball in mechanism.balls.values():
        lengths = np.linalg.norm(ball.quaternion(rows.q), axis=1)
        for row in np.flatnonzero(np.abs(lengths - 1.0) > UNIT)[:1]:
            raise InputError(
                f"row {row}: the quaternion of '{ball.name}' has the length {lengths[row]:.6g}",
                expected="(x, y, z, w) of length 1",
            )


def _require_complete(known: Mapping[str, StateColumn], names: Collection[str]) -> None:
    """Refuse a motion without positions, or with some columns of q, v or a but not all; efforts may be missing.

    Raises:
        InputError: It is one; says which are missing.
    """
    for array in ("q", "v", "a"):
        wanted = [name for name, column in known.items() if column.array == array]
        missing = [name for name in wanted if name not in names]
        if missing and len(missing) < len(wanted):
            raise InputError(
                f"the columns {several(missing, 3)} are missing",
                expected="one for every joint, by the names of quantities, such as "
                f"{wanted[0]} [{known[wanted[0]].unit}]",
            )
        if missing and array == "q":
            raise InputError("there are no columns of positions", expected=f"such as {wanted[0]}")


def _states(array: str, width: int, known: Mapping[str, StateColumn], columns: Mapping[str, Array]) -> Array:
    """Return q, v, a or tau, shape (n, width); efforts that are not given beside others are 0."""
    values = np.zeros((len(columns["t"]), width))
    for name, column in known.items():
        if column.array == array:
            values[:, column.place] = columns.get(name, 0.0)
    return values


def _split(heading: str) -> tuple[str, str | None]:
    parts = split_heading(heading)
    if parts is None:
        raise InputError(f"'{heading}' is no heading", expected="a name and a unit, such as joint.knee.position [deg]")
    return parts


def _factor(name: str, written: str | None, wanted: Unit) -> float:
    """Return the factor from the unit of a heading to SI.

    Raises:
        UnitError: It has no unit, or one of another dimension.
    """
    measured = unit(written) if written is not None else DIMENSIONLESS
    if measured.dimension != wanted.dimension or (written is None and str(wanted) != "1"):
        raise UnitError(
            f"the column '{name}' is in {measured}" if written else f"the column '{name}' has no unit",
            expected=f"{name} [{wanted}], or another unit of that kind",
        )
    return measured.factor


def _values(numbers: Sequence[float] | str) -> Array:
    """Return the numbers of a column.

    Raises:
        InputError: One is none.
    """
    try:
        return np.array(numbers.split() if isinstance(numbers, str) else numbers, float)
    except ValueError as error:
        raise InputError(f"a number is expected ({error})", expected="numbers with blanks between them") from None


def _require_one_length(columns: Mapping[str, Array]) -> None:
    rows = len(columns["t"])
    for name, values in columns.items():
        if len(values) != rows:
            raise InputError(f"the column '{name}' has {len(values)} rows, 't' has {rows}", expected="as many")


def _text(values: Array) -> str:
    return " ".join(map(repr, values.tolist()))

"""Columns of a recorded motion by name, and the arrays of states that they make."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.recorded_motion import RecordedRows
from pinarm.errors import InputError, Key, UnitError, choices, several, within
from pinarm.input.csv_rows import split_heading
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.mechanics.forces.joint_definitions import effort_unit
from pinarm.mechanics.loading.pinocchio_layout import UNIT

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
    rates = {"angular_velocity": ("v", unit("rad/s")), "angular_acceleration": ("a", unit("rad/s^2")),
             "effort": ("tau", unit("N*m"))}  # fmt: skip
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
    """Return what else the columns of positions may be called -> their names."""
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
    """Return what headings say, such as ``joint.knee.velocity [deg/s]``; a joint's own name is its position.

    Args:
        mechanism: What moves.
        headings: Of the columns.

    Raises:
        InputError: A column is missing or stands twice.
        UnitError: A unit does not fit.
    """
    known, aliases = state_columns(mechanism), _aliases(mechanism)
    given: dict[str, tuple[str, float]] = {}
    unread, names = list[str](), list[str]()
    for heading in headings:
        with within(Key(heading)):
            name, measured = _split(heading)
            names.append(name)
            name = aliases.get(name, name)
            if name in given:
                raise InputError(f"two columns are '{name}'", expected="one for each")
            if name == "t" or name in known:
                given[name] = heading, _factor(name, measured, unit("s") if name == "t" else known[name].unit)
            else:
                unread.append(heading)
    if "t" not in given:
        expected, hint = choices("t", names)
        raise InputError("there is no column 't'", expected=f"t [s] beside {expected}", hint=hint)
    _require_complete(known, given)
    return RecordedHeadings(given, {known[name].array for name in given if name != "t"}, tuple(unread))


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
    given = dict[str, Array]()
    for name, (heading, factor) in headings.columns.items():
        with within(Key(heading)):
            given[name] = _values(columns[heading]) * factor
    _require_one_length(given)
    known, model = state_columns(mechanism), mechanism.model
    sizes = {"q": model.nq, "v": model.nv, "a": model.nv, "tau": model.nv}
    found = {array: _states(array, sizes[array], known, given) for array in headings.arrays}
    return RecordedRows(given["t"], **found)


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
        raise InputError(f"the instants {rows.t[row]:.9g} s and {rows.t[row + 1]:.9g} s (row {row + 1}) are too close",
                         expected=f"the same instant, or at least {np.finfo(float).tiny:.2g} s between")  # fmt: skip
    for ball in mechanism.balls.values():
        lengths = np.linalg.norm(ball.quaternion(rows.q), axis=1)
        for row in np.flatnonzero(np.abs(lengths - 1.0) > UNIT)[:1]:
            raise InputError(f"row {row}: the quaternion of '{ball.name}' has the length {lengths[row]:.6g}",
                             expected="(x, y, z, w) of length 1")  # fmt: skip


def _require_complete(known: Mapping[str, StateColumn], given: Collection[str]) -> None:
    """Refuse a motion without positions, or with some columns of q, v or a but not all; efforts may be missing.

    Raises:
        InputError: It is one; says which are missing.
    """
    for array in ("q", "v", "a"):
        wanted = [name for name, column in known.items() if column.array == array]
        missing = [name for name in wanted if name not in given]
        if missing and len(missing) < len(wanted):
            raise InputError(
                f"the columns {several(missing, 3)} are missing",
                expected="one for every joint, by the names of quantities, such as "
                f"{wanted[0]} [{known[wanted[0]].unit}]",
            )
        if missing and array == "q":
            raise InputError("there are no columns of positions", expected=f"such as {wanted[0]}")


def _states(array: str, width: int, known: Mapping[str, StateColumn], given: Mapping[str, Array]) -> Array:
    """Return q, v, a or tau, shape (n, width); efforts that are not given beside others are 0."""
    values = np.zeros((len(given["t"]), width))
    for name, column in known.items():
        if column.array == array:
            values[:, column.place] = given.get(name, 0.0)
    return values


def _split(heading: str) -> tuple[str, str | None]:
    parts = split_heading(heading)
    if parts is None:
        raise InputError(f"'{heading}' is no heading", expected="a name and a unit, such as joint.knee.position [deg]")
    return parts


def _factor(name: str, written: str | None, wanted: Unit) -> float:
    """Return what a number in the unit of a heading is in SI.

    Raises:
        UnitError: It has no unit, or one of another dimension.
    """
    given = unit(written) if written is not None else DIMENSIONLESS
    if given.dimension != wanted.dimension or (written is None and str(wanted) != "1"):
        raise UnitError(f"the column '{name}' is in {given}" if written else f"the column '{name}' has no unit",
                        expected=f"{name} [{wanted}], or another unit of that kind")  # fmt: skip
    return given.factor


def _values(numbers: Sequence[float] | str) -> Array:
    """Return the numbers of a column.

    Raises:
        InputError: One is none.
    """
    try:
        return np.array(numbers.split() if isinstance(numbers, str) else numbers, float)
    except ValueError as error:
        raise InputError(f"a number is expected ({error})", expected="numbers with blanks between them") from None


def _require_one_length(given: Mapping[str, Array]) -> None:
    rows = len(given["t"])
    for name, values in given.items():
        if len(values) != rows:
            raise InputError(f"the column '{name}' has {len(values)} rows, 't' has {rows}", expected="as many")


def _text(values: Array) -> str:
    return " ".join(map(repr, values.tolist()))

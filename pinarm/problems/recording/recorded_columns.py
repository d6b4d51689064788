"""Columns of a recorded motion by name, and the arrays of states that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.recorded_motion import RecordedRows
from pinarm.errors import InputError, Key, UnitError, choices, within
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


def recorded_rows(
    mechanism: Mechanism, columns: Mapping[str, Sequence[float] | str]
) -> tuple[RecordedRows, tuple[str, ...]]:
    """Return the rows that columns hold, and the headings of columns that are none of a state.

    Args:
        mechanism: What moves.
        columns: Heading such as ``joint.knee.velocity [deg/s]`` -> numbers, or a text of them with blanks between. A
            joint's or a coordinate's own name is its position.

    Raises:
        InputError: A column is missing or stands twice, a unit does not fit, or something is no finite number.
        UnitError: A unit does not fit.
    """
    known, aliases = state_columns(mechanism), _aliases(mechanism)
    given: dict[str, Array] = {}
    unread: list[str] = []
    for heading, numbers in columns.items():
        with within(Key(heading)):
            name, measured = _split(heading)
            name = aliases.get(name, name)
            if name in given:
                raise InputError(f"two columns are '{name}'", expected="one for each")
            if name == "t" or name in known:
                given[name] = _values(numbers) * _factor(name, measured, unit("s") if name == "t" else known[name].unit)
            else:
                unread.append(heading)
    if "t" not in given:
        expected, hint = choices("t", [_split(heading)[0] for heading in columns])
        raise InputError("there is no column 't'", expected=f"t [s] beside {expected}", hint=hint)
    _require_one_length(given)
    model = mechanism.model
    positions = _states("q", model.nq, known, given)
    if positions is None:
        raise InputError("there are no columns of positions", expected=f"such as {next(iter(known))}")
    v, a, tau = (_states(array, model.nv, known, given) for array in ("v", "a", "tau"))
    return RecordedRows(given["t"], positions, v, a, tau), tuple(unread)


def check_rows(mechanism: Mechanism, rows: RecordedRows) -> None:
    """Refuse rows that are no motion.

    Raises:
        InputError: There are none, instants descend, a number is not finite, or a quaternion has not the length 1.
    """
    if not len(rows.t):
        raise InputError("the motion has no rows", expected="one at least")
    for name, values in (("t", rows.t), ("q", rows.q), ("v", rows.v), ("a", rows.a), ("tau", rows.tau)):
        if values is not None and not np.isfinite(values).all():
            row = int((~np.isfinite(values)).reshape(len(values), -1).any(axis=1).argmax())
            raise InputError(f"{name} is not finite in row {row}", expected="finite numbers")
    if (np.diff(rows.t) < 0.0).any():
        row = int((np.diff(rows.t) < 0.0).argmax())
        raise InputError(f"the instants descend: {rows.t[row]:.9g} s, then {rows.t[row + 1]:.9g} s (row {row + 1})")
    for ball in mechanism.balls.values():
        lengths = np.linalg.norm(ball.quaternion(rows.q), axis=1)
        for row in np.flatnonzero(np.abs(lengths - 1.0) > UNIT)[:1]:
            raise InputError(f"row {row}: the quaternion of '{ball.name}' has the length {lengths[row]:.6g}",
                             expected="(x, y, z, w) of length 1")  # fmt: skip


def _states(array: str, width: int, known: Mapping[str, StateColumn], given: Mapping[str, Array]) -> Array | None:
    """Return q, v, a or tau, shape (n, width); ``None`` where no column gives any of it.

    Efforts that are not given beside others are 0.

    Raises:
        InputError: Some columns of q, v or a are missing.
    """
    wanted = [name for name, column in known.items() if column.array == array]
    missing = [name for name in wanted if name not in given]
    if len(missing) == len(wanted):
        return None
    if missing and array != "tau":
        others = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        raise InputError(
            f"the columns {', '.join(missing[:3])}{others} are missing",
            expected=f"one for every joint, by the names of quantities, such as {wanted[0]} [{known[wanted[0]].unit}]",
        )
    values = np.zeros((len(given["t"]), width))
    for name in wanted:
        values[:, known[name].place] = given.get(name, 0.0)
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

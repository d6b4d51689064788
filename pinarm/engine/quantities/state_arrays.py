"""Arrays of states as a library's users give them: any leading axes, units, joints by name, Pinocchio's order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import truediv
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, real
from pinarm.engine.series import Series, require_unit
from pinarm.errors import InputError, require_map
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.mechanics.ball_joints import configuration, places_of, positions_of, unit_of, velocities_of
from pinarm.mechanics.laws.motion_law import SECOND
from pinarm.mechanics.loading.pinocchio_layout import UNIT

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pinarm.engine.mechanism import Mechanism


@dataclass(frozen=True)
class LeadingAxes:
    """Lengths of the leading axes that the arrays of one call share; none where a single state was given."""

    shape: tuple[int, ...]

    @classmethod
    def fold(cls, **given: tuple[ArrayLike, int]) -> tuple[LeadingAxes, list[Array]]:
        """Return the leading axes that arrays share, and the arrays as rows, each of shape (n, width).

        Args:
            given: Name -> array of shape (..., width), and its width.
        """
        arrays = {name: real(x, name) for name, (x, _) in given.items()}
        for name, x in arrays.items():
            width = given[name][1]
            if x.ndim == 0 or x.shape[-1] != width:
                raise InputError(f"{name} has the shape {x.shape}", expected=f"(..., {width}), such as ({width},)")
        if len({x.shape[:-1] for x in arrays.values()}) > 1:
            shapes = ", ".join(f"{name}: {x.shape}" for name, x in arrays.items())
            raise InputError(f"the arrays have the shapes {shapes}", expected="the same axes before the last one")
        shape = next(iter(arrays.values())).shape[:-1]
        return cls(shape), [x.reshape(-1 if x.size else 0, given[name][1]) for name, x in arrays.items()]

    def unfold(self, rows: Array) -> Array:
        """Return an array of rows, shape (n, ...), with the leading axes in place of the first."""
        return rows.reshape((*self.shape, *rows.shape[1:]))

    def place(self, row: int) -> str:
        """Return the name of a row in messages."""
        if len(self.shape) == 1:
            return f"row {row}"
        return f"state {tuple(map(int, np.unravel_index(row, self.shape)))}" if self.shape else "the state"


def states_of(mechanism: Mechanism, q: ArrayLike, **rates: ArrayLike | None) -> tuple[LeadingAxes, dict[str, Array]]:
    """Return the leading axes of states, and their arrays by name as rows, as far as they are given."""
    refuse_foreign(mechanism, q, **rates)
    given = {"q": (q, mechanism.model.nq)}
    given |= {name: (x, mechanism.model.nv) for name, x in rates.items() if x is not None}
    leading, rows = LeadingAxes.fold(**given)
    _check_quaternions(mechanism, leading, rows[0])
    return leading, dict(zip(given, rows, strict=True))


def refuse_foreign(mechanism: Mechanism, q: ArrayLike, **rates: ArrayLike | None) -> None:
    """Raise where arrays are not what the mechanism takes; see ``states_of``."""
    for name, x in {"q": q, **rates}.items():
        if isinstance(x, Series):
            require_unit(x, name, *_measures(mechanism, name))
    nq, shape = mechanism.model.nq, real(q, "q").shape
    if not shape or shape[-1] == nq:
        return
    try:
        layout = mechanism.pinocchio_layout
    except InputError:  # Pinocchio's reader has no such model
        return
    if shape[-1] == layout.p_nq:
        raise InputError(
            f"q has the shape {shape}, as Pinocchio has it",
            expected=f"(..., {nq})",
            hint=f"q, v = mechanism.from_pinocchio(q, v): {layout.words()}",
        )


def _measures(mechanism: Mechanism, name: str) -> set[Unit]:
    """Return in what q, v, a or tau of the coordinates of a mechanism are measured."""
    second, angles = unit("s"), [unit("rad")] if mechanism.balls else []
    coordinates = {*(joint.unit for joint in mechanism.joints.values()), *angles}
    if name == "tau":
        return {unit("N*m" if own.dimension == DIMENSIONLESS.dimension else "N") for own in coordinates}
    per = {"q": [], "v": [second], "a": [second, second]}[name]
    return {reduce(truediv, per, own) for own in coordinates}


def _check_quaternions(mechanism: Mechanism, leading: LeadingAxes, q: Array) -> None:
    """Raise where a quaternion has not the length 1."""
    for ball in mechanism.balls.values():
        lengths = np.linalg.norm(ball.quaternion(q), axis=1)
        for row in np.flatnonzero(np.abs(lengths - 1.0) > UNIT)[:1]:
            said = f"{leading.place(int(row))}: the quaternion of '{ball.name}' has the length {lengths[row]:.6g}"
            raise InputError(said, expected="(x, y, z, w) of length 1", hint="configurations({...}) makes them")


def configurations(mechanism: Mechanism, positions: Mapping[str, ArrayLike]) -> Array:
    """Return configurations from joint coordinates by name.

    Args:
        positions: Joint -> values [rad or m], arrays of one shape (...) or single numbers; what is not named is 0. Ball
            joints by their components, as in ``mechanics.balls.configuration``.

    Returns:
        q, shape (..., nq).
    """
    require_map(positions, "positions", "{'knee': 0.5}")
    model, joints, balls = mechanism.model, mechanism.joints, mechanism.balls
    shape, columns = columns_of(positions, {name: (of,) for name, of in positions_of(joints, balls).items()})
    if all(name in joints for name in positions):
        rows = np.tile(np.asarray(pin.neutral(model)), (*shape, 1))
        for name, column in columns.items():
            rows[..., joints[name].q] = column
        return rows
    named = [dict(zip(columns, row, strict=True)) for row in zip(*map(np.ravel, columns.values()), strict=True)]
    q = np.array([configuration(model, joints, balls, values) for values in named])
    return q.reshape(*shape, model.nq)


def rates(mechanism: Mechanism, values: Mapping[str, ArrayLike]) -> Array:
    """Return velocities, accelerations or efforts of joints by name, shape (..., nv); see ``configurations``.

    Those of a ball joint J are ``J.angular_velocity.x`` and so on, in the axes of the link, whatever they are.
    """
    require_map(values, "values of joints", "{'knee': 0.5}")
    known, places = velocities_of(mechanism.joints, mechanism.balls), places_of(mechanism.joints, mechanism.balls)
    for name in values:
        unit_of(name, known)
    effort = {unit("m/s"): unit("N")}
    measures = {name: (rate, rate / unit("s"), effort.get(rate, unit("N*m"))) for name, rate in known.items()}
    shape, columns = columns_of(values, measures)
    rows = np.zeros((*shape, mechanism.model.nv))
    for name, column in columns.items():
        rows[..., places[name]] = column
    return rows


def columns_of(
    values: Mapping[str, ArrayLike], units: Mapping[str, Sequence[Unit]]
) -> tuple[tuple[int, ...], dict[str, Array]]:
    """Return the shape that values share, and each of them in it, in SI.

    Args:
        values: Values by name.
        units: Name -> what it may be measured in; others are refused elsewhere.
    """
    for name, value in values.items():
        if name in units:
            require_unit(value, name, *units[name])
    given = [real(value, name) for name, value in values.items()]
    try:
        columns = np.broadcast_arrays(*given)
    except ValueError:
        shapes = ", ".join(f"{name}: {np.shape(value)}" for name, value in values.items())
        raise InputError(f"the arrays have the shapes {shapes}", expected="one shape, or single numbers") from None
    return columns[0].shape if columns else (), dict(zip(values, columns, strict=True))


def instant(t: float) -> float:
    """Return an instant [s]."""
    require_unit(t, "t", SECOND)
    time = real(t, "t")
    if time.ndim or not np.isfinite(time):
        raise InputError("t is not an instant", expected="one finite number [s]")
    return float(time)


def from_pinocchio(mechanism: Mechanism, q: ArrayLike, v: ArrayLike | None) -> tuple[Array, Array]:
    """Return q and v from those of ``pin.buildModelFromUrdf``; see ``Mechanism.from_pinocchio``."""
    layout = mechanism.pinocchio_layout
    leading, rows = _states(q, v, layout.p_nq, layout.p_nv)
    positions, velocities = layout.take(*rows)
    return leading.unfold(positions), leading.unfold(velocities)


def to_pinocchio(mechanism: Mechanism, q: ArrayLike, v: ArrayLike | None) -> tuple[Array, Array]:
    """Return q and v of ``pin.buildModelFromUrdf``; see ``Mechanism.to_pinocchio``."""
    layout = mechanism.pinocchio_layout
    leading, rows = _states(q, v, layout.nq, layout.nv)
    positions, velocities = layout.give(*rows)
    return leading.unfold(positions), leading.unfold(velocities)


def _states(q: ArrayLike, v: ArrayLike | None, nq: int, nv: int) -> tuple[LeadingAxes, list[Array]]:
    """Return the leading axes of q and v, and both as rows; velocities that are left out are 0."""
    if v is None:
        leading, (rows,) = LeadingAxes.fold(q=(q, nq))
        return leading, [rows, np.zeros((len(rows), nv))]
    return LeadingAxes.fold(q=(q, nq), v=(v, nv))

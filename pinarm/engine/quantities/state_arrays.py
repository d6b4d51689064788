"""Arrays of states as a library's users give them, and matrices of configurations as Pinocchio's users ask for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from math import isfinite
from operator import truediv
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, real
from pinarm.engine.constraints.constraint_rows import rows_of
from pinarm.engine.dynamics import equation
from pinarm.engine.series import Series, require_unit
from pinarm.errors import InputError, choices, require_map, require_name
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.mechanics.ball_joints import configuration, places_of, positions_of, unit_of, velocities_of
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.joints import UNIVERSE, frame_of
from pinarm.mechanics.laws.motion_law import SECOND
from pinarm.mechanics.loading.pinocchio_layout import UNIT
from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pinarm.engine.mechanism import Mechanism

FEW = 4096
"""Numbers of an array up to which products are computed by one thread: others wait busily for more work afterwards."""

RATES = {"positions": "", "velocities": "/s", "accelerations": "/s^2"}
"""Arrays of a state -> suffix of their unit behind that of positions."""


class LeadingAxes(ValueRecord, frozen=True):
    """Lengths of the leading axes that the arrays of one call share; none where a single state was given."""

    shape: tuple[int, ...]

    @classmethod
    def fold(cls, **given: tuple[ArrayLike, int]) -> tuple[LeadingAxes, list[Array]]:
        """Return the leading axes that arrays share, and the arrays as rows, each of shape (n, width).

        Args:
            given: Name -> array of shape (..., width), and its width.
        """
        rows, shapes = dict[str, Array](), dict[str, tuple[int, ...]]()
        for name, (array, width) in given.items():
            x = real(array, name)
            if x.ndim == 0 or x.shape[-1] != width:
                hint = "q, v = mechanism.from_pinocchio(q, v), of states as Pinocchio has them" if name == "q" else ""
                expected = f"(..., {width}), such as ({width},)"
                raise InputError(f"{name} has the shape {x.shape}", expected=expected, hint=hint)
            rows[name], shapes[name] = x.reshape(-1 if x.size else 0, width), x.shape
        leading = cls(next(iter(shapes.values()))[:-1])
        for name, x in rows.items():
            if shapes[name][:-1] != leading.shape:
                said = ", ".join(f"{name}: {shape}" for name, shape in shapes.items())
                raise InputError(f"the arrays have the shapes {said}", expected="the same axes before the last one")
            if x.size > FEW or not isfinite(np.vdot(x, x)):  # the fastest look at few numbers; squares may overflow
                leading.require_finite(name, x)
        return leading, [*rows.values()]

    def require_finite(self, name: str, rows: Array) -> None:
        """Raise where a number of an array of rows is infinite or NaN."""
        finite = np.isfinite(rows)
        if finite.all():
            return
        for row, column in np.argwhere(~finite).tolist():
            said = f"{name}[{column}] of {self.place(row)} is {rows[row, column]}"
            raise InputError(said, expected="finite numbers", hint="leave out states that are not known")

    def unfold(self, rows: Array) -> Array:
        """Return an array of rows, shape (n, ...), with the leading axes in place of the first."""
        return rows.reshape((*self.shape, *rows.shape[1:]))

    def place(self, row: int) -> str:
        if len(self.shape) == 1:
            return f"row {row}"
        return f"state {tuple(map(int, np.unravel_index(row, self.shape)))}" if self.shape else "the state"


def states_of(mechanism: Mechanism, q: ArrayLike, **rates: ArrayLike | None) -> tuple[LeadingAxes, dict[str, Array]]:
    """Return the leading axes of states, and their arrays by name as rows, as far as they are given."""
    refuse_foreign(mechanism, q=q, **rates)
    given = {"q": (q, mechanism.model.nq)}
    given |= {name: (x, mechanism.model.nv) for name, x in rates.items() if x is not None}
    leading, rows = LeadingAxes.fold(**given)
    check_quaternions(mechanism, leading, rows[0])
    return leading, dict(zip(given, rows, strict=True))


def refuse_foreign(mechanism: Mechanism, **given: ArrayLike | None) -> None:
    """Raise where arrays measure something else than the mechanism takes; see ``states_of``."""
    for name, x in given.items():
        if isinstance(x, Series):
            require_unit(x, name, *_measures(mechanism, name))


def _measures(mechanism: Mechanism, name: str) -> set[Unit]:
    second, angles = unit("s"), [unit("rad")] if mechanism.balls else []
    coordinates = {*(joint.unit for joint in mechanism.joints.values()), *angles}
    if name == "tau":
        return {unit("N*m" if own.dimension == DIMENSIONLESS.dimension else "N") for own in coordinates}
    per = {"q": [], "v": [second], "a": [second, second]}[name]
    return {reduce(truediv, per, own) for own in coordinates}


def check_quaternions(mechanism: Mechanism, leading: LeadingAxes, q: Array) -> None:
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
    if type(t) is float and isfinite(t):
        return t
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


TWISTS = {"point": slice(0, 3), "body": slice(3, 6)}
"""First word of a quantity of links -> the rows of a frame's Jacobian that it asks for."""

COORDINATES = ("coordinate", "joint")
"""First words of quantities that are coordinates."""

ALONG = ".along."


def jacobian(mechanism: Mechanism, name: str, q: ArrayLike) -> Array:
    """Return the matrix J of ``x' = J v``; see ``Mechanism.jacobian``."""
    require_name(name)
    leading, rows = _configurations(mechanism, q)
    of, _, axes = name.partition(ALONG)
    word, _, rest = of.partition(".")
    if _is_coordinate(mechanism, of):
        if axes:
            raise InputError(f"'{name}': a coordinate has no axes", expected=of)
        element = rest if word in COORDINATES and of not in mechanism.coordinates else of
        return leading.unfold(_of_coordinate(mechanism, element, rows))
    link, part = (rest, TWISTS[word]) if word in TWISTS and rest else (of, slice(0, 6))
    frame = frame_named(mechanism, link)
    turn = frame_named(mechanism, axes) if axes else UNIVERSE
    matrices = np.empty((len(rows), 6, mechanism.model.nv))
    for matrix, row in zip(matrices, rows, strict=True):
        state = Kinematics.at(mechanism.model, row)
        own = pin.getFrameJacobian(state.model, state.data, frame, pin.LOCAL_WORLD_ALIGNED).reshape(2, 3, -1)
        matrix[:] = (state.data.oMf[turn].rotation.T @ own).reshape(6, -1)
    return leading.unfold(matrices[:, part])


def mass_matrices(mechanism: Mechanism, q: ArrayLike) -> Array:
    """Return M(q); see ``Mechanism.mass_matrix``."""
    leading, rows = _configurations(mechanism, q)
    return leading.unfold(equation.mass_matrices(mechanism.model, rows))


def placements(mechanism: Mechanism, name: str, q: ArrayLike) -> Array:
    """Return the placement of a link or a joint in the world; see ``Mechanism.frame``."""
    leading, rows = _configurations(mechanism, q)
    frame = frame_named(mechanism, name)
    matrices = [Kinematics.at(mechanism.model, row).data.oMf[frame].homogeneous for row in rows]
    return leading.unfold(np.array(matrices).reshape(-1, 4, 4))


def pinocchio_data(mechanism: Mechanism, q: ArrayLike, v: ArrayLike | None, a: ArrayLike | None) -> pin.Data:
    """Return Pinocchio's data of one state; see ``Mechanism.pin_data``."""
    model = mechanism.model
    if np.ndim(q) != 1:
        raise InputError(f"q has the shape {np.shape(q)}", expected=f"one state, shape ({model.nq},)")
    still = np.zeros(model.nv)
    _, rows = states_of(mechanism, q, v=still if v is None else v, a=still if a is None else a)
    configuration, velocity, acceleration = (row[0] for row in rows.values())
    data = model.createData()
    pin.computeAllTerms(model, data, configuration, velocity)
    pin.rnea(model, data, configuration, velocity, acceleration)
    pin.forwardKinematics(model, data, configuration, velocity, acceleration)
    pin.updateFramePlacements(model, data)
    data.M = equation.mass_matrix(model, configuration)
    return data


def _configurations(mechanism: Mechanism, q: ArrayLike) -> tuple[LeadingAxes, Array]:
    leading, rows = states_of(mechanism, q)
    return leading, rows["q"]


def _is_coordinate(mechanism: Mechanism, name: str) -> bool:
    word, _, rest = name.partition(".")
    coordinates = {*mechanism.coordinates, *mechanism.balls}
    if name in coordinates and any(
        frame.type == pin.FrameType.BODY and frame.name == name for frame in mechanism.model.frames
    ):
        raise InputError(
            f"'{name}' is a link and a coordinate", expected=f"point.{name}, body.{name} or coordinate.{name}"
        )
    return name in coordinates or (word in COORDINATES and rest in coordinates)


def _of_coordinate(mechanism: Mechanism, name: str, rows: Array) -> Array:
    """Return the row of a coordinate, shape (n, nv); of a ball joint its three rows, shape (n, 3, nv)."""
    model = mechanism.model
    if name in mechanism.balls:
        joint = model.joints[mechanism.balls[name].index]
        return np.tile(np.eye(model.nv)[joint.idx_v : joint.idx_v + 3], (len(rows), 1, 1))
    return np.asarray(rows_of(model, [mechanism.coordinates[name]], rows)[:, 0])


def frame_named(mechanism: Mechanism, name: str) -> int:
    """Return the index of the frame of a link, or of a joint where it begins with ``joint.``."""
    model = mechanism.model
    word, _, joint = name.partition(".")
    frames = {
        frame.name: index
        for index, frame in enumerate(model.frames)
        if frame.type in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT) and index
    }
    if word != "joint" or not joint:
        return frame_of(model, name)
    if joint not in frames:
        expected, hint = choices(joint, frames)
        raise InputError(f"the model has no joint '{joint}'", expected=expected, hint=hint)
    return frames[joint]

"""Closed states from values of coordinates and placements of frames; see ``Mechanism.close``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices, real
from pinarm.engine.kinematics.assembly import OPEN, closed_drawing, first_position, near_given, null_space
from pinarm.engine.kinematics.continuation import StraightWays
from pinarm.engine.kinematics.joint_motion import joint_rates
from pinarm.engine.kinematics.newton import AGREED, SHORT, NewtonSolver, assembled, start_configuration
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.kinematics.singular import running
from pinarm.engine.quantities.state_arrays import RATES, LeadingAxes, frame_named, states_of
from pinarm.engine.series import require_unit
from pinarm.errors import AssemblyError, InputError, PinarmError, require_map
from pinarm.input.units import unit
from pinarm.mechanics.coordinates import Coordinate, PairCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.pairs import LowerPair, RotationVectorRow, TiedFrames
from pinarm.mechanics.geometry.vectors import dot, rotation_vector
from pinarm.mechanics.joints import METRE, RADIAN, UNIVERSE
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.mechanics.loading.pinocchio_layout import UNIT
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pinarm.engine.mechanism import Mechanism

FAR = 2.5
"""Angle between a frame and its placement at the start beyond which rotation vectors are measured from halfway [rad]:
at half a turn they are not determined."""

COMPONENT = re.compile(r"point\.(.+)\.position\.([xyz])")
"""Name of a component of the position of a point, as a quantity has it."""

COORDINATE, POINT, POSE = ((), (), ()), ((3,), (3,), (3,)), ((4, 4), (6,), (6,))
"""Shapes of positions, velocities and accelerations of a name in one state."""


class Target(Record, frozen=True):
    """Prescribed values of one name in n states: a coordinate, the position of a point, or the placement of a frame.

    Of a placement velocities are ``[velocity of the origin; angular velocity]`` in world axes, accelerations their
    derivatives; its coordinates are the position of its origin, and its rotation vector against a reference.

    Attributes:
        coordinates: Name in messages -> coordinate.
        shapes: Shapes of the given arrays in one state.
        given: Positions, velocities and accelerations, shape (n, *shapes[k]) each; empty where nothing is given yet.
        frame: Name and index of a frame that is placed.
        reference: Orientation from which its rotation is measured, shape (3, 3).
    """

    coordinates: dict[str, Coordinate]
    shapes: Sequence[tuple[int, ...]] = COORDINATE
    given: tuple[Array, ...] = ()
    frame: tuple[str, int] = ("", UNIVERSE)
    reference: Array = np.eye(3)

    @classmethod
    def placed(cls, name: str, frame: int, reference: Array, given: tuple[Array, ...] = ()) -> Target:
        """Return the placement of a frame."""
        rows = [TiedFrames(UNIVERSE, frame, RotationVectorRow(k, reference)) for k in range(3)]
        turns = {f"{name}.rotation.{axis}": PairCoordinate(row, RADIAN) for axis, row in zip("xyz", rows, strict=True)}
        return cls({**_position(name, frame), **turns}, POSE, given, (name, frame), reference)

    def laws(self) -> Array:
        """Return the values of the coordinates and their first and second derivatives, shape (3, n, k)."""
        if self.shapes is not POSE:
            return np.array([x.reshape(len(x), -1) for x in self.given])
        placement, twist, change = self.given
        axes, still, omega = _axes(placement), np.zeros((3, len(twist))), twist[:, 3:].T
        laws = np.array([np.hstack([placement[:, :3, 3], self.turns()]), twist, change])
        for k in range(3):
            row = RotationVectorRow(k, self.reference)
            direction = row.directions(still, axes)[1][0]
            laws[1, :, 3 + k] = dot(direction, omega)
            laws[2, :, 3 + k] = dot(direction, change[:, 3:].T) + row.bend(still, axes, still, omega)[0]
        return laws

    def turns(self) -> Array:
        """Return the rotation vectors of placements, shape (n, 3); 0 of others."""
        if self.shapes is not POSE:
            return np.zeros((len(self.given[0]), 3))
        return rotation_vector(_axes(self.reference.T @ self.given[0][:, :3, :3])).T

    def some(self, rows: Indices) -> Target:
        return replace(self, given=tuple(x[rows] for x in self.given))

    def halfway(self) -> Target:
        """Return the target in one state, a placement measured from the orientation halfway to it."""
        if self.shapes is not POSE:
            return self
        return Target.placed(*self.frame, np.asarray(self.reference @ pin.exp3(0.5 * self.turns()[0])), self.given)


def _axes(turns: Array) -> Array:
    """Return the axes of orientations, shape (n, 3, 3), or of placements, (n, 4, 4), components last: (3, 3, n)."""
    return np.ascontiguousarray(turns[:, :3, :3].transpose(2, 1, 0))


def _position(name: str, frame: int) -> dict[str, Coordinate]:
    rows = [TiedFrames(UNIVERSE, frame, LowerPair.row(axis, np.zeros(3))) for axis in np.eye(3)]
    return {f"point.{name}.position.{x}": PairCoordinate(row, METRE) for x, row in zip("xyz", rows, strict=True)}


def target_of(mechanism: Mechanism, name: str, start: Kinematics) -> Target:
    """Return the target of a name, without values.

    Args:
        name: A coordinate, ``point.P.position.x``, ``point.P``, a link, or the frame ``joint.J``.
    """
    if name in mechanism.coordinates:
        return Target({name: mechanism.coordinates[name]})
    if component := COMPONENT.fullmatch(name):
        return Target({name: _position(component[1], frame_named(mechanism, component[1]))[name]})
    if name.startswith("point."):
        point = name.removeprefix("point.")
        return Target(_position(point, frame_named(mechanism, point)), POINT)
    frame = frame_named(mechanism, name)
    return Target.placed(name, frame, np.array(start.data.oMf[frame].rotation))


def close(
    mechanism: Mechanism, positions: Mapping[str, ArrayLike], velocities: Mapping[str, ArrayLike] | None,
    accelerations: Mapping[str, ArrayLike] | None, start: Mapping[str, float] | ArrayLike | None, *, partly: bool,
) -> tuple[Array, ...]:  # fmt: skip
    """Return q, and v and a as far as rates are given; see ``Mechanism.close``."""
    orders = 3 if accelerations is not None else 2 if velocities is not None else 1
    given = [{} if x is None else x for x in (positions, velocities, accelerations)]
    for what, values in zip(RATES, given, strict=True):
        require_map(values, what, "{'knee': 0.5}")
    begun = _start(mechanism, start)
    state = mechanism.closure.state(begun)
    leading, targets = _filled({name: target_of(mechanism, name, state) for name in positions}, given)
    n, model = int(np.prod(leading.shape, dtype=int)), mechanism.model
    q, v, a = np.tile(begun, (n, 1)), np.zeros((n, model.nv)), np.zeros((n, model.nv))
    with running():
        far = sum((np.linalg.norm(target.turns(), axis=1) > FAR for target in targets), np.zeros(n, dtype=bool))
        near = [np.flatnonzero(~far)] if targets and not far.all() else []
        for rows in [*near, *np.flatnonzero(far)[:, None]]:
            part = [target.some(rows) for target in targets]
            part = [target.halfway() for target in part] if far[rows[0]] else part
            prescribed = _prescribed(part)
            laws = np.concatenate([target.laws() for target in part], axis=2)
            places = [leading.place(k) for k in rows.tolist()]
            q[rows] = _positions(mechanism, prescribed, begun, laws[0], None if partly else places)
            there = np.flatnonzero(np.isfinite(q[rows]).all(axis=1))
            v[rows], a[rows] = q[rows, :1] * 0.0, q[rows, :1] * 0.0
            if laws[1:].any() and len(there):
                some, known = rows[there], [places[k] for k in there]
                v[some], a[some] = _rates(mechanism, prescribed, begun, q[some], laws[:orders, there], known)
    return tuple(map(leading.unfold, (q, v, a)[:orders]))


def _start(mechanism: Mechanism, start: Mapping[str, float] | ArrayLike | None) -> Array:
    """Return the closed configuration near joint coordinates, or near a configuration, shape (nq,)."""
    if start is None or isinstance(start, Mapping):
        named = {name: float(real(value, name)) for name, value in (start or {}).items()}
        rough = start_configuration(mechanism, named)
        rough = near_given(mechanism, rough, [*named], OPEN, Grid.cover(np.zeros(1), []))
    else:
        leading, rows = states_of(mechanism, start)
        if leading.shape:
            raise InputError(f"start has the shape {np.shape(start)}", expected="one configuration, or {'knee': 0.5}")
        rough = rows["q"][0]
    drawing = closed_drawing(mechanism.closure, rough)
    for note in drawing.notes:
        raise InputError(f"start: {note}", expected="joint coordinates near which the loops close")
    return drawing.q


def _filled(
    targets: Mapping[str, Target], given: Sequence[Mapping[str, ArrayLike]]
) -> tuple[LeadingAxes, list[Target]]:
    for name in (name for rates in given[1:] for name in rates if name not in targets):
        raise InputError(f"'{name}' has a rate and no position", expected=f"one of {', '.join(targets)}")
    arrays = {
        name: [_array(name, what, values.get(name), target) for what, values in zip(RATES, given, strict=True)]
        for name, target in targets.items()
    }
    leads = {
        f"{what} of {name}": x.shape[: x.ndim - len(own)]
        for name, target in targets.items()
        for what, x, own in zip(RATES, arrays[name], target.shapes, strict=True)
    }
    try:
        shape = np.broadcast_shapes(*leads.values())
    except ValueError:
        shapes = ", ".join(f"{name}: {lead}" for name, lead in leads.items() if lead)
        raise InputError(f"the states have the shapes {shapes}", expected="one shape, or single states") from None
    rows = {
        name: tuple(
            np.broadcast_to(x, (*shape, *own)).reshape(-1 if x.size else 0, *own)
            for x, own in zip(arrays[name], target.shapes, strict=True)
        )
        for name, target in targets.items()
    }
    return LeadingAxes(shape), [replace(target, given=rows[name]) for name, target in targets.items()]


def _array(name: str, what: str, value: ArrayLike | pin.SE3 | None, target: Target) -> Array:
    """Return values of a target in SI, shape (..., *shape of one state); 0 where none are given."""
    own = target.shapes[[*RATES].index(what)]
    if value is None:
        return np.zeros(own)
    coordinate = next(iter(target.coordinates.values()))
    require_unit(value, name, unit(f"{coordinate.unit}{RATES[what]}"))
    x = real(getattr(value, "homogeneous", value), f"{what} of {name}")
    if x.shape[x.ndim - len(own) :] != own or x.ndim < len(own):
        shape = f"(..., {', '.join(map(str, own))})"
        raise InputError(
            f"the {what} of {name} have the shape {x.shape}",
            expected=f"{shape}, or pin.SE3" if own == (4, 4) else shape,
        )
    if not np.isfinite(x).all():
        raise InputError(f"the {what} of {name} are not all finite", expected="finite numbers")
    if own == (4, 4):
        turn = x[..., :3, :3]
        off = np.abs(turn @ turn.swapaxes(-1, -2) - np.eye(3)).max(initial=0.0)
        if off > UNIT or (np.linalg.det(turn) < 0.0).any() or np.abs(x[..., 3, :] - np.eye(4)[3]).max(initial=0.0):
            raise InputError(
                f"the positions of {name} are no placements",
                expected="[[R, p], [0, 1]], R a rotation",
                hint="pin.SE3(R, p), mechanism.frame(name, q)",
            )
    return x


def _prescribed(targets: Sequence[Target]) -> PrescribedCoordinates:
    named = {name: coordinate for target in targets for name, coordinate in target.coordinates.items()}
    return PrescribedCoordinates(tuple(named), tuple(named.values()), ())


def _positions(
    mechanism: Mechanism, prescribed: PrescribedCoordinates, start: Array, w: Array, places: Sequence[str] | None
) -> Array:
    """Return closed configurations with values of coordinates, shape (n, k), as an array of shape (n, nq).

    Without ``places``, names of the states, those that are not reached are NaN.
    """
    closure, ways = mechanism.closure, StraightWays.of(mechanism.closure, prescribed, start)
    q, good = ways.ends(w) if ways else (np.tile(start, (len(w), 1)), np.zeros(len(w), dtype=bool))
    if ways and not places:
        q[~good] = np.nan
        return q
    for k in np.flatnonzero(~good).tolist():
        try:
            assembly = first_position(closure, prescribed, w[k], 0.0, start)
            for note in assembly.notes:
                raise InputError(note, expected="a start from which the coordinates can go straight to their values")
            q[k] = assembled(closure, prescribed, assembly.q, w[k], 0.0)
        except PinarmError as error:
            q[k] = np.nan
            if places:
                error.message = f"{places[k]}: {error.message}"
                raise
    return q


def _rates(
    mechanism: Mechanism, prescribed: PrescribedCoordinates, start: Array, q: Array, laws: Array, places: Sequence[str]
) -> tuple[Array, Array]:
    """Return velocities and accelerations of joints, shape (n, nv) each, from those of coordinates at configurations.

    Without accelerations among the ``laws``, shape (3 or 2, n, k), those of joints are only such that these are 0.
    """
    closure = mechanism.closure
    if closure.rolls:
        raise InputError("the mechanism rolls: rates of its positions do not say how", hint="kind: kinematics")
    solver = NewtonSolver(closure, prescribed)
    if free := min(len(null_space(solver.rows(closure.state(x)))) for x in (start, q[0])):  # one may be singular
        raise InputError(
            f"the velocities leave {free} degrees of freedom open",
            expected=f"positions and velocities of {free} more coordinates",
        )
    try:
        v, a = joint_rates(closure, prescribed, q, laws[1], laws[2] if len(laws) > 2 else 0.0 * laws[1])
    except AssemblyError as error:
        error.message = f"{places[int(error.data['t'])]}: {error.message}"
        raise
    whole = closure.with_guides(prescribed.names, prescribed.coordinates)
    measured, wanted = whole.constraint_rows.at(q), np.zeros((len(laws) - 1, len(q), whole.size))
    wanted[..., closure.size :] = laws[1:]
    wanted[1:] -= measured.drifts(v)
    pace = np.abs(v).max(axis=1, initial=0.0)[:, None]
    paces = (pace, pace * pace + np.abs(a).max(axis=1, initial=0.0)[:, None])
    for what, x, right, least in zip([*RATES][1:], (v, a), wanted, paces, strict=False):
        reached, sizes = np.matvec(measured.matrices, x), np.matvec(np.abs(measured.matrices), np.abs(x))
        bounds = AGREED * (sizes + np.abs(right) + SHORT * least)
        for k, row in np.argwhere(np.abs(reached - right) > bounds)[:1].tolist():
            name, off = whole.owners()[row][0].name, abs(reached[k, row] - right[k, row])
            raise InputError(
                f"{places[k]}: the {what} do not go together: {name} is off by {off:.3g}",
                expected=f"{what} that the mechanism allows",
                hint="fewer of them",
            )
    return v, a

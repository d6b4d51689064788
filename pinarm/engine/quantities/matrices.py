"""Matrices of configurations, as Pinocchio's users ask for them: Jacobians, mass matrices, placements."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.constraint_rows import rows_of
from pinarm.engine.dynamics import mass_matrix
from pinarm.engine.quantities.state_arrays import LeadingAxes, states_of
from pinarm.errors import InputError, choices, require_name
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.joints import UNIVERSE, frame_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pinarm.engine.mechanism import Mechanism

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
    return leading.unfold(mass_matrix.mass_matrices(mechanism.model, rows))


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
    data.M = mass_matrix.mass_matrix(model, configuration)
    return data


def _configurations(mechanism: Mechanism, q: ArrayLike) -> tuple[LeadingAxes, Array]:
    leading, rows = states_of(mechanism, q)
    return leading, rows["q"]


def _is_coordinate(mechanism: Mechanism, name: str) -> bool:
    """Tell whether a name is that of a coordinate or of a ball joint."""
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

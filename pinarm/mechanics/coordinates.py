"""Coordinates: numbers that describe a configuration, and on which a motion can be imposed.

Each gives its value w(q), its row J with ``w' = J v``, and its drift ``J' v``, so that ``w'' = J a + drift``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol

import numpy as np
import pinocchio as pin
from pydantic import Field

from pinarm.arrays import Array, Indices
from pinarm.errors import InputError, choices
from pinarm.input.schema import Model
from pinarm.input.units import Unit, unit

METRE, RADIAN = unit("m"), unit("rad")
AXES: dict[str, tuple[float, float, float]] = {
    "x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1),
}  # fmt: skip
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


@dataclass(frozen=True)
class Joint:
    """A joint of the tree that has one coordinate.

    Attributes:
        name: Its name in the model.
        index: Pinocchio's joint index.
        q: Index of its coordinate in q.
        v: Index of its velocity in v.
        unit: rad or m.
    """

    name: str
    index: int
    q: int
    v: int
    unit: Unit


def joints_of(model: pin.Model) -> dict[str, Joint]:
    """Return the joints with one coordinate, by name, in the order of v."""
    found = {}
    for index in range(1, model.njoints):
        joint = model.joints[index]
        if joint.nq == joint.nv == 1:
            measured = METRE if joint.shortname().startswith("JointModelP") else RADIAN
            found[model.names[index]] = Joint(model.names[index], index, joint.idx_q, joint.idx_v, measured)
    return found


def frame_of(model: pin.Model, name: str) -> int:
    """Return the index of the frame of a link.

    Raises:
        InputError: The model has no link of that name.
    """
    for index, frame in enumerate(model.frames):
        if frame.name == name and frame.type == pin.FrameType.BODY:
            return index
    links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    expected, hint = choices(name, links)
    raise InputError(f"the model has no link '{name}'", expected=expected, hint=hint)


class Coordinate(Protocol):
    """A coordinate of one mechanism, ready for evaluation."""

    @property
    def unit(self) -> Unit:
        """Unit of its value."""
        ...

    def value(self, data: pin.Data, q: Array) -> float:
        """Return w(q); the placements of frames in ``data`` are those of q."""
        ...

    def row(self, model: pin.Model, data: pin.Data) -> Array:
        """Return J, shape (nv,); the joint Jacobians in ``data`` are those of q."""
        ...

    def drift(self, model: pin.Model, data: pin.Data) -> float:
        """Return J' v; ``data`` holds the forward kinematics of (q, v, 0)."""
        ...


@dataclass(frozen=True)
class LinearCoordinate:
    """A joint's own coordinate, or a weighted sum of several: ``w = sum_i weight_i q_i``.

    Attributes:
        unit: Unit of its value.
        weights: Shape (nv,).
        places: Index in q of every index in v, shape (nv,).
    """

    unit: Unit
    weights: Array
    places: Indices

    def value(self, data: pin.Data, q: Array) -> float:
        """Return the weighted sum."""
        return float(self.weights @ q[self.places])

    def row(self, model: pin.Model, data: pin.Data) -> Array:
        """Return the weights."""
        return self.weights

    def drift(self, model: pin.Model, data: pin.Data) -> float:
        """Return 0: the row is constant."""
        return 0.0


@dataclass(frozen=True)
class FrameCoordinate:
    """Position of a link's origin along an axis of the world: ``w = u . p(q)`` [m].

    Attributes:
        frame: Index of the frame.
        axis: Unit vector u in world axes, shape (3,).
        unit: Metre.
    """

    frame: int
    axis: Array
    unit: Unit = METRE

    def value(self, data: pin.Data, q: Array) -> float:
        """Return u . p."""
        return float(self.axis @ data.oMf[self.frame].translation)

    def row(self, model: pin.Model, data: pin.Data) -> Array:
        """Return u . J_p."""
        jacobian = pin.getFrameJacobian(model, data, self.frame, pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(self.axis @ jacobian.reshape(6, -1)[:3])

    def drift(self, model: pin.Model, data: pin.Data) -> float:
        """Return u . (J_p' v): the acceleration that the point has while a = 0."""
        acceleration = pin.getFrameClassicalAcceleration(model, data, self.frame, pin.LOCAL_WORLD_ALIGNED)
        return float(self.axis @ acceleration.linear)


class AngleSum(Model):
    """Sum of joint coordinates about parallel axes: the absolute angle of a link, turns counted."""

    kind: Literal["sum"]
    of: list[str] = Field(min_length=1)

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> Coordinate:
        """Return the coordinate of one model."""
        return sum_of(model, joints, self.of)


class PointCoordinate(Model):
    """Position of a link's origin along an axis of the world, e.g. a height."""

    kind: Literal["point"]
    point: str
    along: Axis

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> Coordinate:
        """Return the coordinate of one model."""
        return FrameCoordinate(frame_of(model, self.point), np.array(AXES[self.along], float))


CoordinateDefinition = Annotated[AngleSum | PointCoordinate, Field(discriminator="kind")]
"""Any coordinate that a mechanism file may define. A new kind is one class above and one entry here."""


def sum_of(model: pin.Model, joints: Mapping[str, Joint], names: Sequence[str]) -> LinearCoordinate:
    """Return the sum of the coordinates of the named joints.

    Raises:
        InputError: A joint is unknown, or angles and lengths are mixed.
    """
    for name in names:
        if name not in joints:
            expected, hint = choices(name, joints)
            raise InputError(f"the model has no joint '{name}' with one coordinate", expected=expected, hint=hint)
    units = {joints[name].unit for name in names}
    if len(units) > 1:
        raise InputError("a sum of joint coordinates cannot mix angles and lengths", expected="joints of one kind")
    weights = np.zeros(model.nv)
    places = np.zeros(model.nv, dtype=np.intp)
    for joint in joints.values():
        places[joint.v] = joint.q
    for name in names:
        weights[joints[name].v] += 1.0
    return LinearCoordinate(units.pop(), weights, places)


def coordinates_of(
    model: pin.Model, joints: Mapping[str, Joint], definitions: Mapping[str, Any]
) -> dict[str, Coordinate]:
    """Return every coordinate by name: those of the joints, then the defined ones.

    Raises:
        InputError: A definition takes the name of a joint, or names something that does not exist.
    """
    found: dict[str, Coordinate] = {name: sum_of(model, joints, [name]) for name in joints}
    for name, definition in definitions.items():
        if name in joints:
            raise InputError(f"the coordinate '{name}' has the name of a joint", expected="a name of its own")
        found[name] = definition.bind(model, joints)
    return found

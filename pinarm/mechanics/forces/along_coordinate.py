"""Springs, dampers, stops, efforts and motor curves along coordinates: of joints, loop joints, points, distances."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, continued
from pinarm.errors import InputError, within
from pinarm.input.units import unit
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, NotNegative, Positive, check_each, check_keys, check_unit
from pinarm.mechanics.coordinates import (
    Coordinate,
    LinearCoordinate,
    MeasuredCoordinate,
    coordinate_of,
    coordinates_of,
    sum_of,
)
from pinarm.mechanics.forces.force_element import Edge, ElementQuantity, ForceElement, Pieces, edge_along
from pinarm.mechanics.forces.joint_forces import CREEP, DryFriction, SpringDamper
from pinarm.mechanics.forces.load_laws import LoadKeys, LoadLaw
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import Joint, effort_unit
from pinarm.mechanics.laws import Law
from pinarm.mechanics.laws.motion_law import PowerSeries

if TYPE_CHECKING:
    from pinarm.mechanics.rotors import Elasticity

Coordinates: TypeAlias = Mapping[str, Coordinate]
NONE: Coordinates = {}

TOUCHING = 1e-13
"""Gap, relative to ``1 + |w|`` in SI, at which what pushes or pulls one way counts as closed: where it closes it is at
work, though rounding may leave it open there."""


class AlongCoordinate(MeasuredCoordinate, ForceElement, frozen=True):
    """An effort along a coordinate w with the row J, ``load = J^T effort``; fields as in ``MeasuredCoordinate``."""

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        """Return the effort [N*m or N] for values w and their rates, each of shape (n,)."""
        raise NotImplementedError

    def acting(self, t: Array | float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the effort [N*m or N] in states, shape (...), and J, shape (..., nv)."""
        w, rate, rows = self.moving(q, v)
        return self.effort(t, w, rate), rows

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load ``J^T effort`` to ``tau``."""
        effort, rows = self.acting(t, q, v)
        tau += np.asarray(effort)[..., None] * rows

    def efforts(self, t: Array | float, q: Array, v: Array) -> Array:
        return np.broadcast_to(self.acting(t, q, v)[0], q.shape[:-1])

    def wrenches(self, links: LinkPlacements, t: Array, v: Array) -> dict[int, Array]:
        return self.coordinate.wrenches(links, self.efforts(t, links.q, v))

    def measures(self) -> Mapping[str, ElementQuantity]:
        return {"effort": ElementQuantity(effort_unit(self.coordinate.unit), self.efforts)}


class SpringAlong(AlongCoordinate, frozen=True):
    """Spring and damper, and a constant pull: ``effort = -stiffness (w - rest) - damping w' - pull``.

    The energy is ``stiffness (w - rest)^2 / 2 + pull (w - rest)``.

    Attributes:
        stiffness: [N*m/rad or N/m].
        damping: [N*m*s/rad or N*s/m].
        rest: Value at which the spring is free [rad or m].
        force: The pull [N*m or N].
    """

    stiffness: float
    damping: float
    rest: float
    force: float = 0.0

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        return np.asarray(-self.stiffness * (w - self.rest) - self.damping * rate - self.force)

    def potential_energy(self, q: Array) -> Array:
        stretched = self.values(q) - self.rest
        return np.asarray(0.5 * self.stiffness * stretched**2 + self.force * stretched)

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        return np.asarray(self.damping * self.moving(q, v)[1] ** 2)

    @property
    def conservative(self) -> bool:
        return not self.damping


class StopSpring(AlongCoordinate, frozen=True):
    """``effort = -max(k (w - h) + c w', 0)`` for w > h, its mirror image for w < -h, and 0 between.

    Such as the flanks of a gear with the backlash 2 h: free travel, then springs and dampers that only push. Steps end
    where a side is met or left and, with a damper, where it stops pushing.

    Attributes:
        stiffness: k [N*m/rad or N/m].
        damping: c [N*m*s/rad or N*s/m].
        half: h [rad or m].
    """

    stiffness: float
    damping: float
    half: float
    sides: tuple[float, ...] = (1.0, -1.0)

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        side = self._side(w)
        push = np.maximum(self._push(side, w, rate), 0.0)
        return np.asarray(np.where(self._touches(side, w), -side * push, 0.0))

    def _side(self, w: Array) -> Array:
        return np.where(np.real(w) < 0.0, -1.0, 1.0) if len(self.sides) > 1 else np.ones(w.shape)

    def _push(self, side: Array | float, w: Array, rate: Array) -> Array:
        return np.asarray(self.stiffness * (side * w - self.half) + self.damping * side * rate)

    def _touches(self, side: Array | float, w: Array) -> Flags:
        return np.asarray(side * w > self.half - TOUCHING * (1.0 + self.half))

    def _compression(self, w: Array) -> Array:
        return np.asarray(np.maximum(self._side(w) * w - self.half, 0.0))

    def potential_energy(self, q: Array) -> Array:
        """Return ``k d^2 / 2`` of the compression d of a side."""
        return np.asarray(0.5 * self.stiffness * self._compression(self.values(q)) ** 2)

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return ``-(effort + k d) w'``: of the damper, and of a side that is left before it has sprung back."""
        w, rate, _ = self.moving(q, v)
        stored = self.stiffness * self._side(w) * self._compression(w)
        return np.asarray(-(self.effort(t, w, rate) + stored) * rate)

    @property
    def conservative(self) -> bool:
        return not self.damping

    def edges(self) -> list[Edge]:
        return [edge for side in self.sides for edge in self._edges_of(side)]

    def _edges_of(self, side: float) -> list[Edge]:
        met = edge_along(self, lambda w, rate: side * w - self.half)
        if not self.damping:
            return [met]
        return [met, edge_along(self, lambda w, rate: self._push(side, w, rate), lambda w: self._touches(side, w))]

    @property
    def in_pieces(self) -> bool:
        return len(self.sides) > 1

    def passed(self, q: Array, v: Array) -> bool:
        return self._pieces.passed(self.values(q))

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(np.array([-self.half, self.half]))


class MotorCurve(AlongCoordinate, frozen=True):
    """A motor at full power: its effort is a function of its velocity, linear between points, constant beyond them.

    Attributes:
        speeds: Velocities of the points, ascending [rad/s or m/s], shape (k,).
        torques: Efforts there [N*m or N], shape (k,).
    """

    speeds: Array
    torques: Array
    in_pieces: ClassVar[bool] = True

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        return continued(self._curve, rate)

    def _curve(self, rate: Array) -> tuple[Array, Array]:
        place = np.searchsorted(self.speeds, rate)
        slopes = np.concatenate([[0.0], np.diff(self.torques) / np.diff(self.speeds), [0.0]])
        return np.interp(rate, self.speeds, self.torques), slopes[place]

    def passed(self, q: Array, v: Array) -> bool:
        return self._pieces.passed(self.moving(q, v)[1])

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(self.speeds)


class EffortAlong(AlongCoordinate, frozen=True):
    """A torque or force that follows a law; all of its power is supplied, also where it could be a spring.

    Attributes:
        law: The effort [N*m or N].
    """

    law: LoadLaw

    def acting(self, t: Array | float, q: Array, v: Array) -> tuple[Array, Array]:
        return self.law(t, q, v), self.evaluated(q)[1]

    @property
    def steady(self) -> bool:
        function = self.law.function if self.law.over_time_alone else None
        constant = isinstance(function, PowerSeries) and len(function.coefficients) == 1
        return constant and isinstance(self.coordinate, LinearCoordinate)


class SpringKeys(InputStruct, frozen=True, kw_only=True):
    """The keys of a spring and damper along a coordinate.

    Attributes:
        stiffness: Effort per coordinate, such as ``20 N*m/rad``.
        damping: Effort per velocity, such as ``0.1 N*m*s/rad``.
        rest: Coordinate at which the spring is free, such as ``30 deg``.
    """

    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0
    rest: AnyQuantity = 0.0

    def bind(self, model: pin.Model, joints: Mapping[str, Joint], coordinates: Coordinates = NONE) -> ForceElement:
        """Return the spring along a coordinate; at a joint one that the compiled kernel knows."""
        along = _along(self, model, joints, coordinates)
        stiff = effort_unit(along.unit) / along.unit
        check_keys(self, stiffness=stiff, rest=along.unit, damping=stiff * unit("s"))
        numbers = float(self.stiffness), float(self.damping), float(self.rest)
        if not isinstance(along, LinearCoordinate) or along.joint is None:
            return SpringAlong(model, along, *numbers)
        joint = np.array([along.joint])
        return SpringDamper(along.places[joint], joint, *(np.array([number]) for number in numbers))


class JointSpring(SpringKeys, frozen=True, tag_field="kind", tag="joint_spring"):
    """Spring and damper between a joint's two links.

    Attributes:
        joint: The joint, such as ``knee``.
    """

    joint: str


class CoordinateSpring(SpringKeys, frozen=True, tag_field="kind", tag="coordinate_spring"):
    """Spring and damper along a coordinate, such as ``L.angle`` or ``L.position`` of a loop joint L.

    Attributes:
        coordinate: The coordinate.
    """

    coordinate: str


class EffortKeys(LoadKeys, frozen=True, kw_only=True):
    """The key of an effort that follows a law.

    Attributes:
        effort: The law, over time or over a coordinate, such as a turning-moment diagram.
    """

    effort: Law

    def bind(self, model: pin.Model, joints: Mapping[str, Joint], coordinates: Coordinates = NONE) -> ForceElement:
        along, known = _along(self, model, joints, coordinates), coordinates or coordinates_of(model, joints, {})
        return EffortAlong(model, along, self.load_law("effort", effort_unit(along.unit), model, known))


class JointEffort(EffortKeys, frozen=True, tag_field="kind", tag="joint_effort"):
    """Torque or force at a joint, over time or over a coordinate, such as a turning-moment diagram.

    Attributes:
        joint: Joint that it acts on.
    """

    joint: str


class CoordinateEffort(EffortKeys, frozen=True, tag_field="kind", tag="coordinate_effort"):
    """Torque or force along a coordinate, such as ``L.angle`` of a loop joint L.

    Attributes:
        coordinate: The coordinate.
    """

    coordinate: str


class RegularisedFriction(InputStruct, frozen=True, tag_field="kind", tag="regularised_friction"):
    """Dry friction between a joint's two links, regularised: ``-friction tanh(v / creep)``; see ``DryFriction``.

    It never sticks. For friction that does, see ``friction`` in the mechanism file.

    Attributes:
        joint: Joint that it acts in.
        friction: Largest load [N*m or N].
        creep: Velocity below which it gives way [rad/s or m/s].
    """

    joint: str
    friction: NotNegative
    creep: Positive = CREEP

    def bind(self, model: pin.Model, joints: Mapping[str, Joint], coordinates: Coordinates = NONE) -> ForceElement:
        along = _at_joint(model, joints, self.joint)
        check_keys(self, friction=effort_unit(along.unit), creep=along.unit / unit("s"))
        return DryFriction(along.moved, np.array([float(self.friction)]), np.array([float(self.creep)]))


class TorqueSpeed(InputStruct, frozen=True, tag_field="kind", tag="torque_speed"):
    """A motor's curve at its joint.

    Attributes:
        joint: The joint that it drives.
        curve: Pairs of velocity and effort, ascending, such as ``[[0 rpm, 8 N*m], [3000 rpm, 0 N*m]]``.
    """

    joint: str
    curve: list[tuple[AnyQuantity, AnyQuantity]]

    def check(self) -> None:
        if len(self.curve) < 2 or any(b <= a for (a, _), (b, _) in pairwise(self.curve)):
            raise InputError("the velocities of the curve do not ascend", expected="two points or more, ascending")

    def bind(self, model: pin.Model, joints: Mapping[str, Joint], coordinates: Coordinates = NONE) -> ForceElement:
        along = _at_joint(model, joints, self.joint)
        for row, point in enumerate(self.curve):
            with within("curve", row):
                check_each(point, along.unit / unit("s"), effort_unit(along.unit))
        return MotorCurve(model, along, *np.array(self.curve, float).T)


def _at_joint(model: pin.Model, joints: Mapping[str, Joint], name: str) -> LinearCoordinate:
    with within("joint"):
        return sum_of(model, joints, [name])


def _along(keys: InputStruct, model: pin.Model, joints: Mapping[str, Joint], coordinates: Coordinates) -> Coordinate:
    """Return the joint or coordinate that a key names."""
    if isinstance(keys, JointSpring | JointEffort):
        return _at_joint(model, joints, keys.joint)
    with within("coordinate"):
        return coordinate_of(model, coordinates, getattr(keys, "coordinate"))  # noqa: B009


def elastic_gear(
    model: pin.Model, deflection: LinearCoordinate, elasticity: Elasticity, backlash: float
) -> ForceElement:
    """Return the spring and damper of an elastic gear, or its flanks.

    Args:
        backlash: [rad or m].
    """
    stiff = effort_unit(deflection.unit) / deflection.unit
    with within("elasticity"):
        check_keys(elasticity, stiffness=stiff, damping=stiff * unit("s"))
    with within("backlash"):
        check_unit(backlash, deflection.unit)
    stiffness, damping = float(elasticity.stiffness), float(elasticity.damping)
    if backlash:
        return StopSpring(model, deflection, stiffness, damping, 0.5 * float(backlash))
    return SpringAlong(model, deflection, stiffness, damping, 0.0)

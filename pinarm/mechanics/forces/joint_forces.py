"""Forces between the two links of a joint: springs, dampers, friction, torque laws and motor curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices, continued
from pinarm.errors import InputError, within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, NotNegative, Positive, check_each, check_unit
from pinarm.mechanics.coordinates import Coordinate, coordinates_of
from pinarm.mechanics.forces.force_element import ForceElement, LawElement, Pieces
from pinarm.mechanics.forces.load_conditions import LoadCondition, LoadKeys
from pinarm.mechanics.joints import Joint, effort_unit, joint_of
from pinarm.mechanics.laws import Law
from pinarm.mechanics.laws.motion_law import MotionLaw, PowerSeries, Values
from pinarm.records import AbstractRecord

CREEP = 1e-3
"""Velocity below which regularised friction gives way [rad/s or m/s], where a file gives none."""


class JointSpring(InputStruct, frozen=True, tag_field="kind", tag="joint_spring"):
    """Spring and damper between a joint's two links.

    Attributes:
        joint: The joint, such as ``knee``.
        stiffness: Effort per coordinate, such as ``20 N*m/rad``.
        damping: Effort per velocity, such as ``0.1 N*m*s/rad``.
        rest: Coordinate at which the spring is free, such as ``30 deg``.
    """

    joint: str
    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0
    rest: AnyQuantity = 0.0

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        joint = _joint(joints, self.joint)
        effort = effort_unit(joint)
        _check(self, stiffness=effort / joint.unit, rest=joint.unit, damping=effort / joint.unit * unit("s"))
        numbers = (np.array([float(number)]) for number in (self.stiffness, self.damping, self.rest))
        return SpringDamper(np.array([joint.q]), np.array([joint.v]), *numbers)


class SpringDamper(AbstractRecord, ForceElement, frozen=True):
    """Linear springs and dampers at joints: ``load = -stiffness (q - rest) - damping v``.

    Potential energy ``stiffness (q - rest)^2 / 2``, dissipated power ``damping v^2``, summed over the joints.

    Attributes:
        q: Indices in q, shape (k,).
        v: Indices in v, shape (k,).
        stiffness: [N*m/rad or N/m], shape (k,).
        damping: [N*m*s/rad or N*s/m], shape (k,).
        rest: Coordinate at which the spring is free [rad or m], shape (k,).
    """

    q: Indices
    v: Indices
    stiffness: Array
    damping: Array
    rest: Array

    @classmethod
    def sum(cls, elements: Sequence[SpringDamper]) -> SpringDamper:
        """Return the element whose load is the sum of theirs; its energy differs by a constant."""
        size = max((int(element.v.max(initial=-1)) for element in elements), default=-1) + 1
        sums, places = np.zeros((3, size)), np.zeros(size, np.intp)
        for element in elements:
            sums[:, element.v] += [element.stiffness, element.damping, element.stiffness * element.rest]
            places[element.v] = element.q
        kept = np.flatnonzero(sums[:2].any(axis=0))
        stiffness, damping, pull = sums[:, kept]
        rest = np.divide(pull, stiffness, out=np.zeros(len(kept)), where=stiffness > 0.0)
        return cls(places[kept], kept, stiffness, damping, rest)

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        load = self.stiffness * (q[..., self.q] - self.rest)
        if self._damped:
            load += self.damping * v[..., self.v]
        tau[..., self.v] -= load

    def within(self, kept_q: Indices, kept_v: Indices) -> SpringDamper:
        """Return the springs and dampers at the joints of a part; the energy of the others is left out."""
        mine = np.isin(self.v, kept_v)
        numbers = (numbers[mine] for numbers in (self.stiffness, self.damping, self.rest))
        places = np.searchsorted(kept_q, self.q[mine]), np.searchsorted(kept_v, self.v[mine])
        return SpringDamper(*places, *numbers)

    @cached_property
    def _damped(self) -> bool:
        return bool(self.damping.any())

    def potential_energy(self, q: Array) -> Array:
        moved = q[..., self.q] - self.rest
        return np.asarray(0.5 * (self.stiffness * moved * moved).sum(axis=-1))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        rates = v[..., self.v]
        return np.asarray((self.damping * rates * rates).sum(axis=-1))

    @property
    def conservative(self) -> bool:
        return not self._damped


class BallSpring(AbstractRecord, ForceElement, frozen=True):
    """Spring of a ball joint to its zero: ``load = -stiffness w``, with the rotation vector w, ``R = exp([w])``.

    Potential energy ``stiffness |w|^2 / 2``. It jumps at half a turn, where the shortest way back changes sides.

    Attributes:
        q: Index in q of the joint's quaternion (x, y, z, w).
        v: Index in v of its angular velocity, child's axes.
        stiffness: [N*m/rad].
    """

    q: int
    v: int
    stiffness: float

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        tau[..., self.v : self.v + 3] -= self.stiffness * self._rotation(q)

    def potential_energy(self, q: Array) -> Array:
        return np.asarray(0.5 * self.stiffness * (self._rotation(q) ** 2).sum(axis=-1))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        return np.zeros(v.shape[:-1])

    @property
    def conservative(self) -> bool:
        return True

    def _rotation(self, q: Array) -> Array:
        """Return the rotation vectors, shape (..., 3); ``w = 2 atan(n / c) u`` for the quaternion (n u, c)."""
        vector, c = q[..., self.q : self.q + 3], q[..., self.q + 3 : self.q + 4]
        n, sign = np.sqrt((vector * vector).sum(axis=-1, keepdims=True)), np.where(c < 0.0, -1.0, 1.0)
        half = np.arctan2(n, sign * c) if np.isrealobj(q) else np.arctan(n / (sign * c))  # of a complex step
        return np.asarray(vector * sign * 2.0 * half / np.where(n == 0.0, 1.0, n))


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

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        joint = _joint(joints, self.joint)
        _check(self, friction=effort_unit(joint), creep=joint.unit / unit("s"))
        return DryFriction(np.array([joint.v]), np.array([float(self.friction)]), np.array([float(self.creep)]))


class DryFriction(AbstractRecord, ForceElement, frozen=True):
    """Coulomb friction at joints, regularised: ``load = -friction tanh(v / creep)``.

    Right within 1e-4 of its bound where ``|v| > 5 creep``. A joint that ought to stick creeps with
    ``v = creep atanh(load / friction)`` instead. Small values of creep make forward problems stiff.

    Attributes:
        v: Indices in v, shape (k,).
        friction: Largest load [N*m or N], shape (k,).
        creep: [rad/s or m/s], shape (k,).
    """

    v: Indices
    friction: Array
    creep: Array

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        tau[..., self.v] -= self.friction * np.tanh(v[..., self.v] / self.creep)


class JointEffort(LoadKeys, frozen=True, tag_field="kind", tag="joint_effort"):
    """Torque or force at a joint, over time or over a coordinate, such as a turning-moment diagram.

    Attributes:
        joint: Joint that it acts on.
        effort: The law.
    """

    joint: str
    effort: Law

    def bind(
        self, model: pin.Model, joints: Mapping[str, Joint], coordinates: Mapping[str, Coordinate] | None = None
    ) -> ForceElement:
        joint = _joint(joints, self.joint)
        known = coordinates or coordinates_of(model, joints, {})
        law, condition = self.acting("effort", effort_unit(joint), model, known)
        return AppliedEffort(joint.v, law, condition=condition)


class AppliedEffort(AbstractRecord, LawElement, frozen=True):
    """A torque or force at a joint that follows a law; all of its power is supplied, also where it could be a spring.

    Attributes:
        law: The effort [N*m or N] over time, or a factor over time of that of the condition.
    """

    v: int
    law: MotionLaw
    function: Callable[[Array], Values] | None = None
    condition: LoadCondition | None = None

    @property
    def constant(self) -> float | None:
        """The effort [N*m or N] on the present interval if it is constant."""
        if self.condition or not isinstance(self.function, PowerSeries) or len(self.function.coefficients) > 1:
            return None
        return self.function.coefficients[0]

    @property
    def steady(self) -> bool:
        return self.constant is not None

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        constant = self.constant
        tau[..., self.v] += self.law_at(t, q, v) if constant is None else constant


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

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        joint = _joint(joints, self.joint)
        for row, point in enumerate(self.curve):
            with within("curve", row):
                check_each(point, joint.unit / unit("s"), effort_unit(joint))
        points = np.array(self.curve, float)
        return MotorCurve(joint.v, points[:, 0].copy(), points[:, 1].copy())


class MotorCurve(AbstractRecord, ForceElement, frozen=True):
    """A motor at full power: its effort is a function of its velocity, linear between points, constant beyond them.

    Attributes:
        speeds: Velocities of the points, ascending [rad/s or m/s], shape (k,).
        efforts: Efforts there [N*m or N], shape (k,).
    """

    v: int
    speeds: Array
    efforts: Array
    in_pieces: ClassVar[bool] = True

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        tau[..., self.v] += continued(self._curve, v[..., self.v])

    def passed(self, q: Array, v: Array) -> bool:
        return self._pieces.passed(v[..., self.v])

    def _curve(self, rate: Array) -> tuple[Array, Array]:
        place = np.searchsorted(self.speeds, rate)
        slopes = np.concatenate([[0.0], np.diff(self.efforts) / np.diff(self.speeds), [0.0]])
        return np.interp(rate, self.speeds, self.efforts), slopes[place]

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(self.speeds)


def _joint(joints: Mapping[str, Joint], name: str) -> Joint:
    with within("joint"):
        return joint_of(joints, name)


def _check(keys: InputStruct, **expected: Unit) -> None:
    for name, measured in expected.items():
        with within(name):
            check_unit(getattr(keys, name), measured)

"""Forces between the two links of a joint: springs, dampers, friction, torque laws and motor curves."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.errors import InputError, within
from pinarm.input.schema import AnyQuantity, Extent, Model, NotNegative, Positive, check_each, check_unit
from pinarm.input.units import Unit, unit
from pinarm.mechanics.forces.contract import ForceElement
from pinarm.mechanics.forces.pieces import Pieces
from pinarm.mechanics.joints import METRE, Joint, joint_of
from pinarm.mechanics.laws import Constant, Law
from pinarm.mechanics.laws.over import Profile
from pinarm.mechanics.motion import MotionLaw, Values

CREEP = 1e-3
"""Velocity below which regularised friction gives way [rad/s or m/s], where a file gives none."""


def effort_unit(joint: Joint) -> Unit:
    """Return N for a joint that slides and N*m for one that turns."""
    return unit("N") if joint.unit == METRE else unit("N*m")


@dataclass(frozen=True)
class SpringDamper(ForceElement):
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
        size = max((int(one.v.max(initial=-1)) for one in elements), default=-1) + 1
        sums, places = np.zeros((3, size)), np.zeros(size, np.intp)
        for one in elements:
            sums[:, one.v] += [one.stiffness, one.damping, one.stiffness * one.rest]
            places[one.v] = one.q
        kept = np.flatnonzero(sums[:2].any(axis=0))
        stiffness, damping, pull = sums[:, kept]
        rest = np.divide(pull, stiffness, out=np.zeros(len(kept)), where=stiffness > 0.0)
        return cls(places[kept], kept, stiffness, damping, rest)

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        places, rates = self._places
        load = self.stiffness * (q[..., places] - self.rest)
        if self._damped:
            load += self.damping * v[..., rates]
        tau[..., rates] -= load

    @cached_property
    def _damped(self) -> bool:
        return bool(self.damping.any())

    @cached_property
    def _places(self) -> tuple[slice | Indices, slice | Indices]:
        """The indices, as slices where they follow one another: these are read without a copy."""
        return _following(self.q), _following(self.v)

    def potential_energy(self, q: Array) -> Array:
        """Return the energy of the springs."""
        return np.asarray((0.5 * self.stiffness * (q[..., self.q] - self.rest) ** 2).sum(axis=-1))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the power of the dampers."""
        return np.asarray((self.damping * v[..., self.v] ** 2).sum(axis=-1))

    @property
    def conservative(self) -> bool:
        """Whether there are no dampers."""
        return not self.damping.any()


@dataclass(frozen=True)
class BallSpring(ForceElement):
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
        """Add the load to ``tau``."""
        tau[..., self.v : self.v + 3] -= self.stiffness * self._rotation(q)

    def potential_energy(self, q: Array) -> Array:
        """Return the energy of the spring."""
        return np.asarray(0.5 * self.stiffness * (self._rotation(q) ** 2).sum(axis=-1))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return 0."""
        return np.zeros(v.shape[:-1])

    @property
    def conservative(self) -> bool:
        """Whether it is: a spring alone."""
        return True

    def _rotation(self, q: Array) -> Array:
        """Return the rotation vectors, shape (..., 3); ``w = 2 atan(n / c) u`` for the quaternion (n u, c)."""
        vector, c = q[..., self.q : self.q + 3], q[..., self.q + 3 : self.q + 4]
        n = np.linalg.norm(vector, axis=-1, keepdims=True)
        factor = 2.0 * np.arctan2(n * np.where(c < 0.0, -1.0, 1.0), np.abs(c)) / np.maximum(n, np.finfo(float).tiny)
        return np.asarray(vector * np.where(n > 0.0, factor, 0.0))


@dataclass(frozen=True)
class DryFriction(ForceElement):
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
        """Add the load to ``tau``."""
        tau[..., self.v] -= self.friction * np.tanh(v[..., self.v] / self.creep)

    def potential_energy(self, q: Array) -> Array:
        """Return 0."""
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the heat."""
        rates = v[..., self.v]
        return np.asarray((self.friction * np.tanh(rates / self.creep) * rates).sum(axis=-1))


@dataclass(frozen=True)
class AppliedEffort(ForceElement):
    """A torque or force at a joint that follows a law of time; all of its power is supplied.

    Attributes:
        v: Index in v.
        law: The effort [N*m or N] over time.
        function: The smooth piece of the law on the present stretch.
        constant: Its value there if it is constant.
    """

    v: int
    law: MotionLaw
    function: Callable[[Array], Values] | None = None
    constant: float | None = None

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v] += self._effort(t)

    def potential_energy(self, q: Array) -> Array:
        """Return 0."""
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the power supplied, with a minus."""
        return np.asarray(-self._effort(t) * v[..., self.v])

    @property
    def steady(self) -> bool:
        """Whether the effort is constant."""
        return self.constant is not None

    def laws(self) -> list[MotionLaw]:
        """Return the law."""
        return [self.law]

    def on(self, start: float, end: float) -> AppliedEffort:
        """Return the element with the piece of its law on the stretch."""
        constant = float(self.law.value) if isinstance(self.law, Constant) else None
        return replace(self, function=self.law.on(start, end), constant=constant)

    def _effort(self, t: Array | float) -> Array | float:
        if self.constant is not None:
            return self.constant
        if self.function is None:
            raise ValueError("a law is evaluated on a stretch of time: take the element's on(start, end)")
        return self.function(np.asarray(t, float))[0]


@dataclass(frozen=True)
class ProfiledEffort(ForceElement):
    """A torque or force at a joint that depends on the coordinate of a joint, such as of gas on a crank.

    All of its power is supplied, also where it could be called a spring. Forward problems step over the profile's
    breakpoints, where their accuracy is that of a kink, but over no whole piece.

    Attributes:
        v: Index in v of the joint that it acts on.
        q: Index in q of the joint that it depends on.
        profile: The effort [N*m or N] over that joint's coordinate.
    """

    v: int
    q: int
    profile: Profile

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v] += self.profile(q[..., self.q])[0]

    def potential_energy(self, q: Array) -> Array:
        """Return 0."""
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the power supplied, with a minus."""
        return np.asarray(-self.profile(q[..., self.q])[0] * v[..., self.v])

    @property
    def in_pieces(self) -> bool:
        """Whether there are pieces: there are."""
        return True

    def passed(self, q: Array, v: Array) -> bool:
        """Return whether the coordinate passes a whole piece of the profile."""
        return self._pieces.passed(q[..., self.q])

    @cached_property
    def _pieces(self) -> Pieces:
        starts = [piece.start for piece in self.profile.pieces if math.isfinite(piece.start)]
        return Pieces(np.array(starts), self.profile.period)


@dataclass(frozen=True)
class MotorCurve(ForceElement):
    """A motor at full power: its effort is a function of its velocity, linear between points, constant beyond them.

    Attributes:
        v: Index in v.
        speeds: Velocities of the points, ascending [rad/s or m/s], shape (k,).
        efforts: Efforts there [N*m or N], shape (k,).
    """

    v: int
    speeds: Array
    efforts: Array

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v] += np.interp(v[..., self.v], self.speeds, self.efforts)

    def potential_energy(self, q: Array) -> Array:
        """Return 0."""
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the power supplied, with a minus."""
        rate = v[..., self.v]
        return np.asarray(-np.interp(rate, self.speeds, self.efforts) * rate)

    @property
    def in_pieces(self) -> bool:
        """Whether there are pieces: there are."""
        return True

    def passed(self, q: Array, v: Array) -> bool:
        """Return whether the velocity passes the whole way between two points of the curve."""
        return self._pieces.passed(v[..., self.v])

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(self.speeds)


class JointSpring(Model, frozen=True, tag_field="kind", tag="joint_spring"):
    """Spring and damper between a joint's two links."""

    joint: str
    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0
    rest: AnyQuantity = 0.0

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        """Return the element of one model."""
        joint = _joint(joints, self.joint)
        effort = effort_unit(joint)
        _check(self, stiffness=effort / joint.unit, rest=joint.unit, damping=effort / joint.unit * unit("s"))
        one = np.array([1.0])
        return SpringDamper(np.array([joint.q]), np.array([joint.v]), self.stiffness * one, self.damping * one,
                            self.rest * one)  # fmt: skip


class JointFriction(Model, frozen=True, tag_field="kind", tag="joint_friction"):
    """Dry friction between a joint's two links, regularised: see ``DryFriction``."""

    joint: str
    friction: NotNegative
    creep: Positive = CREEP

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        """Return the element of one model."""
        joint = _joint(joints, self.joint)
        _check(self, friction=effort_unit(joint), creep=joint.unit / unit("s"))
        return DryFriction(np.array([joint.v]), np.array([float(self.friction)]), np.array([float(self.creep)]))


class JointEffort(Model, frozen=True, tag_field="kind", tag="joint_effort"):
    """Torque or force at a joint, over time or over the coordinate of a joint.

    Attributes:
        joint: Joint that it acts on.
        effort: The law.
        over: Joint whose coordinate stands for the time of the law: ``duration: 90 deg``; over time where none is
            given.
        period: After which a law over a coordinate repeats, such as ``720 deg``.
    """

    joint: str
    effort: Law
    over: str | None = None
    period: Extent | None = None

    def check(self) -> None:
        """Refuse a period of a law over time."""
        if self.period is not None and self.over is None:
            with within("period"):
                raise InputError("a law over time has no period", expected="over: the joint whose turns are meant")

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        """Return the element of one model."""
        joint = _joint(joints, self.joint)
        if self.over is None:
            with within("effort"):
                self.effort.check_units(effort_unit(joint))
            return AppliedEffort(joint.v, self.effort)
        with within("over"):
            along = joint_of(joints, self.over)
        with within("effort"):
            self.effort.check_units(effort_unit(joint), along.unit)
            self.effort.require_continuous(along.unit)
        with within("period"):
            check_unit(self.period or 0.0, along.unit)
        return ProfiledEffort(joint.v, along.q, Profile.of(self.effort, self.period))


class TorqueSpeed(Model, frozen=True, tag_field="kind", tag="torque_speed"):
    """A motor's curve at its joint: pairs of velocity and effort."""

    joint: str
    curve: list[tuple[AnyQuantity, AnyQuantity]]

    def check(self) -> None:
        """Refuse a curve that is no function of the velocity."""
        if len(self.curve) < 2 or any(b <= a for (a, _), (b, _) in pairwise(self.curve)):
            raise InputError("the velocities of the curve do not ascend", expected="two points or more, ascending")

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        """Return the element of one model."""
        joint = _joint(joints, self.joint)
        for row, point in enumerate(self.curve):
            with within("curve", row):
                check_each(point, joint.unit / unit("s"), effort_unit(joint))
        points = np.array(self.curve, float)
        return MotorCurve(joint.v, points[:, 0].copy(), points[:, 1].copy())


def _following(indices: Indices) -> slice | Indices:
    """Return the slice of indices that follow one another, otherwise these."""
    if not len(indices):
        return indices
    first, last = int(indices[0]), int(indices[-1]) + 1
    return slice(first, last) if np.array_equal(indices, np.arange(first, last)) else indices


def _joint(joints: Mapping[str, Joint], name: str) -> Joint:
    with within("joint"):
        return joint_of(joints, name)


def _check(keys: Model, **expected: Unit) -> None:
    for name, measured in expected.items():
        with within(name):
            check_unit(getattr(keys, name), measured)

"""Ball joints: their orientation as a quaternion, and as three numbers that a person can give.

With R the rotation of the child link in the joint's own placement: the rotation vector w, ``R = exp([w])``, or roll,
pitch and yaw, ``R = Rz(yaw) Ry(pitch) Rx(roll)``. The velocity is the angular velocity in the child's axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, choices
from pinarm.input.units import Unit, unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, PairCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.pairs import RollPitchYawRow, RotationVectorRow, TiedFrames, whole_turns
from pinarm.mechanics.geometry.vectors import arctan2
from pinarm.mechanics.joints import METRE, RADIAN, UNIVERSE, Joint
from pinarm.records import ValueRecord

ANGLES, ROTATIONS, SPINS = (
    ("roll", "pitch", "yaw"),
    *(tuple(f"{vector}.{axis}" for axis in "xyz") for vector in ("rotation", "angular_velocity")),
)
"""Names of what says an orientation, and an angular velocity, behind the name of a ball joint."""


class Ball(ValueRecord, frozen=True):
    """A joint that turns about a point.

    Attributes:
        q: Index in q of its quaternion (x, y, z, w).
    """

    name: str
    index: int
    q: int
    v: int

    def quaternion(self, q: Array) -> Array:
        """Return the quaternions (x, y, z, w) of configurations, shape (..., 4)."""
        return q[..., self.q : self.q + 4]

    def vectors(self, v: Array) -> Array:
        """Return its part of velocities, accelerations or efforts, child's axes, shape (..., 3)."""
        return v[..., self.v : self.v + 3]


def balls_of(model: pin.Model) -> dict[str, Ball]:
    """Return the ball joints, by name, in the order of v."""
    balls = {}
    for index in range(1, model.njoints):
        joint = model.joints[index]
        if joint.shortname() == "JointModelSpherical":
            balls[model.names[index]] = Ball(model.names[index], index, joint.idx_q, joint.idx_v)
    return balls


def roll_pitch_yaw(quaternion: Array) -> Array:
    """Return roll, pitch and yaw [rad], shape (..., 3); at a pitch of 90 deg only roll -+ yaw is determined.

    With s = roll + yaw and d = roll - yaw, ``(w - y, x + z)`` has the direction of s / 2 and ``(w + y, x - z)`` that of
    d / 2; the pitch is in their lengths. Together the three angles give back the orientation to rounding at any pitch,
    which the elements of the matrix do not: theirs is off by the square root of it near 90 deg. Source: Bernardes and
    Viollet, Quaternion to Euler angles conversion, PLoS ONE 17 (2022).

    Args:
        quaternion: (x, y, z, w), of unit length, shape (..., 4).
    """
    x, y, z, w = np.moveaxis(quaternion, -1, 0)
    half_sum, half_difference = arctan2(x + z, w - y), arctan2(x - z, w + y)
    lengths = (np.sqrt(a * a + b * b) for a, b in ((x - z, w + y), (x + z, w - y)))
    pitch = 2.0 * arctan2(*lengths) - 0.5 * np.pi
    turned = np.stack([half_sum + half_difference, pitch, half_sum - half_difference], axis=-1)
    return turned - whole_turns(turned)


class BallCoordinate(PairCoordinate, frozen=True, kw_only=True):
    """Component k of a ball joint's rotation vector: the rotation of its link in its placement on the parent."""

    kind: ClassVar[type[RotationVectorRow | RollPitchYawRow]] = RotationVectorRow
    ball: Ball
    component: int

    @classmethod
    def of(cls, model: pin.Model, ball: Ball, component: int) -> Self:
        parent = int(model.parents[ball.index])
        first = model.getFrameId(model.names[parent], pin.JOINT) if parent else UNIVERSE
        row = cls.kind(component, np.asarray(model.jointPlacements[ball.index].rotation))
        way = TiedFrames(first, model.getFrameId(ball.name, pin.JOINT), row)
        return cls(way, RADIAN, ball=ball, component=component)

    def value(self, state: Kinematics) -> float:
        return float(self.vector(state.q)[self.component])

    def vector(self, q: Array) -> Array:
        """Return the rotation vector [rad], shape (3,)."""
        return np.asarray(pin.log3(pin.Quaternion(self.ball.quaternion(q)).matrix()))

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        return {}


class BallAngle(BallCoordinate, frozen=True, kw_only=True):
    """Roll, pitch or yaw of a ball joint, up to half a turn; at a pitch of 90 deg roll and yaw are not determined.

    The component is 0 for roll, 1 for pitch, 2 for yaw: the angles of three joints in series, about z, y, x.
    """

    kind: ClassVar[type[RotationVectorRow | RollPitchYawRow]] = RollPitchYawRow

    @property
    def wraps(self) -> bool:  # type: ignore[override]
        return ANGLES[self.component] != "pitch"

    def vector(self, q: Array) -> Array:
        """Return roll, pitch and yaw [rad], shape (3,)."""
        return roll_pitch_yaw(self.ball.quaternion(q))


def ball_coordinates(model: pin.Model, balls: Mapping[str, Ball]) -> dict[str, Coordinate]:
    """Return the coordinates of every ball joint J: ``J.rotation.x`` and so on of all, then ``J.roll`` and so on."""
    names: dict[type[BallCoordinate], Sequence[str]] = {BallCoordinate: ROTATIONS, BallAngle: ANGLES}
    return {
        f"{name}.{part}": kind.of(model, ball, k)
        for kind, parts in names.items()
        for name, ball in balls.items()
        for k, part in enumerate(parts)
    }


def _joint_at(model: pin.Model, index: int) -> pin.JointModel:
    return next(joint for joint in model.joints if joint.nv and joint.idx_v <= index < joint.idx_v + joint.nv)


def coordinate_at(model: pin.Model, index: int) -> Coordinate:
    """Return the coordinate that belongs to an index in v: a joint's, or a component of a rotation vector."""
    joint = _joint_at(model, index)
    if joint.nv == 3:
        ball = Ball(model.names[joint.id], joint.id, joint.idx_q, joint.idx_v)
        return BallCoordinate.of(model, ball, index - joint.idx_v)
    weights, places = np.zeros(model.nv), np.full(model.nv, joint.idx_q, dtype=np.intp)
    weights[index] = 1.0
    return LinearCoordinate(METRE if joint.shortname().startswith("JointModelP") else RADIAN, weights, places)


def coordinate_name(model: pin.Model, index: int) -> str:
    """Return the name of the coordinate that belongs to an index in v."""
    joint = _joint_at(model, index)
    name = str(model.names[joint.id])
    return f"{name}.rotation.{'xyz'[index - joint.idx_v]}" if joint.nv == 3 else name


def indices_of(name: str, joints: Mapping[str, Joint], balls: Mapping[str, Ball]) -> tuple[int, ...]:
    """Return the indices in v of what a key of ``configuration`` or ``velocity`` says something of."""
    if name in joints:
        return (joints[name].v,)
    ball = next(ball for key, ball in balls.items() if name.startswith(f"{key}.") and name not in joints)
    return tuple(range(ball.v, ball.v + 3))


def positions_of(joints: Mapping[str, Joint], balls: Mapping[str, Ball]) -> dict[str, Unit]:
    """Return the names of values that give a configuration, with their units: see ``configuration``."""
    turns = (f"{name}.{part}" for name in balls for part in (*ROTATIONS, *ANGLES))
    return {**{name: joint.unit for name, joint in joints.items()}, **dict.fromkeys(turns, RADIAN)}


def velocities_of(joints: Mapping[str, Joint], balls: Mapping[str, Ball]) -> dict[str, Unit]:
    """Return the names of values that give velocities, with their units: see ``velocity``."""
    measures = {METRE: unit("m/s"), RADIAN: unit("rad/s")}
    rates = {name: measures[joint.unit] for name, joint in joints.items()}
    return {**rates, **{f"{name}.{spin}": measures[RADIAN] for name in balls for spin in SPINS}}


def places_of(joints: Mapping[str, Joint], balls: Mapping[str, Ball]) -> dict[str, int]:
    """Return the indices in v of what velocities can be given by."""
    spins = {f"{name}.{spin}": ball.v + k for name, ball in balls.items() for k, spin in enumerate(SPINS)}
    return {**{name: joint.v for name, joint in joints.items()}, **spins}


def unit_of(name: str, units: Mapping[str, Unit]) -> Unit:
    """Return the unit of a value given by name."""
    if name not in units:
        expected, hint = choices(name, units)
        raise InputError(f"the model has no joint '{name}' with one coordinate", expected=expected, hint=hint)
    return units[name]


def configuration(
    model: pin.Model, joints: Mapping[str, Joint], balls: Mapping[str, Ball], values: Mapping[str, float]
) -> Array:
    """Return a configuration from values by name, shape (nq,); what is not given is 0.

    Args:
        balls: Ball joints J, with the keys ``J.rotation.x`` and so on, or ``J.roll``, ``J.pitch``, ``J.yaw``.
        values: Values [rad or m].
    """
    units = positions_of(joints, balls)
    for name in values:
        unit_of(name, units)
    q: Array = pin.neutral(model)
    for name, joint in joints.items():
        q[joint.q] = values.get(name, 0.0)
    for name, ball in balls.items():
        vector, angles = (
            np.array([values.get(f"{name}.{part}", 0.0) for part in parts]) for parts in (ROTATIONS, ANGLES)
        )
        by_vector, by_angles = (any(f"{name}.{part}" in values for part in parts) for parts in (ROTATIONS, ANGLES))
        if by_vector and by_angles:
            raise InputError(f"the orientation of '{name}' is given twice", expected="roll, pitch and yaw, or rotation")
        turn = pin.exp3(vector) if by_vector else pin.rpy.rpyToMatrix(angles)
        q[ball.q : ball.q + 4] = pin.Quaternion(turn).coeffs()
    return q

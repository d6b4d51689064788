"""Angles along which something acts, and that no joint can count: where they leap, the motion is no mechanism's.

An angle of a loop in space that is not counted leaps by a turn at 180 deg, a rotation vector leaps at half a turn, and
roll and yaw of a ball joint leap by half a turn at a pitch of 90 deg: springs, drives and controllers with them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.constraint import joint_ties
from pinarm.errors import DynamicsError
from pinarm.mechanics.ball_joints import BallAngle, BallCoordinate, roll_pitch_yaw
from pinarm.mechanics.coordinates import Coordinate, PairCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.rotation_rows import RotationVectorRow
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint import Constraint
    from pinarm.mechanics.control.controller import Controller
    from pinarm.mechanics.forces.force_element import ForceElement

PARTS, TURN = 8, 2.0 * np.pi
"""Parts of a step that are looked at: within one a motion that steps resolve turns by much less than a quarter."""


POLE = (
    "roll and yaw leap by half a turn where the pitch passes 90 deg",
    "three revolute joints in place of the ball joint",
)
VECTOR = "a rotation vector leaps where it passes half a turn", "a revolute joint, or a reference that is turned"
UNCOUNTED = (
    "it is told from -180 to 180 deg and leaps by a turn there",
    "in the mechanism file: turns: [{angle}], which counts them",
)
BUSHING = (
    "there its frames are half a turn apart, and a bushing acts up to 170 deg",
    "a joint_spring, or a coordinate_spring along an angle whose turns are counted",
)
"""Why an angle leaps, and what to write instead."""


class Acting(NamedTuple):
    """A force, drive or controller along an angle that is known up to half a turn only.

    Attributes:
        user: Its name for messages.
        angle: The angle.
        name: Name of the angle, where it is known.
        counted: Whether whole turns do not matter: a joint counts them.
        vector: Why it leaps where it is part of a rotation vector, and what to write instead.
    """

    user: str
    angle: Coordinate
    name: str = "NAME"
    counted: bool = False
    vector: tuple[str, str] = VECTOR

    def leap(self, before: Kinematics, after: Kinematics) -> tuple[str, str] | None:
        """Return why the angle leaps between two states, and what to write instead; ``None`` where it does not."""
        angle = self.angle
        if isinstance(angle, BallAngle):
            ends = [roll_pitch_yaw(angle.ball.quaternion(state.q))[[0, 2]] for state in (before, after)]
            turned = (ends[1] - ends[0]) / TURN
            if np.abs(turned - np.round(turned)).max() > 0.25:
                return POLE
        elif isinstance(angle, BallCoordinate) or _is_turn(angle):
            way = np.linalg.norm(_vector(angle, after) - _vector(angle, before))
            return self.vector if way > np.pi else None
        return None if self.counted or abs(angle.value(after) - angle.value(before)) < np.pi else UNCOUNTED


def acting_on_angles(
    constraints: Iterable[Constraint], forces: Mapping[str, ForceElement], controllers: Iterable[Controller] = (),
    coordinates: Mapping[str, Coordinate] = MappingProxyType({}),
) -> list[Acting]:  # fmt: skip
    """Return what acts along angles that may leap.

    Args:
        constraints: Ties of drives, and of joints that count turns, among them.
        forces: Force elements by name.
        controllers: Those of a run that has been made: functions have asked for what they need.
        coordinates: The mechanism's, by name.
    """
    found = [Acting(f"'{tie.name}'", tie.coordinate, counted=tie.coordinate.wraps) for tie in joint_ties(constraints)]
    found += [Acting(f"'{name}'", force.coordinate) for name, force in forces.items() if hasattr(force, "coordinate")]
    for one in controllers:
        names = [name.removeprefix("loop.") for name in getattr(one, "readers", ())]
        measured = [signal.coordinate for signal in one.signals if hasattr(signal, "coordinate")]
        measured += [coordinates[name] for name in names if name in coordinates]
        found += [Acting(f"the controller of {', '.join(one.drives)}", coordinate) for coordinate in measured]
    names_of = {id(coordinate): name for name, coordinate in coordinates.items()}
    return [one._replace(name=names_of.get(id(one.angle), one.name)) for one in found if _leaps(one)]


def turned_between(forces: Mapping[str, ForceElement], q: Array) -> list[Acting]:
    """Return the bushings whose frames may pass half a turn between two rows of a motion.

    Args:
        forces: Force elements by name.
        q: Configurations, shape (n, nq).
    """
    angles = {name: force.turned_between(q) for name, force in forces.items()}
    return [Acting(f"'{name}'", angle, vector=BUSHING) for name, angle in angles.items() if angle is not None]


def _is_turn(angle: Coordinate) -> bool:
    return isinstance(angle, PairCoordinate) and isinstance(angle.way.pair, RotationVectorRow)


def _vector(angle: Coordinate, state: Kinematics) -> Array:
    """Return the rotation vector of which an angle is a component [rad], shape (3,)."""
    if isinstance(angle, BallCoordinate):
        return angle.vector(state.q)
    assert isinstance(angle, PairCoordinate)
    rows = (replace(angle.way, pair=RotationVectorRow(k, np.eye(3))) for k in range(3))
    return np.array([row.gap(state)[0] for row in rows])


def _leaps(one: Acting) -> bool:
    """Return whether the angle may leap: that of a loop does not where a joint counts its turns."""
    ball = isinstance(one.angle, BallCoordinate) or _is_turn(one.angle)
    return ball or (one.angle.wraps and not one.counted)


def require_turns(
    model: pin.Model, acting: Sequence[Acting], t: Array, q: Array, parameter: str = "t", measured: str = "s"
) -> None:
    """Raise where an angle along which something acts leaps between two of many configurations.

    Args:
        model: Pinocchio's model.
        acting: What acts along such angles.
        t: Values of the parameter, shape (n,).
        q: Configurations there, close enough for an angle to turn by less than a quarter in between, shape (n, nq).
        parameter: Name of the parameter.
        measured: Its unit.

    Raises:
        DynamicsError: Says what acts, when, and what to do.
    """
    states = (Kinematics.at(model, one) for one in q)
    for to, (before, after) in zip(t[1:].tolist(), pairwise(states), strict=True):
        for one in acting:
            if (leap := one.leap(before, after)) is not None:
                raise DynamicsError(
                    f"{one.user} acts along an angle that does not go on at {parameter} = {to:.6g} {measured}: "
                    f"{leap[0]}",
                    expected="an angle that goes on without a leap",
                    hint=leap[1].format(angle=one.name),
                    t=to,
                )


def between(t: Array) -> Array:
    """Return values of a parameter with ``PARTS`` parts between each two, ascending or descending as they are."""
    parts = t[:-1, None] + np.diff(t)[:, None] * (np.arange(PARTS) / PARTS)
    return np.append(parts[np.diff(t) != 0.0].reshape(-1), t[-1:])

"""Forces between the two links of a joint: springs, dampers, friction, torque laws and motor curves."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.errors import InputError, within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import AnyQuantity, Extent, InputStruct, NotNegative, Positive, check_each, check_unit
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.joints import METRE, Joint, joint_of
from pinarm.mechanics.laws import Law
from pinarm.mechanics.laws.over_coordinate import Profile

if TYPE_CHECKING:
    from pinarm.mechanics.coordinates import Coordinate

CREEP = 1e-3
"""Velocity below which regularised friction gives way [rad/s or m/s], where a file gives none."""


def effort_unit(joint: Joint | Coordinate) -> Unit:
    """Return N for a joint that slides, or a coordinate that is a length, and N*m for one that turns."""
    return unit("N") if joint.unit == METRE else unit("N*m")


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
        from pinarm.mechanics.forces.joint_springs import SpringDamper

        joint = _joint(joints, self.joint)
        effort = effort_unit(joint)
        _check(self, stiffness=effort / joint.unit, rest=joint.unit, damping=effort / joint.unit * unit("s"))
        one = np.array([1.0])
        return SpringDamper(np.array([joint.q]), np.array([joint.v]), self.stiffness * one, self.damping * one,
                            self.rest * one)  # fmt: skip


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
        from pinarm.mechanics.forces.joint_springs import DryFriction

        joint = _joint(joints, self.joint)
        _check(self, friction=effort_unit(joint), creep=joint.unit / unit("s"))
        return DryFriction(np.array([joint.v]), np.array([float(self.friction)]), np.array([float(self.creep)]))


class JointEffort(InputStruct, frozen=True, tag_field="kind", tag="joint_effort"):
    """Torque or force at a joint, over time or over the coordinate of a joint.

    Attributes:
        joint: Joint that it acts on.
        effort: The law.
        over: Joint whose coordinate stands for the time of the law: ``duration: 90 deg``; over time where none is
            given.
        period: After which a law over a coordinate repeats, such as ``720 deg``: what it says from 0 to there holds
            for every turn.
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
        from pinarm.mechanics.forces.joint_efforts import AppliedEffort, ProfiledEffort

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
            profile = Profile.of(self.effort, self.period)
            profile.check_repeated(kinks=True)
        return ProfiledEffort(joint.v, along.q, along.v, profile)


class TorqueSpeed(InputStruct, frozen=True, tag_field="kind", tag="torque_speed"):
    """A motor's curve at its joint.

    Attributes:
        joint: The joint that it drives.
        curve: Pairs of velocity and effort, ascending, such as ``[[0 rpm, 8 N*m], [3000 rpm, 0 N*m]]``.
    """

    joint: str
    curve: list[tuple[AnyQuantity, AnyQuantity]]

    def check(self) -> None:
        """Refuse a curve that is no function of the velocity."""
        if len(self.curve) < 2 or any(b <= a for (a, _), (b, _) in pairwise(self.curve)):
            raise InputError("the velocities of the curve do not ascend", expected="two points or more, ascending")

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        from pinarm.mechanics.forces.joint_efforts import MotorCurve

        joint = _joint(joints, self.joint)
        for row, point in enumerate(self.curve):
            with within("curve", row):
                check_each(point, joint.unit / unit("s"), effort_unit(joint))
        points = np.array(self.curve, float)
        return MotorCurve(joint.v, points[:, 0].copy(), points[:, 1].copy())


def _joint(joints: Mapping[str, Joint], name: str) -> Joint:
    with within("joint"):
        return joint_of(joints, name)


def _check(keys: InputStruct, **expected: Unit) -> None:
    for name, measured in expected.items():
        with within(name):
            check_unit(getattr(keys, name), measured)

"""The two members of a coupling, such as two wheels, as they are seen from the body that carries both."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.mechanics.geometry.kinematics import new_data
from pinarm.mechanics.joints import METRE, PARALLEL, Joint
from pinarm.records import Record

IN_LINE = 1e-6
"""Distance of axes that are the same or meet [m], relative to 1 m or to their places: more than typed digits leave."""


class Member(Record, frozen=True):
    """A body that turns about, or slides along, one axis that is fixed in the carrier.

    Attributes:
        body: Index of the joint that moves it; 0 for the ground.
        joint: The joint that the coupling names.
        axis: Unit vector of the axis in the carrier, the positive sense of the joint, shape (3,).
        point: A point of the axis in the carrier: the origin of the joint [m], shape (3,).
        rates: Joint -> its part in the angle or way of the body in the carrier, 1 or -1.
    """

    body: int
    joint: Joint
    axis: Array
    point: Array
    rates: Mapping[Joint, float]


class MemberPair(Record, frozen=True):
    """Two members on one carrier. Their angles or ways there are s1 and s2.

    Attributes:
        carrier: Index of the joint that moves the carrier; 0 for the ground.
        first: The first member.
        second: The second one.
    """

    carrier: int
    first: Member
    second: Member

    @property
    def sense(self) -> float:
        """Way of the second member in the carrier per way of its joint, 1 or -1: a multiplier lam acts on s2 by it."""
        return self.second.rates[self.second.joint]

    def inner_ratio(self, ratio: float) -> float:
        """Return ``ds2 / ds1`` from the ratio of the two joints, ``dq2 / dq1`` with the other joints at rest."""
        return ratio * self.sense / self.first.rates[self.first.joint]

    def weights(self, inner_ratio: float) -> dict[Joint, float]:
        """Return the weights of ``s2 - inner_ratio s1``, that of the second joint being 1."""
        found = dict.fromkeys([self.second.joint, self.first.joint], 0.0)
        for share, member in ((self.sense, self.second), (-self.sense * inner_ratio, self.first)):
            for joint, rate in member.rates.items():
                found[joint] = found.get(joint, 0.0) + share * rate
        return found


def member_pair(
    model: pin.Model, joints: Mapping[str, Joint], pair: tuple[Joint, Joint], carrier: Joint | None = None
) -> MemberPair:
    """Return the members that two joints move, on the carrier that a third joint moves.

    Without a carrier it is the body that both joints are at: the parent of both, or the link between them where one
    carries the other. The member of the latter joint is then what that joint stands on, such as a fixed ring.

    Raises:
        InputError: No body carries both, or a member does not move about one axis in it.
    """
    first, second = pair
    bodies = (carrier.index, first.index, second.index) if carrier is not None else _bodies(model, first, second)
    frames = _AxesAtNeutral(model, {joint.index: joint for joint in joints.values()}, bodies[0])
    return MemberPair(bodies[0], frames.member(bodies[1], first), frames.member(bodies[2], second))


def _bodies(model: pin.Model, first: Joint, second: Joint) -> tuple[int, int, int]:
    """Return the carrier and the bodies of the members, where no carrier is named."""
    below = [int(model.parents[joint.index]) for joint in (first, second)]
    if below[0] == below[1]:
        return below[0], first.index, second.index
    if below[1] == first.index:
        return first.index, below[0], second.index
    if below[0] == second.index:
        return second.index, first.index, below[1]
    raise InputError(
        f"no link carries the axes of both {first.name} and {second.name}",
        expected="joints of one parent link, or one joint on the link that the other moves",
        hint="carrier: the joint that moves the link with both axes",
    )


class _AxesAtNeutral:
    """Axes of joints in the frame of a carrier, at the neutral configuration."""

    def __init__(self, model: pin.Model, joints: Mapping[int, Joint], carrier: int) -> None:
        self.model, self.joints, self.carrier = model, joints, carrier
        self.data = new_data(model)
        self.columns = np.asarray(
            pin.computeJointJacobians(model, self.data, pin.neutral(model)), dtype=np.float64
        ).reshape(6, -1)

    def axis(self, joint: Joint) -> Array:
        """Return the unit vector of a joint's axis."""
        part = self.columns[:3, joint.v] if joint.unit == METRE else self.columns[3:, joint.v]
        return np.asarray(self.data.oMi[self.carrier].rotation.T @ part)

    def origin(self, joint: Joint) -> Array:
        """Return the origin of a joint's frame [m]."""
        return np.asarray(self.data.oMi[self.carrier].actInv(self.data.oMi[joint.index].translation))

    def member(self, body: int, joint: Joint) -> Member:
        """Return a member; every joint between it and the carrier must move about the axis of the joint named."""
        axis, point, rates = self.axis(joint), self.origin(joint), dict[Joint, float]()
        for index, way in self._path(body):
            step = self.joints.get(index)
            if step is None or not self._same_axis(step, joint):
                between = self.model.names[index]
                raise InputError(
                    f"the member at {joint.name} does not move about one axis in its carrier: {between} lies between",
                    expected="joints about, or along, the same axis only", hint="another carrier",
                )  # fmt: skip
            rates[step] = way * float(np.sign(axis @ self.axis(step)))
        if joint not in rates:
            raise InputError(f"{joint.name} does not move a member in the carrier", expected="another carrier")
        return Member(body, joint, axis, point, rates)

    def _path(self, body: int) -> list[tuple[int, float]]:
        """Return the joints from the carrier to a body, those that lead away from the ground with 1, others with -1."""
        down, up = ([int(j) for j in self.model.supports[k]] for k in (body, self.carrier))
        return [*((j, -1.0) for j in up if j not in down), *((j, 1.0) for j in down if j not in up)]

    def _same_axis(self, one: Joint, other: Joint) -> bool:
        axis, apart = self.axis(other), self.origin(one) - self.origin(other)
        if one.unit != other.unit or np.linalg.norm(np.cross(axis, self.axis(one))) > PARALLEL:
            return False
        slack = IN_LINE * max(1.0, float(np.linalg.norm(apart)))
        return one.unit == METRE or bool(np.linalg.norm(np.cross(axis, apart)) <= slack)

"""Joints of the tree as names of the bodies that they move."""

from __future__ import annotations

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.family import Asked
from pinarm.errors import InputError

ALL = "all"
"""The whole mechanism, in place of a joint."""


def moved_joints(run: Trajectory) -> list[str]:
    """Return the names of the joints of the tree."""
    return [*run.mechanism.joints, *run.mechanism.balls]


def index_of(asked: Asked, run: Trajectory) -> int:
    """Return Pinocchio's index of the joint that is asked about.

    Raises:
        UnknownQuantity: There is no such joint.
    """
    joint = run.mechanism.joints.get(asked.of) or run.mechanism.balls.get(asked.of)
    if joint is None:
        raise asked.unknown
    return joint.index


def beyond(asked: Asked, run: Trajectory) -> list[int]:
    """Return Pinocchio's indices of a joint and those beyond it, or of all joints.

    Raises:
        UnknownQuantity: There is no such joint.
        InputError: A joint is called ``all``.
    """
    if asked.of != ALL:
        return [int(joint) for joint in run.mechanism.model.subtrees[index_of(asked, run)]]
    if ALL in moved_joints(run):
        raise InputError(f"'{asked.name}': '{ALL}' is a joint, and the whole mechanism", expected="one meaning",
                         hint="another name of the joint")  # fmt: skip
    return list(range(1, run.mechanism.model.njoints))

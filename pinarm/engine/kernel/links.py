"""The links of a tree as the compiled library knows them: kinds of joints, and frames with the joint's axis along z."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.kernel.structures import REAL, LinkStructure, ScrewStructure

SCREW, CONTINUOUS, BALL, FLOATING, PLANAR, TRANSLATION = range(6)
"""Kinds of joints, see ``joints.h``."""

KINDS = {
    "RX": SCREW, "RY": SCREW, "RZ": SCREW, "RevoluteUnaligned": SCREW,
    "PX": SCREW, "PY": SCREW, "PZ": SCREW, "PrismaticUnaligned": SCREW,
    "HX": SCREW, "HY": SCREW, "HZ": SCREW, "HelicalUnaligned": SCREW,
    "RUBX": CONTINUOUS, "RUBY": CONTINUOUS, "RUBZ": CONTINUOUS, "RevoluteUnboundedUnaligned": CONTINUOUS,
    "Spherical": BALL, "FreeFlyer": FLOATING, "Planar": PLANAR, "Translation": TRANSLATION,
}  # fmt: skip
"""Pinocchio's name of a joint, without ``JointModel`` -> its kind."""

X, Y, Z = range(3)
COLUMNS: dict[int, tuple[tuple[int, float, float], ...]] = {
    BALL: ((X, 0, 1), (Y, 0, 1), (Z, 0, 1)),
    FLOATING: ((X, 1, 0), (Y, 1, 0), (Z, 1, 0), (X, 0, 1), (Y, 0, 1), (Z, 0, 1)),
    PLANAR: ((X, 1, 0), (Y, 1, 0), (Z, 0, 1)),
    TRANSLATION: ((X, 1, 0), (Y, 1, 0), (Z, 1, 0)),
}
"""Kind of a joint with several velocities -> the axis, the slide and the turn of each: see ``Screw``."""


class JointFrame(NamedTuple):
    """A joint in the frame in which the library knows its link.

    Attributes:
        kind: Kind of the joint.
        screws: Axis, slide and turn of each of its velocities.
        rotation: Axes of that frame in Pinocchio's frame of the joint, as columns, shape (3, 3).
    """

    kind: int
    screws: tuple[tuple[int, float, float], ...]
    rotation: Array


def links_of(model: pin.Model) -> tuple[list[LinkStructure], list[ScrewStructure]] | None:
    """Return the links of a model, and the screw of each velocity; ``None`` where a joint is of no known kind."""
    known = [_frame(model, joint) for joint in model.joints.tolist()[1:]]
    frames = [one for one in known if one is not None]
    if len(frames) < len(known):
        return None
    links = [_link(model, index, frames) for index in range(1, model.njoints)]
    return links, [ScrewStructure(*screw) for frame in frames for screw in frame.screws]


def _frame(model: pin.Model, joint: pin.JointModel) -> JointFrame | None:
    kind = KINDS.get(joint.shortname().removeprefix("JointModel"))
    if kind is None:
        return None
    if kind in COLUMNS:
        return JointFrame(kind, COLUMNS[kind], np.eye(3))
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    linear, angular = np.reshape(data.S, (2, 3))
    turns = bool(angular.any())
    axis = angular if turns else linear
    axis = axis / np.linalg.norm(axis)
    slide = float(linear @ axis) if turns else 1.0
    return JointFrame(kind, ((Z, slide, float(turns)),), _with_z_along(axis))


def _with_z_along(axis: Array) -> Array:
    """Return a rotation whose last column is a unit vector; one along an axis only changes the order of the axes."""
    beside = np.eye(3)[(int(np.abs(axis).argmax()) + 1) % 3]
    x = np.cross(beside, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _link(model: pin.Model, index: int, frames: list[JointFrame]) -> LinkStructure:
    """Return the link of a joint of the model, in the frames of the library: ``R = A_p^T R_0 A`` and so on."""
    parent, frame, joint = int(model.parents[index]), frames[index - 1], model.joints[index]
    outer, turned = frames[parent - 1].rotation if parent else np.eye(3), frame.rotation
    placement, body = model.jointPlacements[index], model.inertias[index]
    rotation = outer.T @ placement.rotation @ turned
    inertia = turned.T @ body.matrix()[3:, 3:] @ turned
    return LinkStructure(
        parent - 1, frame.kind, joint.idx_q, joint.idx_v,
        (REAL * 9)(*rotation.flat), (REAL * 3)(*(outer.T @ placement.translation)),
        body.mass, (REAL * 3)(*(turned.T @ (body.mass * body.lever))),
        (REAL * 6)(*inertia[np.triu_indices(3)]),
    )  # fmt: skip

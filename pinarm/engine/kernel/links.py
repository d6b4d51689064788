"""The links of a tree as the compiled library knows them: kinds of joints, and frames with the joint's axis along z."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.kernel.structures import LINK, SCREW
from pinarm.mechanics.geometry.model_variants import ModelVariants
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray

UNIAXIAL, CONTINUOUS, BALL, FLOATING, PLANAR, TRANSLATION = range(6)
"""Kinds of joints, see ``joints.h``."""

KINDS = {
    "RX": UNIAXIAL, "RY": UNIAXIAL, "RZ": UNIAXIAL, "RevoluteUnaligned": UNIAXIAL,
    "PX": UNIAXIAL, "PY": UNIAXIAL, "PZ": UNIAXIAL, "PrismaticUnaligned": UNIAXIAL,
    "HX": UNIAXIAL, "HY": UNIAXIAL, "HZ": UNIAXIAL, "HelicalUnaligned": UNIAXIAL,
    "RUBX": CONTINUOUS, "RUBY": CONTINUOUS, "RUBZ": CONTINUOUS, "RevoluteUnboundedUnaligned": CONTINUOUS,
    "Spherical": BALL, "FreeFlyer": FLOATING, "Planar": PLANAR, "Translation": TRANSLATION,
}  # fmt: skip
"""Pinocchio's name of a joint, without ``JointModel`` -> its kind."""

SYMMETRIC = np.array([4, 5, 7, 5, 6, 8, 7, 8, 9])
"""Places of a symmetric matrix's entries in Pinocchio's parameters of a body, where xx, xy, yy, xz, yz, zz are last."""

X, Y, Z = range(3)
COLUMNS: dict[int, tuple[tuple[int, float, float], ...]] = {
    BALL: ((X, 0, 1), (Y, 0, 1), (Z, 0, 1)),
    FLOATING: ((X, 1, 0), (Y, 1, 0), (Z, 1, 0), (X, 0, 1), (Y, 0, 1), (Z, 0, 1)),
    PLANAR: ((X, 1, 0), (Y, 1, 0), (Z, 0, 1)),
    TRANSLATION: ((X, 1, 0), (Y, 1, 0), (Z, 1, 0)),
}
"""Kind of a joint with several velocities -> the axis, the slide and the turn of each: see ``structures.SCREW``."""


ALONG = {"X": np.eye(3)[:, [1, 2, 0]], "Y": np.eye(3)[:, [2, 0, 1]], "Z": np.eye(3)}
"""Last letter of the name of a joint, its axis -> a rotation whose last column is that axis."""


class JointFrame(Record, frozen=True):
    """A joint in the frame in which the library knows its link.

    Attributes:
        kind: Kind of the joint.
        screws: Axis, slide and turn of each of its velocities.
        rotation: Axes of that frame in Pinocchio's frame of the joint, as columns, shape (3, 3).
    """

    kind: int
    screws: tuple[tuple[int, float, float], ...]
    rotation: Array


class Links(Record, frozen=True):
    """The links of a model.

    Attributes:
        links: Links, shape (njoints - 1,), of ``structures.LINK``.
        screws: The screw of each velocity, shape (nv,), of ``structures.SCREW``.
        axes: Axes of the frames of the world and of the links in Pinocchio's, as columns, shape (njoints, 3, 3).
    """

    links: NDArray[np.void]
    screws: NDArray[np.void]
    axes: Array


def links_of(model: pin.Model) -> Links | None:
    """Return the links of a model; ``None`` where a joint is of no known kind.

    With the axes A of a link's frame in Pinocchio's, and A_p of its parent's, placements are ``A_p^T R A`` and
    ``A_p^T r``, and of the body ``A^T m c`` and ``A^T I A``.
    """
    joints = [_frame(model, joint) for joint in model.joints.tolist()[1:]]
    frames = [one for one in joints if one is not None]
    if len(frames) < len(joints):
        return None
    parents, links = np.array(model.parents.tolist())[1:], np.zeros(len(frames), LINK)
    axes, every = np.array([np.eye(3), *(frame.rotation for frame in frames)]), np.arange(len(frames))
    placements = np.array([one.homogeneous for one in model.jointPlacements.tolist()[1:]])
    bodies = np.array([one.toDynamicParameters() for one in model.inertias.tolist()[1:]])
    links["parent"], links["kind"] = parents - 1, [frame.kind for frame in frames]
    links["q"], links["v"] = model.idx_qs.tolist()[1:], model.idx_vs.tolist()[1:]
    _place(links, every, axes, placements[:, :3, :3], placements[:, :3, 3])
    _weigh(links, every, axes, bodies)
    return Links(links, np.array([screw for frame in frames for screw in frame.screws], SCREW), axes)


def links_of_variants(first: Links, variants: ModelVariants) -> NDArray[np.void]:
    """Return the links of variants of a model, shape (k, njoints - 1), given those of the first of them."""
    links = np.repeat(first.links[None], len(variants), axis=0)
    moved, bodies = (np.array(joints, dtype=np.intp) - 1 for joints in (variants.moved, variants.bodies))
    _place(links, moved, first.axes, variants.turns, variants.shifts)
    _weigh(links, bodies, first.axes, variants.parameters)
    return links


def _place(links: NDArray[np.void], some: Indices, axes: Array, turns: Array, shifts: Array) -> None:
    """Set the placements of some of the links, shape (.., njoints - 1), from those of their joints."""
    turned, outwards = axes[1:][some], axes[links["parent"][..., some] + 1].swapaxes(-1, -2)
    links["rotation"][..., some, :, :] = outwards @ turns @ turned
    links["translation"][..., some, :] = np.matvec(outwards, shifts)


def _weigh(links: NDArray[np.void], some: Indices, axes: Array, bodies: Array) -> None:
    """Set the bodies of some of the links, shape (.., njoints - 1), from their dynamic parameters, shape (.., 10)."""
    turned = axes[1:][some]
    links["mass"][..., some], links["moment"][..., some, :] = bodies[..., 0], np.vecmat(bodies[..., 1:4], turned)
    inertias = bodies[..., SYMMETRIC].reshape(*bodies.shape[:-1], 3, 3)
    links["inertia"][..., some, :] = (turned.swapaxes(-1, -2) @ inertias @ turned)[..., *np.triu_indices(3)]


def _frame(model: pin.Model, joint: pin.JointModel) -> JointFrame | None:
    name = joint.shortname().removeprefix("JointModel")
    kind = KINDS.get(name)
    if kind is None:
        return None
    if kind in COLUMNS:
        return JointFrame(kind, COLUMNS[kind], np.eye(3))
    if name[-1] in ALONG and name[0] != "H":
        turns = name[0] == "R"
        return JointFrame(kind, ((Z, float(not turns), float(turns)),), ALONG[name[-1]])
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    linear, angular = np.reshape(data.S, (2, 3))
    turns = bool(angular.any())
    axis = angular if turns else linear
    axis = axis / np.linalg.norm(axis)
    slide = float(linear @ axis) if turns else 1.0
    return JointFrame(kind, ((Z, slide, float(turns)),), _with_z_along(axis))


def _with_z_along(axis: Array) -> Array:
    """Return a rotation whose last column is a unit vector, shape (3, 3)."""
    beside = np.eye(3)[(int(np.abs(axis).argmax()) + 1) % 3]
    x = np.cross(beside, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)

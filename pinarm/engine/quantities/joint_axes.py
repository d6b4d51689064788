"""Axes of joints, and the parts of what they transmit along the axis and at right angles to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.mechanics.geometry.screws import screw_of

if TYPE_CHECKING:
    from pinarm.mechanics.loops.loop_joints import LoopJoint

ALONG_AXIS = ("axial", "radial")
"""Components of a force or moment F by an axis u: ``F . u``, and ``|F - (F . u) u|``."""

NO_AXIS = ("fixed", "spherical")
"""Kinds of lower pairs without an axis."""


def tree_axis(model: pin.Model, joint: int) -> Array | None:
    """Return the axis of a joint of the tree, in the joint's frame, shape (3,); ``None`` where it has none.

    Args:
        model: Pinocchio's model.
        joint: Pinocchio's joint index.
    """
    screw = screw_of(model.joints[joint])
    return None if screw is None else screw[1]


def loop_axis(loop: LoopJoint) -> Array | None:
    """Return the axis of a loop joint, in the axes of frame 1, shape (3,); ``None`` where it has none."""
    from pinarm.mechanics.loops.lower_pairs import LowerPair

    return loop.pair.axis if isinstance(loop.pair, LowerPair) and loop.kind not in NO_AXIS else None


def split(vectors: Array, axes: Array, part: str) -> Array:
    """Return a component of ``ALONG_AXIS`` of vectors by unit vectors, both of shape (n, 3); shape (n,)."""
    axial = np.asarray((vectors * axes).sum(axis=-1))
    return axial if part == "axial" else np.asarray(np.linalg.norm(vectors - axial[..., None] * axes, axis=-1))

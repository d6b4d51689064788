"""The screw of a joint with one coordinate: whether it turns or slides, and its axis."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array


def screw_of(joint: pin.JointModel) -> tuple[bool, Array] | None:
    """Return whether a joint is revolute, and its axis in joint axes; ``None`` if neither revolute nor prismatic."""
    if joint.nq != 1 or joint.nv != 1:
        return None
    data = joint.createData()
    joint.calc(data, np.zeros(max(joint.idx_q, 0) + 1))  # it reads at its place in q, unchecked
    motion = np.asarray(data.S, float).ravel()
    slides, turns = motion[:3].any(), motion[3:].any()
    return None if slides and turns else (bool(turns), motion[3:] if turns else motion[:3])

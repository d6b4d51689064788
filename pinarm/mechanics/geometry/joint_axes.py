"""Axes of joints: the screw of one joint, and whether several joints are parallel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.mechanics.geometry.kinematics import new_data

PARALLEL = 1e-3
"""Angle between axes that are parallel but for the digits in which right angles are typed [rad]."""


def screw_of(joint: pin.JointModel) -> tuple[bool, Array] | None:
    """Return whether a joint is revolute, and its axis in joint axes; ``None`` if neither revolute nor prismatic."""
    if joint.nq != 1 or joint.nv != 1:
        return None
    data = joint.createData()
    joint.calc(data, np.zeros(max(joint.idx_q, 0) + 1))  # it reads at its place in q, unchecked
    motion = np.asarray(data.S, float).ravel()
    slides, turns = motion[:3].any(), motion[3:].any()
    return None if slides and turns else (bool(turns), motion[3:] if turns else motion[:3])


def check_parallel(model: pin.Model, columns: Mapping[str, int]) -> None:
    """Raise where joints turn, or slide, about other than parallel axes of one sense, wherever the mechanism is.

    Args:
        model: Pinocchio's model.
        columns: Index in v of every joint, by name; all turn or all slide.

    Raises:
        InputError: Names the first joint and one that differs.
    """
    data, somewhere = new_data(model), np.sin(np.arange(1.0, model.nv + 1.0))
    first, *others = columns
    for q in (pin.neutral(model), pin.integrate(model, pin.neutral(model), somewhere)):
        jacobian = pin.computeJointJacobians(model, data, q).reshape(6, -1)
        part = jacobian[3:] if jacobian[3:, columns[first]].any() else jacobian[:3]
        axis = part[:, columns[first]]
        for name in others:
            other = part[:, columns[name]]
            if np.linalg.norm(other - axis) > PARALLEL:
                how = "opposite" if np.linalg.norm(other + axis) <= PARALLEL else "not parallel"
                raise InputError(f"the axes of '{first}' and '{name}' are {how}: no link turns by their sum",
                                 expected="joints about parallel axes of one sense")  # fmt: skip

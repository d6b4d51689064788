"""Joints and link frames of a model by name, and directions as files give them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, choices, within
from pinarm.input.units import Unit, unit
from pinarm.mechanics.geometry.kinematics import cached_by_model, new_data
from pinarm.records import ValueRecord

METRE, RADIAN = unit("m"), unit("rad")

UNIVERSE = 0
"""Index of the world's frame in a model."""

AXES: dict[str, tuple[float, float, float]] = {
    "x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1),
}  # fmt: skip
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Direction = Axis | tuple[float, float, float]
"""A world axis, or the components of a direction in world axes, of any length."""


def unit_vector(direction: Direction) -> Array:
    """Return a direction as a unit vector, shape (3,)."""
    vector = np.array(AXES[direction] if isinstance(direction, str) else direction, float)
    length = float(np.linalg.norm(vector))
    if not 0.0 < length < np.inf:
        raise InputError(f"{direction} is no direction", expected="three finite numbers, not all zero")
    return vector / length


class Joint(ValueRecord, frozen=True):
    """A joint of the model with one coordinate.

    Attributes:
        unit: Unit of its coordinate, rad or m.
    """

    name: str
    index: int
    q: int
    v: int
    unit: Unit


def effort_unit(measured: Unit) -> Unit:
    """Return the unit of efforts along a joint or a coordinate, by its own: N of lengths, N*m of angles."""
    return unit("N" if measured == METRE else "N*m")


def joints_of(model: pin.Model) -> dict[str, Joint]:
    """Return the joints with one coordinate by name, in the order of v."""
    joints = {}
    for index in range(1, model.njoints):
        joint = model.joints[index]
        if joint.nq == joint.nv == 1:
            measured = METRE if joint.shortname().startswith("JointModelP") else RADIAN
            joints[model.names[index]] = Joint(model.names[index], index, joint.idx_q, joint.idx_v, measured)
    return joints


def format_configuration(model: pin.Model, q: Array) -> str:
    """Return a configuration q, shape (nq,), as text such as ``track = 0.2 m, pivot = 30 deg``, for messages."""
    joints, words = joints_of(model), []
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        turns = name in joints and joints[name].unit == RADIAN
        own = np.degrees(q[joint.idx_q : joint.idx_q + joint.nq]) if turns else q[joint.idx_q : joint.idx_q + joint.nq]
        values = " ".join(f"{number:.6g}" for number in own)
        measured = "deg" if turns else joints[name].unit if name in joints else ""
        words.append(f"{name} = {values} {measured}" if name in joints else f"{name} = ({values})")
    return ", ".join(words)


def links_of(model: pin.Model) -> list[str]:
    """Return the names of the links of a model."""
    return [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]


@cached_by_model
def links_behind(model: pin.Model) -> list[list[str]]:
    """Return the links that are fixed to each other behind every joint, by its index; 0 is the world."""
    links: list[list[str]] = [[] for _ in range(model.njoints)]
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            links[frame.parentJoint].append(str(frame.name))
    return links


def moved_links(model: pin.Model, joint: int) -> list[str]:
    """Return the links that are fixed to each other behind a joint, by its index; its own name where there are none."""
    return links_behind(model)[joint] or [str(model.names[joint])]


def frame_of(model: pin.Model, name: str) -> int:
    """Return the index of the frame of a link."""
    if (index := model.getFrameId(name, pin.FrameType.BODY)) < model.nframes:
        return int(index)
    expected, hint = choices(name, links_of(model))
    raise InputError(f"the model has no link '{name}'", expected=expected, hint=hint)


def frames_of(model: pin.Model, between: tuple[str, str]) -> tuple[int, int]:
    """Return the frame indices of two links; errors are located at the key ``between``."""
    with within("between", 0):
        first = frame_of(model, between[0])
    with within("between", 1):
        return first, frame_of(model, between[1])


def joint_of(joints: Mapping[str, Joint], name: str) -> Joint:
    """Return a joint by name."""
    if name not in joints:
        expected, hint = choices(name, joints)
        raise InputError(f"the model has no joint '{name}' with one coordinate", expected=expected, hint=hint)
    return joints[name]


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
        columns: Index in v of every joint, by name; all turn or all slide.
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
                raise InputError(
                    f"the axes of '{first}' and '{name}' are {how}: no link turns by their sum",
                    expected="joints about parallel axes of one sense",
                )

"""Bodies of a moving picture: their placements, points fixed to them, and springs, rods and cables between points.

Each joint of the model has one node, the body that it carries, placed in its parent's node by the joint's coordinate. A
revolute or prismatic joint is given by its axis and its values: between two rows the page turns and slides it exactly,
over any number of turns. Other joints are given by their placements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, distinct
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.kinematics import new_data
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint_rows import Constraint

SAMPLED = 100
"""Rows that give the extent of a motion."""

NodeKind = Literal["fixed", "turn", "slide", "pose"]

ConnectionKind = Literal["spring", "cylinder", "bushing", "rod", "cable", "loop", "slot"]

LOOPS: Mapping[str, ConnectionKind] = {"rod": "rod", "point_on_plane": "slot"}
"""Loop joints that have a mark of their own."""


class Node(ValueRecord, frozen=True):
    """The body that a joint carries. Node 0 is the world.

    Attributes:
        parent: Index of the node that it hangs from; -1 for the world itself.
        placement: Of the joint in that node.
        kind: What ``values`` are: angles about ``axis`` [rad], ways along it [m], or placements (x, y, z and a
            quaternion x, y, z, w).
        axis: In the joint's frame, shape (3,).
        values: Shape (rows,), or (rows, 7) for placements.
        carries: Whether it carries a link: of the simple joints that make up a floating one, only the last does.
    """

    parent: int
    placement: pin.SE3
    kind: NodeKind
    axis: Array
    values: Array
    carries: bool = True


class BodyPoint(ValueRecord, frozen=True):
    """A point that is fixed to a body: the body's node, and the place in it [m], shape (3,)."""

    node: int
    place: Array

    def plain(self) -> dict[str, Any]:
        return {"node": self.node, "point": np.asarray(self.place).tolist()}

    def path(self, places: Array) -> Array:
        """Return its positions in the world, shape (rows, 3), from placements of shape (rows, njoints, 4, 4)."""
        return np.asarray(places[:, self.node, :3, :3] @ self.place + places[:, self.node, :3, 3])


class Connection(ValueRecord, frozen=True):
    """A connection of two points.

    Its kind is a ``spring``, a ``cylinder`` (a damper, a constant force, or a strut, which pushes), a ``bushing``, a
    ``rod``, a straight part of a ``cable``, the mark of a ``loop`` joint, or the pin in a ``slot``.
    """

    kind: ConnectionKind
    ends: tuple[BodyPoint, BodyPoint]

    def lengths(self, places: Array) -> Array:
        """Return its lengths [m], shape (rows,), from placements of shape (rows, njoints, 4, 4)."""
        start, end = self.ends
        return np.asarray(np.linalg.norm(end.path(places) - start.path(places), axis=1))

    def plain(self, places: Array) -> dict[str, Any]:
        (start, end), lengths = self.ends, self.lengths(places)
        extremes = {"shortest": float(lengths.min()), "longest": float(lengths.max())}
        return {"kind": self.kind, "a": start.plain(), "b": end.plain(), **extremes}


def nodes_of(model: pin.Model, q: Array) -> list[Node]:
    """Return the nodes of a model, by joint index, for configurations of shape (rows, nq)."""
    data, still = new_data(model), np.zeros(3)
    carrying = {frame.parentJoint for frame in model.frames if frame.type == pin.FrameType.BODY}
    pin.computeJointJacobians(model, data, pin.neutral(model))
    nodes = [Node(-1, pin.SE3.Identity(), "fixed", still, np.zeros(0))]
    for index in range(1, model.njoints):
        joint, axis = model.joints[index], still
        kind: NodeKind = "pose"
        if joint.nq == joint.nv == 1:
            jacobian = np.asarray(pin.getJointJacobian(model, data, index, pin.LOCAL)).reshape(6, -1)
            linear, angular = jacobian[:, joint.idx_v].reshape(2, 3)
            if not (linear.any() and angular.any()):
                kind, axis = ("slide", linear) if linear.any() else ("turn", angular)
        values = np.ascontiguousarray(q[:, joint.idx_q]) if kind != "pose" else _placements(model, index, q)
        nodes.append(Node(model.parents[index], model.jointPlacements[index], kind, axis, values, index in carrying))
    return nodes


def _placements(model: pin.Model, joint: int, q: Array) -> Array:
    data, back = new_data(model), model.jointPlacements[joint].inverse()
    rows = np.empty((len(q), 7))
    for row, state in zip(rows, q, strict=True):
        pin.forwardKinematics(model, data, state)
        row[:] = pin.SE3ToXYZQUAT(back * data.liMi[joint])
    return rows


def placed(model: pin.Model, q: Array, most: int = SAMPLED) -> Array:
    """Return the placements of all joints in the world at some of the rows, shape (samples, njoints, 4, 4)."""
    data = new_data(model)
    chosen = q[distinct(np.linspace(0, len(q) - 1, most).round().astype(np.intp))]
    placements = np.empty((len(chosen), model.njoints, 4, 4))
    for row, state in zip(placements, chosen, strict=True):
        pin.forwardKinematics(model, data, state)
        row[:] = [place.homogeneous for place in data.oMi]
    return placements


def point_of(model: pin.Model, frame: int) -> BodyPoint:
    """Return the origin of a frame."""
    return BodyPoint(int(model.frames[frame].parentJoint), np.array(model.frames[frame].placement.translation))


def connections(mechanism: Mechanism, forces: Mapping[str, ForceElement]) -> list[Connection]:
    """Return springs, cylinders, bushings and cables among the forces, and loop joints."""
    elements: list[ForceElement | Constraint] = [*forces.values(), *mechanism.constraints]
    lines = list[Connection]()
    for kind, frames in map(_drawn_as, elements):
        points = [point_of(mechanism.model, frame) for frame in frames]
        lines += [Connection(kind, ends) for ends in pairwise(points)]
    return lines


def _drawn_as(element: ForceElement | Constraint) -> tuple[ConnectionKind, Sequence[int]]:
    """Return the kind and the frames of the connection that an element makes; no frames where it has no place."""
    if isinstance(element, LoopJoint):
        return LOOPS.get(element.kind, "loop"), (element.first, element.second)
    from pinarm.mechanics.forces.bushing import LinearBushing
    from pinarm.mechanics.forces.points import TautSpring, TwoPointSpring
    from pinarm.mechanics.loops.loop_joints import CableLoop

    if isinstance(element, TwoPointSpring):
        return "spring" if element.stiffness > 0.0 and element.force >= 0.0 else "cylinder", element.points
    if isinstance(element, LinearBushing):
        return "bushing", element.frames
    if isinstance(element, TautSpring | CableLoop):
        return "cable", element.path.frames
    return "rod", ()

"""Motion of the bodies: one node per joint, placed in its parent's node by the value of its coordinate.

A revolute or prismatic joint is given by its axis and its values, so that between two rows the page turns and slides it
exactly, over any number of turns. Other joints are given by their placements.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices, distinct
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.geometry.pinocchio_data import new_data
from pinarm.records import ValueRecord

MOST_ROWS = 2400
"""Rows in the page: forty seconds at sixty pictures a second; of more, evenly spaced ones are taken."""

SAMPLED = 100
"""Rows that give the extent of a motion."""

Kind = Literal["fixed", "turn", "slide", "pose"]


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
    kind: Kind
    axis: Array
    values: Array
    carries: bool = True


def rows_shown(run: Trajectory, extremes: list[Array], most: int = MOST_ROWS) -> Indices:
    """Return the rows that the page gets: all, or evenly spaced ones with all jumps and extremes.

    Args:
        run: The trajectory.
        extremes: Arrays whose smallest and largest value must be among them, each of shape (n,).
        most: How many, not counting those that must be.
    """
    n = len(run)
    if n <= most:
        return np.arange(n)
    ends = np.array(run.grid.rows)
    ends = np.concatenate([ends[:-1], ends[1:] - 1])
    peaks = [int(index) for values in extremes for index in (values.argmin(), values.argmax())]
    even = np.linspace(0, n - 1, most).round().astype(np.intp)
    return distinct(np.concatenate([even, ends[(ends >= 0) & (ends < n)], np.array(peaks, np.intp)]))


def nodes_of(model: pin.Model, q: Array) -> list[Node]:
    """Return the nodes of a model, by joint index.

    Args:
        model: Pinocchio's model.
        q: Configurations, shape (rows, nq).
    """
    data, still = new_data(model), np.zeros(3)
    carrying = {frame.parentJoint for frame in model.frames if frame.type == pin.FrameType.BODY}
    pin.computeJointJacobians(model, data, pin.neutral(model))
    nodes = [Node(-1, pin.SE3.Identity(), "fixed", still, np.zeros(0))]
    for index in range(1, model.njoints):
        joint, axis = model.joints[index], still
        kind: Kind = "pose"
        if joint.nq == joint.nv == 1:
            jacobian = np.asarray(pin.getJointJacobian(model, data, index, pin.LOCAL)).reshape(6, -1)
            kind, axis = _axis(jacobian[:, joint.idx_v])
        values = q[:, joint.idx_q] if kind != "pose" else _placements(model, index, q)
        values = np.ascontiguousarray(values)
        nodes.append(Node(model.parents[index], model.jointPlacements[index], kind, axis, values, index in carrying))
    return nodes


def _axis(column: Array) -> tuple[Kind, Array]:
    """Return the kind and the axis of a joint with one coordinate, from its Jacobian in its own frame."""
    linear, angular = column[:3], column[3:]
    if not linear.any():
        return "turn", angular
    return ("slide", linear) if not angular.any() else ("pose", np.zeros(3))


def _placements(model: pin.Model, joint: int, q: Array) -> Array:
    """Return a joint's own placement at every row, shape (rows, 7)."""
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
    places = [data.oMi[joint] for joint in range(model.njoints)]
    for row, state in zip(placements, chosen, strict=True):
        pin.forwardKinematics(model, data, state)
        row[:] = [place.homogeneous for place in places]
    return placements

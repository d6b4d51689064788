"""Placements and motions of all links at many configurations, and transformations of wrenches on them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices
from pinarm.mechanics.geometry.vectors import crossed


@dataclass(frozen=True, eq=False)
class LinkPlacements:
    """World placements of the joint frames, one for each link, at n configurations.

    Attributes:
        model: Pinocchio's model.
        turns: Rotation matrices R, columns are the joint axes in world axes, shape (n, njoints, 3, 3).
        places: Origins p in the world [m], shape (n, njoints, 3).
    """

    model: pin.Model = field(repr=False)
    turns: Array
    places: Array

    @classmethod
    def at(cls, model: pin.Model, q: Array) -> LinkPlacements:
        """Return the placements at configurations, shape (n, nq)."""
        data, shape = model.createData(), (len(q), model.njoints)
        turns, places = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
        for k, configuration in enumerate(q):
            pin.forwardKinematics(model, data, configuration)
            joints = data.oMi.tolist()
            turns[k], places[k] = [joint.rotation for joint in joints], [joint.translation for joint in joints]
        return cls(model, turns, places)

    def some(self, rows: Indices) -> LinkPlacements:
        """Return the placements at some of the configurations."""
        return LinkPlacements(self.model, self.turns[rows], self.places[rows])

    def frame(self, index: int) -> tuple[Array, Array]:
        """Return the rotation matrices, shape (n, 3, 3), and the origins [m], shape (n, 3), of a frame of the model."""
        frame = self.model.frames[index]
        turn, place = self.turns[:, frame.parentJoint], self.places[:, frame.parentJoint]
        return turn @ frame.placement.rotation, place + turn @ frame.placement.translation

    def inwards(self, wrenches: Array) -> Array:
        """Return wrenches [f; m] in link frames from those at the world origin: ``R^T f``, ``R^T (m - p x f)``.

        Shape (n, njoints, 6).
        """
        forces = wrenches[..., :3]
        return self._turned(forces, wrenches[..., 3:] - crossed(self.places, forces), self.turns.swapaxes(-1, -2))

    def outwards(self, wrenches: Array) -> Array:
        """Return wrenches [f; m] at the joint origins in world axes from those in link axes, shape (n, njoints, 6)."""
        return self._turned(wrenches[..., :3], wrenches[..., 3:], self.turns)

    def at_world(self, wrenches: Array) -> Array:
        """Return wrenches [f; m] at the world origin from those in link frames: ``R f``, ``R m + p x R f``.

        Shape (.., n, njoints, 6).
        """
        forces, moments = np.matvec(self.turns, wrenches[..., :3]), np.matvec(self.turns, wrenches[..., 3:])
        return np.concatenate([forces, moments + crossed(self.places, forces)], axis=-1)

    def _turned(self, forces: Array, moments: Array, turns: Array) -> Array:
        return np.concatenate([np.matvec(turns, forces), np.matvec(turns, moments)], axis=-1)


def moving(model: pin.Model, q: Array, v: Array, a: Array) -> tuple[LinkPlacements, Array, Array, Array]:
    """Return the placements of links, their twists, the time derivatives of these, and the world Jacobian.

    Args:
        model: Pinocchio's model.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        a: Accelerations, shape (n, nv).

    Returns:
        The placements; twists and their derivatives in link frames, each of shape (n, njoints, 6); and the columns of
        the joints as twists in the world frame, shape (n, 6, nv).
    """
    data, shape = model.createData(), (len(q), model.njoints)
    turns, places = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
    twists, rates, columns = np.empty((*shape, 6)), np.empty((*shape, 6)), np.empty((len(q), 6, model.nv))
    for k, (configuration, velocity, acceleration) in enumerate(zip(q, v, a, strict=True)):
        pin.computeJointJacobians(model, data, configuration)
        pin.forwardKinematics(model, data, configuration, velocity, acceleration)
        joints, columns[k] = data.oMi.tolist(), data.J.reshape(6, -1)
        turns[k], places[k] = [joint.rotation for joint in joints], [joint.translation for joint in joints]
        twists[k], rates[k] = (
            [motion.vector for motion in data.v.tolist()],
            [motion.vector for motion in data.a.tolist()],
        )
    return LinkPlacements(model, turns, places), twists, rates, columns


def supports(model: pin.Model) -> Flags:
    """Return which velocities move which links, shape (njoints, nv): row j is true for all joints up to joint j."""
    moves = np.zeros((model.njoints, model.nv), dtype=bool)
    for k, (parent, joint) in enumerate(zip(model.parents, model.joints, strict=True)):
        if k:
            moves[k] = moves[parent]
            moves[k, joint.idx_v : joint.idx_v + joint.nv] = True
    return moves

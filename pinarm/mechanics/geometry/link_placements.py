"""Where the links of a mechanism are, and how they move, at many configurations."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices
from pinarm.mechanics.geometry.vectors import crossed


@dataclass(frozen=True, eq=False)
class LinkPlacements:
    """The placements of the joints' frames in the world, one of each link, at n configurations.

    Attributes:
        model: Pinocchio's model.
        turns: Rotation matrices, columns the axes of the joints, shape (n, njoints, 3, 3).
        places: Origins [m], shape (n, njoints, 3).
    """

    model: pin.Model = field(repr=False)
    turns: Array
    places: Array

    @classmethod
    def at(cls, model: pin.Model, q: Array) -> LinkPlacements:
        """Return the placements at configurations, shape (n, nq)."""
        data, shape = model.createData(), (len(q), model.njoints)
        turns, places = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
        for k, one in enumerate(q):
            pin.forwardKinematics(model, data, one)
            joints = data.oMi.tolist()
            turns[k], places[k] = [joint.rotation for joint in joints], [joint.translation for joint in joints]
        return cls(model, turns, places)

    def some(self, rows: Indices) -> LinkPlacements:
        """Return the placements at some of the configurations."""
        return LinkPlacements(self.model, self.turns[rows], self.places[rows])

    def frame(self, index: int) -> tuple[Array, Array]:
        """Return the rotation matrices, shape (n, 3, 3), and the origins, shape (n, 3), of a frame."""
        one = self.model.frames[index]
        turn, place = self.turns[:, one.parentJoint], self.places[:, one.parentJoint]
        return turn @ one.placement.rotation, place + turn @ one.placement.translation

    def inwards(self, wrenches: Array) -> Array:
        """Return wrenches on the links in their own frames, shape (n, njoints, 6), from those at the world's origin."""
        forces = wrenches[..., :3]
        return self._turned(forces, wrenches[..., 3:] - crossed(self.places, forces), self.turns.swapaxes(-1, -2))

    def outwards(self, wrenches: Array) -> Array:
        """Return wrenches at the joints' origins in world axes, shape (n, njoints, 6), from those in their own."""
        return self._turned(wrenches[..., :3], wrenches[..., 3:], self.turns)

    def at_world(self, wrenches: Array) -> Array:
        """Return wrenches at the world's origin, shape (.., n, njoints, 6), from those in the links' own frames."""
        forces, moments = np.matvec(self.turns, wrenches[..., :3]), np.matvec(self.turns, wrenches[..., 3:])
        return np.concatenate([forces, moments + crossed(self.places, forces)], axis=-1)

    def _turned(self, forces: Array, moments: Array, turns: Array) -> Array:
        return np.concatenate([np.matvec(turns, forces), np.matvec(turns, moments)], axis=-1)


def moving(model: pin.Model, q: Array, v: Array, a: Array) -> tuple[LinkPlacements, Array, Array, Array]:
    """Return where links are, their twists, the rates of these, and the Jacobian, by forward kinematics.

    Args:
        model: Pinocchio's model.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        a: Accelerations, shape (n, nv).

    Returns:
        The links; their twists and rates in their own frames, each of shape (n, njoints, 6); and the columns of all
        joints, twists in the world's frame, shape (n, 6, nv).
    """
    data, shape = model.createData(), (len(q), model.njoints)
    turns, places = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
    twists, rates, columns = np.empty((*shape, 6)), np.empty((*shape, 6)), np.empty((len(q), 6, model.nv))
    for k, (one, velocity, acceleration) in enumerate(zip(q, v, a, strict=True)):
        pin.computeJointJacobians(model, data, one)
        pin.forwardKinematics(model, data, one, velocity, acceleration)
        joints, columns[k] = data.oMi.tolist(), data.J.reshape(6, -1)
        turns[k], places[k] = [joint.rotation for joint in joints], [joint.translation for joint in joints]
        twists[k], rates[k] = [one.vector for one in data.v.tolist()], [one.vector for one in data.a.tolist()]
    return LinkPlacements(model, turns, places), twists, rates, columns


def supports(model: pin.Model) -> Flags:
    """Return which velocities move which links, shape (njoints, nv)."""
    found = np.zeros((model.njoints, model.nv), dtype=bool)
    for k, (parent, joint) in enumerate(zip(model.parents, model.joints, strict=True)):
        if k:
            found[k] = found[parent]
            found[k, joint.idx_v : joint.idx_v + joint.nv] = True
    return found

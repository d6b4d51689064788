"""Placements and motions of all links at many configurations, and transformations of wrenches on them."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.mechanics.geometry.link_tree import LinkTree, components_first, states_first, turned
from pinarm.mechanics.geometry.model_variants import Model
from pinarm.mechanics.geometry.vectors import cross, crossed, joined, rotated
from pinarm.records import Record


class LinkPlacements(Record, frozen=True):
    """World placements of the joint frames, one for each link, at n configurations.

    Attributes:
        model: Pinocchio's model, or variants of one.
        turns: Rotation matrices R, columns are the joint axes in world axes, shape (n, njoints, 3, 3).
        places: Origins p in the world [m], shape (n, njoints, 3). Of variants there is an axis after the first, of
            length 1 where they are alike; see ``link_tree``.
        q: The configurations, shape (n, nq): they tell whole turns of a joint, too.
    """

    model: Model
    turns: Array
    places: Array
    q: Array

    @classmethod
    def at(cls, model: Model, q: Array) -> LinkPlacements:
        """Return the placements at configurations, shape (n, nq)."""
        tree, still = LinkTree.of(model), np.zeros((*q.shape[:-1], model.nv))
        relative = tree.relative(model, q, still)
        turns = tree.multiplied(relative.turns)
        places = tree.summed(turned(turns.take(tree.parents, axis=2), relative.arms))
        return cls(model, states_first(turns, 3), states_first(places), q)

    def some(self, rows: Indices) -> LinkPlacements:
        """Return the placements at some of the configurations."""
        return LinkPlacements(self.model, self.turns[rows], self.places[rows], self.q[rows])

    def frame(self, index: int) -> tuple[Array, Array]:
        """Return the rotation matrices, shape (n, 3, 3), and the origins [m], shape (n, 3), of a frame of the model."""
        frame = self.model.frames[index]
        turn, place = self.turns[..., frame.parentJoint, :, :], self.places[..., frame.parentJoint, :]
        rotation, along = frame.placement.rotation, rotated(turn, frame.placement.translation)
        return turn if (rotation == np.eye(3)).all() else turn @ rotation, place + along

    def inwards(self, wrenches: Array) -> Array:
        """Return wrenches [f; m] in link frames from those at the world origin: ``R^T f``, ``R^T (m - p x f)``.

        Shape (n, njoints, 6).
        """
        return _rotated(self.turns.swapaxes(-1, -2), self.at_joints(wrenches))

    def outwards(self, wrenches: Array) -> Array:
        """Return wrenches [f; m] at the joint origins in world axes from those in link axes, shape (n, njoints, 6)."""
        return _rotated(self.turns, wrenches)

    def at_joints(self, wrenches: Array) -> Array:
        """Return wrenches [f; m] at the joint origins from those at the world origin, both in world axes."""
        forces = wrenches[..., :3]
        return joined(forces, wrenches[..., 3:] - crossed(self.places, forces))

    def at_world(self, wrenches: Array) -> Array:
        """Return wrenches [f; m] at the world origin from those in link frames: ``R f``, ``R m + p x R f``.

        Shape (.., n, njoints, 6).
        """
        turned = _rotated(self.turns, wrenches)
        turned[..., 3:] += crossed(self.places, turned[..., :3])
        return turned


def _rotated(turns: Array, wrenches: Array) -> Array:
    """Return ``[R f; R m]`` of wrenches [f; m] along the last axis."""
    found = rotated(turns[..., None, :, :], wrenches.reshape(*wrenches.shape[:-1], 2, 3))
    return found.reshape(*found.shape[:-2], 6)


def moving(model: Model, q: Array, v: Array, a: Array) -> tuple[LinkPlacements, Array, Array, Array]:
    """Return the placements of links, their twists, the time derivatives of these, and the world Jacobian.

    From the parent p to the link, over the arm r in world axes, with the joint's motion ``[d; w] = S v`` and
    ``[d'; w'] = S a + c`` turned to world axes:

        omega = omega_p + w,    alpha = alpha_p + w' + omega_p x w
        u = u_p + omega_p x r + d,    u' = u_p' + alpha_p x r + omega_p x (omega_p x r) + (omega_p + omega) x d + d'

    u being the velocity of the link's origin; the derivative of its twist is ``[u' - omega x u; alpha]``. The simple
    route to the same numbers is Pinocchio's ``forwardKinematics``, state by state.

    Args:
        model: Pinocchio's model.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        a: Accelerations, shape (n, nv).

    Returns:
        The placements; twists and their derivatives in link frames, each of shape (n, njoints, 6); and the columns of
        the joints as twists in the world frame, shape (n, 6, nv).
    """
    tree = LinkTree.of(model)
    relative = tree.relative(model, q, v)
    turns = tree.multiplied(relative.turns)
    arms = turned(turns.take(tree.parents, axis=2), relative.arms)
    places = tree.summed(arms)
    d, w = _turned(turns, tree.motions(relative, v))
    dd, dw = _turned(turns, tree.motions(relative, a) + components_first(relative.biases))
    omega = tree.summed(w)
    before = omega.take(tree.parents, axis=1)
    swept = cross(before, arms)
    u, alpha = tree.summed(swept + d), tree.summed(dw + cross(before, w))
    du = tree.summed(
        cross(alpha.take(tree.parents, axis=1), arms) + cross(before, swept) + cross(before + omega, d) + dd
    )
    inwards = turns.swapaxes(0, 1)
    twists, rates = (
        states_first(np.concatenate([turned(inwards, linear), turned(inwards, angular)]))
        for linear, angular in ((u, omega), (du - cross(omega, u), alpha))
    )
    links = LinkPlacements(model, states_first(turns, 3), states_first(places), q)
    return links, twists, rates, _columns(tree, turns, places, relative.subspaces)


def _turned(turns: Array, motions: Array) -> tuple[Array, Array]:
    """Return the linear and the angular part of motions in link axes, shape (6, njoints, n), in world axes."""
    found = turned(turns[:, :, None], motions.reshape(2, 3, *motions.shape[1:]).swapaxes(0, 1))
    return found[:, 0], found[:, 1]


def _columns(tree: LinkTree, turns: Array, places: Array, subspaces: Array) -> Array:
    """Return the columns S of all velocities as twists in the world frame, shape (n, 6, nv)."""
    states = range(subspaces.ndim - 2)
    columns = subspaces.transpose(-2, -1, *states)
    d, w = _turned(turns[:, :, tree.moved], columns)
    found = np.concatenate([d + cross(places[:, tree.moved], w), w])
    return np.ascontiguousarray(found.transpose(*(2 + k for k in states), 0, 1))

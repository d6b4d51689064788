"""Placements and motions of all links at many configurations, and transformations of wrenches on them."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.mechanics.geometry.link_tree import LinkTree, components_first, states_first, turned
from pinarm.mechanics.geometry.model_variants import Model
from pinarm.mechanics.geometry.vectors import cross, crossed, joined, moved, rotated
from pinarm.records import Record


class LinkPlacements(Record, frozen=True):
    """World placements of the joint frames, one for each link, at n configurations.

    Attributes:
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
        tree = LinkTree.of(model)
        turns, arms = tree.placed(q)
        return cls(model, states_first(turns, 3), states_first(tree.summed(arms)), q)

    def some(self, rows: Indices) -> LinkPlacements:
        return LinkPlacements(self.model, self.turns[rows], self.places[rows], self.q[rows])

    def frame(self, index: int) -> tuple[Array, Array]:
        """Return the rotation matrices, shape (n, 3, 3), and the origins [m], shape (n, 3), of a frame of the model."""
        frame = self.model.frames[index]
        turn, place = self.turns[..., frame.parentJoint, :, :], self.places[..., frame.parentJoint, :]
        rotation, along = frame.placement.rotation, rotated(turn, np.asfortranarray(frame.placement.translation))
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

    def demands(self, twists: Array, rates: Array) -> Array:
        """Return the wrenches that the motion of every link requires (Newton-Euler equations), in the link's own frame.

        Args:
            twists: V of the links, in their own frames, shape (n, njoints, 6).
            rates: V', likewise.

        Returns:
            ``I V'``, ``V x* I V`` and the wrench against the weight, shape (3, n, njoints, 6).
        """
        turns, twist, rate = components_first(self.turns, 3), components_first(twists), components_first(rates)
        motions = np.zeros((3, *twist.shape), twist.dtype)
        motions[0], motions[1], motions[2, :3] = rate, twist, turned(turns.swapaxes(0, 1), -self.model.gravity.linear)
        wrenches = LinkTree.of(self.model).momenta(motions)
        linear, v, omega = wrenches[1, :3], twist[:3], twist[3:]
        dragged = cross(v, linear)
        wrenches[1, :3], wrenches[1, 3:] = cross(omega, linear), cross(omega, wrenches[1, 3:]) + dragged
        return wrenches.transpose(0, *range(3, wrenches.ndim), 2, 1)

    def momenta(self, twists: Array) -> Array:
        """Return ``I V`` in link axes, about the origins of the links, shape (n, .., njoints, 6)."""
        (momenta,) = LinkTree.of(self.model).momenta(components_first(twists)[None])
        return states_first(momenta)

    def energies(self, twists: Array) -> tuple[Array, Array]:
        """Return the kinetic and the potential energy of every link [J], shape (n, .., njoints), without rotors.

        Args:
            twists: V, in the links' own frames, shape (n, .., njoints, 6).
        """
        tree = LinkTree.of(self.model)
        kinetic = 0.5 * (twists * self.momenta(twists)).sum(axis=-1)
        centres = self.places + rotated(self.turns, tree.levers)
        return np.asarray(kinetic), np.asarray(-tree.masses * (centres @ self.model.gravity.linear))

    def gravity_power(self, twists: Array) -> Array:
        """Return the power of the weights of all links [W], shape (n, ..), from V in the links' own frames."""
        momenta = rotated(self.turns, self.momenta(twists)[..., :3])
        return np.asarray(momenta.sum(axis=-2) @ self.model.gravity.linear)


def opposed(model: Model, first: int, second: int, wrench: Array) -> dict[int, Array]:
    """Return a wrench on the link of the second frame and its opposite on the link of the first, by joint index.

    Empty where both frames are on one link, inside which the wrenches balance.
    """
    child, other = (model.frames[frame].parentJoint for frame in (first, second))
    return {} if child == other else {child: -wrench, other: wrench}


def _rotated(turns: Array, wrenches: Array) -> Array:
    """Return ``[R f; R m]`` of wrenches [f; m] along the last axis."""
    turned = rotated(turns[..., None, :, :], wrenches.reshape(*wrenches.shape[:-1], 2, 3))
    return turned.reshape(*turned.shape[:-2], 6)


def moving(model: Model, q: Array, v: Array, a: Array) -> tuple[LinkPlacements, Array, Array, Array]:
    """Return the placements of links, their twists, the time derivatives of these, and the world Jacobian.

    From the parent p to the link, over the arm r in world axes, with the joint's motion ``[d; w] = S v`` and
    ``[d'; w'] = S a + c`` turned to world axes:

        omega = omega_p + w,    alpha = alpha_p + w' + omega_p x w
        u = u_p + omega_p x r + d,    u' = u_p' + alpha_p x r + omega_p x (omega_p x r) + (omega_p + omega) x d + d'

    u being the velocity of the link's origin; the derivative of its twist is ``[u' - omega x u; alpha]``. The simple
    route to the same numbers is Pinocchio's ``forwardKinematics``, state by state.

    Args:
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        a: Accelerations, shape (n, nv).

    Returns:
        The placements; twists and their derivatives in link frames, each of shape (n, njoints, 6); and the columns of
        the joints as twists in the world frame, shape (n, 6, nv).
    """
    tree = LinkTree.of(model)
    turns, arms = tree.placed(q)
    columns, places = tree.columns(turns), tree.summed(arms)
    d, w, dd, dw = (tree.along(part, rates) for rates in (v, a) for part in columns)
    omega = tree.summed(w)
    before = omega.take(tree.parents, axis=1)
    swept = cross(before, arms)
    u, alpha = tree.summed(swept + d), tree.summed(dw + cross(before, w))
    swinging = cross(alpha.take(tree.parents, axis=1), arms)
    du = tree.summed(swinging + cross(before, swept) + cross(before + omega, d) + dd)
    links = LinkPlacements(model, states_first(turns, 3), states_first(places), q)
    twists, rates = _inwards(turns, u, omega), _inwards(turns, du - cross(omega, u), alpha)
    linear, angular = columns
    world = np.concatenate([linear + cross(places.take(tree.moved, axis=1), angular), angular])
    return links, twists, rates, world.transpose(*range(2, world.ndim), 0, 1)


def speeding(model: Model, q: Array, v: Array) -> tuple[LinkPlacements, Array]:
    """Return the placements of links and their twists in link frames, shape (n, njoints, 6); see ``moving``."""
    return moving(model, q, v, np.zeros_like(v))[:2]


def transmitted(links: LinkPlacements, q: Array, v: Array, a: Array, acting: Array) -> Array:
    """Return the wrench of the parent on the child at every joint's origin, world axes, shape (n, .., njoints, 6).

    It is the sum of what the motion of the link and of those beyond it demands, less what else acts on them.

    Args:
        q: Configurations, shape (n, .., nq).
        v: Velocities, shape (n, .., nv).
        a: Accelerations, shape (n, .., nv).
        acting: Wrenches [f; m] on the links about the world's origin, world axes, shape (n, .., njoints, 6).
    """
    _, twists, rates, _ = moving(links.model, q, v, a)
    wrenches = links.outwards(links.demands(twists, rates).sum(axis=0)) - links.at_joints(acting)
    parents = LinkTree.of(links.model).parents
    arms = links.places - links.places[..., parents, :]
    for link in range(len(parents) - 1, 0, -1):
        wrenches[..., parents[link], :] += moved(wrenches[..., link, :], arms[..., link, :])
    wrenches[..., 0, :] = 0.0  # of the world, not of a joint
    return wrenches


def _inwards(turns: Array, linear: Array, angular: Array) -> Array:
    """Return motions in link frames from those in world axes, shape (3, njoints, n), as (n, njoints, 6)."""
    inwards, parts = turns.swapaxes(0, 1), np.empty((6, *linear.shape[1:]), linear.dtype)
    for part, motions in ((parts[:3], linear), (parts[3:], angular)):
        np.einsum("ab...,b...->a...", inwards, motions, out=part)
    return states_first(parts)

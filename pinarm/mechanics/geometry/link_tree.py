"""A tree of links as arrays, from which placements and motions of all links at many configurations are computed.

Sums and products along the path from the world to each link take ``log2`` of its length in steps: to the sum over the
last ``2^k`` joints that of the ``2^k`` before them is added, for all links at once.

States are rows, shape (n, nq). For variants of a tree (``variants.ModelVariants``) a second axis stands after the rows,
states of shape (n, k, nq) or (n, 1, nq) where all move alike; what differs between variants has it as its first axis,
shape (k, ...), and numpy spreads one over the other. So everything here and in ``link_placements`` holds for both.

While they are summed and multiplied, vectors and matrices have their components first and the states last: numpy takes
long rows of numbers some ten times as fast as vectors of three.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.model_variants import Model, bodies_of, placements_of
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.records import Record


class SingleJoints(Record, frozen=True):
    """The joints with one coordinate, which turn about an axis, slide along it, or both.

    Attributes:
        links: Their links, shape (k,).
        q: Their coordinates in q, shape (k,).
        constant: C0 in the rotation ``C0 + cos(q) C1 + sin(q) C2`` to the parent's axes, shape (.., k, 3, 3).
        cosine: C1, shape (k, 3, 3).
        sine: C2, shape (k, 3, 3).
        shift: Place of the joint in the axes of its parent [m], shape (k, 3).
        slide: How far it moves the link per unit of its coordinate, in the axes of the parent, shape (k, 3).
    """

    links: Indices
    q: Indices
    constant: Array
    cosine: Array
    sine: Array
    shift: Array
    slide: Array


class RelativeMotion(Record, frozen=True):
    """Every link seen from its parent, at n configurations.

    Attributes:
        turns: Rotation matrices, columns are the link's axes in those of its parent, shape (3, 3, njoints, n).
        arms: Origins in the axes of the parent [m], shape (3, njoints, n).
        subspaces: S, what unit velocities do to the link, in its own axes, shape (n, 6, nv), or (1, 6, nv) where that
            is the same everywhere.
        biases: Accelerations for ``a = 0``, in the link's own axes, shape (n, njoints, 6) or (1, njoints, 6).
    """

    turns: Array
    arms: Array
    subspaces: Array
    biases: Array


class LinkTree(Record, frozen=True):
    """What is the same of a tree of links at all configurations.

    Attributes:
        parents: Index of the parent of every link; that of the world is the world itself, shape (njoints,).
        jumps: The ancestors 1, 2, 4, ... joints before every link, as far as there are any, each of shape (njoints,).
        moved: Link that every velocity moves first, shape (nv,).
        starts: First velocity of every joint, shape (njoints - 1,).
        single: The joints with one coordinate.
        others: Indices of the others.
        subspace: S of the joints with one coordinate, 0 of others, shape (6, nv).
        masses: Of the links [kg], shape (njoints,), of variants (k, njoints).
        levers: Their centres of mass in link axes [m], shape (njoints, 3), of variants (k, njoints, 3).
        inertias: Their spatial inertias in link axes, 0 of the world, shape (njoints, 6, 6), of variants (k, ...).
    """

    parents: Indices
    jumps: tuple[Indices, ...]
    moved: Indices
    starts: Indices
    single: SingleJoints
    others: tuple[int, ...]
    subspace: Array
    masses: Array
    levers: Array
    inertias: Array

    @classmethod
    def of(cls, model: Model) -> LinkTree:
        """Return the tree of a model, or of variants of one, whose joints and inertias do not change any more."""
        return _tree(model)

    @cached_property
    def supports(self) -> Flags:
        """Which velocities move which links, shape (njoints, nv): row j is true for all joints up to joint j."""
        return self.moves(np.arange(len(self.moved)))

    @cached_property
    def mass(self) -> Array:
        """Mass of all links [kg], shape (), of variants (k,)."""
        return np.asarray(self.masses.sum(axis=-1))

    def moves(self, velocities: Indices) -> Flags:
        """Return which of k velocities move which links, shape (njoints, k)."""
        moves = np.zeros((len(self.parents), len(velocities)), dtype=bool)
        moves[self.moved[velocities], np.arange(len(velocities))] = True
        for jump in self.jumps:
            moves |= moves[jump]
        return moves

    def momenta(self, motions: Array) -> Array:
        """Return ``I V`` in link axes, of motions of shape (k, 6, njoints, ..)."""
        inertias = states_last(self.inertias, motions.ndim - 3, 3)
        if motions.ndim == 4:  # of one mechanism: its states are few, so that one call is the fastest
            return np.asarray(np.einsum("ab...,kb...->ka...", inertias, motions))
        found = np.zeros((*motions.shape[:3], *np.broadcast_shapes(motions.shape[3:], inertias.shape[3:])))
        part, every = np.empty_like(found[:, 0]), tuple(range(self.inertias.ndim - 2))
        for a, b in np.argwhere(self.inertias.any(axis=every)).tolist():  # in the plane most of them are 0
            found[:, a] += np.multiply(inertias[a, b], motions[:, b], out=part)
        return found

    def summed(self, x: Array) -> Array:
        """Return the sums over the paths from the world to every link, whose own term is 0; shape (3, njoints, ..)."""
        for jump in self.jumps:
            x = x + x.take(jump, axis=1)
        return x

    def carried(self, x: Array) -> Array:
        """Return the sums over every link and those beyond it, 0 of the world; shape (.., njoints, w)."""
        total = x.copy(order="K")
        for link in range(len(self.parents) - 1, 0, -1):
            total[..., self.parents[link], :] += total[..., link, :]
        total[..., 0, :] = 0.0
        return total

    def multiplied(self, turns: Array) -> Array:
        """Return the products of rotations along these paths; that of the world is 1; shape (3, 3, njoints, ..)."""
        for jump in self.jumps:
            turns = np.einsum("ab...,bc...->ac...", turns.take(jump, axis=2), turns)
        return turns

    def along(self, columns: Array, x: Array) -> Array:
        """Return the sums of columns times velocities over those of every joint, 0 of the world.

        (3, nv, ..) and (.., nv) to (3, njoints, ..).
        """
        each = columns * components_first(x, 1)
        found = np.zeros((3, len(self.parents), *each.shape[2:]))
        found[:, 1:] = np.add.reduceat(each, self.starts, axis=1) if self.others else each
        return found

    def relative(self, model: Model, q: Array, v: Array) -> RelativeMotion:
        """Return how every link is placed and moves with respect to its parent, in states, (.., nq) and (.., nv)."""
        n, count, one, rank = len(q), len(self.parents), self.single, q.ndim - 1
        along = np.ascontiguousarray(components_first(q, 1)[one.q])
        constant, cosine, sine = (states_last(x, rank, 3) for x in (one.constant, one.cosine, one.sine))
        shift, slide = (states_last(x, rank, 2) for x in (one.shift, one.slide))
        turned = constant + np.cos(along) * cosine + np.sin(along) * sine
        shifted = shift + along * slide
        states = turned.shape[3:]
        if states != shifted.shape[2:]:
            states = np.broadcast_shapes(states, shifted.shape[2:])
        turns, arms = np.zeros((3, 3, count, *states)), np.zeros((3, count, *states))
        turns[0, 0, 0] = turns[1, 1, 0] = turns[2, 2, 0] = 1.0
        turns[:, :, one.links] = turned
        arms[:, one.links] = shifted
        if not self.others:
            alike = (1,) * rank
            return RelativeMotion(turns, arms, self.subspace.reshape(*alike, 6, -1), np.zeros((*alike, count, 6)))
        motion = RelativeMotion(turns, arms, np.tile(self.subspace, (n, 1, 1)), np.zeros((n, count, 6)))
        for k in self.others:
            BY_KIND.get(model.joints[k].shortname(), _add_joint)(motion, model, k, q, v)
        return motion


def turned(turns: Array, vectors: Array) -> Array:
    """Return ``R x``, shapes (3, 3, ..) and (3, ..)."""
    return np.asarray(np.einsum("ab...,b...->a...", turns, vectors))


def states_last(x: Array, rank: int, tail: int) -> Array:
    """Return an array of links, shape (.., links, 3 or 3, 3), with components first, spread over states of a rank.

    Args:
        x: Vectors or matrices, with k variants in place of the dots, or nothing.
        rank: Number of axes of the states.
        tail: Number of axes behind the dots.
    """
    first = components_first(x, tail)
    return first.reshape(*first.shape[:tail], *(1,) * (rank - first.ndim + tail), *first.shape[tail:])


def components_first(x: Array, tail: int = 2) -> Array:
    """Return an array of shape (.., links, w) or (.., links, w, w) as (w, links, ..) or (w, w, links, ..).

    With a tail of 1 states, shape (.., nv), become (nv, ..).
    """
    lead = x.ndim - tail
    return x.transpose(*range(lead + 1, x.ndim), lead, *range(lead))


def components_far(x: Array, tail: int = 2) -> Array:
    """Return the same array, laid out in memory component by component, as those of many states are."""
    return states_first(np.ascontiguousarray(components_first(x, tail)), tail)


def states_first(x: Array, tail: int = 2) -> Array:
    """Return an array of shape (w, links, ..) or (w, w, links, ..) as (.., links, w) or (.., links, w, w)."""
    return x.transpose(*range(tail, x.ndim), tail - 1, *range(tail - 1))


@cached_by_model
def _tree(model: Model) -> LinkTree:
    joints, parents = model.joints.tolist(), np.array(model.parents.tolist())
    single = [k for k, joint in enumerate(joints) if k and joint.nq == joint.nv == 1]
    subspace, zero = np.zeros((6, model.nv)), np.zeros(model.nq)  # S of a single joint is the same at all coordinates
    for k in single:
        data = joints[k].createData()
        joints[k].calc(data, zero)
        subspace[:, joints[k].idx_v] = data.S
    jumps, ahead = [], parents
    while ahead.any():
        jumps.append(ahead)
        ahead = ahead[ahead]
    counts = np.array([joint.nv for joint in joints[1:]], dtype=np.intp)
    masses, levers, inertias = map(np.asfortranarray, bodies_of(model))  # the variants last in memory, as states are
    inertias[..., 0, :, :] = 0.0
    levers, inertias = components_far(levers), components_far(inertias, 3)
    return LinkTree(
        parents, tuple(jumps), np.repeat(np.arange(1, len(joints)), counts), np.cumsum(counts) - counts,
        _single(model, single, subspace), tuple(k for k in range(1, len(joints)) if k not in set(single)),
        subspace, masses, levers, inertias,
    )  # fmt: skip


def _single(model: Model, links: list[int], subspace: Array) -> SingleJoints:
    """Return the joints of links, with the rotation by Rodrigues' formula, ``u u^T + cos (1 - u u^T) + sin [u]x``."""
    turns, shifts = placements_of(model)
    turns, joints = turns[..., links, :, :], [model.joints[k] for k in links]
    columns = subspace[:, [joint.idx_v for joint in joints]].T
    axes = columns[:, 3:]
    still = np.where(np.asarray(axes.any(axis=1))[:, None, None], 0.0, np.eye(3))
    along = axes[:, :, None] * axes[:, None]
    across = np.eye(3) - along - still
    crossing = crossed(axes[:, None], np.eye(3)).swapaxes(1, 2)
    return SingleJoints(
        np.array(links, dtype=np.intp), np.array([joint.idx_q for joint in joints], dtype=np.intp),
        turns @ (along + still), turns @ across, turns @ crossing,
        shifts[..., links, :], np.matvec(turns, columns[:, :3]),
    )  # fmt: skip


def _add_floating(motion: RelativeMotion, model: pin.Model, k: int, q: Array, v: Array) -> None:
    """Set the motion of a link that floats."""
    joint, place = model.joints[k], model.jointPlacements[k]
    shift, quaternion = np.split(q[:, joint.idx_q : joint.idx_q + joint.nq], [3], axis=1)
    motion.turns[:, :, k] = (place.rotation @ _rotations(quaternion)).transpose(1, 2, 0)
    motion.arms[:, k] = place.translation[:, None] + place.rotation @ shift.T
    motion.subspaces[:, :, joint.idx_v : joint.idx_v + joint.nv] = np.eye(6)


def _add_ball(motion: RelativeMotion, model: pin.Model, k: int, q: Array, v: Array) -> None:
    """Set the motion of a link on a ball joint."""
    joint, place = model.joints[k], model.jointPlacements[k]
    own = _rotations(q[:, joint.idx_q : joint.idx_q + joint.nq])
    motion.turns[:, :, k] = (place.rotation @ own).transpose(1, 2, 0)
    motion.arms[:, k] = place.translation[:, None]
    motion.subspaces[:, 3:, joint.idx_v : joint.idx_v + joint.nv] = np.eye(3)


def _rotations(quaternion: Array) -> Array:
    """Return ``R = 1 + 2 w [u]x + 2 [u]x^2``, shape (n, 3, 3), for unit quaternions (u, w), shape (n, 4)."""
    u, w = np.split(quaternion, [3], axis=1)
    crossing = crossed(u[:, None], np.eye(3)).swapaxes(1, 2)
    return np.asarray(np.eye(3) + 2.0 * (w[..., None] * crossing + crossing @ crossing))


def _add_joint(motion: RelativeMotion, model: pin.Model, k: int, q: Array, v: Array) -> None:
    """Set the motion of a link whose joint has several coordinates, as Pinocchio computes it, state by state."""
    joint, place = model.joints[k], model.jointPlacements[k]
    data, columns = joint.createData(), slice(joint.idx_v, joint.idx_v + joint.nv)
    for row, (configuration, velocity) in enumerate(zip(q, v, strict=True)):
        joint.calc(data, configuration, velocity)
        placed = place * pin.SE3(data.M)
        motion.turns[:, :, k, row], motion.arms[:, k, row] = placed.rotation, placed.translation
        motion.subspaces[row, :, columns] = np.reshape(data.S, (6, -1))
        motion.biases[row, k] = data.c


BY_KIND = {"JointModelFreeFlyer": _add_floating, "JointModelSpherical": _add_ball}
"""How links move whose joints have several coordinates, all states at once; others are computed state by state."""

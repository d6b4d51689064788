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

from pinarm.arrays import Array, Indices
from pinarm.mechanics.geometry.kinematics import cached_by_model
from pinarm.mechanics.geometry.model_variants import Model, bodies_of, placements_of
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.records import Record

FREE = 6
"""Velocities of a joint that floats."""


class LinkTree(Record, frozen=True):
    """Data of a tree of links that do not depend on the configuration.

    Attributes:
        parents: Index of the parent of every link; the world is its own parent, shape (njoints,).
        jumps: The ancestors 1, 2, 4, ... joints before every link, as far as there are any, each of shape (njoints,).
        moved: Link that every velocity moves first, shape (nv,).
        starts: First velocity of every joint, shape (njoints - 1,).
        single: Links of joints with one coordinate, which turn about an axis, slide along it, or both, shape (k,), and
            their coordinates in q, shape (k,).
        turning: C, S and D of their rotations ``C + sin(q) S + cos(q) D`` to the parents' axes, (.., k, 3, 3) each.
        sliding: Their places in the parents' axes, and how far they move per unit, shape (.., k, 3) each.
        balls: Links of joints about which they turn freely, shape (b,), and coordinates (x, y, z, w), shape (b, 4).
        floating: Those of these that slide freely, too, shape (f,), and coordinates (x, y, z), shape (f, 3).
        places: Rotations of joints to the axes of their parents, shape (.., njoints, 3, 3), and places there [m], shape
            (.., njoints, 3).
        subspace: S, twists of links per unit velocity of their joints, in link axes, shape (6, nv).
        masses: Of the links [kg], shape (njoints,), of variants (k, njoints).
        levers: Their centres of mass in link axes [m], shape (njoints, 3), of variants (k, njoints, 3).
        inertias: Their spatial inertias in link axes, 0 of the world, shape (njoints, 6, 6), of variants (k, ...).
    """

    parents: Indices
    jumps: tuple[Indices, ...]
    moved: Indices
    starts: Indices
    single: tuple[Indices, Indices]
    turning: tuple[Array, Array, Array]
    sliding: tuple[Array, Array]
    balls: tuple[Indices, Indices]
    floating: tuple[Indices, Indices]
    places: tuple[Array, Array]
    subspace: Array
    masses: Array
    levers: Array
    inertias: Array

    @classmethod
    def of(cls, model: Model) -> LinkTree:
        return _tree(model)

    @cached_property
    def mass(self) -> Array:
        """Mass of all links [kg], shape (), of variants (k,)."""
        return np.asarray(self.masses.sum(axis=-1))

    def momenta(self, motions: Array) -> Array:
        """Return ``I V`` in link axes, of motions of shape (k, 6, njoints, ..)."""
        inertias = states_last(self.inertias, motions.ndim - 3, 3)
        return np.asarray(np.einsum("ab...,kb...->ka...", inertias, motions))

    def summed(self, x: Array) -> Array:
        """Return the sums over the paths from the world to every link, whose own term is 0; shape (3, njoints, ..)."""
        for jump in self.jumps:
            x = x + x.take(jump, axis=1)
        return x

    def along(self, columns: Array, x: Array) -> Array:
        """Return the sums of columns times velocities over those of every joint, 0 of the world.

        (3, nv, ..) and (.., nv) to (3, njoints, ..).
        """
        each = columns * components_first(x, 1)
        sums = np.zeros((3, len(self.parents), *each.shape[2:]), each.dtype)
        sums[:, 1:] = np.add.reduceat(each, self.starts, axis=1) if len(self.balls[0]) else each
        return sums

    def placed(self, q: Array) -> tuple[Array, Array]:
        """Return the rotations of links and the arms to them from their parents, in world axes.

        Shapes (3, 3, njoints, ..) and (3, njoints, ..) [m], at configurations of shape (.., nq).
        """
        rank, x, (links, coordinates) = q.ndim - 1, components_first(q, 1), self.single
        along, (constant, sine, cosine) = x[coordinates], (states_last(part, rank, 3) for part in self.turning)
        shift, slide = (states_last(part, rank, 2) for part in self.sliding)
        rotation, shifted = constant + np.sin(along) * sine + np.cos(along) * cosine, shift + along * slide
        states = np.broadcast_shapes(rotation.shape[3:], shifted.shape[2:])
        turns = np.zeros((3, 3, len(self.parents), *states), q.dtype)
        arms = np.zeros((3, len(self.parents), *states), q.dtype)
        turns[0, 0, 0] = turns[1, 1, 0] = turns[2, 2, 0] = 1.0
        turns[:, :, links], arms[:, links] = rotation, shifted
        if len(self.balls[0]):
            (balls, turned_by), (afloat, moved_by) = self.balls, self.floating
            outer, shift = states_last(self.places[0], rank, 3), states_last(self.places[1], rank, 2)
            turns[:, :, balls] = product(outer[:, :, balls], rotations(x[turned_by.T]))
            arms[:, balls] = shift[:, balls]
            arms[:, afloat] += turned(outer[:, :, afloat], x[moved_by.T])
        for jump in self.jumps:  # products along the paths from the world
            turns = product(turns.take(jump, axis=2), turns)
        return turns, turned(turns.take(self.parents, axis=2), arms)

    def columns(self, turns: Array) -> tuple[Array, Array]:
        """Return the motion subspace S in world axes, linear and angular part, shape (3, nv, ..) each.

        Args:
            turns: Rotations of the links, shape (3, 3, njoints, ..).
        """
        own, rank = turns.take(self.moved, axis=2), turns.ndim - 3
        linear, angular = (states_last(part.T, rank, 2) for part in (self.subspace[:3], self.subspace[3:]))
        return turned(own, linear), turned(own, angular)


def rotations(quaternion: Array) -> Array:
    """Return ``R = 1 + 2 w [u]x + 2 [u]x^2`` for unit quaternions (u, w), shape (4, ..) to (3, 3, ..)."""
    x, y, z, w = quaternion
    xx, yy, zz, xy, yz, zx = x * x, y * y, z * z, x * y, y * z, z * x
    rows = [
        [1.0 - 2.0 * (yy + zz), 2.0 * (xy - w * z), 2.0 * (zx + w * y)],
        [2.0 * (xy + w * z), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - w * x)],
        [2.0 * (zx - w * y), 2.0 * (yz + w * x), 1.0 - 2.0 * (xx + yy)],
    ]
    return np.array(rows)


def turned(turns: Array, vectors: Array) -> Array:
    """Return ``R x``, shapes (3, 3, ..) and (3, ..)."""
    return np.asarray(np.einsum("ab...,b...->a...", turns, vectors))


def product(first: Array, other: Array) -> Array:
    """Return the products of matrices, shape (3, 3, ..)."""
    return np.asarray(np.einsum("ab...,bc...->ac...", first, other))


def states_last(x: Array, rank: int, tail: int) -> Array:
    """Return an array of links, shape (.., links, 3 or 3, 3), with components first, spread over states of a rank.

    Args:
        x: Vectors or matrices, with k variants in place of the dots, or nothing.
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
    """Return an equal array that is stored component by component, as arrays of many states are."""
    return states_first(np.ascontiguousarray(components_first(x, tail)), tail)


def states_first(x: Array, tail: int = 2) -> Array:
    """Return an array of shape (w, links, ..) or (w, w, links, ..) as (.., links, w) or (.., links, w, w)."""
    return x.transpose(*range(tail, x.ndim), tail - 1, *range(tail - 1))


@cached_by_model
def _tree(model: Model) -> LinkTree:
    joints, parents = model.joints.tolist(), np.array(model.parents.tolist())
    single = [k for k, joint in enumerate(joints) if k and joint.nq == joint.nv == 1]
    balls = [k for k in range(1, len(joints)) if k not in set(single)]
    floating = [k for k in balls if joints[k].nv == FREE]
    subspace, anywhere = np.zeros((6, model.nv)), np.ones(model.nq)  # S is the same at all coordinates
    for joint in joints[1:]:
        data = joint.createData()
        joint.calc(data, anywhere)
        subspace[:, joint.idx_v : joint.idx_v + joint.nv] = np.reshape(data.S, (6, -1))
    jumps, ahead = [], parents
    while ahead.any():
        jumps.append(ahead)
        ahead = ahead[ahead]
    counts = np.array([joint.nv for joint in joints[1:]], dtype=np.intp)
    masses, levers, inertias = map(np.asfortranarray, bodies_of(model))  # the variants last in memory, as states are
    inertias[..., 0, :, :] = 0.0
    levers, inertias = components_far(levers), components_far(inertias, 3)
    slides, axes = np.split(subspace[:, [joints[k].idx_v for k in single]], 2)
    crosses, places = crossed(axes.T[:, None], np.eye(3)).swapaxes(1, 2), placements_of(model)
    outer, square = places[0][..., single, :, :], crosses @ crosses
    # Rodrigues' formula: 1 + sin(q) [u]x + (1 - cos(q)) [u]x^2
    turning = outer @ (np.eye(3) + square), outer @ crosses, -outer @ square

    def coordinates(links: list[int], end: int, count: int) -> tuple[Indices, Indices]:
        """Return links, and the last of their coordinates but for ``end``."""
        last = np.array([joints[k].idx_q + joints[k].nq - end - count for k in links], dtype=np.intp)
        return np.array(links, dtype=np.intp), last[:, None] + np.arange(count)

    links, own = coordinates(single, 0, 1)
    return LinkTree(
        parents, tuple(jumps), np.repeat(np.arange(1, len(joints)), counts), np.cumsum(counts) - counts,
        (links, own[:, 0]), turning, (places[1][..., single, :], np.matvec(outer, slides.T)),
        coordinates(balls, 0, 4), coordinates(floating, 4, 3), places, subspace, masses, levers, inertias,
    )  # fmt: skip

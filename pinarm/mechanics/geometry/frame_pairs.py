"""Relative motion of two frames of a tree: placement, twist for unit velocities, and acceleration at constant ones.

Only the joints on the path between the frames take part: from frame 1 towards the root, to the last common joint, and
from there to frame 2.

Arrays have components first and states last, as in ``link_tree``; several pairs whose paths have like joints stand side
by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.mechanics.geometry.link_tree import LinkTree, product, states_last, turned
from pinarm.mechanics.geometry.model_variants import Model
from pinarm.mechanics.geometry.pairs import LowerPair, Pair
from pinarm.mechanics.geometry.vectors import cross, dot
from pinarm.records import Record


class Path(NamedTuple):
    """The joints between two frames.

    Attributes:
        up: From frame 1 towards the root.
        down: From there to frame 2.
    """

    up: tuple[int, ...]
    down: tuple[int, ...]

    @classmethod
    def between(cls, model: Model, first: int, second: int) -> Path:
        """Return the path between two frames, given by their indices."""
        return cls.of_joints(model, *(model.frames[frame].parentJoint for frame in (first, second)))

    @classmethod
    def of_joints(cls, model: Model, first: int, second: int) -> Path:
        start, end = (list(model.supports[joint])[1:] for joint in (first, second))
        shared = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(start, end, strict=False)))
        return cls(tuple(map(int, reversed(start[shared:]))), tuple(map(int, end[shared:])))

    @property
    def senses(self) -> list[tuple[int, float]]:
        """The joints in their order, those towards the root with -1, others with 1."""
        return [*((joint, -1.0) for joint in self.up), *((joint, 1.0) for joint in self.down)]

    def velocities(self, model: Model) -> list[int]:
        """Return the indices in v of the joints, in their order."""
        joints = (model.joints[joint] for joint, _ in self.senses)
        return [joint.idx_v + k for joint in joints for k in range(joint.nv)]


class Ends(Record, frozen=True):
    """Frames at one end of L pairs.

    Attributes:
        joints: Their joints, shape (L,).
        turn: Rotation of each in its joint's axes, shape (.., L, 3, 3).
        place: Origin of each in these axes [m], shape (.., L, 3).
    """

    joints: Indices
    turn: Array
    place: Array

    @classmethod
    def of(cls, model: Model, frames: Sequence[int]) -> Ends:
        own = [model.frames[frame] for frame in frames]
        return cls(
            np.array([frame.parentJoint for frame in own], dtype=np.intp),
            np.stack(np.broadcast_arrays(*(frame.placement.rotation for frame in own)), axis=-3),
            np.stack(np.broadcast_arrays(*(frame.placement.translation for frame in own)), axis=-2),
        )

    def placed(self, turns: Array, places: Array) -> tuple[Array, Array]:
        """Return rotations, shape (3, 3, L, ..), and origins [m], shape (3, L, ..), in world axes; see ``at``."""
        rank, own = turns.ndim - 3, turns.take(self.joints, axis=2)
        along = turned(own, states_last(self.place, rank, 2))
        return product(own, states_last(self.turn, rank, 3)), places.take(self.joints, axis=1) + along


class FramePairs(Record, frozen=True):
    """L pairs of frames; the joints between them have the same numbers of velocities, in their order.

    Attributes:
        velocities: Velocities of the joints from frame 1 to frame 2, shape (s, L).
        starts: The first of these of each joint, shape (j,).
        senses: -1 for joints on the way towards the root, else 1, shape (s,).
    """

    tree: LinkTree
    first: Ends
    second: Ends
    velocities: Indices
    starts: Indices
    senses: Array

    @classmethod
    def of(cls, model: Model, pairs: Sequence[tuple[int, int]]) -> FramePairs:
        """Return pairs of frames, given by their indices, whose ``likeness`` is the same."""
        paths = [Path.between(model, *pair) for pair in pairs]
        first, second = (Ends.of(model, [pair[end] for pair in pairs]) for end in (0, 1))
        counts = np.array([model.joints[joint].nv for joint, _ in paths[0].senses], dtype=np.intp)
        senses = np.repeat(np.array([sense for _, sense in paths[0].senses]), counts)
        velocities = np.array([path.velocities(model) for path in paths], dtype=np.intp)
        starts = np.cumsum(counts) - counts
        return cls(LinkTree.of(model), first, second, velocities.reshape(len(pairs), -1).T, starts, senses)

    @classmethod
    def between(cls, model: Model, first: int, second: int) -> FramePairs:
        """Return the pair of two frames, given by their indices."""
        return cls.of(model, [(first, second)])

    def at_configurations(self, q: Array) -> RelativeMotion:
        """Return placements and Jacobians of frames 2 in frames 1 at configurations, shape (.., nq)."""
        turns, arms = self.tree.placed(q)
        return self.at(turns, self.tree.summed(arms))

    def at(self, turns: Array, places: Array) -> RelativeMotion:
        """Return placements and Jacobians of frames 2 in frames 1.

        Args:
            turns: Rotations of all links, shape (3, 3, njoints, ..).
            places: Their origins in the world [m], shape (3, njoints, ..).
        """
        (rotation, start), (other, end) = self.first.placed(turns, places), self.second.placed(turns, places)
        rank, moved = turns.ndim - 3, self.tree.moved[self.velocities]
        own = turns.take(moved.ravel(), axis=2)
        screws = self.senses[:, None] * self.tree.subspace[:, self.velocities]
        linear, angular = (
            turned(own, states_last(part.reshape(3, -1).T, rank, 2)).reshape(3, *moved.shape, *own.shape[3:])
            for part in (screws[:3], screws[3:])
        )
        arms = end[:, None] - places.take(moved.ravel(), axis=1).reshape(3, *moved.shape, *places.shape[2:])
        back = rotation.swapaxes(0, 1)
        linear, angular = (turned(back[:, :, None], part) for part in (linear + cross(angular, arms), angular))
        return RelativeMotion(self, turned(back, end - start), product(back, other), linear, angular)


def likeness(model: Model, first: int, second: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the numbers of velocities of the joints between two frames, on both branches of the path."""
    path = Path.between(model, first, second)
    up, down = (tuple(int(model.joints[joint].nv) for joint in way) for way in path)
    return up, down


class RelativeMotion(Record, frozen=True):
    """Frames 2 seen from frames 1, in the axes of these.

    Attributes:
        p: Origins of frames 2 [m], shape (3, L, ..).
        turn: Rotations, columns are the axes of frames 2, shape (3, 3, L, ..).
        linear: Velocities of these origins for unit velocities, shape (3, s, L, ..).
        angular: Angular velocities, likewise.
    """

    pairs: FramePairs
    p: Array
    turn: Array
    linear: Array
    angular: Array

    @cached_property
    def flat(self) -> tuple[Array, Array]:
        """``p`` and the axes of frames 2, all pairs and states along the last axis: shapes (3, N) and (3, 3, N)."""
        return self.p.reshape(3, -1), self.turn.swapaxes(0, 1).reshape(3, 3, -1)

    def directions(self, pair: Pair) -> tuple[Array, Array]:
        """Return the directions e and w of a pair's rows, shape (m, 3), or (m, 3, L, ..) where they turn."""
        if isinstance(pair, LowerPair):
            return pair.e, pair.w
        e, w = (x if x.ndim == 2 else x.reshape(*x.shape[:2], *self.p.shape[1:]) for x in pair.directions(*self.flat))
        return e, w

    def rows(self, pair: Pair) -> Array:
        """Return the rows of a pair along the velocities of the path, shape (m, s, L, ..)."""
        e, w = self.directions(pair)
        return power(e, self.linear) + power(w, self.angular)

    def efforts(self, force: Array, moment: Array) -> Array:
        """Return the efforts along the velocities of a force and a moment at the origins of frames 2.

        Shapes (3, L, ..) to (s, L, ..).
        """
        return np.asarray(dot(force[:, None], self.linear) + dot(moment[:, None], self.angular))

    def rates(self, v: Array) -> tuple[Array, Array, Array, Array]:
        """Return ``p'`` and ``omega``, and ``p''`` and ``omega'`` while the velocities are constant.

        With ``l_j`` and ``w_j``, the share of joint j in p' and in omega, and the sum ``W_j`` of these w up to joint j,

            p'' = sum_j (W_j-1 + W_j) x l_j,    omega' = sum_j W_j-1 x w_j

        as ``l_j' = W_j-1 x l_j + w_j x (l_j + l_j+1 + ..)``: a joint's motion is constant in the axes of its link.

        Args:
            v: Velocities, shape (nv, ..).

        Returns:
            Each of shape (3, L, ..).
        """
        own = v[self.pairs.velocities]
        along, about = (
            np.add.reduceat(part * own, self.pairs.starts, axis=1) if len(own) else part
            for part in (self.linear, self.angular)
        )
        beyond = np.cumsum(about, axis=1)
        before = beyond - about
        return (
            along.sum(axis=1),
            about.sum(axis=1),
            cross(before + beyond, along).sum(axis=1),
            cross(before, about).sum(axis=1),
        )


def power(directions: Array, motions: Array) -> Array:
    """Return the power of unit multipliers, shape (m, s, L, ..).

    Args:
        directions: Their forces or moments, shape (m, 3), or (m, 3, L, ..).
        motions: Velocities, shape (3, s, L, ..).
    """
    if directions.ndim == 2:
        return np.tensordot(directions, motions, 1)
    return np.asarray(np.einsum("mc...,cs...->ms...", directions, motions))

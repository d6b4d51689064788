"""Relative motion of two frames of a tree: placement, twist for unit velocities, and acceleration at constant ones.

Only the joints on the path between the frames take part: from frame 1 towards the root, to the last common joint, and
from there to frame 2. Their arms are added from origin to origin, and what both branches have in common is taken off
before short arms are added: the distance of the mechanism from the origin of the world costs no digits.

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
from pinarm.mechanics.geometry.pairs import Pair
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
        start, end = (list(model.supports[model.frames[frame].parentJoint])[1:] for frame in (first, second))
        shared = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(start, end, strict=False)))
        return cls(tuple(map(int, reversed(start[shared:]))), tuple(map(int, end[shared:])))


class Ends(Record, frozen=True):
    """Frames at one end of L pairs.

    Attributes:
        joints: Their joints, shape (L,).
        turn: Rotation of each in its joint's axes, shape (.., L, 3, 3).
        place: Origin of each in these axes [m], shape (.., L, 3).
        way: Joints of the path's branch, from the last common joint to the frame, shape (b, L).
    """

    joints: Indices
    turn: Array
    place: Array
    way: Indices

    @classmethod
    def of(cls, model: Model, frames: Sequence[int], ways: Sequence[Sequence[int]]) -> Ends:
        own = [model.frames[frame] for frame in frames]
        return cls(
            np.array([frame.parentJoint for frame in own], dtype=np.intp),
            np.stack(np.broadcast_arrays(*(frame.placement.rotation for frame in own)), axis=-3),
            np.stack(np.broadcast_arrays(*(frame.placement.translation for frame in own)), axis=-2),
            np.array(ways, dtype=np.intp).reshape(len(frames), -1).T,
        )

    def placed(self, turns: Array, arms: Array) -> PlacedEnds:
        """Return where the frames are.

        Args:
            turns: Rotations of all links, shape (3, 3, njoints, ..).
            arms: From the parent of every link to it, world axes [m], shape (3, njoints, ..).
        """
        rank, own = turns.ndim - 3, turns.take(self.joints, axis=2)
        end, rotation = (turned(own, states_last(self.place, rank, 2)), product(own, states_last(self.turn, rank, 3)))
        if not len(self.way):
            return PlacedEnds(rotation, np.zeros_like(end), end, end[:, None][:, :0])
        along = arms.take(self.way.ravel(), axis=1).reshape(3, *self.way.shape, *arms.shape[2:])
        beyond = np.empty((*along.shape[:2], *np.broadcast_shapes(end.shape[1:], along.shape[2:])), end.dtype)
        beyond[:, -1] = end
        for k in range(len(self.way) - 1, 0, -1):
            beyond[:, k - 1] = beyond[:, k] + along[:, k]
        return PlacedEnds(rotation, along[:, 0], beyond[:, 0], beyond)


class PlacedEnds(NamedTuple):
    """Frames at one end of L pairs, in world axes.

    Attributes:
        rotation: Their rotations, shape (3, 3, L, ..).
        common: From the last common joint of the pair to the first joint of the branch [m], shape (3, L, ..).
        reach: From there to the frame [m], shape (3, L, ..).
        beyond: From every joint of the branch to the frame [m], shape (3, b, L, ..).
    """

    rotation: Array
    common: Array
    reach: Array
    beyond: Array


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
        ups, downs = [path.up[::-1] for path in paths], [path.down for path in paths]
        first, second = (Ends.of(model, [pair[end] for pair in pairs], ways) for end, ways in ((0, ups), (1, downs)))
        joints = [model.joints[joint] for joint in (*paths[0].up, *paths[0].down)]
        counts = np.array([joint.nv for joint in joints], dtype=np.intp)
        velocities = [
            [model.joints[joint].idx_v + k for joint in (*path.up, *path.down) for k in range(model.joints[joint].nv)]
            for path in paths
        ]
        senses = np.repeat(np.where(np.arange(len(joints)) < len(paths[0].up), -1.0, 1.0), counts)
        return cls(
            LinkTree.of(model),
            first,
            second,
            np.array(velocities, dtype=np.intp).reshape(len(pairs), -1).T,
            np.cumsum(counts) - counts,
            senses,
        )

    @classmethod
    def between(cls, model: Model, first: int, second: int) -> FramePairs:
        """Return the pair of two frames, given by their indices."""
        return cls.of(model, [(first, second)])

    def at_configurations(self, q: Array) -> RelativeMotion:
        """Return placements and Jacobians of frames 2 in frames 1 at configurations, shape (.., nq)."""
        return self.at(*self.tree.placed(q))

    def at(self, turns: Array, arms: Array) -> RelativeMotion:
        """Return placements and Jacobians of frames 2 in frames 1.

        Args:
            turns: Rotations of all links, shape (3, 3, njoints, ..).
            arms: From the parent of every link to it, world axes [m], shape (3, njoints, ..).
        """
        first, second = self.first.placed(turns, arms), self.second.placed(turns, arms)
        way = (second.reach - first.reach) + (second.common - first.common)
        branches = [first.beyond[:, ::-1] + way[:, None], second.beyond]
        reaches = np.concatenate([np.broadcast_to(x, (*x.shape[:2], *way.shape[1:])) for x in branches], axis=1)
        counts = np.diff(np.append(self.starts, len(self.velocities)))
        columns = self._columns(turns, np.repeat(reaches, counts, axis=1))
        back = first.rotation.swapaxes(0, 1)
        linear, angular = (turned(back[:, :, None], part) for part in columns)
        return RelativeMotion(self, turned(back, way), product(back, second.rotation), linear, angular)

    def _columns(self, turns: Array, arms: Array) -> tuple[Array, Array]:
        """Return Jacobian columns of frame 2 relative to frame 1: linear at its origin, and angular, world axes."""
        rank, moved = turns.ndim - 3, self.tree.moved[self.velocities]
        own = turns.take(moved.ravel(), axis=2)
        screws = self.senses[:, None] * self.tree.subspace[:, self.velocities]
        linear, angular = (
            turned(own, states_last(part.reshape(3, -1).T, rank, 2)).reshape(3, *moved.shape, *own.shape[3:])
            for part in (screws[:3], screws[3:])
        )
        return linear + cross(angular, arms), angular


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
        if pair.constant is not None:
            return pair.constant
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

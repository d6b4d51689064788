"""Pinocchio's recursions for variants of a model: their trees stand side by side in one model, some at a time.

A call from Python costs more than what a small tree takes, so that one for many trees and all states saves most of it.
What Pinocchio computes is the same as for each variant alone, as no joint of one tree is before a joint of another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.model_variants import ModelVariants, VariantsDiffer

WIDTH = 48
"""Coordinates side by side: more take longer to build, since Pinocchio's buffers grow with their third power."""

FREE = 6
"""Velocities of a joint that leaves everything free."""


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Inverse dynamics of variants, without loads; of n states of each, shape (n, k or 1, nq).

    Attributes:
        variants: The variants.
    """

    variants: ModelVariants = field(repr=False)

    def rnea(self, q: Array, v: Array, a: Array) -> Array:
        """Return efforts, shape (n, k, nv); see ``Parallel.rnea``."""
        return self._called(_forest(self.variants.first), pin.rneaInParallel, q, v, a)

    def transmitted(self, links: LinkPlacements, q: Array, v: Array, a: Array, acting: Array) -> Array:
        """Return wrenches of parents on children, shape (n, k, njoints, 6); see ``Parallel.transmitted``.

        What moves a joint that leaves everything free is its wrench: such joints stand in the place of those of the
        trees, and move as these do. Then what else acts on the links beyond is taken off.
        """
        tree = LinkTree.of(self.variants)
        if tree.others:
            raise VariantsDiffer("joints with several coordinates")
        q, v, a = (x[..., tree.single.q] for x in (q, v, a))
        slides, turns = tree.subspace[:3].T, tree.subspace[3:].T
        half = 0.5 * q[..., None]
        cosine = np.where(turns.any(axis=-1, keepdims=True), np.cos(half), 1.0)
        places = np.concatenate([q[..., None] * slides, np.sin(half) * turns, cosine], axis=-1)
        moved = (x[..., None] * tree.subspace.T for x in (v, a))
        states = (x.reshape(*x.shape[:2], -1) for x in (places, *moved))
        found = self._called(_free_forest(self.variants.first), pin.rneaInParallel, *states)
        wrenches = np.zeros((*found.shape[:2], self.variants.njoints, 6))
        wrenches[:, :, 1:] = found.reshape(*found.shape[:2], -1, 6)
        return links.outwards(wrenches) - links.at_joints(tree.carried(acting))

    def mass_matrices(self, q: Array) -> Array:
        """Return M, shape (n, k, nv, nv); armatures are in it."""
        nv, forest = self.variants.nv, _forest(self.variants.first)
        model, data = forest.pool.getModel(0), forest.pool.getData(0)
        upper, every = np.empty((len(q), len(self.variants), nv, nv)), np.arange(forest.count)
        for some, (states,) in self._filled(forest, q):
            for row, state in enumerate(states):
                whole = pin.crba(model, data, state)
                upper[row, some] = whole.reshape(forest.count, nv, forest.count, nv)[every, :, every][: len(some)]
        above = np.triu(np.ones((nv, nv)), 1)
        return np.asarray(upper * (np.eye(nv) + above) + (upper * above).swapaxes(-2, -1))

    def masses(self, q: Array) -> Array:
        """Return M: as ``mass_matrices``, variants have few joints."""
        return self.mass_matrices(q)

    def _called(self, forest: Forest, call: Callable[..., Array], *arrays: Array) -> Array:
        """Return what Pinocchio computes of all rows of states, shape (n, k, w)."""
        n, found = len(arrays[0]), list[Array]()
        for some, states in self._filled(forest, *arrays):
            own = call(1, forest.pool, *(x.T for x in states)).reshape(-1, n).T
            found.append(own.reshape(n, forest.count, -1)[:, : len(some)])
        return np.concatenate(found, axis=1)

    def _filled(self, forest: Forest, *arrays: Array) -> Iterator[tuple[Indices, list[Array]]]:
        """Yield some variants, of which the forest has the numbers, and their rows of arrays, each of shape (n, ..)."""
        every = np.arange(len(self.variants))
        for start in range(0, len(every), forest.count):
            some = every[start : start + forest.count]
            trees = np.minimum(start + np.arange(forest.count), every[-1])  # those left over repeat the last variant
            for copy, k in enumerate(trees.tolist()):
                forest.fill(copy, self._numbers[k])
            spread = (np.broadcast_to(x, (len(x), len(every), x.shape[-1]))[:, trees] for x in arrays)
            yield some, [np.ascontiguousarray(x).reshape(len(x), -1) for x in spread]

    @cached_property
    def _numbers(self) -> list[Numbers]:
        """Inertias and placements of each variant, as Pinocchio has them."""
        made, placed, v = pin.Inertia.FromDynamicParameters, pin.SE3, self.variants
        return [
            ([*zip(v.bodies, map(made, own), strict=True)], [*zip(v.moved, map(placed, turns, shifts), strict=True)])
            for own, turns, shifts in zip(v.parameters, v.turns, v.shifts, strict=True)
        ]


Numbers = tuple[list[tuple[int, pin.Inertia]], list[tuple[int, pin.SE3]]]
"""Inertias and placements of some joints."""


@dataclass(frozen=True, eq=False)
class Forest:
    """Copies of a tree side by side.

    Attributes:
        count: How many there are.
        size: Number of joints of each.
        pool: Pinocchio's model of all of them, and its buffers.
    """

    count: int
    size: int
    pool: pin.ModelPool

    @classmethod
    def of(cls, tree: pin.Model, joints: Callable[[int], pin.JointModel], width: int) -> Forest:
        """Return as many copies of a tree as fit, with other joints, of which each copy has so many velocities."""
        count, model = max(1, WIDTH // width), pin.Model()
        for copy in range(count):
            first = model.njoints - 1
            for joint in range(1, tree.njoints):
                parent = tree.parents[joint]
                place, name = tree.jointPlacements[joint], f"{copy}/{tree.names[joint]}"
                model.addJoint(parent + first if parent else 0, joints(joint), place, name)
                model.inertias[first + joint] = tree.inertias[joint]
        model.gravity = tree.gravity
        if width == tree.nv:  # of free joints the armature is none of the links' wrenches
            model.armature[:] = np.tile(tree.armature, count)
        return cls(count, tree.njoints - 1, pin.ModelPool(model, 1))

    def fill(self, copy: int, numbers: Numbers) -> None:
        """Give the numbers of a variant to one of the trees."""
        model, first = self.pool.getModel(0), copy * self.size
        inertias, places = model.inertias, model.jointPlacements
        for joint, inertia in numbers[0]:
            inertias[first + joint] = inertia
        for joint, place in numbers[1]:
            places[first + joint] = place


@cached_by_model
def _forest(tree: pin.Model) -> Forest:
    return Forest.of(tree, lambda joint: tree.joints[joint], tree.nv)


@cached_by_model
def _free_forest(tree: pin.Model) -> Forest:
    """Return the copies with joints that leave everything free."""
    return Forest.of(tree, lambda joint: pin.JointModelFreeFlyer(), FREE * (tree.njoints - 1))

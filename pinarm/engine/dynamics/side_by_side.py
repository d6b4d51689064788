"""Pinocchio's recursions for variants of a model: their trees stand side by side in one model, some at a time.

A call from Python costs more than what a small tree takes, so that one for many trees saves most of it. What Pinocchio
computes is the same as for each variant alone, as no joint of one tree is before a joint of another.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.model_variants import ModelVariants

WIDTH = 48
"""Coordinates side by side: more take longer to build, since Pinocchio's buffers grow with their third power."""


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Inverse dynamics of variants, without loads; of n states of each, shape (n, k or 1, nq).

    Attributes:
        variants: The variants.
    """

    variants: ModelVariants = field(repr=False)

    def rnea(self, q: Array, v: Array, a: Array) -> Array:
        """Return efforts, shape (n, k, nv); see ``Parallel.rnea``."""
        tau = np.empty((len(q), len(self.variants), self.variants.nv))
        for some, forest in self._forests:
            for row, state in enumerate(self._states(some, forest, q, v, a)):
                tau[row, some] = forest.own(pin.rnea(forest.model, forest.data, *state), len(some))
        return tau

    def transmitted(self, q: Array, v: Array, a: Array, outside: Array) -> Array:
        """Return wrenches of parents on children, shape (n, k, njoints, 6); see ``Parallel.transmitted``.

        Args:
            q: Configurations.
            v: Velocities.
            a: Accelerations.
            outside: Wrenches on the links, shape (n, k or 1, njoints, 6).
        """
        found = np.zeros((len(q), len(self.variants), self.variants.njoints, 6))
        for some, forest in self._forests:
            acting = self._states(some, forest, outside[..., 1:, :].reshape(*outside.shape[:2], -1))
            for row, state in enumerate(self._states(some, forest, q, v, a)):
                pin.rnea(forest.model, forest.data, *state, *forest.outside(acting[row][0]))
                wrenches = np.array([wrench.vector for wrench in forest.data.f.tolist()[1:]])
                found[row, some, 1:] = forest.own(wrenches.reshape(-1), len(some)).reshape(len(some), -1, 6)
        return found

    def mass_matrices(self, q: Array) -> Array:
        """Return M, shape (n, k, nv, nv); armatures are in it."""
        nv = self.variants.nv
        upper = np.empty((len(q), len(self.variants), nv, nv))
        for some, forest in self._forests:
            every = np.arange(forest.count)
            for row, state in enumerate(self._states(some, forest, q)):
                whole = pin.crba(forest.model, forest.data, *state)
                upper[row, some] = whole.reshape(forest.count, nv, forest.count, nv)[every, :, every][: len(some)]
        above = np.triu(np.ones((nv, nv)), 1)
        return np.asarray(upper * (np.eye(nv) + above) + (upper * above).swapaxes(-2, -1))

    @cached_property
    def _forests(self) -> list[tuple[Indices, Forest]]:
        """Some variants, and the forest that has their numbers, for all of them; buffers are shared."""
        empty, every = _forest(self.variants.first), np.arange(len(self.variants))
        parts = [every[start : start + empty.count] for start in range(0, len(every), empty.count)]
        return [(some, empty.filled(self.variants, some)) for some in parts]

    def _states(self, some: Indices, forest: Forest, *arrays: Array) -> list[tuple[Array, ...]]:
        """Return arrays, shape (n, k or 1, w), of some variants as rows of the forest, each of shape (w * trees,)."""
        spread = [np.broadcast_to(x, (len(x), len(self.variants), x.shape[-1]))[:, some] for x in arrays]
        idle = forest.count - len(some)  # trees that are left over repeat the last variant
        rows = [np.concatenate([x, *[x[:, -1:]] * idle], axis=1).reshape(len(x), -1) for x in spread]
        return list(zip(*rows, strict=True))


@dataclass(frozen=True, eq=False)
class Forest:
    """Copies of a tree side by side.

    Attributes:
        count: How many there are.
        model: Pinocchio's model of all of them.
        data: Its buffers.
    """

    count: int
    model: pin.Model
    data: pin.Data

    @classmethod
    def of(cls, tree: pin.Model) -> Forest:
        """Return as many copies of a tree as fit."""
        count, model = max(1, WIDTH // tree.nv), pin.Model()
        for copy in range(count):
            first = model.njoints - 1
            for joint in range(1, tree.njoints):
                parent = tree.parents[joint]
                place, name = tree.jointPlacements[joint], f"{copy}/{tree.names[joint]}"
                model.addJoint(parent + first if parent else 0, tree.joints[joint], place, name)
                model.inertias[first + joint] = tree.inertias[joint]
        model.gravity, model.armature[:] = tree.gravity, np.tile(tree.armature, count)
        return cls(count, model, model.createData())

    def filled(self, variants: ModelVariants, some: Indices) -> Forest:
        """Return the forest whose first trees have the numbers of some variants."""
        model = self.model.copy()
        size, inertias, places = variants.njoints - 1, model.inertias, model.jointPlacements
        made, placed = pin.Inertia.FromDynamicParameters, pin.SE3
        for copy, k in enumerate(some.tolist()):
            for body, parameters in zip(variants.bodies, variants.parameters[k], strict=True):
                inertias[copy * size + body] = made(parameters)
            for joint, turn, shift in zip(variants.moved, variants.turns[k], variants.shifts[k], strict=True):
                places[copy * size + joint] = placed(turn, shift)
        return Forest(self.count, model, self.data)

    def outside(self, wrenches: Array) -> tuple[pin.StdVec_Force, ...]:
        """Return wrenches on the links, shape (joints * 6,), as Pinocchio takes them; nothing where all are 0."""
        if not wrenches.any():
            return ()
        acting = pin.StdVec_Force()
        acting.extend([pin.Force.Zero(), *(pin.Force(wrench) for wrench in wrenches.reshape(-1, 6))])
        return (acting,)

    def own(self, numbers: Array, some: int) -> Array:
        """Return the numbers of the first trees, each in a row."""
        return np.asarray(numbers.reshape(self.count, -1)[:some])


@cached_by_model
def _forest(tree: pin.Model) -> Forest:
    return Forest.of(tree)

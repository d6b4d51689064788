"""Self-stresses, multipliers that do nothing, ``G^T lam = 0``, and what they add to the wrenches of joints.

Where constraints are redundant self-stresses are added freely to any solution, so that what one of them adds to is not
determined by rigid bodies. A joint is looked at through the functions of the multipliers that it transmits: a loop
joint those of its own rows, a joint of the tree those of the loops that it lies on.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint import Constraint
from pinarm.engine.constraints.nullspaces.nullspace import RowDecompositions
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record


class SelfStresses(Record, frozen=True):
    """The self-stresses of the constraints of a mechanism at n configurations.

    What they add is told for s of them, each of length 1, that span all of those which add to it; they stand along the
    first axis. States have a second axis where they are those of variants; see ``link_tree``.

    Attributes:
        closure: The constraints.
        q: The configurations, shape (n, nq).
    """

    closure: Closure
    q: Array

    @cached_property
    def splits(self) -> RowDecompositions:
        """The rows of the constraints, taken apart."""
        return self.closure.splits(self.q)

    @cached_property
    def links(self) -> LinkPlacements:
        """Where the links are."""
        return LinkPlacements.at(self.closure.model, self.q)

    @property
    def degree(self) -> int:
        """Degree of hyperstatism: number of rows that repeat others, where there are most."""
        return self.closure.size - self.splits.rank if self.closure.size and len(self.q) else 0

    def on(self, functions: Array) -> Array:
        """Return what they add to functions of the multipliers, shape (n, m, k) to (s, n, k)."""
        stresses = self.splits.stresses_on(functions)
        return np.moveaxis(stresses.swapaxes(-1, -2) @ functions, -2, 0)

    def on_loop(self, joint: LoopJoint) -> Array:
        """Return what they add to the wrench of a loop joint, see ``LoopJoint.wrench``, shape (s, n, 6)."""
        return self.on(self._held(joint)) if self.degree else self._nothing

    def on_joint(self, joint: int) -> Array:
        """Return what they add to the wrench of the parent on the child of a joint, see ``transmitted``, (s, n, 6)."""
        return self.on(self.transmitted(joint)) if self.degree else self._nothing

    def on_multipliers(self, weights: Mapping[str, Array]) -> Array:
        """Return what they add to a sum of multipliers, shape (s, n).

        Args:
            weights: Name of a constraint of one row -> weight of its multiplier, shape (n,).
        """
        if not self.degree or not weights:
            return self._nothing[..., 0]
        return self.on(self._functions({name: weight[:, None, None] for name, weight in weights.items()}))[..., 0]

    def own(self, constraint: Constraint) -> Array:
        """Return the multipliers of a constraint as functions of all, shape (n, m, size)."""
        return self._functions({constraint.name: np.eye(constraint.size)})

    def transmitted(self, joint: int) -> Array:
        """Return the wrench of the parent on the child per unit of every multiplier, shape (n, m, 6).

        [f; m] at the joint's origin, world axes. It balances what the multipliers do to the links beyond the joint.

        Args:
            joint: Pinocchio's joint index.
        """
        arm = -self.links.places[..., joint, None, :]
        return self._functions({name: moved(-beyond, arm) for name, beyond in self._beyond[joint].items()})

    @property
    def _nothing(self) -> Array:
        """What is added to wrenches where there are no self-stresses."""
        return np.zeros((0, len(self.q), 6))

    def _held(self, joint: LoopJoint) -> Array:
        """Return the wrench of a loop joint per unit of every multiplier, shape (n, m, 6)."""
        second, arm = self.closure.model.frames[joint.second].parentJoint, -self.links.frame(joint.second)[1]
        return self._functions({joint.name: moved(self._acting[joint.name][second], arm[..., None, :])})

    def _functions(self, parts: Mapping[str, Array]) -> Array:
        """Return functions of all multipliers from those of some constraints, shape (.., size, k) each."""
        width = max((part.shape[-1] for part in parts.values()), default=6)
        states = np.broadcast_shapes(self.links.places.shape[:-2], *(part.shape[:-2] for part in parts.values()))
        found = np.zeros((*states, self.closure.size, width))
        for name, part in parts.items():
            found[..., self.closure.slices[name], :] = part
        return found

    @cached_property
    def _acting(self) -> Mapping[str, Mapping[int, Array]]:
        """What unit multipliers of every constraint do to links at the world's origin, (n, size, 6), by joint index."""
        return {constraint.name: self._per_unit(constraint) for constraint in self.closure.constraints}

    def _per_unit(self, constraint: Constraint) -> Mapping[int, Array]:
        lam = np.zeros((*self.links.places.shape[:-2], constraint.size))
        idle, found = constraint.wrenches(self.links, lam), []
        for row in range(constraint.size):
            unit = lam.copy()
            unit[..., row] = 1.0
            found.append(constraint.wrenches(self.links, unit))
        return {joint: np.stack([each[joint] - idle[joint] for each in found], axis=-2) for joint in idle}

    @cached_property
    def _beyond(self) -> Mapping[int, Mapping[str, Array]]:
        """What the constraints do to the links beyond every joint, as in ``_acting``, by joint index and name.

        Those whose links are all beyond a joint, and which are in balance, do nothing to them together.
        """
        supports = [set(path.tolist()) for path in self.closure.model.supports]
        found: dict[int, dict[str, Array]] = {joint: {} for joint in range(len(supports))}
        for name, acting in self._acting.items():
            balanced = not sum(acting.values(), np.zeros(())).any()
            between = set.union(set(), *(supports[link] for link in acting))
            if balanced and acting:
                between -= set.intersection(*(supports[link] for link in acting))
            for joint in between:
                found[joint][name] = sum(
                    (each for link, each in acting.items() if joint in supports[link]), np.zeros(())
                )
        return found

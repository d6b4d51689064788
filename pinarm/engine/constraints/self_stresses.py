"""Self-stresses (multipliers with ``G^T lam = 0``) of redundant constraints, and the reactions that they change.

Self-stresses can be added to any solution, so that rigid bodies do not determine a wrench that one of them changes. A
loop joint transmits functions of its own rows, a joint of the tree those of the loops on which it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint import Constraint
from pinarm.engine.constraints.nullspace import RowDecompositions
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record

Acting = Mapping[int, Array]
"""Wrenches [f; m] on links at the world's origin, world axes, by joint index, shape (n, size, 6) for the rows of one
constraint."""

LARGE = 2.0**30
"""Size of multipliers at which couplings are looked at [N or N*m]: what a self-stress of any size may do, beyond the
pretension of belts."""

KEPT = 8
"""Joints of which what is added is kept."""


class SelfStresses(Record, frozen=True):
    """The self-stresses of the constraints of a mechanism at n configurations.

    Changes are given for s of them, each of length 1, along the first axis. States of variants have a second axis.

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
        return np.moveaxis(self.splits.stresses.swapaxes(-1, -2) @ functions, -2, 0)

    def on_loop(self, joint: LoopJoint) -> Array:
        """Return what they add to the wrench of a loop joint, see ``LoopJoint.wrench``, shape (s, n, 6)."""
        return self._on_loop(joint) if self.degree else self._nothing

    def on_joint(self, joint: int) -> Array:
        """Return what they add to the wrench of the parent on the child of a joint, see ``transmitted``, (s, n, 6).

        Each coupling that pushes its members apart both ways, or pulls them together, adds on its own: of two that
        share a load what one pushes less the other does not push more.
        """
        return self._on_joint(joint) if self.degree else self._nothing

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
        return self._about(joint, self._beyond[joint])

    def _about(self, joint: int, beyond: Mapping[str, Array]) -> Array:
        """Return what balances wrenches at the world's origin, by constraint, at a joint's origin, shape (n, m, 6)."""
        arm = -self.links.places[..., joint, None, :]
        return self._functions({name: moved(-part, arm) for name, part in beyond.items()})

    @cached_property
    def _on_loop(self) -> Callable[[LoopJoint], Array]:
        """What is added to loop joints; the last are kept, as components of a wrench are asked one after the other."""
        return lru_cache(maxsize=KEPT)(lambda joint: self.on(self._held(joint)))

    @cached_property
    def _on_joint(self) -> Callable[[int], Array]:
        """What is added to joints of the tree; the last are kept."""

        def added(joint: int) -> Array:
            both_ways = [self.on(self._about(joint, {name: part})) for name, part in self._both_ways[joint].items()]
            return np.concatenate([self.on(self.transmitted(joint)), *both_ways])

        return lru_cache(maxsize=KEPT)(added)

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
    def _acting(self) -> Mapping[str, Acting]:
        """What unit multipliers of every constraint do to links: what changes its sense with them."""
        one_way = {
            one.name: self._per_unit(one, 1.0) for one in self.closure.constraints if one.name not in self._pushed
        }
        both = {name: {k: 0.5 * (up[k] - down[k]) for k in up} for name, (up, down) in self._pushed.items()}
        return one_way | both

    @cached_property
    def _beyond(self) -> list[Mapping[str, Array]]:
        """What unit multipliers do to the links beyond every joint, as in ``_acting``, by constraint."""
        return self._beyond_joints(self._acting)

    @cached_property
    def _both_ways(self) -> list[Mapping[str, Array]]:
        """What they do in the same sense both ways, as teeth push wheels apart and strands pull them together."""
        both = {name: {k: 0.5 * (up[k] + down[k]) for k in up} for name, (up, down) in self._pushed.items()}
        return self._beyond_joints({name: acting for name, acting in both.items() if any(map(np.any, acting.values()))})

    @cached_property
    def _pushed(self) -> Mapping[str, tuple[Acting, Acting]]:
        """What large multipliers of every coupling do to links per unit, and what opposite ones do."""
        found = {}
        for one in self.closure.constraints:
            if isinstance(one, JointRelation):
                idle = one.wrenches(self.links, np.zeros((*self.links.places.shape[:-2], 1)))
                up, down = (self._per_unit(one, size) for size in (LARGE, -LARGE))
                at_rest = {k: wrench[..., None, :] / LARGE for k, wrench in idle.items()}
                found[one.name] = {k: up[k] - at_rest[k] for k in up}, {k: -down[k] - at_rest[k] for k in down}
        return found

    def _per_unit(self, constraint: Constraint, size: float) -> Acting:
        """Return what multipliers of a size, one after the other, do to links per unit."""
        found = []
        for row in range(constraint.size):
            lam = np.zeros((*self.links.places.shape[:-2], constraint.size))
            lam[..., row] = size
            found.append(constraint.wrenches(self.links, lam))
        return {link: np.stack([each[link] for each in found], axis=-2) / size for link in found[0]}

    def _beyond_joints(self, parts: Mapping[str, Acting]) -> list[Mapping[str, Array]]:
        """Return what constraints do to the links beyond every joint, by their names.

        Those whose links are all beyond a joint, and which are in balance, do nothing to them together.
        """
        supports = [set(path.tolist()) for path in self.closure.model.supports]
        found: list[dict[str, Array]] = [{} for _ in supports]
        for name, acting in parts.items():
            between = set.union(set(), *(supports[link] for link in acting))
            if acting and not sum(acting.values(), np.zeros(())).any():
                between -= set.intersection(*(supports[link] for link in acting))
            for joint in between:
                some = (part for link, part in acting.items() if joint in supports[link])
                found[joint][name] = sum(some, np.zeros(()))
        return [*found]

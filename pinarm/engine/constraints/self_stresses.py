"""Self-stresses (multipliers with ``G^T lam = 0``) of redundant constraints, and the reactions that they change.

Self-stresses can be added to any solution, so that rigid bodies do not determine a wrench that one of them changes. A
loop joint transmits functions of its own rows, a joint of the tree those of the loops on which it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import Constraint
from pinarm.engine.constraints.nullspace import ACTS, Decomposition
from pinarm.errors import several
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import looser
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

Acting = Mapping[int, Array]
"""Wrenches [f; m] on links at the world's origin, world axes, by joint index, shape (n, size, 6) for the rows of one
constraint."""

LARGE = 2.0**30
"""Size of multipliers at which couplings are looked at [N or N*m]: what a self-stress of any size may do, beyond the
pretension of belts."""


class SelfStresses(Record, frozen=True):
    """The self-stresses of the constraints of a mechanism at n configurations.

    Changes are given for s of them, each of length 1, along the first axis. States of variants have a second axis.
    """

    closure: Closure
    q: Array

    @cached_property
    def split(self) -> Decomposition:
        return self.closure.split_at(self.q)

    @cached_property
    def links(self) -> LinkPlacements:
        """Where the links are."""
        return LinkPlacements.at(self.closure.model, self.q)

    @property
    def degree(self) -> int:
        """Degree of hyperstatism: number of rows that repeat others, where there are most."""
        return self.closure.size - int(self.split.rank.min()) if self.closure.size and len(self.q) else 0

    def on(self, functions: Array) -> Array:
        """Return the changes of functions of the multipliers by self-stresses, shape (n, m, k) to (s, n, k)."""
        return np.moveaxis(self.split.stresses.swapaxes(-1, -2) @ functions, -2, 0)

    def on_loop(self, joint: LoopJoint) -> Array:
        """Return the changes of the wrench of a loop joint, see ``LoopJoint.wrench``, shape (s, n, 6)."""
        if not self.degree:
            return self._nothing
        second, arm = self.closure.model.frames[joint.second].parentJoint, -self.links.frame(joint.second)[1]
        held = moved(self._acting[joint.name][second], arm[..., None, :])
        return self.on(self.functions({joint.name: held}))

    def on_joint(self, joint: int) -> Array:
        """Return the changes of the wrench of the parent on the child of a joint, see ``transmitted``, shape (s, n, 6).

        Each coupling that pushes its members apart both ways, or pulls them together, adds a change of its own: if two
        couplings share a load, the push that one loses is not gained by the other.
        """
        if not self.degree:
            return self._nothing
        both_ways = [self.on(self._about(joint, {name: part})) for name, part in self._both_ways[joint].items()]
        return np.concatenate([self.on(self.transmitted(joint)), *both_ways])

    def on_multipliers(self, weights: Mapping[str, Array]) -> Array:
        """Return the changes of a weighted sum of multipliers, shape (s, n)."""
        if not self.degree or not weights:
            return self._nothing[..., 0]
        return self.on(self.functions({name: weight[:, None, None] for name, weight in weights.items()}))[..., 0]

    def transmitted(self, joint: int) -> Array:
        """Return the wrench of the parent on the child per unit of every multiplier, shape (n, m, 6).

        [f; m] at the joint's origin, world axes. It balances what the multipliers do to the links beyond the joint.
        """
        return self._about(joint, self._beyond[joint])

    def _about(self, joint: int, beyond: Mapping[str, Array]) -> Array:
        """Return wrenches at a joint's origin that balance wrenches at the world's, by constraint, shape (n, m, 6)."""
        arm = -self.links.places[..., joint, None, :]
        return self.functions({name: moved(-part, arm) for name, part in beyond.items()})

    @property
    def _nothing(self) -> Array:
        return np.zeros((0, len(self.q), 6))

    def functions(self, parts: Mapping[str, Array]) -> Array:
        """Return functions of all multipliers from those of some constraints, shape (.., size, k) each."""
        width = max((part.shape[-1] for part in parts.values()), default=6)
        states = np.broadcast_shapes(self.links.places.shape[:-2], *(part.shape[:-2] for part in parts.values()))
        functions = np.zeros((*states, self.closure.size, width))
        for name, part in parts.items():
            functions[..., self.closure.slices[name], :] = part
        return functions

    @cached_property
    def _acting(self) -> Mapping[str, Acting]:
        """Wrenches on links per unit multiplier of every constraint, without the part that keeps its sense."""
        one_way = {
            constraint.name: self._per_unit(constraint, 1.0)
            for constraint in self.closure.constraints
            if constraint.name not in self._pushed
        }
        both = {name: {k: 0.5 * (up[k] - down[k]) for k in up} for name, (up, down) in self._pushed.items()}
        return one_way | both

    @cached_property
    def _beyond(self) -> list[Mapping[str, Array]]:
        """Wrenches of ``_acting`` on the links beyond every joint, by constraint."""
        return self._beyond_joints(self._acting)

    @cached_property
    def _both_ways(self) -> list[Mapping[str, Array]]:
        """Wrenches beyond every joint that keep their sense both ways: teeth push apart, strands pull together."""
        both = {name: {k: 0.5 * (up[k] + down[k]) for k in up} for name, (up, down) in self._pushed.items()}
        return self._beyond_joints({name: acting for name, acting in both.items() if any(map(np.any, acting.values()))})

    @cached_property
    def _pushed(self) -> Mapping[str, tuple[Acting, Acting]]:
        """Wrenches on links per unit of large multipliers of every coupling, and of opposite ones."""
        pushes = {}
        for constraint in self.closure.constraints:
            if isinstance(constraint, JointRelation):
                idle = constraint.wrenches(self.links, np.zeros((*self.links.places.shape[:-2], 1)))
                up, down = (self._per_unit(constraint, size) for size in (LARGE, -LARGE))
                at_rest = {k: wrench[..., None, :] / LARGE for k, wrench in idle.items()}
                pushes[constraint.name] = {k: up[k] - at_rest[k] for k in up}, {k: -down[k] - at_rest[k] for k in down}
        return pushes

    def _per_unit(self, constraint: Constraint, size: float) -> Acting:
        """Return the wrenches on links per unit of each multiplier of a constraint, computed at a size."""
        stresses = []
        for row in range(constraint.size):
            lam = np.zeros((*self.links.places.shape[:-2], constraint.size))
            lam[..., row] = size
            stresses.append(constraint.wrenches(self.links, lam))
        return {link: np.stack([wrenches[link] for wrenches in stresses], axis=-2) / size for link in stresses[0]}

    def _beyond_joints(self, parts: Mapping[str, Acting]) -> list[Mapping[str, Array]]:
        """Return the wrenches of constraints, by name, on the links beyond every joint."""
        supports = [set(path.tolist()) for path in self.closure.model.supports]
        wrenches: list[dict[str, Array]] = [{} for _ in supports]
        for name, acting in parts.items():
            between = set.union(set(), *(supports[link] for link in acting))
            if acting and not sum(acting.values(), np.zeros(())).any():
                between -= set.intersection(*(supports[link] for link in acting))
            for joint in between:
                some = (part for link, part in acting.items() if joint in supports[link])
                wrenches[joint][name] = sum(some, np.zeros(()))
        return [*wrenches]


SPINNING = 1e-9
"""Largest ratio of singular values of a joint's columns at which one of its motions moves nothing that is held."""

COMPONENTS = ("force x", "force y", "force z", "moment x", "moment y", "moment z")


class Mobility(Record, frozen=True):
    """Mobility and degree of hyperstatism of a mechanism in one configuration.

    Attributes:
        regularity: Smallest singular value of the rows that counts, relative to the largest; 0 at singular positions.
        spins: Links that turn about an axis of their own by themselves, such as rods between two ball joints, by the
            joints that they turn on. Each is one of the degrees of freedom.
    """

    stresses: SelfStresses
    regularity: float
    spins: tuple[str, ...] = ()

    @property
    def joints(self) -> int:
        return int(self.stresses.closure.model.nv)

    @property
    def rows(self) -> int:
        return self.stresses.closure.size

    @property
    def degree(self) -> int:
        """Degree of hyperstatism: rows that repeat others."""
        return self.stresses.degree

    @property
    def rank(self) -> int:
        return self.rows - self.degree

    @property
    def mobility(self) -> int:
        """Degrees of freedom of the closed mechanism."""
        return self.joints - self.rank

    @cached_property
    def undetermined(self) -> dict[str, list[str]]:
        """Joint -> components of its reaction that rigid bodies do not determine.

        Of loop joints in frame 1, of joints of the tree in their own axes.
        """
        if not self.degree:
            return {}
        stresses, links, model = self.stresses, self.stresses.links, self.stresses.closure.model
        added = [
            (joint.name, links.frame(joint.first)[0][0], stresses.on_loop(joint)[:, 0])
            for joint in stresses.closure.constraints
            if isinstance(joint, LoopJoint)
        ]
        added += [(str(model.names[k]), links.turns[0, k], stresses.on_joint(k)[:, 0]) for k in range(1, model.njoints)]
        undetermined = {name: _acting(turn, wrenches) for name, turn, wrenches in added}
        return {name: parts for name, parts in undetermined.items() if parts}

    @cached_property
    def loosenings(self) -> tuple[Loosening, ...]:
        """Loosenings that keep the mobility and reduce the redundant rows, the best first."""
        loose, stresses = list[Loosening](), self.stresses
        loops = [joint for joint in stresses.closure.constraints if isinstance(joint, LoopJoint) and self.degree]
        for joint, kind, given_up in ((loop, *other) for loop in loops for other in looser(loop.pair)):
            if not given_up.size:
                continue
            added = stresses.on(stresses.functions({joint.name: given_up}))[:, 0]
            if np.count_nonzero(np.linalg.svd(added, compute_uv=False) > ACTS) == given_up.shape[-1]:  # independently
                loose.append(Loosening(((joint.name, kind),), self.degree - given_up.shape[-1]))
        return tuple(sorted(loose, key=lambda loosening: (loosening.degree, loosening.changes)))

    @property
    def shared(self) -> str:
        """Sentence on the loads of joints that rigid bodies do not determine, and on the best loosening."""
        parts = [f"{name} ({', '.join(components)})" for name, components in self.undetermined.items()]
        held = f"hyperstatic of degree {self.degree}{f', shared by {several(parts)}' if parts else ''}"
        return f"{held}; looser: {self.loosenings[0]}" if self.loosenings else held


def mobility_of(mechanism: Mechanism, q: Array) -> Mobility:
    """Return the mobility and degree of hyperstatism of a mechanism at a closed configuration, shape (nq,)."""
    closure = mechanism.closure
    stresses, values = SelfStresses(closure, q[None]), closure.values(q[None])[0]
    rank = closure.size - stresses.degree
    regularity = float(values[rank - 1] / values[0]) if rank else 1.0
    return Mobility(stresses, regularity, _spins(mechanism, q))


def _spins(mechanism: Mechanism, q: Array) -> tuple[str, ...]:
    """Return the ball joints that turn about an axis while all other joints stand still, at a configuration, (nq,).

    Loops hold what is on them, but not this motion: ``G_b w = 0`` for a direction w of the columns of the joint.
    """
    model, spins = mechanism.model, list[str]()
    balls = [k for k in range(1, model.njoints) if model.joints[k].shortname().startswith("JointModelSpherical")]
    matrix = mechanism.closure.rows(mechanism.closure.state(q)) if balls else np.zeros((0, model.nv))
    for index in balls:
        joint = model.joints[index]
        columns = matrix[:, joint.idx_v : joint.idx_v + joint.nv]
        if not columns.any():
            continue
        values = np.linalg.svd(columns, compute_uv=False)
        if len(values) < joint.nv or values[-1] <= SPINNING * values[0]:
            spins.append(str(model.names[index]))
    return tuple(spins)


def _acting(turn: Array, wrenches: Array) -> list[str]:
    """Return the components of wrenches, shape (s, 6), in the axes of a rotation matrix, that are not 0."""
    local = np.hstack([wrenches[:, :3] @ turn, wrenches[:, 3:] @ turn])
    return [name for name, part in zip(COMPONENTS, local.T, strict=True) if np.abs(part).max(initial=0.0) > ACTS]


def joint_kind(model: pin.Model, index: int) -> str:
    """Return the kind of a joint of the tree, as mechanism files call it."""
    name = str(model.joints[index].shortname()).removeprefix("JointModel")
    return next((kind for start, kind in KINDS.items() if name.startswith(start)), name)


KINDS = {
    "Planar": "planar", "Revolute": "revolute", "R": "revolute", "P": "prismatic", "Spherical": "spherical",
    "FreeFlyer": "free", "Translation": "translation", "Mimic": "mimic",
}  # fmt: skip
"""Prefixes of Pinocchio's names of joints, longer ones first -> kinds of joints."""


class Loosening(ValueRecord, frozen=True):
    """Joints replaced by others that hold less."""

    changes: tuple[tuple[str, str], ...]
    degree: int

    def __str__(self) -> str:
        return f"{' and '.join(f'{joint} as {kind}' for joint, kind in self.changes)}: degree {self.degree}"

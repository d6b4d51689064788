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
from pinarm.engine.constraints.nullspace import ACTS, Decomposition
from pinarm.errors import several
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import looser
from pinarm.records import Record, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

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
    def _split(self) -> Decomposition:
        return self.closure.split_at(self.q)

    @cached_property
    def links(self) -> LinkPlacements:
        """Where the links are."""
        return LinkPlacements.at(self.closure.model, self.q)

    @property
    def degree(self) -> int:
        """Degree of hyperstatism: number of rows that repeat others, where there are most."""
        return self.closure.size - int(self._split.rank.min()) if self.closure.size and len(self.q) else 0

    @cached_property
    def multipliers(self) -> Array:
        """The self-stresses, shape (s, n, .., m); 0 where there are fewer than elsewhere."""
        if not self.degree:
            return np.zeros((0, *self.q.shape[:-1], self.closure.size))
        return np.moveaxis(self._split.stresses, -1, 0)

    def on_loop(self, joint: LoopJoint) -> Array:
        """Return the changes of the wrench of a loop joint, see ``LoopJoint.wrench``, shape (s, n, 6)."""
        return joint.wrench(self.links, self.multipliers[..., self.closure.slices[joint.name]])

    def on_multipliers(self, weights: Mapping[str, Array]) -> Array:
        """Return the changes of a weighted sum of multipliers, shape (s, n)."""
        parts = (self.multipliers[..., self.closure.slices[name].start] * weight for name, weight in weights.items())
        return np.asarray(sum(parts, np.zeros(self.multipliers.shape[:-1])))

    def on_joint(self, joint: int) -> Array:
        """Return the changes of the wrench of the parent on the child of a joint, see ``transmitted``, shape (c, n, 6).

        Each coupling that pushes its members apart both ways, or pulls them together, adds changes of its own: if two
        couplings share a load, the push that one loses is not gained by the other.
        """
        return -moved(self._beyond[..., joint, :], -self.links.places[..., joint, :])

    @cached_property
    def _beyond(self) -> Array:
        """Changes of wrenches on the links beyond every joint, [f; m] at the world's origin, (c, n, .., njoints, 6)."""
        (up, down), closure, places = self._pushes(self.closure), self.closure, self.closure.slices
        changes = [0.5 * (up - down)]
        for coupling in (coupling for coupling in closure.constraints if isinstance(coupling, JointRelation)):
            up, down = self._pushes(replace(closure, constraints=(coupling,)), places[coupling.name])
            changes.append(0.5 * (up + down))
        beyond = np.concatenate([change for change in changes if change.any()] or changes[:1])
        for link in range(closure.model.njoints - 1, 0, -1):
            beyond[..., closure.model.parents[link], :] += beyond[..., link, :]
        return beyond

    def _pushes(self, closure: Closure, rows: slice = slice(None)) -> tuple[Array, Array]:
        """Return the wrenches of some constraints on links per unit of large self-stresses, and of opposite ones.

        Teeth push apart and strands pull together both ways. Shape (s, n, .., njoints, 6) each.
        """
        lam = self.multipliers[..., rows]
        idle = closure.wrenches(self.links, 0.0 * lam)
        up, down = ((closure.wrenches(self.links, size * lam) - idle) / LARGE for size in (LARGE, -LARGE))
        return up, down


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
            added = stresses.multipliers[:, 0, stresses.closure.slices[joint.name]] @ given_up
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

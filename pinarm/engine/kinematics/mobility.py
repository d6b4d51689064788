"""How a mechanism can move and how it is tied: mobility, redundant constraints, and which joints to loosen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import RowDecomposition
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import looser

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

COMPONENTS = ("force x", "force y", "force z", "moment x", "moment y", "moment z")

ACTS = 1e-8
"""Part of a self-stress of length 1 that acts on a component: rounding leaves 1e-12."""


@dataclass(frozen=True)
class Mobility:
    """What the constraints of a mechanism do in one configuration.

    Attributes:
        joints: Degrees of freedom of the tree.
        rows: Number of constraint rows.
        rank: Number of independent ones.
        regularity: Smallest of their singular values that counts, relative to the largest; 0 at singular positions.
        undetermined: Joint -> components of its reaction that rigid bodies do not determine, in its own axes.
        loosenings: What could be loosened, with the degree of hyperstatism and the mobility that it leaves.
    """

    joints: int
    rows: int
    rank: int
    regularity: float
    undetermined: dict[str, list[str]]
    loosenings: tuple[Loosening, ...]

    @property
    def mobility(self) -> int:
        """Degrees of freedom of the closed mechanism."""
        return self.joints - self.rank

    @property
    def degree(self) -> int:
        """Degree of hyperstatism: rows that repeat others."""
        return self.rows - self.rank


@dataclass(frozen=True)
class Loosening:
    """A loop joint replaced by one that holds less.

    Attributes:
        joint: Name of the loop joint.
        kind: The kind that it would get.
        degree: Degree of hyperstatism that is left.
    """

    joint: str
    kind: str
    degree: int


def mobility_of(mechanism: Mechanism, q: Array) -> Mobility:
    """Return what the constraints of a mechanism do at a closed configuration, shape (nq,)."""
    closure = mechanism.closure
    matrix = closure.rows(closure.state(q))
    split, values = RowDecomposition.of(matrix), closure.values_of(matrix)
    rank, rows = len(split.values), closure.size
    regularity = float(values[rank - 1] / values[0]) if rank else 1.0
    loosenings = _loosenings(closure, q, rows - rank, rank) if rows > rank else ()
    return Mobility(mechanism.model.nv, rows, rank, regularity, _undetermined(closure, split, q), loosenings)


def _undetermined(closure: Closure, split: RowDecomposition, q: Array) -> dict[str, list[str]]:
    """Return the components that self-stresses act on, of loop joints in frame 1, of tree joints in their own axes."""
    model, found, links = closure.model, dict[str, set[int]](), LinkPlacements.at(closure.model, q[None])
    stresses = (split.scale[:, None] * split.redundant).T
    for stress in stresses / np.maximum(np.linalg.norm(stresses, axis=1, keepdims=True), 1e-300):
        for constraint, rows in zip(closure.constraints, closure.slices().values(), strict=True):
            if isinstance(constraint, LoopJoint):
                turn, wrench = links.frame(constraint.first)[0][0], constraint.wrench(links, stress[None, rows])[0]
                found.setdefault(constraint.name, set()).update(_acting(turn, wrench))
        acting = closure.added_wrenches(links, stress[None])[0]
        for joint in range(1, model.njoints):
            total = -acting[list(model.subtrees[joint])].sum(axis=0)
            total[3:] -= np.cross(links.places[0, joint], total[:3])
            found.setdefault(str(model.names[joint]), set()).update(_acting(links.turns[0, joint], total))
    return {name: [COMPONENTS[k] for k in sorted(parts)] for name, parts in found.items() if parts}


def _acting(turn: Array, wrench: Array) -> list[int]:
    local = np.concatenate([turn.T @ wrench[:3], turn.T @ wrench[3:]])
    return [k for k in range(6) if abs(local[k]) > ACTS]


def _loosenings(closure: Closure, q: Array, degree: int, rank: int) -> tuple[Loosening, ...]:
    """Return the looser kinds of every loop joint that leave the mobility as it is and fewer redundant rows."""
    found = []
    for index, joint in enumerate(closure.constraints):
        if not isinstance(joint, LoopJoint):
            continue
        for kind, pair in looser(joint.pair):
            others = list(closure.constraints)
            others[index] = replace(joint, kind=kind, pair=pair)
            changed = Closure.of(closure.model, others)
            left = RowDecomposition.of(changed.rows(changed.state(q)))
            if len(left.values) == rank and changed.size - rank < degree:
                found.append(Loosening(joint.name, kind, changed.size - rank))
    return tuple(sorted(found, key=lambda one: (one.degree, one.joint, one.kind)))


def assembled_near(mechanism: Mechanism, start: dict[str, float]) -> Array:
    """Return the closed configuration near rough joint coordinates, shape (nq,).

    Raises:
        AssemblyError: The loops cannot be closed from there.
    """
    from pinarm.engine.kinematics.newton import assembled, start_configuration
    from pinarm.engine.kinematics.prescribed import PrescribedCoordinates

    q = start_configuration(mechanism, start)
    return (
        assembled(mechanism.closure, PrescribedCoordinates((), (), ()), q, np.zeros(0), 0.0)
        if mechanism.closure.size
        else q
    )


def joint_kind(model: pin.Model, index: int) -> str:
    """Return what kind a joint of the tree is, in the words of mechanisms."""
    name = str(model.joints[index].shortname()).removeprefix("JointModel")
    return next((kind for start, kind in KINDS.items() if name.startswith(start)), name)


KINDS = {
    "Planar": "planar", "Revolute": "revolute", "R": "revolute", "P": "prismatic", "Spherical": "spherical",
    "FreeFlyer": "free", "Translation": "translation", "Mimic": "mimic",
}  # fmt: skip
"""How Pinocchio's names of joints begin, the longer ones first, and the words for them."""

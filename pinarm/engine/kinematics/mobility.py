"""How a mechanism can move and how it is tied: mobility, redundant constraints, and which joints to loosen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import ACTS, RowDecomposition
from pinarm.engine.kinematics.loosening import Loosening, loosenings
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.loops.loop_joints import LoopJoint

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

COMPONENTS = ("force x", "force y", "force z", "moment x", "moment y", "moment z")


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

    @property
    def shared(self) -> str:
        """What joints share in a way that rigid bodies do not determine, and what to loosen, in one sentence."""
        parts = [f"{name} ({', '.join(components)})" for name, components in self.undetermined.items()]
        held = f"hyperstatic of degree {self.degree}, shared by {', '.join(parts)}"
        return f"{held}; looser: {self.loosenings[0]}" if self.loosenings else held


def mobility_of(mechanism: Mechanism, q: Array) -> Mobility:
    """Return what the constraints of a mechanism do at a closed configuration, shape (nq,)."""
    closure = mechanism.closure
    matrix = closure.rows(closure.state(q))
    split, values = closure.split(matrix), closure.values_of(matrix)
    rank, rows = len(split.values), closure.size
    regularity = float(values[rank - 1] / values[0]) if rank else 1.0
    found = loosenings(closure, q, rows - rank, rank) if rows > rank else ()
    return Mobility(mechanism.model.nv, rows, rank, regularity, _undetermined(closure, split, q), found)


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


def joint_kind(model: pin.Model, index: int) -> str:
    """Return what kind a joint of the tree is, in the words of mechanisms."""
    name = str(model.joints[index].shortname()).removeprefix("JointModel")
    return next((kind for start, kind in KINDS.items() if name.startswith(start)), name)


KINDS = {
    "Planar": "planar", "Revolute": "revolute", "R": "revolute", "P": "prismatic", "Spherical": "spherical",
    "FreeFlyer": "free", "Translation": "translation", "Mimic": "mimic",
}  # fmt: skip
"""How Pinocchio's names of joints begin, the longer ones first, and the words for them."""

"""How a mechanism can move and how it is tied: mobility, redundant constraints, and which joints to loosen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspaces.nullspace import ACTS, SplitRows
from pinarm.engine.kinematics.loosening import Loosening, loosenings
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.loops.loop_joints import LoopJoint

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

SPINNING = 1e-9
"""Largest ratio of singular values of a joint's columns at which one of its motions moves nothing that is held."""

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
        spins: Links that turn about an axis of their own by themselves, such as rods between two ball joints, by the
            joints that they turn on. Each is one of the degrees of freedom.
    """

    joints: int
    rows: int
    rank: int
    regularity: float
    undetermined: dict[str, list[str]]
    loosenings: tuple[Loosening, ...]
    spins: tuple[str, ...] = ()

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
    rank, rows = split.rank, closure.size
    regularity = float(values[rank - 1] / values[0]) if rank else 1.0
    found = loosenings(closure, q, rows - rank, rank) if rows > rank else ()
    return Mobility(mechanism.model.nv, rows, rank, regularity, _undetermined(closure, split, q), found,
                    _spins(mechanism, matrix))  # fmt: skip


def _spins(mechanism: Mechanism, matrix: Array) -> tuple[str, ...]:
    """Return the ball joints that turn about an axis while all other joints stand still, under the rows G, (m, nv).

    Loops hold what is on them, but not this motion: ``G_b w = 0`` for a direction w of the columns of the joint.
    """
    model, found = mechanism.model, list[str]()
    for index in range(1, model.njoints):
        joint = model.joints[index]
        columns = matrix[:, joint.idx_v : joint.idx_v + joint.nv]
        if not joint.shortname().startswith("JointModelSpherical") or not columns.any():
            continue
        values = np.linalg.svd(columns, compute_uv=False)
        if len(values) < joint.nv or values[-1] <= SPINNING * values[0]:
            found.append(str(model.names[index]))
    return tuple(found)


def _undetermined(closure: Closure, split: SplitRows, q: Array) -> dict[str, list[str]]:
    """Return the components that self-stresses act on, of loop joints in frame 1, of tree joints in their own axes."""
    model, found, links = closure.model, dict[str, set[int]](), LinkPlacements.at(closure.model, q[None])
    for stress in split.stresses.T:
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

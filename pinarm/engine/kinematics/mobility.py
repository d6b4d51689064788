"""How a mechanism can move and how it is tied: mobility, redundant constraints, and which joints to loosen."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.constraints.self_stresses import SelfStresses
from pinarm.engine.kinematics.loosening import Loosening, loosenings
from pinarm.errors import several
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

SPINNING = 1e-9
"""Largest ratio of singular values of a joint's columns at which one of its motions moves nothing that is held."""

COMPONENTS = ("force x", "force y", "force z", "moment x", "moment y", "moment z")


class Mobility(Record, frozen=True):
    """What the constraints of a mechanism do in one configuration.

    Attributes:
        stresses: The self-stresses there.
        regularity: Smallest singular value of the rows that counts, relative to the largest; 0 at singular positions.
        spins: Links that turn about an axis of their own by themselves, such as rods between two ball joints, by the
            joints that they turn on. Each is one of the degrees of freedom.
    """

    stresses: SelfStresses
    regularity: float
    spins: tuple[str, ...] = ()

    @property
    def joints(self) -> int:
        """Degrees of freedom of the tree."""
        return int(self.stresses.closure.model.nv)

    @property
    def rows(self) -> int:
        """Number of constraint rows."""
        return self.stresses.closure.size

    @property
    def rank(self) -> int:
        """Number of independent ones."""
        return self.rows - self.degree

    @property
    def mobility(self) -> int:
        """Degrees of freedom of the closed mechanism."""
        return self.joints - self.rank

    @property
    def degree(self) -> int:
        """Degree of hyperstatism: rows that repeat others."""
        return self.stresses.degree

    @cached_property
    def undetermined(self) -> dict[str, list[str]]:
        """Joint -> components of its reaction that rigid bodies do not determine, in its own axes."""
        return _undetermined(self.stresses) if self.degree else {}

    @cached_property
    def loosenings(self) -> tuple[Loosening, ...]:
        """What could be loosened, with the degree of hyperstatism that it leaves and the mobility as it is."""
        return loosenings(self.stresses) if self.degree else ()

    @property
    def shared(self) -> str:
        """What joints share in a way that rigid bodies do not determine, and what to loosen, in one sentence."""
        parts = [f"{name} ({', '.join(components)})" for name, components in self.undetermined.items()]
        held = f"hyperstatic of degree {self.degree}{f', shared by {several(parts)}' if parts else ''}"
        return f"{held}; looser: {self.loosenings[0]}" if self.loosenings else held


def mobility_of(mechanism: Mechanism, q: Array) -> Mobility:
    """Return what the constraints of a mechanism do at a closed configuration, shape (nq,)."""
    closure = mechanism.closure
    stresses, values = SelfStresses(closure, q[None]), closure.values(q[None])[0]
    rank = closure.size - stresses.degree
    regularity = float(values[rank - 1] / values[0]) if rank else 1.0
    return Mobility(stresses, regularity, _spins(mechanism, q))


def _spins(mechanism: Mechanism, q: Array) -> tuple[str, ...]:
    """Return the ball joints that turn about an axis while all other joints stand still, at a configuration, (nq,).

    Loops hold what is on them, but not this motion: ``G_b w = 0`` for a direction w of the columns of the joint.
    """
    model, found = mechanism.model, list[str]()
    balls = [k for k in range(1, model.njoints) if model.joints[k].shortname().startswith("JointModelSpherical")]
    matrix = mechanism.closure.rows(mechanism.closure.state(q)) if balls else np.zeros((0, model.nv))
    for index in balls:
        joint = model.joints[index]
        columns = matrix[:, joint.idx_v : joint.idx_v + joint.nv]
        if not columns.any():
            continue
        values = np.linalg.svd(columns, compute_uv=False)
        if len(values) < joint.nv or values[-1] <= SPINNING * values[0]:
            found.append(str(model.names[index]))
    return tuple(found)


def _undetermined(stresses: SelfStresses) -> dict[str, list[str]]:
    """Return the components that self-stresses act on, of loop joints in frame 1, of tree joints in their own axes."""
    model, links, added = stresses.closure.model, stresses.links, dict[str, tuple[Array, Array]]()
    for joint in stresses.closure.constraints:
        if isinstance(joint, LoopJoint):
            added[joint.name] = links.frame(joint.first)[0][0], stresses.on_loop(joint)[:, 0]
    for index in range(1, model.njoints):
        added[str(model.names[index])] = links.turns[0, index], stresses.on_joint(index)[:, 0]
    found = {name: _acting(*each) for name, each in added.items()}
    return {name: parts for name, parts in found.items() if parts}


def _acting(turn: Array, wrenches: Array) -> list[str]:
    """Return the components of wrenches, shape (s, 6), in the axes of a rotation matrix, that are not 0."""
    local = np.hstack([wrenches[:, :3] @ turn, wrenches[:, 3:] @ turn])
    return [name for name, part in zip(COMPONENTS, local.T, strict=True) if np.abs(part).max(initial=0.0) > ACTS]


def joint_kind(model: pin.Model, index: int) -> str:
    """Return what kind a joint of the tree is, in the words of mechanisms."""
    name = str(model.joints[index].shortname()).removeprefix("JointModel")
    return next((kind for start, kind in KINDS.items() if name.startswith(start)), name)


KINDS = {
    "Planar": "planar", "Revolute": "revolute", "R": "revolute", "P": "prismatic", "Spherical": "spherical",
    "FreeFlyer": "free", "Translation": "translation", "Mimic": "mimic",
}  # fmt: skip
"""How Pinocchio's names of joints begin, the longer ones first, and the words for them."""

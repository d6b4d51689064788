"""Mobility, redundant constraints, undetermined reactions, and joints of a hyperstatic mechanism that could hold less.

A joint that holds less gives up components of what it transmits. The mobility stays as it is if and only if
self-stresses act on these components independently: each takes one self-stress away, and none frees a motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.constraints.self_stresses import SelfStresses
from pinarm.errors import several
from pinarm.mechanics.geometry.joint_axes import screw_of
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import looser, normals
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

SPINNING = 1e-9
"""Largest ratio of singular values of a joint's columns at which one of its motions moves nothing that is held."""

PAIRS = 6
"""Degree of hyperstatism up to which a hinge of the tree is loosened together with a loop joint: beyond it there are
too many pairs to try, and one joint after the other says more."""

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


class Loosening(ValueRecord, frozen=True):
    """Joints replaced by others that hold less.

    Attributes:
        changes: Joints, loop joints first, and the kinds that they would get.
        degree: Degree of hyperstatism that is left.
    """

    changes: tuple[tuple[str, str], ...]
    degree: int

    def __str__(self) -> str:
        """Return it in words."""
        return f"{' and '.join(f'{joint} as {kind}' for joint, kind in self.changes)}: degree {self.degree}"


def loosenings(stresses: SelfStresses) -> tuple[Loosening, ...]:
    """Return what leaves the mobility as it is and fewer redundant rows, the best first.

    Args:
        stresses: The self-stresses at one closed configuration.
    """
    degree = stresses.degree
    found = [
        Loosening(((joint.name, kind),), degree - components.shape[-1])
        for joint, kind, components in _looser(stresses) if components.size and _independent(stresses, components)
    ]  # fmt: skip
    least = min((one.degree for one in found), default=degree)
    if least and degree <= PAIRS:
        found += [one for one in _pairs(stresses) if one.degree < least]
    return tuple(sorted(found, key=lambda one: (one.degree, one.changes)))


def _looser(stresses: SelfStresses) -> Iterator[tuple[LoopJoint, str, Array]]:
    """Yield every loop joint as it is and with each kind that holds less: the joint, the kind, what it gives up.

    That is told as functions of all multipliers, shape (1, m, c).
    """
    for joint in stresses.closure.constraints:
        if isinstance(joint, LoopJoint):
            own = stresses.own(joint)
            yield joint, joint.kind, own[..., :0]
            for kind, given_up in looser(joint.pair):
                yield joint, kind, own @ given_up


def _independent(stresses: SelfStresses, components: Array) -> bool:
    """Tell whether self-stresses act independently on components, functions of all multipliers, shape (1, m, c)."""
    added = stresses.on(components)[:, 0]
    return bool(np.count_nonzero(np.linalg.svd(added, compute_uv=False) > ACTS) == components.shape[-1])


def _pairs(stresses: SelfStresses) -> Iterator[Loosening]:
    """Yield loop joints that hold less or as much, each with a hinge of the tree on its loop that holds less."""
    model = stresses.closure.model
    for joint, kind, components in _looser(stresses):
        one, two = (set(model.supports[model.frames[frame].parentJoint]) for frame in (joint.first, joint.second))
        for index in sorted(one ^ two):
            if not model.joints[index].shortname().startswith("JointModelR"):
                continue
            for name, more in _of_hinge(stresses, index):
                both = np.concatenate([components, more], axis=-1)
                if _independent(stresses, both):
                    changes = ((joint.name, kind),) if kind != joint.kind else ()
                    left = stresses.degree - both.shape[-1]
                    yield Loosening((*changes, (str(model.names[index]), name)), left)


def _of_hinge(stresses: SelfStresses, index: int) -> Iterator[tuple[str, Array]]:
    """Yield the kinds of joint that hold less than a hinge of the tree, and what it would give up; see ``_looser``."""
    screw, turn = screw_of(stresses.closure.model.joints[index]), stresses.links.turns[0, index]
    assert screw is not None
    axis, wrenches = screw[1], stresses.transmitted(index)
    yield "spherical", wrenches[..., 3:] @ (turn @ normals(axis).T)
    yield "cylindrical", wrenches[..., :3] @ (turn @ axis)[:, None]

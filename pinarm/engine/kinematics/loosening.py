"""Which joints of a hyperstatic mechanism could hold less, its mobility staying as it is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspaces.nullspace import split_rows
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.pinocchio_data import new_data
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import looser
from pinarm.records import replace

PAIRS = 6
"""Degree of hyperstatism up to which a hinge of the tree is loosened together with a loop joint: beyond it there are
too many pairs to try, and one joint after the other says more."""


@dataclass(frozen=True)
class Loosening:
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


def loosenings(closure: Closure, q: Array, degree: int, rank: int) -> tuple[Loosening, ...]:
    """Return what leaves the mobility as it is and fewer redundant rows, the best first.

    Args:
        closure: The constraints.
        q: A closed configuration, shape (nq,).
        degree: Degree of hyperstatism there.
        rank: Rank of the rows there.
    """
    found = []
    for joint, kind, changed in _looser(closure):
        less = kind != joint.kind and changed.size - rank < degree
        if less and changed.split(changed.rows(changed.state(q))).rank == rank:
            found.append(Loosening(((joint.name, kind),), changed.size - rank))
    least = min((one.degree for one in found), default=degree)
    if least and degree <= PAIRS:
        found += [one for one in _pairs(closure, q, rank) if one.degree < least]
    return tuple(sorted(found, key=lambda one: (one.degree, one.changes)))


def _looser(closure: Closure) -> Iterator[tuple[LoopJoint, str, Closure]]:
    """Yield every loop joint as it is and with each kind that holds less: the joint, the kind, all constraints."""
    for index, joint in enumerate(closure.constraints):
        if isinstance(joint, LoopJoint):
            for kind, pair in ((joint.kind, joint.pair), *looser(joint.pair)):
                others = list(closure.constraints)
                others[index] = replace(joint, kind=kind, pair=pair)
                yield joint, kind, Closure.of(closure.model, others)


def _pairs(closure: Closure, q: Array, rank: int) -> Iterator[Loosening]:
    """Yield loop joints that hold less or as much, each with a hinge of the tree on its loop that holds less.

    What a hinge transmits, per unit of every multiplier, are the columns that its new freedoms add to G.
    """
    model = closure.model
    for joint, kind, changed in _looser(closure):
        rows, ends = changed.rows(changed.state(q)), (joint.first, joint.second)
        one, two = (set(model.supports[model.frames[frame].parentJoint]) for frame in ends)
        for index in sorted(one ^ two):
            if not model.joints[index].shortname().startswith("JointModelR"):
                continue
            wrenches, axis = _transmitted(changed, q, index), _axis(model, q, index)
            for name, columns, more in (("spherical", wrenches[:, 3:], 2), ("cylindrical", wrenches[:, :3] @ axis, 1)):
                wider = np.column_stack([rows, columns])
                left = split_rows(wider, changed.reach).rank
                if left == rank + more:
                    changes = ((joint.name, kind),) if kind != joint.kind else ()
                    yield Loosening((*changes, (str(model.names[index]), name)), changed.size - left)


def _transmitted(closure: Closure, q: Array, joint: int) -> Array:
    """Return what a joint of the tree transmits per unit of every multiplier, in its own axes, shape (m, 6)."""
    links = LinkPlacements.at(closure.model, np.tile(q, (closure.size, 1)))
    acting = closure.wrenches(links, np.eye(closure.size))
    total = -acting[:, list(closure.model.subtrees[joint])].sum(axis=1)
    moments = total[:, 3:] - np.cross(links.places[:, joint], total[:, :3])
    return np.hstack([total[:, :3] @ links.turns[0, joint], moments @ links.turns[0, joint]])


def _axis(model: pin.Model, q: Array, joint: int) -> Array:
    """Return the axis of a hinge, in its own axes, shape (3,)."""
    data = new_data(model)
    pin.computeJointJacobians(model, data, q)
    jacobian = np.asarray(pin.getJointJacobian(model, data, joint, pin.LOCAL)).reshape(6, -1)
    return jacobian[3:, model.joints[joint].idx_v]

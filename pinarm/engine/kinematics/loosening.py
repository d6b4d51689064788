"""Which joints of a hyperstatic mechanism could hold less, its mobility staying as it is.

A joint that holds less gives up components of what it transmits. The mechanism moves no more than before if and only
if self-stresses act on these components independently: each takes one self-stress away, and none frees a motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.constraints.self_stresses import SelfStresses
from pinarm.mechanics.geometry.screws import screw_of
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import looser, normals

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

"""What couplings leave open whose forces are not known: reactions of the joints between the bodies that they couple.

The multiplier of such a coupling is known, as efforts at its joints, and so are the reactions of loop joints. But
teeth, belts and threads push on the bodies themselves, and on what carries them. All that is known of these wrenches is
that their power is that of the efforts, and that they balance each other on the bodies from the coupled ones down to
the last one that carries all coupled joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.mechanics.geometry.kinematics import new_data
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.coupling import JointRelation


class OpenReaction(Record, frozen=True):
    """The part of a joint's reaction that couplings leave open.

    Attributes:
        couplings: Those that do.
        wrenches: Wrenches [f; m] at the joint's origin, in its own axes, that span what they may add, shape (k, 6).
    """

    couplings: tuple[JointRelation, ...]
    wrenches: Array

    def __str__(self) -> str:
        named = (f"'{coupling.name}' ({coupling.kind}): {coupling.missing}" for coupling in self.couplings)
        return "couplings leave it open: " + "; ".join(named)


def left_open(model: pin.Model, couplings: Sequence[JointRelation]) -> dict[int, OpenReaction]:
    """Return the joints whose reactions are open, by their index.

    At a coupled joint all six components are: part of the coupling may be within it. At a joint between, its efforts
    are known, so that wrenches that do power on its own motion are not open.
    """
    found: dict[int, OpenReaction] = {}
    for coupling in couplings:
        if coupling.known:
            continue
        moved = set(coupling.joints.tolist())
        coupled = {k for k in range(1, model.njoints) if model.joints[k].idx_v in moved}
        for joint in _between(model, coupled):
            others = found[joint].couplings if joint in found else ()
            wrenches = np.eye(6) if joint in coupled else _without_power(model, joint)
            if joint in found and len(found[joint].wrenches) > len(wrenches):
                wrenches = found[joint].wrenches
            found[joint] = OpenReaction((*others, coupling), wrenches)
    return found


def _between(model: pin.Model, coupled: set[int]) -> list[int]:
    """Return the joints from the last body that carries all coupled joints up to these."""
    paths = [{int(j) for j in model.supports[joint]} for joint in coupled]
    carrying = set.intersection(*(path - {joint} for path, joint in zip(paths, coupled, strict=True)))
    return sorted(set.union(*paths) - carrying)


def _without_power(model: pin.Model, joint: int) -> Array:
    """Return the wrenches that do no power on a joint's own motion, in its axes, shape (6 - nv, 6)."""
    own = model.joints[joint]
    jacobian = pin.computeJointJacobian(model, new_data(model), pin.neutral(model), joint).reshape(6, -1)
    motions = jacobian[:, own.idx_v : own.idx_v + own.nv]
    return np.asarray(np.linalg.svd(motions.T)[2][own.nv :])

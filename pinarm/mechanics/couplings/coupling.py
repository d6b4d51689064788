"""A coupling of one mechanism, and what files say of any: a sum of joint coordinates that stays constant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import LinearCoordinate, sum_of
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.joints import Joint, joint_of
from pinarm.mechanics.loading.model_tree import Mimic

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.transmissions import Transmission


@dataclass(frozen=True, eq=False)
class Coupling:
    """A coupling of one mechanism, ready for evaluation; its multiplier is the effort at a joint of weight 1.

    Attributes:
        name: Its name.
        kind: Its kind, as files call it.
        coordinate: The weighted sum of joint coordinates.
        constant: c, its value at all times.
        follower: Index in v of the joint that mimics the other one and has no drive; ``None`` where either may be
            driven.
        transmission: The wrenches on bodies that do what the multiplier does; ``None`` where they are not known.
        missing: What would have to be given for them to be known, in words.
    """

    name: str
    kind: str
    coordinate: LinearCoordinate
    constant: float
    follower: int | None = None
    transmission: Transmission | None = None
    missing: str = ""
    size: int = 1

    def unit(self, row: int) -> Unit:
        """Return the unit of the gap."""
        return self.coordinate.unit

    def gap(self, state: Kinematics) -> Array:
        """Return ``sum_i w_i q_i - c``, shape (1,)."""
        return np.array([self.coordinate.value(state) - self.constant])

    def rows(self, state: Kinematics) -> Array:
        """Return the row of G: the weights, shape (1, nv)."""
        return self.coordinate.weights[None]

    def drift(self, state: Kinematics) -> Array:
        """Return ``G' v = 0``, shape (1,)."""
        return np.zeros(1)

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return what multipliers, shape (n, 1), do to links: joint index -> [f; m] at the world's origin, (n, 6).

        Their virtual power is lam times the row. Nothing where there is no transmission: the multipliers are then
        known as efforts at the coupled joints only.
        """
        known = self.transmission
        if known is None:
            return {}
        return {body: outwards(links, known.carrier, wrench) for body, wrench in known.wrenches(lam[:, 0]).items()}

    def transmitted(self, links: LinkPlacements, lam: Array) -> tuple[Array, Array]:
        """Return where the second member is acted on [m], (n, 3), and [f; m] on it there, world axes, (n, 6).

        lam are multipliers, shape (n, 1); there must be a transmission.
        """
        known = self.transmission
        assert known is not None
        wrench = outwards(links, known.carrier, known.wrenches(lam[:, 0])[known.second])
        point = links.places[:, known.carrier] + np.matvec(links.turns[:, known.carrier], known.point)
        return point, np.concatenate([wrench[:, :3], wrench[:, 3:] - crossed(point, wrench[:, :3])], axis=1)


def outwards(links: LinkPlacements, carrier: int, wrench: Array) -> Array:
    """Return wrenches [f; m] at the world's origin from those in the frame of a joint, shape (n, 6)."""
    turn, place = links.turns[:, carrier], links.places[:, carrier]
    force, moment = np.matvec(turn, wrench[:, :3]), np.matvec(turn, wrench[:, 3:])
    return np.concatenate([force, moment + crossed(place, force)], axis=1)


def mimic_coupling(mimic: Mimic, joints: Mapping[str, Joint], model: pin.Model) -> Coupling:
    """Return the coupling of a joint that mimics another one in the model file."""
    leader, follower = joint_of(joints, mimic.of), joint_of(joints, mimic.joint)
    name = f"{follower.name} mimics {leader.name}"
    weights = {follower: 1.0, leader: -mimic.multiplier}
    found = coupled(model, joints, name, "mimic", weights, mimic.offset)
    return replace(found, follower=follower.v, missing="'mimic' in the model says nothing of the parts between them")


def coupled(
    model: pin.Model, joints: Mapping[str, Joint], name: str, kind: str, weights: Mapping[Joint, float],
    constant: float,
) -> Coupling:  # fmt: skip
    """Return the coupling ``sum_i w_i q_i = constant``; the first joint gives the unit.

    Raises:
        InputError: A joint is coupled to itself.
    """
    first = next(iter(weights))
    if len(weights) < 2:
        raise InputError(f"the joint {first.name} cannot be coupled to itself", expected="two joints")
    coordinate = sum_of(model, joints, [first.name])
    row = np.zeros(model.nv)
    for joint, weight in weights.items():
        row[joint.v] = weight
    return Coupling(name, kind, LinearCoordinate(first.unit, row, coordinate.places), constant)


def independent(couplings: Sequence[Coupling]) -> bool:
    """Return whether the rows of the couplings are linearly independent; a third gear pair in a train repeats two."""
    rows = np.array([coupling.coordinate.weights for coupling in couplings])
    return not couplings or int(np.linalg.matrix_rank(rows)) == len(rows)

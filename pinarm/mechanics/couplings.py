"""Couplings: linear relations ``sum_i w_i q_i = c`` between joint coordinates, as of gears, racks and screws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, Lead, Measured
from pinarm.mechanics.coordinates import LinearCoordinate, sum_of
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE, RADIAN, Joint, joint_of
from pinarm.mechanics.loading.model_tree import Mimic


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
    """

    name: str
    kind: str
    coordinate: LinearCoordinate
    constant: float
    follower: int | None = None
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
        """Return nothing: the multipliers act as efforts at the coupled joints, not as wrenches on links."""
        return {}


class Gear(InputStruct, frozen=True, tag_field="kind", tag="gear"):
    """The second joint moves ``ratio`` times as far as the first: ``q2 = ratio q1 + offset``.

    For joints of one kind, such as two wheels; the ratio is negative where they mesh from outside.

    Attributes:
        joints: The two joints.
        ratio: Turns of the second per turn of the first.
        offset: Coordinate of the second where the first is at 0.
    """

    joints: tuple[str, str]
    ratio: float
    offset: AnyQuantity = 0.0

    def check(self) -> None:
        """Refuse a ratio of 0 or infinity."""
        if not 0.0 < abs(self.ratio) < np.inf:
            raise InputError(f"the ratio of a gear cannot be {self.ratio:g}", expected="a finite number other than 0")

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        """Return the coupling for a model.

        Raises:
            InputError: A joint is unknown, or the joints are of different kinds.
        """
        first, second = (joint_of(joints, joint) for joint in self.joints)
        if first.unit != second.unit:
            raise InputError(
                f"a gear couples joints of one kind: {first.name} has {first.unit}, {second.name} {second.unit}",
                expected="two revolute or two prismatic joints",
                hint="kind: screw, with a lead",
            )
        if isinstance(self.offset, Measured):
            self.offset.check(second.unit)
        return _coupled(joints, model, name, "gear", (first, second), float(self.ratio), float(self.offset))


class Screw(InputStruct, frozen=True, tag_field="kind", tag="screw"):
    """The second joint slides by ``lead`` per turn of the first; a rack's lead is its pinion's circumference.

    Attributes:
        joints: The joint that turns, and the one that slides.
        lead: Way per turn [m].
        offset: Coordinate of the second where the first is at 0 [m].
    """

    joints: tuple[str, str]
    lead: Lead
    offset: Lead = 0.0

    def check(self) -> None:
        """Refuse a lead of 0."""
        if self.lead == 0.0:
            raise InputError("a screw without a lead couples nothing", expected="a length other than 0")

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        """Return the coupling of one model.

        Raises:
            InputError: A joint is unknown, the first is not revolute, or the second not prismatic.
        """
        turns, slides = (joint_of(joints, joint) for joint in self.joints)
        if (turns.unit, slides.unit) != (RADIAN, METRE):
            raise InputError(
                f"a screw couples a revolute to a prismatic joint: {turns.name} has {turns.unit}, "
                f"{slides.name} {slides.unit}",
                expected="a revolute and a prismatic joint, in this order",
            )
        return _coupled(joints, model, name, "screw", (turns, slides), self.lead / (2.0 * np.pi), float(self.offset))


def mimic_coupling(mimic: Mimic, joints: Mapping[str, Joint], model: pin.Model) -> Coupling:
    """Return the coupling of a joint that mimics another one in the model file."""
    leader, follower = joint_of(joints, mimic.of), joint_of(joints, mimic.joint)
    name = f"{follower.name} mimics {leader.name}"
    coupled = _coupled(joints, model, name, "mimic", (leader, follower), mimic.multiplier, mimic.offset)
    return replace(coupled, follower=follower.v)


def _coupled(
    joints: Mapping[str, Joint], model: pin.Model, name: str, kind: str, pair: tuple[Joint, Joint], ratio: float,
    offset: float,
) -> Coupling:  # fmt: skip
    """Return the coupling ``q2 - ratio q1 = offset`` of a pair of joints."""
    first, second = pair
    if first.name == second.name:
        raise InputError(f"the joint {first.name} cannot be coupled to itself", expected="two joints")
    coordinate = sum_of(model, joints, [second.name])
    weights = coordinate.weights.copy()
    weights[first.v] = -ratio
    return Coupling(name, kind, LinearCoordinate(second.unit, weights, coordinate.places), offset)


def independent(couplings: Sequence[Coupling]) -> bool:
    """Return whether the rows of the couplings are linearly independent; a third gear pair in a train repeats two."""
    rows = np.array([coupling.coordinate.weights for coupling in couplings])
    return not couplings or int(np.linalg.matrix_rank(rows)) == len(rows)


CouplingDefinition = Gear | Screw
"""Any coupling. A new kind is one class above and one entry here."""

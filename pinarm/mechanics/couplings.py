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
        follower: Index in v of the joint that mimics the other one and has no drive of its own; ``None`` where either
            may be driven.
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

    def gap(self, data: pin.Data, q: Array) -> Array:
        """Return by how much the sum differs from its constant, shape (1,)."""
        return np.array([self.coordinate.value(data, q) - self.constant])

    def rows(self, model: pin.Model, data: pin.Data) -> Array:
        """Return the weights, shape (1, nv)."""
        return self.coordinate.weights[None]

    def drift(self, model: pin.Model, data: pin.Data) -> Array:
        """Return 0."""
        return np.zeros(1)

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return nothing: the efforts act between the links of the coupled joints."""
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
        """Refuse ratios that couple nothing."""
        if not 0.0 < abs(self.ratio) < np.inf:
            raise InputError(f"a coupling of ratio {self.ratio:g} cannot be", expected="a finite number other than 0")

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        """Return the coupling of one model.

        Raises:
            InputError: A joint is unknown, or the joints are of different kinds.
        """
        one, two = (joint_of(joints, joint) for joint in self.joints)
        if one.unit != two.unit:
            raise InputError(f"{one.name} and {two.name} do not measure alike", hint="kind: screw, with a lead")
        if isinstance(self.offset, Measured):
            self.offset.check(two.unit)
        return _coupled(joints, model, name, "gear", (one, two), float(self.ratio), float(self.offset))


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
        """Refuse a lead that couples nothing."""
        if self.lead == 0.0:
            raise InputError("a screw without a lead couples nothing", expected="a length other than 0")

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        """Return the coupling of one model.

        Raises:
            InputError: A joint is unknown, or the first does not turn or the second not slide.
        """
        turns, slides = (joint_of(joints, joint) for joint in self.joints)
        if (turns.unit, slides.unit) != (RADIAN, METRE):
            raise InputError(
                f"a screw turns one joint and slides the other; {turns.name} and {slides.name} do not",
                expected="a revolute and a prismatic joint, in this order",
            )
        return _coupled(joints, model, name, "screw", (turns, slides), self.lead / (2.0 * np.pi), float(self.offset))


def mimic_coupling(mimic: Mimic, joints: Mapping[str, Joint], model: pin.Model) -> Coupling:
    """Return the coupling of a joint that, as its model says, mimics another one."""
    leader, follower = joint_of(joints, mimic.of), joint_of(joints, mimic.joint)
    name = f"{follower.name} mimics {leader.name}"
    coupled = _coupled(joints, model, name, "mimic", (leader, follower), mimic.multiplier, mimic.offset)
    return replace(coupled, follower=follower.v)


def _coupled(
    joints: Mapping[str, Joint], model: pin.Model, name: str, kind: str, pair: tuple[Joint, Joint], ratio: float,
    offset: float,
) -> Coupling:  # fmt: skip
    one, two = pair
    if one.name == two.name:
        raise InputError(f"the joint {one.name} cannot be coupled to itself", expected="two joints")
    second = sum_of(model, joints, [two.name])
    weights = second.weights.copy()
    weights[one.v] = -ratio
    return Coupling(name, kind, LinearCoordinate(two.unit, weights, second.places), offset)


def independent(couplings: Sequence[Coupling]) -> bool:
    """Tell whether none of the couplings repeats or contradicts what the others say, as the third of a train does."""
    rows = np.array([one.coordinate.weights for one in couplings])
    return not couplings or int(np.linalg.matrix_rank(rows)) == len(rows)


CouplingDefinition = Gear | Screw
"""Any coupling. A new kind is one class above and one entry here."""

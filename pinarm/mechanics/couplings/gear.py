"""Gears: two wheels in mesh, wheels on one axis with planets between them, a rack and its pinion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.errors import InputError
from pinarm.input.yaml.schema import Angle, AnyQuantity, InputStruct, Lead, Measured, Ratio
from pinarm.mechanics.couplings.coupling import Coupling, coupled
from pinarm.mechanics.couplings.members import MemberPair, member_pair
from pinarm.mechanics.couplings.screw import turning_and_sliding
from pinarm.mechanics.couplings.teeth import Teeth, pinion_on_rack, wheels_in_mesh
from pinarm.mechanics.couplings.transmissions import Transmission
from pinarm.mechanics.joints import PARALLEL, RADIAN, Joint, joint_of
from pinarm.records import replace


class Gear(InputStruct, frozen=True, tag_field="kind", tag="gear"):
    """The second joint moves ``ratio`` times as far as the first: ``q2 = ratio q1 + offset``.

    For joints of one kind, such as two wheels; the ratio is negative where they mesh from outside. With a carrier that
    moves, ``q2 = ratio q1 + offset`` holds for the angles in the carrier (Willis): of a sun and a ring with z1 and z2
    teeth on one axis, ``q2 - qc = -z1/z2 (q1 - qc) + offset``; of a planet, whose joint is on the carrier,
    ``q2 = -z1/z2 (q1 - qc) + offset``.

    With a pressure angle the reactions carry the force of the teeth. It acts at the pitch point, which follows from the
    axes and the ratio, and is ``coupling.NAME.tangential``, ``.radial = |tangential| tan(alpha) / cos(beta)`` and
    ``.axial``. Axes are parallel, wheels with outer or inner teeth, or meet (straight bevel wheels). Where one joint
    is on the link that the other one moves, that link is the carrier, and what the latter joint stands on is a wheel,
    such as a fixed ring. Without a pressure angle the reactions of the joints between the wheels are refused.

    Attributes:
        joints: The two joints.
        ratio: Turns of the second per turn of the first: a number, or a fraction such as ``17/43``.
        offset: Coordinate of the second where the first is at 0, such as ``10 deg``.
        carrier: Joint that moves the link in which the axes of both wheels are; none where it is at rest.
        pressure_angle: alpha, in the section normal to the teeth, such as 20 deg.
        helix_angle: beta of the first wheel, positive for a right-handed helix.
        plane: Link whose origin lies in the middle of the width of the teeth, such as ``wheel``, a link of a wheel or
            of the carrier; the origins of both joints where it is left out. Of bevel wheels it is the pitch point.
        planets: Number of planets, such as ``3``, evenly spaced, between wheels on one axis, which are no links of the
            model: they transmit moments, their forces cancel. In place of a pressure angle.
    """

    joints: tuple[str, str]
    ratio: Ratio
    offset: AnyQuantity = 0.0
    carrier: str = ""
    pressure_angle: Angle | None = None
    helix_angle: Angle = 0.0
    plane: str = ""
    planets: Annotated[int, msgspec.Meta(ge=2)] | None = None

    def check(self) -> None:
        """Refuse a ratio of 0 or infinity, and angles that no teeth have."""
        if not 0.0 < abs(self.ratio) < np.inf:
            raise InputError(f"the ratio of a gear cannot be {self.ratio:g}", expected="a finite number other than 0")
        check_teeth(self.pressure_angle, self.helix_angle, self.plane)
        if self.planets is not None and self.pressure_angle is not None:
            raise InputError("a gear has one pair of wheels in mesh, or planets between two",
                             expected="pressure_angle or planets", hint="planets as links, with gears of their own",
                             )  # fmt: skip

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        """Return the coupling for a model.

        Raises:
            InputError: A joint is unknown, the joints are of different kinds, or their axes carry no such gear.
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
        weights, pair = {second: 1.0, first: -float(self.ratio)}, None
        if self.carrier or self.pressure_angle is not None or self.planets is not None:
            pair = self._pair(joints, model, (first, second))
        if pair is not None and self.carrier:
            weights = pair.weights(pair.inner_ratio(self.ratio))
        found = coupled(model, joints, name, "gear", weights, float(self.offset))
        known = None if pair is None else self._transmission(model, pair)
        return replace(found, transmission=known, missing="" if known else "it has no pressure_angle")

    def _pair(self, joints: Mapping[str, Joint], model: pin.Model, pair: tuple[Joint, Joint]) -> MemberPair:
        carrier = joint_of(joints, self.carrier) if self.carrier else None
        if carrier in pair:
            raise InputError(f"{self.carrier} is the carrier and a wheel", expected="the two wheels, and their carrier",
                             hint="leave carrier out, where one joint moves what the other one is on")  # fmt: skip
        if pair[0].unit != RADIAN:
            raise InputError("a gear between joints that slide has no carrier, teeth or planets",
                             expected="revolute joints")  # fmt: skip
        return member_pair(model, joints, pair, carrier)

    def _transmission(self, model: pin.Model, pair: MemberPair) -> Transmission | None:
        ratio = pair.inner_ratio(self.ratio)
        if self.pressure_angle is not None:
            teeth = Teeth(self.pressure_angle, self.helix_angle, self.plane)
            return wheels_in_mesh(model, pair, ratio, teeth)
        return None if self.planets is None else _moments(pair, ratio, self.planets)


class Rack(InputStruct, frozen=True, tag_field="kind", tag="rack"):
    """The second joint slides by ``radius`` per angle of the first: ``q2 = radius q1 + offset``.

    With a pressure angle the reactions carry the force of the teeth, as for a gear. It acts at the pitch point, at the
    distance ``radius`` from the axis of the pinion, on the side that follows from the sign: with a the axis and s the
    direction in which the rack slides, at ``radius (s x a)``.

    Attributes:
        joints: The joint of the pinion, and that of the rack.
        radius: Pitch radius of the pinion [m]; negative where the rack goes back while the pinion turns forwards.
        offset: Coordinate of the rack where the pinion is at 0 [m].
        pressure_angle: alpha, in the section normal to the teeth, such as 20 deg.
        helix_angle: beta of the pinion, positive for a right-handed helix.
        plane: Link whose origin lies in the middle of the width of the teeth, such as ``pinion``; the origin of the
            pinion's joint where it is left out.
    """

    joints: tuple[str, str]
    radius: Lead
    offset: Lead = 0.0
    pressure_angle: Angle | None = None
    helix_angle: Angle = 0.0
    plane: str = ""

    def check(self) -> None:
        """Refuse a radius of 0, and angles that no teeth have."""
        if self.radius == 0.0:
            raise InputError("a pinion without a radius moves no rack", expected="a length other than 0")
        check_teeth(self.pressure_angle, self.helix_angle, self.plane)

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        """Return the coupling of one model.

        Raises:
            InputError: A joint is unknown, is not of its kind, or the rack does not slide across the pinion's axis.
        """
        turns, slides = turning_and_sliding(joints, self.joints, "rack")
        weights = {slides: 1.0, turns: -float(self.radius)}
        found = coupled(model, joints, name, "rack", weights, float(self.offset))
        if self.pressure_angle is None:
            return replace(found, missing="it has no pressure_angle")
        pair = member_pair(model, joints, (turns, slides))
        teeth = Teeth(self.pressure_angle, self.helix_angle, self.plane)
        return replace(found, transmission=pinion_on_rack(model, pair, pair.inner_ratio(self.radius), teeth))


def check_teeth(pressure_angle: float | None, helix_angle: float, plane: str) -> None:
    """Refuse angles that no teeth have, and what says more of teeth whose pressure angle is not given."""
    if pressure_angle is not None:
        Teeth(pressure_angle, helix_angle, plane).check()
    elif helix_angle or plane:
        raise InputError("the teeth have no pressure_angle", expected="pressure_angle, such as 20 deg")


def _moments(pair: MemberPair, inner_ratio: float, planets: int) -> Transmission:
    """Return the moments of planets between coaxial wheels: their forces cancel on every member."""
    a, b = pair.first.axis, pair.second.axis
    apart = np.cross(a, pair.second.point - pair.first.point)
    if np.linalg.norm(np.cross(a, b)) > PARALLEL or np.linalg.norm(apart) > PARALLEL:
        raise InputError(f"{pair.first.joint.name} and {pair.second.joint.name} turn about different axes",
                         expected="planets between wheels on one axis", hint="pressure_angle: 20 deg")  # fmt: skip
    on_second, on_first = pair.sense * b, -pair.sense * inner_ratio * a
    wrench, back = (np.concatenate([np.zeros(3), moment]) for moment in (on_second, on_first))
    words = f"moments only, shared by {planets} evenly spaced planets"
    return Transmission(
        pair.carrier, pair.first.body, pair.second.body, pair.second.point, wrench, words, back=back
    )  # fmt: skip

"""The kinds of coupling, and the one that says nothing of its parts: any linear relation between joints of one kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.yaml.schema import (
    Angle,
    AnyQuantity,
    HelixAngle,
    InputStruct,
    Lead,
    Pitch,
    ProfileAngle,
    Ratio,
    Span,
    Tension,
    Weight,
    check_unit,
)
from pinarm.mechanics.couplings.cam import Cam
from pinarm.mechanics.couplings.coupling import Coupling, coupled
from pinarm.mechanics.couplings.teeth import (
    MemberPair,
    Teeth,
    check_teeth,
    member_pair,
    pinion_on_rack,
    plane_of,
    wheels_in_mesh,
)
from pinarm.mechanics.couplings.transmissions import (
    NEWTON,
    NEWTON_METRE,
    FixedContact,
    Part,
    Strands,
    at_origin,
)
from pinarm.mechanics.joints import METRE, PARALLEL, RADIAN, Joint, joint_of


class Belt(InputStruct, frozen=True, tag_field="kind", tag="belt"):
    """Two wheels turn as a belt that does not slip drives them: ``r2 q2 = r1 q1`` in their carrier, plus an offset.

    They turn alike; against each other where the belt is crossed, or where their joints' axes have opposite senses.
    With a pretension the reactions carry the tensions of its strands, ``F0 + D/2`` and ``F0 - D/2`` with
    ``D = M / r``, along the tangents of the wheels. Where one would be pushed it is slack, and the other one carries D.
    The belt has no mass. It slips where ``friction`` of the mechanism file names it. Without a pretension the reactions
    of the joints between are refused.

    Attributes:
        joints: The joints of the two wheels.
        radii: Their pitch radii [m].
        offset: Coordinate of the second where the first is at 0.
        course: ``open``, or ``crossed`` between the wheels.
        pretension: F0, the tension of both strands while no moment is transmitted [N]; 0 N for a chain.
        plane: Link whose origin lies in the middle of the belt's width, such as ``wheel``; the origins of both joints
            where it is left out.
    """

    joints: tuple[str, str]
    radii: tuple[Span, Span]
    offset: Angle = 0.0
    course: Literal["open", "crossed"] = "open"
    pretension: Tension | None = None
    plane: str = ""

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        first, second = (joint_of(joints, joint) for joint in self.joints)
        if first.unit != RADIAN or second.unit != RADIAN:
            raise InputError("a belt couples two wheels", expected="two revolute joints")
        pair = member_pair(model, joints, (first, second))
        if np.linalg.norm(np.cross(pair.first.axis, pair.second.axis)) > PARALLEL:
            raise InputError(
                f"the axes of {first.name} and {second.name} are not parallel",
                expected="a belt between parallel axes",
                hint="kind: gear, with a ratio",
            )
        strands = None if self.pretension is None else self._strands(pair, float(self.pretension))
        weights, missing = pair.weights(self._ratio(pair)), "it has no pretension"
        return coupled(model, joints, name, "belt", weights, float(self.offset), strands, missing)

    def _signed_radii(self, pair: MemberPair) -> tuple[float, float]:
        """Return the radii, the second negative where the wheels turn against each other about the first axis."""
        first, second = (float(radius) for radius in self.radii)
        return first, second if self.course == "open" else -second

    def _ratio(self, pair: MemberPair) -> float:
        first, second = self._signed_radii(pair)
        return first / second * float(np.sign(pair.first.axis @ pair.second.axis))

    def _strands(self, pair: MemberPair, pretension: float) -> Strands:
        """Return the strands: tangents of both wheels, with normals n where ``n . (O2 - O1) = r1 - r2``."""
        a, (r1, r2) = pair.first.axis, self._signed_radii(pair)
        height = plane_of(pair, self.plane)
        first, second = (x.point + a * (height - a @ x.point) for x in (pair.first, pair.second))
        distance = float(np.linalg.norm(second - first))
        if distance <= abs(r1 - r2):
            raise InputError(
                f"the axes are {distance:g} m apart: wheels of these radii leave no place for a belt",
                expected=f"axes more than {abs(r1 - r2):g} m apart",
            )
        along = (second - first) / distance
        cosine = (r1 - r2) / distance
        sine = np.sqrt(1.0 - cosine * cosine)
        pulls = [
            _pull(first, second, r1, r2, cosine * along + side * sine * np.cross(a, along)) for side in (1.0, -1.0)
        ]
        sense = pair.sense * float(np.sign(a @ pair.second.axis))
        angle = float(np.arccos(cosine))  # from the line of centres to the points where the belt leaves the wheels
        wrap = min(2.0 * np.pi - 2.0 * angle, 2.0 * angle) if r2 > 0.0 else 2.0 * np.pi - 2.0 * angle
        pull, difference = np.array(pulls), sense / r2
        slack, share = 2.0 * pretension / abs(difference), 0.25 * abs(difference) * pull.sum(axis=0)
        return Strands(
            *pair.bodies, f"two strands, pretension {pretension:.6g} N", point=second,
            wrench=0.5 * difference * (pull[0] - pull[1]), folds=((slack, share), (-slack, share)),
            difference=difference, pretension=pretension, wrap=wrap,
        )  # fmt: skip


def _pull(first: Array, second: Array, r1: float, r2: float, normal: Array) -> Array:
    """Return the wrench of a strand of unit tension on the second wheel [f; m] at the carrier's origin."""
    start, end = first + r1 * normal, second + r2 * normal
    return at_origin(end, (start - end) / np.linalg.norm(start - end))


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
    pressure_angle: ProfileAngle | None = None
    helix_angle: HelixAngle = 0.0
    plane: str = ""
    planets: Annotated[int, msgspec.Meta(ge=2)] | None = None

    def check(self) -> None:
        check_teeth(self.pressure_angle, self.helix_angle, self.plane)
        if self.planets is not None and self.pressure_angle is not None:
            raise InputError(
                "a gear has one pair of wheels in mesh, or planets between two",
                expected="pressure_angle or planets",
                hint="planets as links, with gears of their own",
            )

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        first, second = (joint_of(joints, joint) for joint in self.joints)
        if first.unit != second.unit:
            raise InputError(
                f"a gear couples joints of one kind: {first.name} has {first.unit}, {second.name} {second.unit}",
                expected="two revolute or two prismatic joints",
                hint="kind: screw, with a lead",
            )
        check_unit(self.offset, second.unit)
        weights, known = {second: 1.0, first: -float(self.ratio)}, None
        if self.carrier or self.pressure_angle is not None or self.planets is not None:
            carrier = joint_of(joints, self.carrier) if self.carrier else None
            if carrier in (first, second) or first.unit != RADIAN:
                raise InputError(
                    f"{self.carrier or first.name} slides, or is carrier and wheel",
                    expected="two wheels, and their carrier: revolute joints",
                    hint="leave carrier out, where one joint moves what the other one is on",
                )
            pair = member_pair(model, joints, (first, second), carrier)
            ratio = pair.inner_ratio(self.ratio)
            if carrier is not None:
                weights = pair.weights(ratio)
            if self.pressure_angle is not None:
                known = wheels_in_mesh(pair, ratio, Teeth(self.pressure_angle, self.helix_angle, self.plane))
            elif self.planets is not None:
                known = _moments(pair, ratio, self.planets)
        missing = "it has no pressure_angle"
        return coupled(model, joints, name, "gear", weights, float(self.offset), known, missing)


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
    radius: Pitch
    offset: Lead = 0.0
    pressure_angle: ProfileAngle | None = None
    helix_angle: HelixAngle = 0.0
    plane: str = ""

    def check(self) -> None:
        check_teeth(self.pressure_angle, self.helix_angle, self.plane)

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        turns, slides = turning_and_sliding(joints, self.joints, "rack")
        weights, contact = {slides: 1.0, turns: -float(self.radius)}, None
        if self.pressure_angle is not None:
            pair = member_pair(model, joints, (turns, slides))
            teeth = Teeth(self.pressure_angle, self.helix_angle, self.plane)
            contact = pinion_on_rack(pair, pair.inner_ratio(self.radius), teeth)
        missing = "it has no pressure_angle"
        return coupled(model, joints, name, "rack", weights, float(self.offset), contact, missing)


def _moments(pair: MemberPair, inner_ratio: float, planets: int) -> FixedContact:
    """Return the moments of planets between coaxial wheels: their forces cancel on every member."""
    a, b = pair.first.axis, pair.second.axis
    apart = np.cross(a, pair.second.point - pair.first.point)
    if np.linalg.norm(np.cross(a, b)) > PARALLEL or np.linalg.norm(apart) > PARALLEL:
        raise InputError(
            f"{pair.first.joint.name} and {pair.second.joint.name} turn about different axes",
            expected="planets between wheels on one axis",
            hint="pressure_angle: 20 deg",
        )
    on_second, on_first = pair.sense * b, -pair.sense * inner_ratio * a
    wrench, back = (np.concatenate([np.zeros(3), moment]) for moment in (on_second, on_first))
    words = f"moments only, shared by {planets} evenly spaced planets"
    return FixedContact(*pair.bodies, words, point=pair.second.point, wrench=wrench, back=back)


class Screw(InputStruct, frozen=True, tag_field="kind", tag="screw"):
    """The second joint slides by ``lead`` per turn of the first: ``q2 = lead q1 / (2 pi) + offset``.

    Where the second joint slides along the axis of the first one, on one carrier, the reactions carry the force of the
    thread, which acts on that axis without friction: ``coupling.NAME.axial``, and the moment ``lead / (2 pi)`` times as
    large. Otherwise the reactions of the joints between are refused; of a rack see ``kind: rack``.

    Attributes:
        joints: The joint that turns, and the one that slides.
        lead: Way per turn [m].
        offset: Coordinate of the second where the first is at 0 [m].
    """

    joints: tuple[str, str]
    lead: Pitch
    offset: Lead = 0.0

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        turns, slides = turning_and_sliding(joints, self.joints, "screw")
        pitch, thread, missing = self.lead / (2.0 * np.pi), None, ""
        try:
            pair = member_pair(model, joints, (turns, slides))
        except InputError:  # joints that are apart in the tree: coupled in some way, which is not known
            missing = "its joints are not on one link"
        else:
            thread, missing = _thread(pair, pitch), "its second joint does not slide along the axis of the first"
        weights = {slides: 1.0, turns: -pitch}
        return coupled(model, joints, name, "screw", weights, float(self.offset), thread, missing)


def turning_and_sliding(joints: Mapping[str, Joint], names: tuple[str, str], kind: str) -> tuple[Joint, Joint]:
    """Return a revolute and a prismatic joint by name."""
    turns, slides = (joint_of(joints, joint) for joint in names)
    if (turns.unit, slides.unit) != (RADIAN, METRE):
        raise InputError(
            f"a {kind} couples a revolute to a prismatic joint: {turns.name} has {turns.unit}, "
            f"{slides.name} {slides.unit}",
            expected="a revolute and a prismatic joint, in this order",
        )
    return turns, slides


def _thread(pair: MemberPair, pitch: float) -> FixedContact | None:
    """Return the thread: a force on the nut, and the moment that keeps its power 0; ``None`` along another axis."""
    if np.linalg.norm(np.cross(pair.first.axis, pair.second.axis)) > PARALLEL:
        return None
    point, along = pair.first.point, pair.sense * pair.second.axis
    about = pair.sense * pair.inner_ratio(pitch) * pair.first.axis
    return FixedContact(
        *pair.bodies, f"thread, lead {2e3 * np.pi * pitch:.6g} mm", point=point,
        wrench=at_origin(point, along) + np.concatenate([np.zeros(3), about]),
        single={"axial": Part(NEWTON, 1.0), "torque": Part(NEWTON_METRE, pitch)},
    )  # fmt: skip


class WeightedSum(InputStruct, frozen=True, tag_field="kind", tag="sum"):
    """A weighted sum of joint coordinates stays constant: ``sum_i w_i q_i = value``, as of a differential.

    Which parts do it is not said: the reactions of the joints between are refused.

    Attributes:
        weights: Joint -> its weight w.
        value: The constant.
    """

    weights: Annotated[dict[str, Weight], msgspec.Meta(min_length=2)]
    value: AnyQuantity = 0.0

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        weights = {joint_of(joints, joint): float(weight) for joint, weight in self.weights.items()}
        first = next(iter(weights))
        if any(joint.unit != first.unit for joint in weights):
            raise InputError(
                "a sum of joint coordinates cannot mix angles and lengths",
                expected="joints of one kind",
                hint="kind: screw or rack",
            )
        check_unit(self.value, first.unit)
        missing = "a sum says nothing of the parts between them"
        return coupled(model, joints, name, "sum", weights, float(self.value), missing=missing)


CouplingDefinition = Gear | Rack | Screw | Belt | Cam | WeightedSum
"""Any coupling. A new kind is one module beside these and one entry here."""

"""A belt or chain around two wheels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.yaml.schema import Angle, InputStruct, Span, Tension
from pinarm.mechanics.couplings.coupling import Coupling, coupled
from pinarm.mechanics.couplings.members import MemberPair, member_pair
from pinarm.mechanics.couplings.teeth import plane_of
from pinarm.mechanics.couplings.transmissions import Strands, at_origin
from pinarm.mechanics.joints import PARALLEL, RADIAN, Joint, joint_of
from pinarm.records import replace


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
        """Return the coupling of one model.

        Raises:
            InputError: A joint is unknown or slides; the axes are not parallel, or too close for the wheels.
        """
        first, second = (joint_of(joints, joint) for joint in self.joints)
        if first.unit != RADIAN or second.unit != RADIAN:
            raise InputError("a belt couples two wheels", expected="two revolute joints")
        pair = member_pair(model, joints, (first, second))
        if np.linalg.norm(np.cross(pair.first.axis, pair.second.axis)) > PARALLEL:
            raise InputError(f"the axes of {first.name} and {second.name} are not parallel",
                             expected="a belt between parallel axes", hint="kind: gear, with a ratio")  # fmt: skip
        weights = pair.weights(self._ratio(pair))
        found = coupled(model, joints, name, "belt", weights, float(self.offset))
        if self.pretension is None:
            return replace(found, missing="it has no pretension")
        return replace(found, transmission=self._strands(model, pair, float(self.pretension)))

    def _signed_radii(self, pair: MemberPair) -> tuple[float, float]:
        """Return the radii, the second negative where the wheels turn against each other about the first axis."""
        first, second = (float(radius) for radius in self.radii)
        return first, second if self.course == "open" else -second

    def _ratio(self, pair: MemberPair) -> float:
        """Return the turns of the second wheel, about its own axis, per turn of the first."""
        first, second = self._signed_radii(pair)
        return first / second * float(np.sign(pair.first.axis @ pair.second.axis))

    def _strands(self, model: pin.Model, pair: MemberPair, pretension: float) -> Strands:
        """Return the strands: tangents of both wheels, with normals n where ``n . (O2 - O1) = r1 - r2``."""
        a, (r1, r2) = pair.first.axis, self._signed_radii(pair)
        height = plane_of(model, pair, self.plane)
        one, two = (x.point + a * (height - a @ x.point) for x in (pair.first, pair.second))
        distance = float(np.linalg.norm(two - one))
        if distance <= abs(r1 - r2):
            raise InputError(f"the axes are {distance:g} m apart: wheels of these radii leave no place for a belt",
                             expected=f"axes more than {abs(r1 - r2):g} m apart")  # fmt: skip
        along = (two - one) / distance
        cosine = (r1 - r2) / distance
        sine = np.sqrt(1.0 - cosine * cosine)
        pulls = [_pull(one, two, r1, r2, cosine * along + side * sine * np.cross(a, along)) for side in (1.0, -1.0)]
        sense = pair.sense * float(np.sign(a @ pair.second.axis))
        angle = float(np.arccos(cosine))  # from the line of centres to the points where the belt leaves the wheels
        wrap = min(2.0 * np.pi - 2.0 * angle, 2.0 * angle) if r2 > 0.0 else 2.0 * np.pi - 2.0 * angle
        members = pair.carrier, pair.first.body, pair.second.body
        return Strands.between(members, two, np.array(pulls), sense / r2, pretension, wrap)


def _pull(one: Array, two: Array, r1: float, r2: float, normal: Array) -> Array:
    """Return the wrench of a strand of unit tension on the second wheel [f; m] at the carrier's origin."""
    start, end = one + r1 * normal, two + r2 * normal
    return at_origin(end, (start - end) / np.linalg.norm(start - end))

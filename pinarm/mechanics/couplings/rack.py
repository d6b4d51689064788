"""A rack and its pinion."""

from __future__ import annotations

from collections.abc import Mapping

import pinocchio as pin

from pinarm.errors import InputError
from pinarm.input.yaml.schema import Angle, InputStruct, Lead
from pinarm.mechanics.couplings.coupling import Coupling, coupled
from pinarm.mechanics.couplings.gear import check_teeth
from pinarm.mechanics.couplings.members import member_pair
from pinarm.mechanics.couplings.screw import turning_and_sliding
from pinarm.mechanics.couplings.teeth import Teeth, pinion_on_rack
from pinarm.mechanics.joints import Joint
from pinarm.records import replace


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

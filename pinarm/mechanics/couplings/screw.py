"""A screw and its nut."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from pinarm.errors import InputError
from pinarm.input.yaml.schema import InputStruct, Lead
from pinarm.mechanics.couplings.coupling import Coupling, coupled
from pinarm.mechanics.couplings.members import MemberPair, member_pair
from pinarm.mechanics.couplings.transmissions import NEWTON, NEWTON_METRE, Part, ThreadContact, at_origin
from pinarm.mechanics.joints import METRE, PARALLEL, RADIAN, Joint, joint_of
from pinarm.records import replace


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
        turns, slides = turning_and_sliding(joints, self.joints, "screw")
        pitch = self.lead / (2.0 * np.pi)
        found = coupled(model, joints, name, "screw", {slides: 1.0, turns: -pitch}, float(self.offset))
        try:
            pair = member_pair(model, joints, (turns, slides))
        except InputError:  # joints that are apart in the tree: coupled in some way, which is not known
            return replace(found, missing="its joints are not on one link")
        if np.linalg.norm(np.cross(pair.first.axis, pair.second.axis)) > PARALLEL:
            return replace(found, missing="its second joint does not slide along the axis of the first")
        return replace(found, transmission=_thread(pair, pitch))


def turning_and_sliding(joints: Mapping[str, Joint], names: tuple[str, str], kind: str) -> tuple[Joint, Joint]:
    """Return a revolute and a prismatic joint by name.

    Raises:
        InputError: A joint is unknown, the first is not revolute, or the second not prismatic.
    """
    turns, slides = (joint_of(joints, joint) for joint in names)
    if (turns.unit, slides.unit) != (RADIAN, METRE):
        raise InputError(
            f"a {kind} couples a revolute to a prismatic joint: {turns.name} has {turns.unit}, "
            f"{slides.name} {slides.unit}",
            expected="a revolute and a prismatic joint, in this order",
        )
    return turns, slides


def _thread(pair: MemberPair, pitch: float) -> ThreadContact:
    """Return the wrench of a unit multiplier: a force on the nut, and the moment that keeps its power 0."""
    point, along = pair.first.point, pair.sense * pair.second.axis
    about = pair.sense * pair.inner_ratio(pitch) * pair.first.axis
    wrench = at_origin(point, along) + np.concatenate([np.zeros(3), about])
    return ThreadContact(
        pair.carrier, pair.first.body, pair.second.body, point, wrench, f"thread, lead {2e3 * np.pi * pitch:.6g} mm",
        single={"axial": Part(NEWTON, 1.0), "torque": Part(NEWTON_METRE, pitch)}, about=about, pitch=pitch,
    )  # fmt: skip

"""What files say of friction that sticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, choices, within
from pinarm.input.units import unit
from pinarm.input.yaml.schema import Force, InputStruct, NotNegative, Positive, Span, check_unit
from pinarm.mechanics.forces.joint_definitions import effort_unit
from pinarm.mechanics.friction.bearing import Bearing
from pinarm.mechanics.friction.contact import FrictionContact, JointContact, LoopContact
from pinarm.mechanics.friction.law import FrictionLaw
from pinarm.mechanics.joints import METRE, RADIAN, Joint
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import LowerPair

Coefficient = Annotated[float, msgspec.Meta(ge=0)]

SLIPS = {"revolute": RADIAN, "prismatic": METRE}
"""Kinds of loop joints that have friction, and the unit of what they leave free."""


class Friction(InputStruct, frozen=True):
    """Dry friction in a joint, which sticks: at rest it is whatever holds the joint, up to a limit.

    While the joint slips ``F = mu N + constant + viscous u`` acts against its velocity u, with the load N of its
    bearings; at rest at most ``static_mu N + static_constant``. A joint that turns needs ``radius`` for ``mu``. The
    load is made up of the parts of the reaction for which sizes are given: the force across the axis always, the force
    along it with ``thrust_radius``, the moment across it with ``span``, the moment about a sliding joint's axis with
    ``radius``.

    Attributes:
        mu: Coefficient of friction while the joint slips.
        static_mu: Coefficient at rest; ``mu`` where it is left out.
        radius: Of the journal, at which a joint that turns slips; of a joint that slides, lever of the key that carries
            the moment about its axis.
        thrust_radius: Mean radius of the shoulder that carries the axial force of a joint that turns.
        span: Distance of two bearings that share force and moment across the axis, centred at the joint's origin.
        preload: Normal force that is there without any reaction.
        constant: Part that does not depend on the reaction [N*m or N].
        static_constant: The same at rest; ``constant`` where it is left out.
        viscous: Per velocity [N*m*s/rad or N*s/m].
        stribeck: Velocity by which friction has fallen from its value at rest to that of slip; at once where it is left
            out.
    """

    mu: Coefficient = 0.0
    static_mu: Coefficient | None = None
    radius: Span | None = None
    thrust_radius: Span | None = None
    span: Span | None = None
    preload: Force = 0.0
    constant: NotNegative = 0.0
    static_constant: NotNegative | None = None
    viscous: NotNegative = 0.0
    stribeck: Positive | None = None

    def check(self) -> None:
        """Refuse friction that is less at rest than in slip, and a preload that pulls."""
        for key, rest, slip in (
            ("static_mu", self.static_mu, self.mu), ("static_constant", self.static_constant, self.constant),
        ):  # fmt: skip
            if rest is not None and rest < slip:
                with within(key):
                    raise InputError(f"friction at rest, {rest:g}, is below that of slip, {slip:g}",
                                     expected="at least as much at rest")  # fmt: skip
        if self.preload < 0.0:
            with within("preload"):
                raise InputError("a preload presses", expected="at least 0 N")

    def bind(
        self, name: str, model: pin.Model, joints: Mapping[str, Joint], loops: Sequence[LoopJoint]
    ) -> FrictionContact:
        """Return the friction of a joint of the tree, or of a loop joint, by its name.

        Raises:
            InputError: There is none, or none that turns or slides; or a size is missing.
        """
        of_loops = {loop.name: loop for loop in loops}
        if name in joints:
            joint = joints[name]
            axis = _axis(model, joint)
            law, bearing = self._law(joint), self._bearing(axis, turns=joint.unit == RADIAN)
            return JointContact(f"joint.{name}", effort_unit(joint), joint.index, joint.v, law, bearing)
        if name not in of_loops:
            expected, hint = choices(name, [*joints, *of_loops])
            raise InputError(f"there is no joint '{name}' with one coordinate", expected=expected, hint=hint)
        return self._of_loop(of_loops[name])

    def _of_loop(self, loop: LoopJoint) -> LoopContact:
        if loop.kind not in SLIPS or not isinstance(loop.pair, LowerPair):
            raise InputError(f"the loop joint '{loop.name}' is of the kind {loop.kind}",
                             expected=f"friction of the kinds {', '.join(SLIPS)}")  # fmt: skip
        measured, axis, nothing = SLIPS[loop.kind], loop.pair.axis[None], np.zeros((1, 3))
        turns = measured == RADIAN
        free = LowerPair(nothing, axis, axis[0], None) if turns else LowerPair(axis, nothing, axis[0], None)
        slip = LoopJoint(loop.name, "slip", loop.first, loop.second, free)
        joint = Joint(loop.name, 0, 0, 0, measured)
        return LoopContact(
            f"loop.{loop.name}", effort_unit(joint), loop, slip, self._law(joint), self._bearing(axis[0], turns=turns)
        )

    def _law(self, joint: Joint) -> FrictionLaw:
        effort, rate = effort_unit(joint), joint.unit / unit("s")
        for key, measured in (
            ("constant", effort), ("static_constant", effort), ("viscous", effort / rate), ("stribeck", rate),
        ):  # fmt: skip
            with within(key):
                check_unit(getattr(self, key) or 0.0, measured)
        static_mu = self.mu if self.static_mu is None else self.static_mu
        static = self.constant if self.static_constant is None else self.static_constant
        return FrictionLaw(self.mu, static_mu, float(self.constant), float(static), float(self.viscous),
                           float(self.stribeck or 0.0))  # fmt: skip

    def _bearing(self, axis: Array, *, turns: bool) -> Bearing:
        radius, thrust_radius, span = (float(x or 0.0) for x in (self.radius, self.thrust_radius, self.span))
        if not (self.mu or self.static_mu):
            return Bearing.none()
        if not turns:
            if thrust_radius:
                with within("thrust_radius"):
                    raise InputError("a joint that slides has no shoulder", expected="span, radius")
            return Bearing.guide(axis, radius, span, float(self.preload))
        if not radius:
            raise InputError("mu of a joint that turns needs the radius of its journal", expected="radius: 12 mm")
        return Bearing.journal(axis, radius, thrust_radius, span, float(self.preload))


def _axis(model: pin.Model, joint: Joint) -> Array:
    """Return the axis of a joint in the child's axes, shape (3,)."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    column = pin.getJointJacobian(model, data, joint.index, pin.LOCAL).reshape(6, -1)[:, joint.v]
    return np.array(column[:3] if joint.unit == METRE else column[3:])

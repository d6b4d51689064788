"""Joints of the tree: coordinates and efforts along them, and the wrenches they transmit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from pinarm.arrays import Array
from pinarm.engine.quantities.ball_quantities import MEANINGS as BALL_MEANINGS
from pinarm.engine.quantities.ball_quantities import PARTS as BALL_PARTS
from pinarm.engine.quantities.ball_quantities import ball_quantity
from pinarm.engine.quantities.family import AXES, RATES, WATT, Asked, Offered
from pinarm.engine.quantities.joint_axes import ALONG_AXIS, tree_axis
from pinarm.engine.quantities.transmitted import SAY_HOW, WRENCH, WrenchFamily, acts
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.mechanics.forces.joint_definitions import effort_unit
from pinarm.mechanics.joints import Joint
from pinarm.records import replace

AT_PARENT = "at_parent"
"""Asks for the moment of a joint about its place on the parent: where a joint slides, the child's origin moves."""

EFFORTS = ("effort", "link_effort")


class JointQuantities(WrenchFamily, frozen=True):
    """``joint.J...``: of joints with one coordinate and of ball joints."""

    element: ClassVar[str] = "J"
    of_variants: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "position": "coordinate of the joint", "velocity": "its rate", "acceleration": "its second derivative",
        "effort": "effort of all drives at the joint, those along sums of joints and their rotors' shares included; "
                  "that of one drive is coordinate.J.effort; of a joint without a drive, of the couplings that move "
                  "it, or where none do what its end stops push; behind an elastic gear, what it gives, in every kind "
                  "of problem, and what drives the joint itself beside it",
        "link_effort": "what of the effort reaches the links: without armature * acceleration",
        "power": "effort times velocity",
        "force": "force of the parent on the child, at the child's origin",
        "moment": "moment of the parent on the child, about the child's origin",
        f"moment.{AT_PARENT}": "the same moment about the joint's place on the parent",
        **BALL_MEANINGS,
    }  # fmt: skip

    def entries(self) -> Iterator[Offered]:
        """Yield the quantities of joints with one coordinate, then of ball joints."""
        mechanism = self.run.mechanism
        for name, joint in mechanism.joints.items():
            yield from (Offered(name, part) for part in (*RATES, *EFFORTS, "power"))
            along = ALONG_AXIS if tree_axis(mechanism.model, joint.index) is not None else ()
            yield from self._transmitted_entries(name, along)
        for name in mechanism.balls:
            yield from (Offered(name, part, components) for part, components in BALL_PARTS.items())
            yield from self._transmitted_entries(name, ())

    def _transmitted_entries(self, name: str, along: tuple[str, ...]) -> Iterator[Offered]:
        yield from (Offered(name, part, (*AXES, *along)) for part in WRENCH)
        yield Offered(name, f"moment.{AT_PARENT}", AXES)

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        mechanism = self.run.mechanism
        if (ball := mechanism.balls.get(asked.of)) is not None:
            series = ball_quantity(self.run, ball, asked.name, ".".join(asked.words[1:]))
            return self._transmitted(asked, ball.index) if series is None else series
        if (joint := mechanism.joints.get(asked.of)) is None:
            raise asked.unknown
        if len(asked.words) > 2:
            return self._transmitted(asked, joint.index)
        if asked.part in RATES:
            return self.rate(asked, asked.of, asked.part)
        self.require_efforts(asked)
        effort = self.run.effort(joint.v)
        if asked.part in EFFORTS:
            armature = self.run.armature(joint.v) if asked.part == "link_effort" else 0.0
            values, unit = effort - armature * self.run.a[..., joint.v], effort_unit(joint)
        elif asked.part == "power":
            values, unit = effort * self.run.v[..., joint.v], WATT
        else:
            raise asked.unknown
        return Series(asked.name, unit, values, self._effort_doubt(asked, joint))

    def _effort_doubt(self, asked: Asked, joint: Joint) -> str:
        """Return what is in doubt about the effort of a joint that couplings move; nothing where it has a drive."""
        return self.doubt(asked, self.evaluation.reactions.stressed_multipliers(self.run.couplings_at(joint.v)))

    def _transmitted(self, asked: Asked, index: int) -> Series:
        """Return a component of the wrench that a joint transmits, by Pinocchio's index of the joint."""
        self.require_efforts(asked)
        if len(asked.words) < 3 or asked.part not in WRENCH:
            raise asked.unknown
        reactions = self.evaluation.reactions
        about = origins = reactions.origins[..., index, :]
        if asked.words[1:3] == ("moment", AT_PARENT):
            about = reactions.markers(index)
            asked = replace(asked, words=(*asked.words[:2], *asked.words[3:]))
        for wrench in reactions.open_wrenches(index) if self.evaluation.judged else ():
            if acts(self.wrench_component(asked, origins, wrench, about)):
                raise InputError(f"'{asked.name}': {reactions.left_open[index]}",
                                 expected="a joint before or beyond them", hint=SAY_HOW)  # fmt: skip
        return self.wrench(asked, origins, reactions.joints[..., index, :], reactions.stressed_joint(index), about)

    def axes(self, asked: Asked) -> Array:
        """Return the axis of a joint, world axes, shape (n, 3)."""
        joint = self.run.mechanism.joints.get(asked.of)
        axes = self.evaluation.reactions.tree_axes(joint.index) if joint else None
        if axes is None:
            raise asked.unknown
        return axes

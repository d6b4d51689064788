"""Kinds of joint that close loops: rods, universal joints, cables that do not stretch, and the lower pairs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, ClassVar, get_args

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.yaml.schema import InputStruct, Span
from pinarm.mechanics.coordinates import PathLength
from pinarm.mechanics.geometry.pairs import Holding, Tie
from pinarm.mechanics.geometry.vectors import Axes, combined, cross, dot
from pinarm.mechanics.joints import Direction, unit_vector
from pinarm.mechanics.loops.loop_joints import CableLoop, LoopDefinition
from pinarm.mechanics.loops.lower_pairs import Helical, LowerKind
from pinarm.mechanics.loops.rolling import KnifeEdge, Rolling

ORIGINS = np.eye(4, 3)
"""Directions of translation of a universal joint: the origins stay together, the last row holds an angle."""


class Rod(LoopDefinition, frozen=True, tag_field="kind", tag="rod", kw_only=True):
    """The origins keep their distance, as by a rod without mass with ball joints at its ends.

    Attributes:
        length: Distance of the origins.
    """

    length: Span

    def pair(self) -> Tie:
        return Tie(float(self.length))


class Universal(LoopDefinition, frozen=True, tag_field="kind", tag="universal"):
    """The origins coincide; an axis of frame 1 and an axis of frame 2, those of the cross, stay at right angles.

    Attributes:
        axes: The axis of the cross in frame 1, and that in frame 2.
    """

    axes: tuple[Direction, Direction] = ("x", "y")

    def pair(self) -> Cross:
        return Cross(unit_vector(self.axes[0]), unit_vector(self.axes[1]))


class Cross(Holding, frozen=True):
    """A universal joint's rows, with u an axis of frame 1 and v one of frame 2: ``p' = 0`` and ``(v x u) . omega = 0``.

    Attributes:
        first: u in frame 1, shape (3,).
        second: v in frame 2, shape (3,).
    """

    kinds: ClassVar[str] = "eeew"
    first: Array
    second: Array

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        return [*p, np.arcsin(np.clip(self.first @ combined(axes, self.second), -1.0, 1.0))]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        normal = cross(combined(axes, self.second), self.first)
        w = np.zeros((4, *normal.shape), normal.dtype)
        w[3] = normal
        return ORIGINS, w

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        turning = dot(cross(cross(omega, combined(axes, self.second)), self.first), omega)
        bend = np.zeros((4, *turning.shape), turning.dtype)
        bend[3] = turning
        return bend


class Cable(InputStruct, frozen=True, tag_field="kind", tag="cable"):
    """A cable without mass that does not stretch, from one link over others to the last one; it only pulls.

    On the way it runs without friction over small pulleys or through eyes, whose radius does not count: at the origins
    of the links between, its tension S acts along both parts, and at the ends once. ``loop.NAME.tension`` is S, and
    ``loop.NAME.length`` the length of the path through the links, which is that of the cable while it is taut.

    Inverse problems and statics take it as taut, and tell where it would have to push. In a forward motion it goes
    slack where it would, and its becoming taut is an impact without rebound. It is taut at the start unless the given
    positions leave it slack.

    Attributes:
        through: The links, from one end to the other, such as ``[weight, pulley, door]``.
        length: Length of the cable; where it is left out, that of its path with all joint coordinates at 0, which is
            the position of a drawing: the cable is taut there.
    """

    through: Annotated[list[str], msgspec.Meta(min_length=2)]
    length: Span | None = None

    def bind(self, model: pin.Model, name: str) -> CableLoop:
        path = PathLength.through(model, self.through)
        length = path.at_zero(model) if self.length is None else float(self.length)
        if not length:
            raise InputError(
                "the path of the cable has no length where all joint coordinates are 0",
                expected="the length of the cable",
                hint="length: 2 m",
            )
        return CableLoop(name=name, coordinate=path, offset=length)


LoopJointKind = LowerKind | Helical | Universal | Rod | Rolling | KnifeEdge
"""Any loop joint. A new one is a class here or in ``lower_pairs``, and one entry here."""

LOOP_KINDS: Mapping[str, Callable[..., LoopJointKind]] = {
    str(kind.__struct_config__.tag): kind for kind in get_args(LoopJointKind)
}
"""Loop joints by the name that files call them by."""

Loop = LoopJointKind | Cable
"""Whatever closes a loop: a joint between two links, or a cable."""

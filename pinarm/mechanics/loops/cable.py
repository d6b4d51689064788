"""The cable that does not stretch."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import InputStruct, Span
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.paths import PathLength
from pinarm.records import Record


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
        """Return the cable of one model.

        Raises:
            InputError: A link does not exist, the cable ties nothing that moves, or its path has no length from which
                to take its own.
        """
        path = PathLength.through(model, self.through)
        length = path.at_zero(model) if self.length is None else float(self.length)
        if not length:
            raise InputError("the path of the cable has no length where all joint coordinates are 0",
                             expected="the length of the cable", hint="length: 2 m")  # fmt: skip
        return CableLoop(name, path, length)


class CableLoop(Record, frozen=True):
    """A cable of one mechanism: the constraint ``w(q) = length`` of its path, which can only be shorter.

    The multiplier lam pushes the points apart: the tension is ``-lam``.

    Attributes:
        name: Its name.
        path: Its path.
        length: [m].
    """

    name: str
    path: PathLength
    length: float
    kind: str = "cable"
    size: int = 1
    side: float = -1.0

    def unit(self, row: int) -> Unit:
        return METRE

    def gap(self, state: Kinematics) -> Array:
        return np.array([self.path.value(state) - self.length])

    def rows(self, state: Kinematics) -> Array:
        return self.path.row(state)[None]

    def drift(self, state: Kinematics) -> Array:
        return np.array([self.path.drift(state)])

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return the forces on the links of its path; see ``Constraint``."""
        return self.path.wrenches(links, lam[:, 0])

    def push(self, q: Array, lam: Array) -> Array:
        return -lam

    def push_unit(self) -> Unit:
        return unit("N")

    @property
    def opens(self) -> str:
        return "it goes slack"

    def whereabouts(self, q: Array) -> str:
        """Return nothing: the instant tells."""
        return ""

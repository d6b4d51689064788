"""Loop joints of one mechanism, and the keys that all of them have in files."""

from __future__ import annotations

import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.mechanics.coordinates import Constraint, HeldCoordinate, Parts, PathLength
from pinarm.mechanics.geometry.pairs import Pair, TiedFrames
from pinarm.mechanics.joints import METRE, RADIAN, frame_of


class LoopJoint(TiedFrames, Constraint, frozen=True, kw_only=True):
    """A loop joint of one mechanism, ready for evaluation."""

    name: str
    kind: str

    @property
    def parts(self) -> Parts:
        return [(1.0, self)]

    def unit(self, row: int) -> Unit:
        return RADIAN if self.pair.kinds[row] == "w" else METRE

    def helical(self, row: int) -> bool:
        return self.pair.kinds[row] == "h"


class LoopDefinition(InputStruct, frozen=True):
    """What every loop joint says.

    Attributes:
        between: The two links whose frames the joint ties; a fixed link without mass serves as a named frame.
    """

    between: tuple[str, str]

    def pair(self) -> Pair:
        raise NotImplementedError

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        first, second = (frame_of(model, link) for link in self.between)
        if model.frames[first].parentJoint == model.frames[second].parentJoint:
            raise InputError(
                f"{' and '.join(self.between)} belong to one rigid body: a joint between them closes no loop",
                expected="links that move against each other",
            )
        kind = str(self.__struct_config__.tag)
        return LoopJoint(first, second, self.pair(), name=name, kind=kind)


class CableLoop(HeldCoordinate, frozen=True, kw_only=True):
    """A cable of one mechanism: the constraint ``w(q) = offset`` of its path, which can only be shorter.

    The multiplier lam pushes the points apart: the tension is ``-lam``.
    """

    coordinate: PathLength
    offset: float
    kind: str = "cable"
    side: float = -1.0
    opens: str = "it goes slack"

    @property
    def path(self) -> PathLength:
        return self.coordinate

    def push(self, q: Array, lam: Array) -> Array:
        return -lam

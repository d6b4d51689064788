"""Loop joints of one mechanism, and the keys that all of them have in files."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.mechanics.coordinates import HeldCoordinate, PathLength
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.pairs import Pair, TiedFrames
from pinarm.mechanics.joints import METRE, RADIAN, frame_of


class LoopJoint(TiedFrames, frozen=True, kw_only=True):
    """A loop joint of one mechanism, ready for evaluation.

    Attributes:
        side: 0: it holds both ways.
        rolling: Rows that bind velocities alone: their gap is 0 in all positions.
    """

    name: str
    kind: str
    side: float = 0.0
    rolling: tuple[int, ...] = ()

    def unit(self, row: int) -> Unit:
        return METRE if self.pair.along[row] else RADIAN

    def helical(self, row: int) -> bool:
        return self.pair.along[row] and self.pair.about[row]


class LoopDefinition(InputStruct, frozen=True):
    """What every loop joint says.

    Attributes:
        between: The two links whose frames the joint ties; a fixed link without mass serves as a named frame.
    """

    rolling: ClassVar[tuple[int, ...]] = ()

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
        return LoopJoint(first, second, self.pair(), name=name, kind=kind, rolling=self.rolling)


class CableLoop(HeldCoordinate, frozen=True, kw_only=True):
    """A cable of one mechanism: the constraint ``w(q) = length`` of its path, which can only be shorter.

    The multiplier lam pushes the points apart: the tension is ``-lam``.

    Attributes:
        length: [m].
    """

    coordinate: PathLength
    length: float
    kind: str = "cable"
    side: float = -1.0
    opens: str = "it goes slack"

    @property
    def path(self) -> PathLength:
        return self.coordinate

    def gap(self, state: Kinematics) -> Array:
        return np.array([self.coordinate.value(state) - self.length])

    def push(self, q: Array, lam: Array) -> Array:
        return -lam

    def push_unit(self) -> Unit:
        return unit("N")

    def whereabouts(self, q: Array) -> str:
        return ""

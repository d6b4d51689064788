"""Lengths of paths through points of links, such as of a cable over small pulleys."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import DistanceCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE, frame_of
from pinarm.records import ValueRecord


class PathLength(ValueRecord, frozen=True):
    """Length of the path through the origins of links, straight from each to the next: ``w = sum_k |p_k+1 - p_k|``.

    Attributes:
        parts: The distances of neighbours.
        unit: Metre.
    """

    wraps: ClassVar[bool] = False
    parts: tuple[DistanceCoordinate, ...]
    unit: Unit = METRE

    @classmethod
    def through(cls, model: pin.Model, links: Sequence[str]) -> PathLength:
        """Return the path through links; errors are located at the key ``through``.

        Raises:
            InputError: A link does not exist, follows itself, or all of them are one rigid body.
        """
        frames = []
        for k, name in enumerate(links):
            with within("through", k):
                frames.append(frame_of(model, name))
                if len(frames) > 1 and frames[-1] == frames[-2]:
                    raise InputError(f"{name} follows itself on the path", expected="another link")
        if len({model.frames[frame].parentJoint for frame in frames}) < 2:
            with within("through"):
                raise InputError(f"{', '.join(links)} belong to one rigid body: the length of the path cannot change",
                                 expected="links that move against each other")  # fmt: skip
        return cls(tuple(DistanceCoordinate(*pair) for pair in pairwise(frames)))

    @property
    def frames(self) -> tuple[int, ...]:
        """Indices of the frames on the path, in their order."""
        return (*(part.first for part in self.parts), self.parts[-1].second)

    def at_zero(self, model: pin.Model) -> float:
        """Return the length where all joint coordinates are 0, which is the position of a drawing [m]."""
        data = model.createData()
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        points = np.array([data.oMf[frame].translation for frame in self.frames])
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())

    def value(self, state: Kinematics) -> float:
        return sum(part.value(state) for part in self.parts)

    def row(self, state: Kinematics) -> Array:
        return np.asarray(sum((part.row(state) for part in self.parts), np.zeros(state.model.nv)))

    def drift(self, state: Kinematics) -> float:
        return sum(part.drift(state) for part in self.parts)

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        """Return the forces that push neighbours apart; on a link between, the resultant of both."""
        found: dict[int, Array] = {}
        for part in self.parts:
            for joint, wrench in part.wrenches(links, effort).items():
                found[joint] = found.get(joint, 0.0) + wrench
        return found

    def words(self, model: pin.Model) -> str:
        return ", ".join(model.frames[frame].name for frame in self.frames)

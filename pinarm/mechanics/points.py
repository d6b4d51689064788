"""Points of interest on links, which the model's file does not have: frames without mass, with names as links have."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from pinarm.errors import InputError
from pinarm.input.yaml.schema import Angle, InputStruct, Position
from pinarm.mechanics.joints import frame_of


class PointDefinition(InputStruct, frozen=True):
    """A frame that is fixed to a link.

    Attributes:
        link: The link.
        at: Its origin in the link's axes [m].
        rpy: Roll, pitch and yaw of its axes in the link's, as in URDF [rad].
    """

    link: str
    at: tuple[Position, Position, Position]
    rpy: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)

    @property
    def placement(self) -> pin.SE3:
        """Placement in the link."""
        return pin.SE3(pin.rpy.rpyToMatrix(np.array(self.rpy, float)), np.array(self.at, float))


def with_points(model: pin.Model, points: Iterable[tuple[str, PointDefinition]]) -> pin.Model:
    """Return a copy of a model with points on its links, each usable as a link by those that follow.

    Raises:
        InputError: The model has no link of that name, or has a link with the name of the point.
    """
    marked = pin.Model(model)
    for name, point in points:
        if any(frame.name == name and frame.type == pin.FrameType.BODY for frame in marked.frames):
            raise InputError(f"the model has a link '{name}' already", expected="a name of its own for each point")
        index = frame_of(marked, point.link)
        frame = marked.frames[index]
        placed = pin.Frame(name, frame.parentJoint, index, frame.placement * point.placement, pin.FrameType.BODY)
        marked.addFrame(placed)
    return marked

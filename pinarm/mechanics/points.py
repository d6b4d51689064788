"""Points and payloads on links: frames without mass, and bodies added to the model, such as a tool or a load."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from pinarm.errors import InputError, within
from pinarm.input.yaml.schema import Angle, Inertia, InputStruct, Mass, Position
from pinarm.mechanics.joints import frame_of
from pinarm.mechanics.loading.model_tree import TRIANGLE


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
        return pin.SE3(pin.rpy.rpyToMatrix(np.array(self.rpy, float)), np.array(self.at, float))


def with_points(model: pin.Model, points: Iterable[tuple[str, PointDefinition]]) -> pin.Model:
    """Return a copy of a model with points on its links, each usable as a link by those that follow."""
    marked = pin.Model(model)
    for name, point in points:
        if any(frame.name == name and frame.type == pin.FrameType.BODY for frame in marked.frames):
            raise InputError(f"the model has a link '{name}' already", expected="a name of its own for each point")
        index = frame_of(marked, point.link)
        frame = marked.frames[index]
        placed = pin.Frame(name, frame.parentJoint, index, frame.placement * point.placement, pin.FrameType.BODY)
        marked.addFrame(placed)
    return marked


class Payload(InputStruct, frozen=True):
    """A body fixed to a link, its centre of mass at the link's origin.

    Attributes:
        point: The link.
        mass: [kg].
        inertia: Moments of inertia about the link's axes, at its origin [kg*m^2], such as ``[0.1 kg*m^2, 0.1 kg*m^2,
            0.2 kg*m^2]``; none for a point mass.
    """

    point: str
    mass: Mass
    inertia: tuple[Inertia, Inertia, Inertia] = (0.0, 0.0, 0.0)

    def check(self) -> None:
        small, middle, large = sorted(self.inertia)
        if small + middle < large * (1.0 - TRIANGLE):
            raise InputError(f"the moment of inertia {large:g} kg*m^2 is more than the sum of the other two")


def with_payloads(model: pin.Model, payloads: Iterable[Payload]) -> pin.Model:
    """Return a copy of a model whose links carry payloads.

    With ``jMp`` the placement of the link in its joint's frame, the body of the joint gets ``jMp.act(I)`` added, as if
    the payload's mass stood in the model's text. The model that is given stays as it is.
    """
    loaded = pin.Model(model)
    for payload in payloads:
        with within("point"):
            frame = loaded.frames[frame_of(loaded, payload.point)]
            if frame.parentJoint == 0:
                message = f"the link '{payload.point}' does not move: a payload on it changes nothing"
                raise InputError(message, expected="a moving link")
        carried = pin.Inertia(float(payload.mass), np.zeros(3), np.diag(np.array(payload.inertia, float)))
        frame.inertia += carried  # which wrenches through fixed joints ask for
        loaded.inertias[frame.parentJoint] += frame.placement.act(carried)
    return loaded

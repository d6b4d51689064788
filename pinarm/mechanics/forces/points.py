"""Forces at points of links: wrenches, springs and dampers between two points, and elastic cables."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import DynamicsError, within
from pinarm.input.units import DIMENSIONLESS, unit
from pinarm.input.yaml.schema import Damping, Force, InputStruct, Length, Moment, Span, Stiffness
from pinarm.mechanics.coordinates import PathLength, coordinates_of, distance
from pinarm.mechanics.forces.along_coordinate import NONE, AlongCoordinate, Coordinates, SpringAlong, StopSpring
from pinarm.mechanics.forces.force_element import ElementQuantity, ForceElement
from pinarm.mechanics.forces.load_laws import LoadKeys, LoadLaw
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import crossed, joined
from pinarm.mechanics.joints import METRE, UNIVERSE, Joint, format_configuration, frame_of, frames_of
from pinarm.mechanics.laws import Constant, Law
from pinarm.records import AbstractRecord

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.frame_pairs import FramePairs


class AppliedWrench(AbstractRecord, ForceElement, frozen=True):
    """A force and moment at a link's origin, constant in the axes of a frame, times a law.

    All of its power is supplied; the potential of a constant force is not counted as energy of the mechanism.

    Attributes:
        frame: Index of the frame at whose origin it acts.
        axes: Index of the frame in whose axes it is given.
        wrench: force and moment [N, N*m], shape (6,).
    """

    unshown = ("model",)

    model: pin.Model
    frame: int
    axes: int
    wrench: Array
    law: LoadLaw

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load ``J^T w`` to ``tau``; of one state by Pinocchio, in a twentieth of the time."""
        if q.ndim == 1 and np.isrealobj(q):
            state = Kinematics.at(self.model, q)
            turn, parts = state.data.oMf[self.axes].rotation, self.wrench.reshape(2, 3)
            jacobian = pin.getFrameJacobian(self.model, state.data, self.frame, pin.LOCAL_WORLD_ALIGNED)
            tau += self.law(t, q, v) * ((parts @ turn.T).ravel() @ jacobian.reshape(6, -1))
            return
        flat = q.reshape(-1, q.shape[-1])
        point, axes = (frames.at_configurations(flat) for frames in self._frame_pairs)
        force, moment = (np.tensordot(part, axes.turn, (0, 1)) for part in (self.wrench[:3], self.wrench[3:]))
        efforts = point.efforts(force, moment)[:, 0].T.reshape(*q.shape[:-1], -1)
        tau[..., point.pairs.velocities[:, 0]] += self.law(t, q, v)[..., None] * efforts

    @cached_property
    def _frame_pairs(self) -> tuple[FramePairs, FramePairs]:
        from pinarm.mechanics.geometry.frame_pairs import FramePairs  # for many states only

        point, axes = (FramePairs.between(self.model, UNIVERSE, frame) for frame in (self.frame, self.axes))
        return point, axes

    @property
    def points(self) -> tuple[int, ...]:
        return (self.frame,)

    def wrenches(self, links: LinkPlacements, t: Array, v: Array) -> dict[int, Array]:
        turns, points = links.frame(self.axes)[0], links.frame(self.frame)[1]
        force, moment = (np.matvec(turns, part) for part in (self.wrench[:3], self.wrench[3:]))
        whole = self.law(t, links.q, v)[..., None] * joined(force, moment + crossed(points, force))
        return {self.model.frames[self.frame].parentJoint: whole}


class PathElement(AlongCoordinate, frozen=True):
    """A pull along a path through the origins of links."""

    @property
    def path(self) -> PathLength:
        assert isinstance(self.coordinate, PathLength)
        return self.coordinate

    @property
    def points(self) -> tuple[int, ...]:
        return self.path.frames

    def measures(self) -> Mapping[str, ElementQuantity]:
        return {
            "length": ElementQuantity(METRE, lambda t, q, v: self.values(q)),
            "tension": ElementQuantity(unit("N"), lambda t, q, v: -self.efforts(t, q, v)),
        }


class TwoPointSpring(PathElement, SpringAlong, frozen=True):
    """Spring, damper and constant pull between the origins of two links, along their line.

    ``tension = stiffness (l - free_length) + damping l' + force``, positive where it pulls the points together. Where
    the points meet the line has no direction, and the spring no load, unless its pull is ``stiffness l``: that is
    ``stiffness d`` as a vector, with d from one point to the other, and 0 there.
    """

    def evaluated(self, q: Array) -> tuple[Array, Array]:
        lengths, rows = super().evaluated(q)
        if (self.rest or self.force or self.damping) and not lengths.all():
            where = q.reshape(-1, q.shape[-1])[lengths.argmin()]
            said = f"the points {self._named} of a two-point spring meet: its direction is undetermined"
            raise DynamicsError(f"{said} where {format_configuration(self.model, where)}", q=where)
        return lengths, rows

    @property
    def description(self) -> str:
        return f"point_spring between {self._named}"

    @property
    def _named(self) -> str:
        return " and ".join(self.model.frames[frame].name for frame in self.points)


class TautSpring(PathElement, StopSpring, frozen=True):
    """An elastic cable: it pulls along a path that is longer than its free length, and is slack on a shorter one."""

    @property
    def description(self) -> str:
        return f"cable through {self.path.words(self.model)}"


class Wrench(LoadKeys, frozen=True, tag_field="kind", tag="wrench"):
    """Force and moment at the origin of a link.

    Attributes:
        point: The link at whose origin it acts.
        force: Components [N].
        moment: Components [N*m], such as ``[0 N*m, 0 N*m, 5 N*m]``.
        axes: ``world``, or the link in whose axes the components are given.
        factor: Law that multiplies them, over time or over a coordinate.
    """

    point: str
    force: tuple[Force, Force, Force] = (0.0, 0.0, 0.0)
    moment: tuple[Moment, Moment, Moment] = (0.0, 0.0, 0.0)
    axes: str = "world"
    factor: Law = msgspec.field(default_factory=lambda: Constant(value=1.0))

    def bind(self, model: pin.Model, joints: Mapping[str, Joint], coordinates: Coordinates = NONE) -> ForceElement:
        with within("axes"):
            axes = 0 if self.axes == "world" else frame_of(model, self.axes)
        with within("point"):
            frame = frame_of(model, self.point)
        law = self.load_law("factor", DIMENSIONLESS, model, coordinates or coordinates_of(model, joints, {}))
        return AppliedWrench(model, frame, axes, np.array([*self.force, *self.moment], float), law)


class PointSpring(InputStruct, frozen=True, tag_field="kind", tag="point_spring"):
    """Spring, damper and constant pull between the origins of two links.

    It pulls with ``stiffness (length - free_length) + damping length' + force``. A gas strut pushes: give the negative
    of its force when extended, how much the force grows by length as stiffness, and its extended length as
    ``free_length``.

    Attributes:
        between: The links, such as ``[frame, lever]``.
        stiffness: Such as ``2 kN/m``.
        damping: Such as ``50 N*s/m``.
        free_length: Length at which the spring is free.
        force: Constant pull on the two points towards each other; negative for a push.
    """

    between: tuple[str, str]
    stiffness: Stiffness = 0.0
    damping: Damping = 0.0
    free_length: Length = 0.0
    force: Force = 0.0

    def bind(self, model: pin.Model, joints: Mapping[str, Joint], coordinates: Coordinates = NONE) -> ForceElement:
        ends = PathLength((distance(*frames_of(model, self.between)).way,))
        return TwoPointSpring(model, ends, *map(float, (self.stiffness, self.damping, self.free_length, self.force)))


class ElasticCable(InputStruct, frozen=True, tag_field="kind", tag="cable"):
    """An elastic cable from one link over others to the last one; it pulls, and is slack where it is too long.

    While the path through the links, of length l, is longer than the free length l0, the tension is
    ``S = max(stiffness (l - l0) + damping l', 0)``. On the way it runs without friction over small pulleys or through
    eyes, as the loop joint ``cable``, which does not stretch.

    Attributes:
        through: The links, from one end to the other, such as ``[weight, pulley, door]``.
        stiffness: Of the whole cable: modulus times cross-section over its length.
        damping: Such as ``50 N*s/m``.
        free_length: Length without tension.
    """

    through: Annotated[list[str], msgspec.Meta(min_length=2)]
    stiffness: Stiffness
    free_length: Span
    damping: Damping = 0.0

    def bind(self, model: pin.Model, joints: Mapping[str, Joint], coordinates: Coordinates = NONE) -> ForceElement:
        numbers = float(self.stiffness), float(self.damping), float(self.free_length)
        return TautSpring(model, PathLength.through(model, self.through), *numbers, (1.0,))

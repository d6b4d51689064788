"""Forces at points of links: wrenches, and springs, dampers and rods between two points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, TypeVar

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import DynamicsError, within
from pinarm.input.units import DIMENSIONLESS, unit
from pinarm.input.yaml.schema import Damping, Force, InputStruct, Length, Moment, Stiffness
from pinarm.mechanics.forces.force_element import ElementQuantity, ForceElement
from pinarm.mechanics.geometry.link_placements import LinkPlacements, opposed
from pinarm.mechanics.geometry.pinocchio_data import new_data
from pinarm.mechanics.geometry.vectors import cross, crossed, dot, joined, moved
from pinarm.mechanics.joints import METRE, UNIVERSE, Joint, format_configuration, frame_of, frames_of
from pinarm.mechanics.laws import Constant, Law
from pinarm.mechanics.laws.motion_law import MotionLaw, Values
from pinarm.records import AbstractRecord, replace

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.frame_pairs import FramePairs

Number = TypeVar("Number", float, Array)

MANY, KEPT = 8, 64
"""Number of configurations from which on it pays to place them together, and up to which what is found is kept."""

ALIGNED = pin.LOCAL_WORLD_ALIGNED


class AppliedWrench(AbstractRecord, ForceElement, frozen=True):
    """A force and moment at a link's origin, constant in the axes of a frame, times a law of time.

    All of its power is supplied; the potential of a constant force is not counted as energy of the mechanism.

    Attributes:
        model: Pinocchio's model.
        frame: Index of the frame at whose origin it acts.
        axes: Index of the frame in whose axes it is given.
        wrench: [force; moment] [N, N*m], shape (6,).
        law: Factor over time.
        function: The smooth piece of the law on the present interval.
        data: Buffers of its own.
    """

    unshown = ("model", "data")

    model: pin.Model
    frame: int
    axes: int
    wrench: Array
    law: MotionLaw
    data: pin.Data
    function: Callable[[Array], Values] | None = None

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load ``J^T w`` to ``tau``."""
        if q.ndim == 2 and (len(q) >= MANY or np.iscomplexobj(q)):
            self._add_many(t, q, tau)
            return
        for instant, state, load in _rows(t, q, tau):
            pin.computeJointJacobians(self.model, self.data, state)
            pin.updateFramePlacements(self.model, self.data)
            jacobian = pin.getFrameJacobian(self.model, self.data, self.frame, pin.LOCAL_WORLD_ALIGNED)
            load += jacobian.reshape(6, -1).T @ self._in_world(instant)

    @cached_property
    def frame_pairs(self) -> tuple[FramePairs, FramePairs]:
        """The point and the axes, seen from the world."""
        from pinarm.mechanics.geometry.frame_pairs import FramePairs  # for many states only

        point, axes = (FramePairs.between(self.model, UNIVERSE, frame) for frame in (self.frame, self.axes))
        return point, axes

    def _add_many(self, t: Array | float, q: Array, tau: Array) -> None:
        """Add the loads at many configurations, shape (n, nv)."""
        point, axes = (frames.at_configurations(q) for frames in self.frame_pairs)
        force, moment = (np.tensordot(part, axes.turn, (0, 1)) for part in (self.wrench[:3], self.wrench[3:]))
        tau[:, point.pairs.velocities[:, 0]] += (self._factor(t) * point.efforts(force, moment)[:, 0]).T

    def potential_energy(self, q: Array) -> Array:
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        tau = np.zeros_like(v)
        self.add_load(t, q, v, tau)
        return np.asarray(-(tau * v).sum(axis=-1))

    def laws(self) -> list[MotionLaw]:
        return [self.law]

    def on(self, start: float, end: float) -> AppliedWrench:
        return replace(self, function=self.law.on(start, end))

    @property
    def points(self) -> tuple[int, ...]:
        return (self.frame,)

    def wrenches(self, t: float, q: Array, v: Array) -> dict[int, Array]:
        pin.framesForwardKinematics(self.model, self.data, q)
        wrench = self._in_world(t)
        point = self.data.oMf[self.frame].translation
        moment = wrench[3:] + cross(point, wrench[:3])
        return {self.model.frames[self.frame].parentJoint: np.concatenate([wrench[:3], moment])}

    def wrenches_at(self, links: LinkPlacements, t: Array, q: Array, v: Array) -> dict[int, Array]:
        turns, points = links.frame(self.axes)[0], links.frame(self.frame)[1]
        force, moment = (np.matvec(turns, part) for part in (self.wrench[:3], self.wrench[3:]))
        whole = self._factor(t)[..., None] * joined(force, moment + crossed(points, force))
        return {self.model.frames[self.frame].parentJoint: whole}

    def _in_world(self, t: float) -> Array:
        """Return the wrench at its point, world axes; the placements in the buffers are those of the state."""
        turn = self.data.oMf[self.axes].rotation
        return np.asarray(self._factor(t) * np.concatenate([turn @ self.wrench[:3], turn @ self.wrench[3:]]))

    def _factor(self, t: Array | float) -> Array:
        if self.function is None:
            raise ValueError("a law is evaluated on an interval of time: take the element's on(start, end)")
        return self.function(np.asarray(t, float))[0]


class TwoPointSpring(AbstractRecord, ForceElement, frozen=True):
    """Spring, damper and constant pull between the origins of two links, along their line.

    ``tension = stiffness (l - free_length) + damping l' + force``, positive where it pulls the points together.
    Potential energy ``stiffness (l - free_length)^2 / 2 + force (l - free_length)``, dissipated power
    ``damping l'^2``. Where the points meet the line has no direction, and the spring no load, unless its pull is
    ``stiffness l``: that is ``stiffness d`` as a vector, with d from one point to the other, and 0 there.

    Attributes:
        model: Pinocchio's model.
        frames: Indices of the two frames.
        stiffness: [N/m].
        damping: [N*s/m].
        free_length: [m].
        force: Constant pull, negative for a push [N].
        data: Buffers of its own.
    """

    unshown = ("model", "data")

    model: pin.Model
    frames: tuple[int, int]
    stiffness: float
    damping: float
    free_length: float
    force: float
    data: pin.Data

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load ``-tension dl/dq`` to ``tau``."""
        if q.ndim > 1:
            length, row = self._lines(q)
            tau -= (self._tension(length, (row * v).sum(axis=-1)))[..., None] * row
            return
        size, _, slope = self._line(q)
        tau -= self._tension(size, float(slope.dot(v))) * slope

    def potential_energy(self, q: Array) -> Array:
        stretched = self._lines(q)[0] - self.free_length
        return np.asarray(0.5 * self.stiffness * stretched**2 + self.force * stretched)

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        if not self.damping:
            return np.zeros(q.shape[:-1])
        return np.asarray(self.damping * (self._lines(q)[1] * v).sum(axis=-1) ** 2)

    @property
    def conservative(self) -> bool:
        return not self.damping

    @property
    def points(self) -> tuple[int, ...]:
        return self.frames

    def wrenches(self, t: float, q: Array, v: Array) -> dict[int, Array]:
        length, direction, row = self._line(q)
        pull = self._tension(length, float(row @ v)) * direction
        found: dict[int, Array] = {}
        for frame, end, force in zip(self.frames, self._ends, (pull, -pull), strict=True):
            joint, (point, _) = self.model.frames[frame].parentJoint, end(q)
            found[joint] = found.get(joint, np.zeros(6)) + np.concatenate([force, cross(point, force)])
        return found

    def wrenches_at(self, links: LinkPlacements, t: Array, q: Array, v: Array) -> dict[int, Array]:
        first, second = (links.frame(frame)[1] for frame in self.frames)
        length, rows = self._lines(q)
        along = (second - first) / np.where(length == 0.0, 1.0, length)[:, None]
        pull = self._tension(length, (rows * v).sum(axis=-1))[:, None] * along
        wrench = moved(joined(-pull, np.zeros_like(pull)), second)
        return opposed(self.model, *self.frames, wrench)

    def measures(self) -> Mapping[str, ElementQuantity]:
        return {
            "length": ElementQuantity(METRE, lambda t, q, v: self._lines(q)[0]),
            "tension": ElementQuantity(unit("N"), self._tensions),
        }

    @property
    def description(self) -> str:
        return f"point_spring between {self._named}"

    @property
    def _named(self) -> str:
        return " and ".join(self.model.frames[frame].name for frame in self.frames)

    def _tensions(self, t: Array, q: Array, v: Array) -> Array:
        lengths, rows = self._lines(q)
        return self._tension(lengths, np.asarray((rows * v).sum(axis=-1)))

    def _tension(self, length: Number, rate: Number) -> Number:
        return self.stiffness * (length - self.free_length) + self.damping * rate + self.force

    @cached_property
    def frame_pair(self) -> FramePairs:
        """The second point, seen from the first."""
        from pinarm.mechanics.geometry.frame_pairs import FramePairs

        return FramePairs.between(self.model, *self.frames)

    def _lines(self, q: Array) -> tuple[Array, Array]:
        """Return lengths [m], shape (...), and dl/dq, shape (..., nv), at configurations, shape (..., nq)."""
        states = q.reshape(-1, q.shape[-1])
        few = len(states) <= KEPT and np.isrealobj(q)
        lengths, rows = self._last(q.tobytes()) if few else self._lines_of(states)
        return lengths.reshape(q.shape[:-1]), rows.reshape(*q.shape[:-1], self.model.nv)

    @cached_property
    def _last(self) -> Callable[[bytes], tuple[Array, Array]]:
        """The lines at the configurations of a table, to be read only: all that looks at it asks for the load there."""
        return lru_cache(maxsize=2)(lambda content: self._lines_of(np.frombuffer(content).reshape(-1, self.model.nq)))

    def _lines_of(self, states: Array) -> tuple[Array, Array]:
        """Return lengths [m], shape (n,), and dl/dq, shape (n, nv), at configurations, shape (n, nq)."""
        if len(states) < MANY and np.isrealobj(states):
            lines = [self._line(state) for state in states]
            lengths, rows = np.array([length for length, _, _ in lines]), np.array([row for _, _, row in lines])
        else:
            motion = self.frame_pair.at_configurations(states)
            lengths = np.sqrt(dot(motion.p, motion.p))[0]
            rows = np.zeros((len(states), self.model.nv), states.dtype)
            if not lengths.all() and not self._passes_zero:
                raise self._meeting(states[lengths.argmin()])
            along = motion.p / np.where(lengths == 0.0, 1.0, lengths)
            rows[:, motion.pairs.velocities[:, 0]] = dot(along[:, None], motion.linear)[:, 0].T
        return np.broadcast_to(lengths, len(states)), rows

    def _line(self, q: Array) -> tuple[float, Array, Array]:
        """Return length [m], direction from the first to the second point, and dl/dq, shape (nv,)."""
        first, second = self._ends
        begin, one = first(q)
        end, two = second(q)
        apart = end - begin
        length = float(apart.dot(apart)) ** 0.5
        if length == 0.0 and not self._passes_zero:
            raise self._meeting(q)
        direction = apart / (length or 1.0)
        return length, direction, direction.dot(two - one)

    @property
    def _passes_zero(self) -> bool:
        """Whether the load is defined where the points meet: of a spring of free length 0, and nothing else."""
        return not (self.free_length or self.force or self.damping)

    @cached_property
    def _ends(self) -> tuple[End, End]:
        first, second = (_end(self.model, self.data, frame) for frame in self.frames)
        return first, second

    def _meeting(self, q: Array) -> DynamicsError:
        said = f"the points {self._named} of a two-point spring meet: its direction is undetermined"
        return DynamicsError(f"{said} where {format_configuration(self.model, q)}", q=q)


End = Callable[[Array], tuple[Array, Array]]
"""From q to the place of a point [m], shape (3,), and to its Jacobian, shape (3, nv), in world axes."""


def _end(model: pin.Model, data: pin.Data, index: int) -> End:
    """Return the origin of a frame as a function of q; on the ground it is one for all."""
    frame = model.frames[index]
    if not frame.parentJoint:
        fixed = frame.placement.translation.copy(), np.zeros((3, model.nv))
        return lambda q: fixed

    def moving(q: Array) -> tuple[Array, Array]:
        jacobian = pin.computeFrameJacobian(model, data, q, index, ALIGNED).reshape(6, -1)[:3]
        return pin.updateFramePlacement(model, data, index).translation, jacobian

    return moving


class Wrench(InputStruct, frozen=True, tag_field="kind", tag="wrench"):
    """Force and moment at the origin of a link.

    Attributes:
        point: The link at whose origin it acts.
        force: Components [N].
        moment: Components [N*m], such as ``[0 N*m, 0 N*m, 5 N*m]``.
        axes: ``world``, or the link in whose axes the components are given.
        factor: Law over time that multiplies them.
    """

    point: str
    force: tuple[Force, Force, Force] = (0.0, 0.0, 0.0)
    moment: tuple[Moment, Moment, Moment] = (0.0, 0.0, 0.0)
    axes: str = "world"
    factor: Law = msgspec.field(default_factory=lambda: Constant(value=1.0))

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        with within("axes"):
            axes = 0 if self.axes == "world" else frame_of(model, self.axes)
        with within("point"):
            frame = frame_of(model, self.point)
        with within("factor"):
            self.factor.check_units(DIMENSIONLESS)
        wrench = np.array([*self.force, *self.moment], float)
        return AppliedWrench(model, frame, axes, wrench, self.factor, new_data(model))


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

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        frames = frames_of(model, self.between)
        return TwoPointSpring(
            model, frames, self.stiffness, self.damping, self.free_length, self.force, new_data(model)
        )


def _loads(tau: Array) -> Array:
    return tau.reshape(-1, tau.shape[-1])


def _rows(t: Array | float, q: Array, tau: Array) -> Iterator[tuple[float, Array, Array]]:
    """Yield instant, configuration and load (a view) of every row."""
    rows = np.atleast_2d(q)
    instants = np.broadcast_to(np.asarray(t, float), (len(rows),))
    return zip((float(x) for x in instants), rows, _loads(tau), strict=True)

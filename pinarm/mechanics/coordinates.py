"""Coordinates: functions w(q) of the configuration on which a motion can be prescribed.

Each has a value w(q), a row J with ``w' = J v``, and a drift ``J' v``, so that ``w'' = J a + drift``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Container, Iterable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices
from pinarm.errors import InputError, Key, choices, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import InputStruct, Weight
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.pairs import LowerPair, RotationVectorRow, Tie, TiedFrames
from pinarm.mechanics.joints import (
    METRE,
    RADIAN,
    UNIVERSE,
    Direction,
    Joint,
    check_parallel,
    effort_unit,
    frame_of,
    frames_of,
    joint_of,
    links_of,
    unit_vector,
)
from pinarm.records import AbstractRecord, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.frame_pairs import FramePairs


class Relation(Protocol):
    """A function of the joint coordinates at configurations, shape (n, nq), with its row of G, shape (n, nv)."""

    def at(self, q: Array) -> Array: ...

    def rows_at(self, q: Array) -> Array: ...

    def drifts_at(self, q: Array, v: Array) -> Array: ...


Parts = Sequence[tuple[float, TiedFrames | Relation]]
"""Signed pairs of frames and relations: the rows of a constraint or a coordinate are those of these, added up."""


class LinearCoordinate(ValueRecord, frozen=True):
    """A joint's own coordinate, or a weighted sum of several: ``w = sum_i weight_i q_i``.

    Attributes:
        places: Index in q for every index in v, shape (nv,).
    """

    wraps: ClassVar[bool] = False
    turning: ClassVar[None] = None
    unit: Unit
    weights: Array
    places: Indices

    @cached_property
    def moved(self) -> Indices:
        """Indices in v of the joints that it is a sum of: one of the thousands that a chain may have."""
        return np.flatnonzero(self.weights)

    @cached_property
    def joint(self) -> int | None:
        """Index in v of the joint whose own coordinate it is; ``None`` of a sum."""
        return int(self.moved[0]) if len(self.moved) == 1 and self.weights[self.moved[0]] == 1.0 else None

    def at(self, q: Array) -> Array:
        if self.joint is not None:
            return np.asarray(q[..., self.places[self.joint]])
        return np.asarray(q[..., self.places[self.moved]] @ self.weights[self.moved])

    def rate(self, v: Array) -> Array:
        """Return its rates at velocities, or its second derivatives at accelerations, shape (n, .., nv)."""
        if self.joint is not None:
            return np.asarray(v[..., self.joint])
        return np.asarray(v[..., self.moved] @ self.weights[self.moved])

    @property
    def parts(self) -> Parts:
        return [(1.0, self)]

    def rows_at(self, q: Array) -> Array:
        return np.broadcast_to(self.weights, (len(q), len(self.weights)))

    def drifts_at(self, q: Array, v: Array) -> Array:
        return np.zeros(len(q))

    def value(self, state: Kinematics) -> float:
        """Return ``sum_i weight_i q_i``."""
        return float(self.weights @ state.q[self.places])

    def row(self, state: Kinematics) -> Array:
        return self.weights

    def drift(self, state: Kinematics) -> float:
        return 0.0

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        return {}


class FrameCoordinate(AbstractRecord, frozen=True):
    """A coordinate whose one row is the sum of those of pairs of frames."""

    wraps: ClassVar[bool] = False

    @property
    @abstractmethod
    def ways(self) -> tuple[TiedFrames, ...]: ...

    @property
    def parts(self) -> Parts:
        return [(1.0, way) for way in self.ways]

    @property
    def turning(self) -> FrameCoordinate | None:
        """The counter of whole turns that a configuration does not tell; ``None`` where there are none."""
        return None

    def missing_turns(self, angle: Array, q: Array) -> Array:
        """Return the whole turns that angles from -pi to pi lack [rad] at configurations, shape (.., nq)."""
        return np.zeros(angle.shape)

    def value(self, state: Kinematics) -> float:
        value = np.array([sum(way.gap(state)[0] for way in self.ways)])
        return float((value + self.missing_turns(value, state.q))[0])

    def row(self, state: Kinematics) -> Array:
        return np.asarray(sum(way.rows(state)[0] for way in self.ways))

    def drift(self, state: Kinematics) -> float:
        return float(sum(way.drift(state)[0] for way in self.ways))

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        total: dict[int, Array] = {}
        for way in self.ways:
            for joint, wrench in way.wrenches(links, effort[..., None]).items():
                total[joint] = total.get(joint, 0.0) + wrench
        return total


class PairCoordinate(FrameCoordinate, frozen=True):
    """The one row of a pair between two frames: a place along an axis, a distance, or a part of a rotation.

    Attributes:
        loop: Name of the loop joint whose coordinate it is; empty of others.
    """

    way: TiedFrames
    unit: Unit
    loop: str = ""

    @property
    def ways(self) -> tuple[TiedFrames, ...]:
        return (self.way,)


def distance(first: int, second: int) -> PairCoordinate:
    """Return the distance between the origins of two frames; where they coincide its direction is arbitrary."""
    return PairCoordinate(TiedFrames(first, second, Tie(0.0)), METRE)


def rotation(frame: int, component: int, reference: int = UNIVERSE) -> PairCoordinate:
    """Return a component of the rotation vector of a frame in a reference frame."""
    return PairCoordinate(TiedFrames(reference, frame, RotationVectorRow(component, np.eye(3))), RADIAN)


class PathLength(FrameCoordinate, frozen=True):
    """Length of the path through the origins of links, straight from each to the next: ``w = sum_k |p_k+1 - p_k|``.

    Such as of a cable over small pulleys.
    """

    ways: tuple[TiedFrames, ...]
    unit: Unit = METRE

    @classmethod
    def through(cls, model: pin.Model, links: Sequence[str]) -> PathLength:
        """Return the path through links; errors are located at the key ``through``."""
        frames = []
        for k, name in enumerate(links):
            with within("through", k):
                frames.append(frame_of(model, name))
                if len(frames) > 1 and frames[-1] == frames[-2]:
                    raise InputError(f"{name} follows itself on the path", expected="another link")
        if len({model.frames[frame].parentJoint for frame in frames}) < 2:
            with within("through"):
                raise InputError(
                    f"{', '.join(links)} belong to one rigid body: the length of the path cannot change",
                    expected="links that move against each other",
                )
        return cls(tuple(distance(*pair).way for pair in pairwise(frames)))

    @property
    def frames(self) -> tuple[int, ...]:
        return (*(way.first for way in self.ways), self.ways[-1].second)

    def at_zero(self, model: pin.Model) -> float:
        """Return the length where all joint coordinates are 0, which is the position of a drawing [m]."""
        return self.value(Kinematics.at(model, pin.neutral(model)))

    def words(self, model: pin.Model) -> str:
        return ", ".join(model.frames[frame].name for frame in self.frames)


Coordinate = LinearCoordinate | PairCoordinate | PathLength
"""A coordinate of one mechanism: ``value`` w(q), ``row`` J, ``drift`` J' v, and ``wrenches`` on links, other than joint
efforts, of efforts along it, shape (n,): joint index -> [f; m] at the world's origin, world axes, shape (n, 6).
``wraps`` tells whether it is an angle that a configuration tells up to whole turns, from -pi to pi."""


class MeasuredCoordinate(AbstractRecord, frozen=True):
    """A coordinate w with the row J, ``w' = J v``."""

    unshown: ClassVar[tuple[str, ...]] = ("model",)

    model: pin.Model
    coordinate: Coordinate

    def values(self, q: Array) -> Array:
        """Return w, shape (...)."""
        return self.evaluated(q)[0]

    def moving(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return w and its rate, shape (...), and J, shape (..., nv)."""
        w, rows = self.evaluated(q)
        return w, (rows * v).sum(axis=-1), rows

    def evaluated(self, q: Array) -> tuple[Array, Array]:
        """Return w, shape (...), and J, shape (..., nv), by the motions of the frames that the coordinate measures."""
        if isinstance(self.coordinate, LinearCoordinate):
            weights = self.coordinate.weights
            values = self.coordinate.at(q)
            return values, np.broadcast_to(weights, (*values.shape, len(weights)))
        states = q.reshape(-1, q.shape[-1])
        w, rows = self._of_one(states[0]) if len(states) == 1 and np.isrealobj(q) else self._of_many(states)
        return w.reshape(q.shape[:-1]), rows.reshape(*q.shape[:-1], self.model.nv)

    def _of_one(self, q: Array) -> tuple[Array, Array]:
        """Return w and J of one real configuration, in a seventh of the time that many take."""
        state = Kinematics.at(self.model, q)
        return np.array(self.coordinate.value(state)), np.asarray(self.coordinate.row(state))

    def _of_many(self, q: Array) -> tuple[Array, Array]:
        w, rows = np.zeros(len(q), q.dtype), np.zeros((self.model.nv, len(q)), q.dtype)
        for way, frames in self._ways:
            motion = frames.at_configurations(q)
            w += way.pair.gap(*motion.flat)[0]
            rows[frames.velocities[:, 0]] += motion.rows(way.pair)[0, :, 0]
        if not isinstance(self.coordinate, LinearCoordinate):
            w += self.coordinate.missing_turns(w, q)
        return w, rows.T

    @cached_property
    def _ways(self) -> list[tuple[TiedFrames, FramePairs]]:
        from pinarm.mechanics.geometry.frame_pairs import FramePairs  # for many states only

        assert isinstance(self.coordinate, FrameCoordinate)
        return [(way, FramePairs.between(self.model, way.first, way.second)) for way in self.coordinate.ways]


class Constraint(ABC):
    """m rows of G that belong together, such as those of one joint, held by forces on bodies.

    Attributes:
        offset: What its gap is less than the sum of its parts, such as the length of a cable [m or rad].
        follower: Index in v of the joint that it ties to others and that has no drive; ``None`` where there is none.
        opens: Effect of the opening of a one-sided constraint, in words, such as "the follower lifts off".
    """

    name: str
    kind: str = ""
    offset: float = 0.0
    follower: int | None = None
    opens: str = ""

    @property
    def size(self) -> int:
        """Number m of rows."""
        return 1

    @property
    def side(self) -> float:
        """Sense in which its multiplier can act, 1 or -1, as of a cam that only pushes; 0 where it holds both ways.

        A constraint with a side may open: its gap then has that sign.
        """
        return 0.0

    @property
    def turning(self) -> FrameCoordinate | Constraint | None:
        """The counter of whole turns in its gap; ``None`` where there are none."""
        return None

    def helical(self, row: int) -> bool:
        """Return whether a row counts turns, so that it is met in many places."""
        return False

    def push(self, q: Array, lam: Array) -> Array:
        """Return with what multipliers, shape (n,), act at configurations, negative against their side, shape (n,)."""
        return lam

    def push_unit(self) -> Unit:
        return effort_unit(self.unit(0))

    @property
    @abstractmethod
    def parts(self) -> Parts: ...

    @abstractmethod
    def unit(self, row: int) -> Unit:
        """Return the unit of the gap in a row: m or rad."""

    @abstractmethod
    def gap(self, state: Kinematics) -> Array: ...

    @abstractmethod
    def rows(self, state: Kinematics) -> Array: ...

    @abstractmethod
    def drift(self, state: Kinematics) -> Array:
        """Return G' v, shape (m,)."""

    @abstractmethod
    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return wrenches of multipliers, (.., m), on links: joint index -> [f; m] at the world's origin, (.., 6).

        Their virtual power is lam times the rows. Empty where they are not known: the multipliers are then efforts at
        the joints only.
        """


class HeldCoordinate(AbstractRecord, Constraint, frozen=True):
    """A coordinate that is held by a force along itself: a constraint of one row, whose multiplier is that force."""

    name: str
    coordinate: Coordinate

    @property
    def parts(self) -> Parts:
        return self.coordinate.parts

    @property
    def turning(self) -> FrameCoordinate | Constraint | None:
        return self.coordinate.turning

    def unit(self, row: int) -> Unit:
        return self.coordinate.unit

    def gap(self, state: Kinematics) -> Array:
        """Return the value, shape (1,): of a guided coordinate what it is held to is the user's to subtract."""
        return np.array([self.coordinate.value(state) - self.offset])

    def rows(self, state: Kinematics) -> Array:
        return self.coordinate.row(state)[None]

    def drift(self, state: Kinematics) -> Array:
        return np.array([self.coordinate.drift(state)])

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        return self.coordinate.wrenches(links, lam[..., 0])


class GuidedCoordinate(HeldCoordinate, frozen=True):
    """A coordinate that follows a law, or that drives hold."""


class AngleSum(InputStruct, frozen=True, tag_field="kind", tag="sum"):
    """Sum of joint coordinates: of a list, about parallel axes of one sense, an absolute angle with its turns.

    With weights, ``of: {left: 0.5, right: 0.5}``, it is any linear function of joints of one kind, such as what a motor
    turns behind a differential.

    Attributes:
        of: Joints, or joint -> weight.
    """

    of: Annotated[list[str], msgspec.Meta(min_length=1)] | Annotated[dict[str, Weight], msgspec.Meta(min_length=1)]

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> Coordinate:
        with within("of"):
            coordinate = sum_of(model, joints, list(self.of))
            if isinstance(self.of, dict):
                weights = np.zeros_like(coordinate.weights)
                weights[[joints[name].v for name in self.of]] = list(self.of.values())
                return replace(coordinate, weights=weights)
            check_parallel(model, {name: joints[name].v for name in self.of})
            return coordinate


class PointCoordinate(InputStruct, frozen=True, tag_field="kind", tag="point"):
    """Position of a link's origin along a direction of the world, e.g. a height, or the place on a line.

    Attributes:
        point: The link.
        along: An axis, or the three components of a direction of any length.
    """

    point: str
    along: Direction

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> Coordinate:
        with within("along"):
            axis = unit_vector(self.along)
        with within("point"):
            along = TiedFrames(UNIVERSE, frame_of(model, self.point), LowerPair.row(axis, np.zeros(3)))
            return PairCoordinate(along, METRE)


class Distance(InputStruct, frozen=True, tag_field="kind", tag="distance"):
    """Distance between the origins of two links.

    Attributes:
        between: The links, such as ``[hand, base]``.
    """

    between: tuple[str, str]

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> Coordinate:
        return distance(*frames_of(model, self.between))


class Rotation(InputStruct, frozen=True, tag_field="kind", tag="rotation"):
    """Component of a link's rotation vector, along an axis of the world or of a reference.

    The rotation vector has the direction of the axis about which the link is turned from the axes of the reference, and
    the length of the angle. Three of them give an orientation; they are singular at half a turn, so a reference is
    best turned as the link is wanted: with ``points: {aim: {link: base, at: [...], rpy: [180 deg, 0 deg, 0 deg]}}`` a
    tool that points down has the rotation vector 0 relative to ``aim``.

    Attributes:
        body: The link.
        about: The axis of the reference.
        relative_to: The reference, a link or a point; the world where it is left out.
    """

    body: str
    about: Literal["x", "y", "z"]
    relative_to: str = ""

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> Coordinate:
        with within("body"):
            frame = frame_of(model, self.body)
        if not self.relative_to:
            return rotation(frame, "xyz".index(self.about))
        with within("relative_to"):
            reference = frame_of(model, self.relative_to)
            if model.frames[frame].parentJoint == model.frames[reference].parentJoint:
                raise InputError(
                    f"'{self.relative_to}' is on the same body as '{self.body}'",
                    expected="a reference from which the body can turn",
                )
        return rotation(frame, "xyz".index(self.about), reference)


CoordinateDefinition = AngleSum | PointCoordinate | Distance | Rotation
"""Any coordinate that a mechanism file may define. A new kind is one class above and one entry here."""


def coordinate_of(model: pin.Model, coordinates: Mapping[str, Coordinate], name: str) -> Coordinate:
    """Return a coordinate by name."""
    if name not in coordinates:
        expected, hint = choices(name, coordinates)
        hint = _definition_of(model, name) or hint
        raise InputError(f"the mechanism has no coordinate '{name}'", expected=expected, hint=hint)
    return coordinates[name]


def _definition_of(model: pin.Model, name: str) -> str:
    """Return a hint that defines the coordinate meant by ``hand.y`` or ``point.hand.position.y``; else empty."""
    point, dot, axis = name.rpartition(".")
    point = point.removeprefix("point.").removesuffix(".position")
    if not dot or axis not in ("x", "y", "z") or point not in links_of(model):
        return ""
    own = f"{point}_{axis}".replace(".", "_")
    return (
        f"{own} here, with coordinates: {{{own}: {{kind: point, point: {point}, along: {axis}}}}} in the mechanism file"
    )


def sum_of(model: pin.Model, joints: Mapping[str, Joint], names: Sequence[str]) -> LinearCoordinate:
    """Return the sum of the coordinates of joints."""
    units = {joint_of(joints, name).unit for name in names}
    if len(units) > 1:
        raise InputError("a sum of joint coordinates cannot mix angles and lengths", expected="joints of one kind")
    weights = np.zeros(model.nv)
    places = np.zeros(model.nv, dtype=np.intp)
    for joint in joints.values():
        places[joint.v] = joint.q
    for name in names:
        weights[joints[name].v] += 1.0
    return LinearCoordinate(units.pop(), weights, places)


def driven_along(coordinates: Iterable[Coordinate], nv: int) -> Flags:
    """Return the joints that drives along coordinates act on, but for those along task coordinates, shape (nv,)."""
    weights = [coordinate.weights for coordinate in coordinates if isinstance(coordinate, LinearCoordinate)]
    return np.asarray(np.array(weights, dtype=np.float64).reshape(-1, nv).any(axis=0), dtype=bool)


def coordinates_of(
    model: pin.Model, joints: Mapping[str, Joint], definitions: Mapping[str, Any], known: Container[str] = ()
) -> dict[str, Coordinate]:
    """Return every coordinate by name: those of the joints, then those defined in the file.

    ``known`` are further names that are taken.
    """
    coordinates: dict[str, Coordinate] = {name: sum_of(model, joints, [name]) for name in joints}
    for name, definition in definitions.items():
        with within(Key(name)):
            if name in joints or name in known:
                raise InputError(f"the coordinate '{name}' has the name of a joint", expected="a name of its own")
        with within(name):
            coordinates[name] = definition.bind(model, joints)
    return coordinates

"""Coordinates: functions w(q) of the configuration on which a motion can be prescribed.

Each has a value w(q), a row J with ``w' = J v``, and a drift ``J' v``, so that ``w'' = J a + drift``.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Protocol

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices
from pinarm.errors import InputError, Key, choices, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import InputStruct, Weight
from pinarm.mechanics.geometry.joint_axes import check_parallel
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements, opposed
from pinarm.mechanics.geometry.rotation_rows import RotationVectorRow
from pinarm.mechanics.geometry.vectors import MEETING, crossed, direction, rotated
from pinarm.mechanics.joints import (
    METRE,
    RADIAN,
    UNIVERSE,
    Direction,
    Joint,
    frame_of,
    frames_of,
    joint_of,
    links_of,
    unit_vector,
)
from pinarm.records import ValueRecord, replace


class Coordinate(Protocol):
    """A coordinate of one mechanism, ready for evaluation."""

    @property
    def unit(self) -> Unit:
        """Unit of its value."""
        ...

    @property
    def wraps(self) -> bool:
        """Whether it is an angle that a configuration tells up to whole turns, from -pi to pi."""
        ...

    def value(self, state: Kinematics) -> float:
        """Return w(q)."""
        ...

    def row(self, state: Kinematics) -> Array:
        """Return J, shape (nv,)."""
        ...

    def drift(self, state: Kinematics) -> float:
        """Return J' v."""
        ...

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        """Return the wrenches on links of efforts along the coordinate, shape (n,), other than joint efforts.

        Joint index -> [f; m] at the world's origin, world axes, shape (n, 6).
        """
        ...


class LinearCoordinate(ValueRecord, frozen=True):
    """A joint's own coordinate, or a weighted sum of several: ``w = sum_i weight_i q_i``.

    Attributes:
        unit: Unit of its value.
        weights: Shape (nv,).
        places: Index in q for every index in v, shape (nv,).
    """

    wraps: ClassVar[bool] = False
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

    def value(self, state: Kinematics) -> float:
        """Return ``sum_i weight_i q_i``."""
        return float(self.weights @ state.q[self.places])

    def row(self, state: Kinematics) -> Array:
        return self.weights

    def drift(self, state: Kinematics) -> float:
        """Return 0: the row is constant."""
        return 0.0

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        """Return nothing: the efforts act as joint efforts."""
        return {}


class FrameCoordinate(ValueRecord, frozen=True):
    """Position of a link's origin along an axis of the world: ``w = u . p(q)`` [m].

    Attributes:
        frame: Index of the frame.
        axis: Unit vector u in world axes, shape (3,).
        unit: Metre.
    """

    wraps: ClassVar[bool] = False
    frame: int
    axis: Array
    unit: Unit = METRE

    def value(self, state: Kinematics) -> float:
        """Return u . p."""
        return float(self.axis @ state.data.oMf[self.frame].translation)

    def row(self, state: Kinematics) -> Array:
        """Return u . J_p."""
        jacobian = pin.getFrameJacobian(state.model, state.data, self.frame, pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(self.axis @ jacobian.reshape(6, -1)[:3])

    def drift(self, state: Kinematics) -> float:
        """Return u . (J_p' v): the acceleration that the point has while a = 0."""
        acceleration = pin.getFrameClassicalAcceleration(state.model, state.data, self.frame, pin.LOCAL_WORLD_ALIGNED)
        return float(self.axis @ acceleration.linear)

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        return pull(links, self.frame, effort[:, None] * self.axis)


class DistanceCoordinate(ValueRecord, frozen=True):
    """Distance between the origins of two links: ``w = |d|``, ``d = p_2 - p_1``, ``w' = u . d'`` with ``u = d / w``.

    The drift is ``u . d'' + (|d'|^2 - (u . d')^2) / w`` with d'' for a = 0. Where they coincide, u is arbitrary.

    Attributes:
        first: Index of the first frame.
        second: Index of the second one.
        unit: Metre.
    """

    wraps: ClassVar[bool] = False
    first: int
    second: int
    unit: Unit = METRE

    def value(self, state: Kinematics) -> float:
        return float(np.linalg.norm(self._apart(state)))

    def row(self, state: Kinematics) -> Array:
        """Return u . (J_2 - J_1)."""
        first, second = (
            pin.getFrameJacobian(state.model, state.data, frame, pin.LOCAL_WORLD_ALIGNED).reshape(6, -1)[:3]
            for frame in (self.first, self.second)
        )
        return np.asarray(direction(self._apart(state)) @ (second - first))

    def drift(self, state: Kinematics) -> float:
        """Return u . d'' + (|d'|^2 - (u . d')^2) / w with d'' for a = 0."""
        world, frames = pin.LOCAL_WORLD_ALIGNED, (self.first, self.second)
        v1, v2 = (pin.getFrameVelocity(state.model, state.data, frame, world).linear for frame in frames)
        a1, a2 = (pin.getFrameClassicalAcceleration(state.model, state.data, frame, world).linear for frame in frames)
        along, rate = direction(self._apart(state)), v2 - v1
        length = max(self.value(state), MEETING)
        return float(along @ (a2 - a1) + (rate @ rate - (along @ rate) ** 2) / length)

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        place = links.frame(self.second)[1]
        force = (effort * direction((place - links.frame(self.first)[1]).T)).T
        return opposed(links.model, self.first, self.second, np.concatenate([force, crossed(place, force)], axis=1))

    def _apart(self, state: Kinematics) -> Array:
        return np.asarray(state.data.oMf[self.second].translation - state.data.oMf[self.first].translation)


class RotationCoordinate(ValueRecord, frozen=True):
    """Component k of the rotation vector w of a link relative to a reference, ``R_ref^T R = exp([w])``.

    ``w' = B(w) omega`` with omega the angular velocity of the link relative to the reference, in the link's axes. With
    theta = |w| and W = [w], ``B = 1 + W/2 + c(theta) W^2`` and
    ``c = 1/theta^2 - (1 + cos theta) / (2 theta sin theta)``; the drift is ``B' omega + B omega'``, where
    ``omega' = R^T (alpha - alpha_ref + omega_link x omega_ref)`` for a = 0, in world axes within the brackets.
    (Sola, Deray, Atchuthan, A micro Lie theory, eq. (144).)

    Attributes:
        frame: Index of the link's frame.
        component: k.
        reference: Index of the frame from which it is turned.
        unit: Radian.
    """

    wraps: ClassVar[bool] = False
    frame: int
    component: int
    reference: int = UNIVERSE
    unit: Unit = RADIAN

    def value(self, state: Kinematics) -> float:
        return float(pin.log3(self._turn(state))[self.component])

    def row(self, state: Kinematics) -> Array:
        """Return row k of ``B R^T (J_omega - J_ref)``."""
        link, reference = (
            pin.getFrameJacobian(state.model, state.data, frame, pin.LOCAL_WORLD_ALIGNED).reshape(6, -1)[3:]
            for frame in (self.frame, self.reference)
        )
        turned = self._axes(state).T @ (link - reference)
        return np.asarray(b_of(pin.log3(self._turn(state)))[self.component] @ turned)

    def drift(self, state: Kinematics) -> float:
        world, frames, axes = pin.LOCAL_WORLD_ALIGNED, (self.frame, self.reference), self._axes(state)
        link, reference = (pin.getFrameVelocity(state.model, state.data, frame, world).angular for frame in frames)
        alpha, carried = (pin.getFrameAcceleration(state.model, state.data, frame, world).angular for frame in frames)
        omega = axes.T @ (link - reference)
        rate = axes.T @ (alpha - carried + np.cross(link, reference))
        w = pin.log3(self._turn(state))
        b = b_of(w)
        return float((b @ rate + rate_of_b(w, b @ omega) @ omega)[self.component])

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        """Return the moments with the same power, along the direction of the angle's row, and back on the reference."""
        turns, references = links.frame(self.frame)[0], links.frame(self.reference)[0]
        axes = (references.swapaxes(-1, -2) @ turns).transpose(2, 1, 0)
        (_, (along,)) = RotationVectorRow(self.component, IDENTITY).directions(axes[0], axes)
        moment = effort[:, None] * rotated(references, along.T)
        wrench = np.concatenate([np.zeros_like(moment), moment], axis=1)
        return opposed(links.model, self.reference, self.frame, wrench)

    def _axes(self, state: Kinematics) -> Array:
        """Return the link's axes in world axes, shape (3, 3)."""
        return np.asarray(state.data.oMf[self.frame].rotation)

    def _turn(self, state: Kinematics) -> Array:
        """Return the rotation of the link relative to the reference, shape (3, 3)."""
        return np.asarray(state.data.oMf[self.reference].rotation.T @ self._axes(state))


def pull(links: LinkPlacements, frame: int, force: Array) -> dict[int, Array]:
    """Return forces at a frame's origin, shape (n, 3), as wrenches on its link.

    Joint index -> [f; m] at the world's origin, world axes, shape (n, 6).
    """
    wrench = np.concatenate([force, crossed(links.frame(frame)[1], force)], axis=1)
    return {links.model.frames[frame].parentJoint: wrench}


IDENTITY = np.eye(3)


def b_of(w: Array) -> Array:
    """Return ``B = 1 + W/2 + c W^2`` of a rotation vector w, shape (3, 3): ``w' = B omega``, omega in turned axes.

    ``pin.Jlog3`` is the same up to 1e-16 / theta^2: 1e-9 at small angles, which second differences would see.
    """
    c, _ = _bend(w)
    return np.asarray((1.0 - c * float(w @ w)) * IDENTITY + 0.5 * pin.skew(w) + c * (w[:, None] * w))


def rate_of_b(w: Array, rate: Array) -> Array:
    """Return B' for a rotation vector w and its rate: ``[w']/2 + c' W^2 + c (W' W + W W')``, shape (3, 3)."""
    c, slope = _bend(w)
    skew, turned = pin.skew(w), pin.skew(rate)
    growth = slope * float(w @ rate)
    return np.asarray(0.5 * turned + growth * (skew @ skew) + c * (turned @ skew + skew @ turned))


def _bend(w: Array) -> tuple[float, float]:
    """Return c of B and ``dc/dtheta / theta``; near 0 by the series ``c = 1/12 + theta^2/720``."""
    theta2 = float(w @ w)
    theta = theta2**0.5
    if theta < 1e-2:  # the series' next term is theta^4 / 30240: below rounding here
        return 1 / 12 + theta2 / 720, 1 / 360 + theta2 / 7560
    sine, cosine = np.sin(theta), np.cos(theta)
    c = 1 / theta2 - (1 + cosine) / (2 * theta * sine)
    return c, ((1 + cosine) * (sine + theta) / (2 * theta2 * sine**2) - 2 / theta**3) / theta


class AngleSum(InputStruct, frozen=True, tag_field="kind", tag="sum"):
    """Sum of joint coordinates: of a list, about parallel axes of one sense, an absolute angle with its turns.

    With weights, ``of: {left: 0.5, right: 0.5}``, it is any linear function of joints of one kind, such as what a motor
    turns behind a differential.

    Attributes:
        of: Joints, or joint -> weight.
    """

    of: Annotated[list[str], msgspec.Meta(min_length=1)] | Annotated[dict[str, Weight], msgspec.Meta(min_length=1)]

    def check(self) -> None:
        """Refuse weights of 0 or infinity."""
        for name, weight in self.of.items() if isinstance(self.of, dict) else ():
            if not 0.0 < abs(weight) < np.inf:
                with within("of", Key(name)):
                    raise InputError(f"the weight of {name} cannot be {weight:g}", expected="a finite number but 0")

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
            return FrameCoordinate(frame_of(model, self.point), axis)


class Distance(InputStruct, frozen=True, tag_field="kind", tag="distance"):
    """Distance between the origins of two links.

    Attributes:
        between: The links, such as ``[hand, base]``.
    """

    between: tuple[str, str]

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> Coordinate:
        return DistanceCoordinate(*frames_of(model, self.between))


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
        """Return the coordinate for a model.

        Raises:
            InputError: A link does not exist, or the two are one rigid body.
        """
        with within("body"):
            frame = frame_of(model, self.body)
        if not self.relative_to:
            return RotationCoordinate(frame, "xyz".index(self.about))
        with within("relative_to"):
            reference = frame_of(model, self.relative_to)
            if model.frames[frame].parentJoint == model.frames[reference].parentJoint:
                raise InputError(f"'{self.relative_to}' is on the same body as '{self.body}'",
                                 expected="a reference from which the body can turn")  # fmt: skip
        return RotationCoordinate(frame, "xyz".index(self.about), reference)


CoordinateDefinition = AngleSum | PointCoordinate | Distance | Rotation
"""Any coordinate that a mechanism file may define. A new kind is one class above and one entry here."""


def coordinate_of(model: pin.Model, coordinates: Mapping[str, Coordinate], name: str) -> Coordinate:
    """Return a coordinate by name.

    Raises:
        InputError: There is none of that name; of a point and an axis, ``hand.y``, the message says how to define it.
    """
    if name not in coordinates:
        expected, hint = choices(name, coordinates)
        hint = _definition_of(model, name) or hint
        raise InputError(f"the mechanism has no coordinate '{name}'", expected=expected, hint=hint)
    return coordinates[name]


def _definition_of(model: pin.Model, name: str) -> str:
    """Return how to define the coordinate that ``hand.y`` or ``point.hand.position.y`` means; empty of other names."""
    point, dot, axis = name.rpartition(".")
    point = point.removeprefix("point.").removesuffix(".position")
    if not dot or axis not in ("x", "y", "z") or point not in links_of(model):
        return ""
    own = f"{point}_{axis}".replace(".", "_")
    return (
        f"{own} here, with coordinates: {{{own}: {{kind: point, point: {point}, along: {axis}}}}} in the mechanism file"
    )


def sum_of(model: pin.Model, joints: Mapping[str, Joint], names: Sequence[str]) -> LinearCoordinate:
    """Return the sum of the coordinates of joints.

    Raises:
        InputError: A joint is unknown, or angles and lengths are mixed.
    """
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

    Raises:
        InputError: A definition takes the name of a joint, or names something that does not exist.
    """
    coordinates: dict[str, Coordinate] = {name: sum_of(model, joints, [name]) for name in joints}
    for name, definition in definitions.items():
        with within(Key(name)):
            if name in joints or name in known:
                raise InputError(f"the coordinate '{name}' has the name of a joint", expected="a name of its own")
        with within(name):
            coordinates[name] = definition.bind(model, joints)
    return coordinates

"""Rolling without slip on a plane, and the knife edge: rows that bind velocities and leave positions free."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import DynamicsError
from pinarm.input.yaml.schema import Span
from pinarm.mechanics.geometry.vectors import Axes, combined, cross, dot
from pinarm.mechanics.joints import Direction, unit_vector
from pinarm.mechanics.loops.loop_joints import LoopDefinition
from pinarm.records import Record, replace

FLAT = 1e-3
"""Sine of the angle between the axis of a wheel and the normal up to which the wheel lies flat."""


class Rolling(LoopDefinition, frozen=True, tag_field="kind", tag="rolling", kw_only=True):
    """A wheel with a sharp edge touches a plane and rolls on it without slip.

    The plane goes through the origin of frame 1. The origin of frame 2 is the centre of the wheel, which is on the side
    of the plane to which the normal points. The first row keeps the edge on the plane; the two others bind the velocity
    of the point of the wheel that touches it, along the wheel's heading and across: how far the wheel has rolled
    depends on its whole way.

    Attributes:
        radius: Radius of the wheel.
        axis: The axis of the wheel, in frame 2.
        normal: The normal of the plane, in frame 1.
    """

    radius: Span
    axis: Direction = "y"
    normal: Direction = "z"

    def pair(self) -> Wheel:
        return Wheel(float(self.radius), unit_vector(self.axis), unit_vector(self.normal))


class KnifeEdge(LoopDefinition, frozen=True, tag_field="kind", tag="knife_edge"):
    """The origin of frame 2 moves along an edge of its link only, as of a skate: not across it, along the plane.

    It does not hold the link on the plane: that is a joint of the tree, or a loop joint ``planar``, ``point_on_plane``.

    Attributes:
        edge: The direction of the edge, in frame 2.
        normal: The normal of the plane on which it glides, in frame 1.
    """

    edge: Direction = "x"
    normal: Direction = "z"

    def pair(self) -> Blade:
        return Blade(unit_vector(self.edge), unit_vector(self.normal))


class Wheel(Record, frozen=True):
    """Rows of a wheel: ``e . (p' + omega x c) = 0``, with e the normal n, the heading h and ``n x h``.

    With the axis a of the wheel, ``c = -r u / |u|`` leads from its centre to the edge, where ``u = n - (n . a) a`` is
    the way up in its plane, and ``h = a x n / |a x n|``. The contact moves along the edge and along the plane, but the
    velocity of the wheel's point there is ``p' + omega x c``: with the normal it is the rate of ``n . p - r |u|``.

    Attributes:
        radius: r [m].
        axis: a in frame 2, shape (3,).
        normal: n in frame 1, shape (3,).
        kinds: ``h``, of a wheel that slides, or ``hhh``.
    """

    radius: float
    axis: Array
    normal: Array
    kinds: str = "hhh"

    @property
    def rolling(self) -> tuple[int, ...]:
        return (1, 2)[: len(self.kinds) - 1]

    @property
    def holding(self) -> Wheel:
        return replace(self, kinds="h")

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        _, up, _ = self._frame(p, axes)
        nothing = np.zeros(p.shape[1:], p.dtype)
        return [self.normal @ p - self.radius * np.sqrt(dot(up, up)), nothing, nothing][: len(self.kinds)]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        _, up, ahead = self._frame(p, axes)
        heading, arm, normal = _unit(ahead), -self.radius * _unit(up), self._normal(p)
        e = [normal, heading, cross(normal, heading)][: len(self.kinds)]
        return np.array(np.broadcast_arrays(*e)), np.array([cross(arm, way) for way in e])

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        axis, up, ahead = self._frame(p, axes)
        normal, turning = self._normal(p), cross(omega, axis)
        heading, arm = _unit(ahead), -self.radius * _unit(up)
        rising = -dot(normal, turning) * axis - dot(normal, axis) * turning
        d_heading, d_arm = _rate(ahead, cross(turning, normal)), -self.radius * _rate(up, rising)
        e, de = (normal, heading, cross(normal, heading)), (0.0 * normal, d_heading, cross(normal, d_heading))
        moving = dp + cross(omega, arm)
        return np.array(
            [dot(change, moving) + dot(way, cross(omega, d_arm)) for way, change in zip(e, de, strict=True)]
        )[: len(self.kinds)]

    def _normal(self, p: Array) -> Array:
        return self.normal.reshape(3, *(1,) * (p.ndim - 1))

    def _frame(self, p: Array, axes: Axes) -> tuple[Array, Array, Array]:
        axis, normal = combined(axes, self.axis), self._normal(p)
        ahead = cross(axis, normal)
        if (np.real(dot(ahead, ahead)) < FLAT**2).any():
            raise DynamicsError(
                "a wheel lies flat on the plane on which it rolls: its point of contact is not determined",
                expected="a wheel that stands or leans",
                hint="the axis of the wheel in its frame, or a run that ends before it falls",
            )
        return axis, normal - dot(normal, axis) * axis, ahead


class Blade(Record, frozen=True):
    """The row of a knife edge: ``s . p' = 0`` with ``s = n x b / |n x b|``, b the edge.

    Attributes:
        edge: b in frame 2, shape (3,).
        normal: n in frame 1, shape (3,).
    """

    kinds: ClassVar[str] = "e"
    rolling: ClassVar[tuple[int, ...]] = (0,)
    holding: ClassVar[None] = None
    edge: Array
    normal: Array

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        return [np.zeros(p.shape[1:], p.dtype)]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        return _unit(self._across(p, combined(axes, self.edge)))[None], np.zeros((1, 3))

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        edge = combined(axes, self.edge)
        return dot(_rate(self._across(p, edge), self._across(p, cross(omega, edge))), dp)[None]

    def _across(self, p: Array, edge: Array) -> Array:
        return cross(self.normal.reshape(3, *(1,) * (p.ndim - 1)), edge)


def _unit(x: Array) -> Array:
    return np.asarray(x / np.sqrt(dot(x, x)))


def _rate(x: Array, dx: Array) -> Array:
    unit = _unit(x)
    return np.asarray((dx - dot(unit, dx) * unit) / np.sqrt(dot(x, x)))

"""The deflection of one frame from another: a displacement and a rotation vector that favour neither frame."""

from __future__ import annotations

import math
from typing import Generic, TypeVar

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.mechanics.geometry.vectors import Axes, rotation_vector
from pinarm.records import Record

Number = TypeVar("Number", float, Array)
Vector = tuple[Number, Number, Number]
"""Components: numbers of one state, which Python multiplies faster than arrays of three, or arrays, shape (n,)."""

REACH = math.radians(170.0)
"""Largest rotation of one frame in the other [rad]: at half a turn the shortest way back changes sides."""

TINY = 1e-300
"""Angle that stands for 0 where one is divided by it [rad]."""


class Deflection(Record, Generic[Number], frozen=True):
    """Where frame 2 is in frame 1, seen from the axes halfway between them.

    With the rotation ``R = exp([phi])`` of frame 2 in frame 1 and the place p of its origin, the halfway axes are those
    of frame 1 turned by ``H = exp([phi / 2])``, and ``d = H^T p``; phi has the same components in all three. Which
    frame comes first changes the signs of d and phi, and nothing else.

    A relative angular velocity w, in halfway axes, gives ``phi' = c w + (1 - c) u (u . w)`` with the axis u of phi, its
    angle theta and ``c = (theta / 2) / sin(theta / 2)``, as w is the integral of ``exp([s phi]) phi'`` over s from -1/2
    to 1/2. Over s from 0 to 1/2 it gives the angular velocity of the halfway axes in frame 1,
    ``(w - tan(theta / 4) u x w) / 2``.

    Attributes:
        d: Displacement [m], halfway axes.
        phi: Rotation vector [rad].
        axis: u; any where theta is 0.
        sine: sin(theta / 2).
        cosine: cos(theta / 2).
        scale: c.
    """

    d: Vector[Number]
    phi: Vector[Number]
    axis: Vector[Number]
    sine: Number
    cosine: Number
    scale: Number

    @classmethod
    def one(cls, placement: pin.SE3) -> Deflection[float]:
        """Return that of a placement of frame 2 in frame 1; not numbers beyond ``REACH``."""
        x, y, z = pin.log3(placement.rotation).tolist()
        theta = math.sqrt(x * x + y * y + z * z)
        half = 0.5 * (theta or TINY) if theta <= REACH else math.nan
        p: Vector[float] = tuple(placement.translation.tolist())
        return Deflection._of(p, (x, y, z), half, math.sin(half), math.cos(half))

    @classmethod
    def many(cls, p: Array, axes: Axes) -> Deflection[Array]:
        """Return those of n placements.

        Args:
            p: Origin of frame 2 [m], axes of frame 1, shape (3, n) or (3, 1).
            axes: Axes of frame 2 in those of frame 1, each of shape (3, n) or (3, 1).
        """
        places, turned = np.broadcast_arrays(p, rotation_vector(axes))
        theta = np.sqrt((turned * turned).sum(axis=0))
        half = np.where(theta > REACH, math.nan, 0.5 * np.where(theta == 0.0, TINY, theta))
        return Deflection._of(tuple(places), tuple(turned), half, np.sin(half), np.cos(half))

    @staticmethod
    def _of(p: Vector[Number], phi: Vector[Number], half: Number, sine: Number, cosine: Number) -> Deflection[Number]:
        per = 0.5 / half
        axis = per * phi[0], per * phi[1], per * phi[2]
        return Deflection(_turned(p, axis, -sine, cosine), phi, axis, sine, cosine, half / sine)

    def backwards(self, a: Vector[Number]) -> Vector[Number]:
        """Return the components in halfway axes of a vector in the axes of frame 1."""
        return _turned(a, self.axis, -self.sine, self.cosine)

    def rate(self, dp: Vector[Number], w: Vector[Number]) -> tuple[Vector[Number], Vector[Number]]:
        """Return d' [m/s] and phi' [rad/s] from p' and w in the axes of frame 1."""
        dp, w = self.backwards(dp), self.backwards(w)
        halfway = _sum(0.5, w, -0.5 * self._lag, _cross(self.axis, w))
        return _sum(1.0, dp, 1.0, _cross(self.d, halfway)), self._mapped(w)

    def wrench(self, f: Vector[Number], m: Vector[Number]) -> tuple[Vector[Number], Vector[Number]]:
        """Return the force on frame 2 and the moment at its origin, in the axes of frame 1: the transpose of ``rate``.

        Their power is ``f . d' + m . phi'``. In halfway axes the force is f, and with ``g = d x f`` the moment is
        ``c m + (1 - c) u (u . m) - (g - tan(theta / 4) g x u) / 2``.
        """
        g = _cross(self.d, f)
        lever = _sum(0.5, g, -0.5 * self._lag, _cross(g, self.axis))
        moment = _sum(1.0, self._mapped(m), -1.0, lever)
        return _turned(f, self.axis, self.sine, self.cosine), _turned(moment, self.axis, self.sine, self.cosine)

    @property
    def _lag(self) -> Number:
        """tan(theta / 4)."""
        return self.sine / (1.0 + self.cosine)

    def _mapped(self, w: Vector[Number]) -> Vector[Number]:
        """Return ``c w + (1 - c) u (u . w)``: a symmetric map."""
        return _sum(self.scale, w, (1.0 - self.scale) * _dot(self.axis, w), self.axis)


def _dot(a: Vector[Number], b: Vector[Number]) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector[Number], b: Vector[Number]) -> Vector[Number]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _sum(a: Number | float, x: Vector[Number], b: Number | float, y: Vector[Number]) -> Vector[Number]:
    """Return ``a x + b y``."""
    return a * x[0] + b * y[0], a * x[1] + b * y[1], a * x[2] + b * y[2]


def _turned(a: Vector[Number], axis: Vector[Number], sine: Number, cosine: Number) -> Vector[Number]:
    """Return a vector turned about an axis (Rodrigues)."""
    across = _sum(cosine, a, sine, _cross(axis, a))
    return _sum(1.0, across, (1.0 - cosine) * _dot(axis, a), axis)

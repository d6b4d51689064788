"""Rows of angles over angular velocities: an angle about an axis, a rotation vector, roll, pitch and yaw.

Each is what a ``Pair`` of two frames measures (``geometry.pairs``), for one or many configurations and complex
steps: the value, the direction d with ``value' = d . omega`` in the axes of frame 1, and ``d' . omega``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import ClassVar

import numpy as np

from pinarm.arrays import Array
from pinarm.mechanics.geometry.vectors import Axes, arctan2, combined, cross, dot, rotation_vector
from pinarm.records import Record

SERIES = 1e-2
"""Angle [rad] below which coefficients of B are those of their series: the next term, theta^4 / 30240, is rounding."""


class RotationRow(Record, frozen=True):
    """An angle of the rotation ``R = turn^T R_2`` of frame 2 against axes that are fixed in frame 1.

    Attributes:
        component: Number of the axis, or of the angle.
        turn: These axes in frame 1, columns, shape (3, 3).
    """

    along: ClassVar[tuple[bool, ...]] = (False,)
    about: ClassVar[tuple[bool, ...]] = (True,)
    constant: ClassVar[None] = None
    component: int
    turn: Array

    @cached_property
    def _back(self) -> Array:
        return self.turn.T

    def _turned(self, axes: Axes) -> Array:
        """Return the axes of frame 2 in the fixed axes, shape (3, 3) or (3, 3, n), the first index their number."""
        return np.array([np.tensordot(self._back, axis, 1) for axis in axes])

    def _in_frame_1(self, direction: Array) -> tuple[Array, Array]:
        turned = np.tensordot(self.turn, direction, 1)[None]
        return np.zeros_like(turned), turned


class RotationVectorRow(RotationRow, frozen=True):
    """Component k of the rotation vector w, ``R = exp([w])``.

    ``d = (1 - c theta^2) e_k + c w_k w + w x e_k / 2`` with ``theta = |w|`` and c of ``bend_coefficients``.
    Source: Sola, Deray, Atchuthan, A micro Lie theory, eq. (146).
    """

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        return [rotation_vector(self._turned(axes))[self.component]]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        w = rotation_vector(self._turned(axes))
        c, _ = bend_coefficients(dot(w, w))
        return self._in_frame_1(self._row(w, c))

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        w, turning = rotation_vector(self._turned(axes)), np.tensordot(self._back, omega, 1)
        c, slope = bend_coefficients(dot(w, w))
        square, unit = dot(w, w), self._unit(w)
        rate = (1.0 - c * square) * turning + c * dot(w, turning) * w - 0.5 * cross(w, turning)
        k, growth = self.component, slope * dot(w, rate)
        change = -(growth * square + 2.0 * c * dot(w, rate)) * unit + growth * w[k] * w
        change = change + c * (rate[k] * w + w[k] * rate) + 0.5 * cross(rate, unit)
        return np.asarray(dot(change, turning))[None]

    def _row(self, w: Array, c: Array) -> Array:
        unit = self._unit(w)
        return np.asarray((1.0 - c * dot(w, w)) * unit + c * w[self.component] * w + 0.5 * cross(w, unit))

    def _unit(self, like: Array) -> Array:
        unit = np.zeros_like(like)
        unit[self.component] = 1.0
        return unit


class RollPitchYawRow(RotationRow, frozen=True):
    """Roll r, pitch p or yaw y, ``R = Rz(y) Ry(p) Rx(r)``.

    With omega in the axes of frame 2, ``A = sin r omega_y + cos r omega_z`` and ``B = cos r omega_y - sin r omega_z``:
    ``r' = omega_x + A tan p``, ``p' = B``, ``y' = A / cos p``; while omega is constant ``A' = r' B``, ``B' = -r' A``.
    """

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        turned = self._turned(axes)
        level = np.sqrt(turned[1, 2] ** 2 + turned[2, 2] ** 2)
        y, x = ((turned[1, 2], turned[2, 2]), (-turned[0, 2], level), (turned[0, 1], turned[0, 0]))[self.component]
        return [arctan2(y, x)]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        (sine, cosine), (slope, secant) = self._functions(axes)
        nothing = np.zeros_like(sine)
        weights = (
            (nothing + 1.0, slope * sine, slope * cosine), (nothing, cosine, -sine),
            (nothing, secant * sine, secant * cosine),
        )[self.component]  # fmt: skip
        turned = np.asarray(combined(axes, weights))[None]
        return np.zeros_like(turned), turned

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        (sine, cosine), (slope, secant) = self._functions(axes)
        x, y, z = (dot(np.asarray(axis), omega) for axis in axes)
        a, b = sine * y + cosine * z, cosine * y - sine * z
        roll = x + slope * a
        second = (secant**2 * b * a + slope * roll * b, -roll * a, secant * (roll * b + slope * b * a))
        return np.asarray(second[self.component])[None]

    def _functions(self, axes: Axes) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Return sine and cosine of the roll, tangent and secant of the pitch."""
        turned = self._turned(axes)
        level = np.sqrt(turned[1, 2] ** 2 + turned[2, 2] ** 2)
        return (turned[1, 2] / level, turned[2, 2] / level), (-turned[0, 2] / level, 1.0 / level)


class AngleAbout(Record, frozen=True):
    """The angle by which frame 2 is turned about an axis, as a rotation vector along that axis.

    Attributes:
        axis: Shape (3,).
        across: u and v, with the axis right-handed, shape (2, 3).
        counted: Angle nearest to which whole turns are added, of a screw; ``None`` where nothing counts them.
    """

    axis: Array
    across: Array
    counted: Callable[[Array], Array] | None = None

    def __call__(self, p: Array, axes: Axes) -> Array:
        angle = angle_about(self.across, axes)
        if self.counted is not None:
            angle = angle + whole_turns(self.counted(p) - angle)
        return np.multiply.outer(self.axis, angle)


def angle_about(across: Array, axes: Axes) -> Array:
    """Return ``atan2(v . R u - u . R v, u . R u + v . R v)``, from -pi to pi, of normals u and v, shape (2, 3)."""
    (u, v), (ru, rv) = across, (combined(axes, normal) for normal in across)
    return arctan2(v @ ru - u @ rv, u @ ru + v @ rv)


def whole_turns(angle: Array) -> Array:
    """Return the whole turns nearest to angles [rad], of complex steps to their real parts."""
    return np.asarray(2.0 * np.pi * np.round(np.real(angle) / (2.0 * np.pi)))


def bend_coefficients(square: Array) -> tuple[Array, Array]:
    """Return ``c = 1/theta^2 - (1 + cos theta) / (2 theta sin theta)`` and ``dc/dtheta / theta`` for theta^2."""
    small = np.real(square) < SERIES**2
    theta = np.sqrt(np.where(small, 1.0, square))
    sine, cosine = np.sin(theta), np.cos(theta)
    c = 1.0 / theta**2 - (1.0 + cosine) / (2.0 * theta * sine)
    slope = ((1.0 + cosine) * (sine + theta) / (2.0 * theta**2 * sine**2) - 2.0 / theta**3) / theta
    near = 1.0 / 12.0 + square / 720.0, 1.0 / 360.0 + square / 7560.0
    return np.where(small, near[0], c), np.where(small, near[1], slope)

"""Pairs of frames: what a joint holds, or a coordinate measures, between two frames, with its rows of G.

With frame 1 on the first link and frame 2 on the second, ``p`` is the place of frame 2's origin and R its orientation,
both seen from frame 1, and ``omega`` the angular velocity of 2 in 1. Every row ``e . p' + w . omega`` has a direction e
of translation and a direction w of rotation, in the axes of frame 1. A row with an e measures a length, and w is a way
per angle [m/rad]; a row without one measures an angle.

The multiplier lam of a row is a force ``lam e`` at the origin of frame 2 and a moment ``lam w``, of the first link on
the second: their power is ``lam`` times the row.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import ClassVar, Protocol, Self

import numpy as np

from pinarm.arrays import Array, vecmat
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements, opposed
from pinarm.mechanics.geometry.link_tree import states_first
from pinarm.mechanics.geometry.vectors import (
    MEETING,
    Axes,
    arctan2,
    combined,
    cross,
    direction,
    dot,
    joined,
    moved,
    rotated,
    rotation_vector,
)
from pinarm.records import AbstractRecord, Record

NOTHING, ALL = np.zeros((0, 3)), np.eye(3)
"""No directions, and all three."""


class Pair(Protocol):
    """Gap and directions of m rows between two frames, in one configuration or in n of them.

    All vectors are in the axes of frame 1; (..) stands for nothing or for n. ``axes`` are those of frame 2.
    """

    @property
    def kinds(self) -> str:
        """A letter for each of m rows.

        ``e`` with a direction of translation, ``w`` of rotation, ``h`` with both; those with an e measure lengths.
        """

    @property
    def rolling(self) -> tuple[int, ...]:
        """Rows that bind velocities alone: their gap is 0 in all positions."""

    @property
    def holding(self) -> Pair | None:
        """The pair without rolling rows; ``None`` if none is left."""

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        """Return the gap, or the value, of every row [m or rad], shape (..) or (1,)."""

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return e and w of all rows, each of shape (m, 3, ..), 0 where a row has none.

        Without their last axis where they are the same in all configurations.
        """

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        """Return the part of the drift from the change of directions, ``e' . p' + w' . omega``, shape (m, ..)."""


RotationGap = Callable[[Array, Axes], Array]
"""From p and the axes of frame 2 to the rotation vector by which a pair is open [rad], shape (3, ..)."""


class Holding(Record, frozen=True):
    """A pair whose rows hold positions."""

    rolling: ClassVar[tuple[int, ...]] = ()

    @property
    def holding(self) -> Self:
        return self


class LowerPair(Holding, frozen=True):
    """A pair whose rows have constant directions, those without a direction of rotation first.

    The gap of these is ``e . p``, that of the others ``w . rotation``.

    Attributes:
        e: Directions of translation, shape (m, 3).
        w: Directions of rotation, shape (m, 3).
        axis: The common axis, shape (3,).
        rotation: The open rotation; none where no row has a direction of rotation, or where no gap is asked for.
    """

    e: Array
    w: Array
    axis: Array
    rotation: RotationGap | None = None

    @classmethod
    def row(cls, e: Array, w: Array, rotation: RotationGap | None = None) -> LowerPair:
        """Return the pair of one row, given its directions, shape (3,) each."""
        return cls(e[None], w[None], e if e.any() else w, rotation)

    @cached_property
    def kinds(self) -> str:
        return "".join(
            "h" if e.any() and w.any() else "e" if e.any() else "w" for e, w in zip(self.e, self.w, strict=True)
        )

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        held = self.kinds.count("e")
        if self.rotation is None:
            return list(self.e[:held] @ p)
        return [*(self.e[:held] @ p), *(self.w[held:] @ self.rotation(p, axes))]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        return self.e, self.w

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        return np.zeros((len(self.e), 1)[: p.ndim])


class Tie(Holding, frozen=True):
    """Distance of the origins less a length, with u the direction of p: ``u . p' = 0``.

    Attributes:
        length: [m].
    """

    kinds: ClassVar[str] = "e"
    length: float

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        return [np.sqrt(dot(p, p)) - self.length]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        return direction(p)[None], np.zeros((1, 3))

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        """Return the centripetal term ``(|p'|^2 - (u . p')^2) / |p|``."""
        along = dot(direction(p), dp)
        return np.asarray((dot(dp, dp) - along * along) / np.maximum(np.sqrt(dot(p, p)), MEETING))[None]


class TiedFrames(AbstractRecord, frozen=True):
    """Two frames of a model with the pair between them."""

    first: int
    second: int
    pair: Pair

    @property
    def size(self) -> int:
        return len(self.pair.kinds)

    def gap(self, state: Kinematics) -> Array:
        return np.array(self.pair.gap(*state.between(self.first, self.second).placed))

    def rows(self, state: Kinematics) -> Array:
        """Return G, shape (m, nv)."""
        relative = state.between(self.first, self.second)
        (e, w), (linear, angular) = self.pair.directions(*relative.placed), relative.columns
        return np.asarray(e @ linear + w @ angular)

    def drift(self, state: Kinematics) -> Array:
        """Return ``G' v``, shape (m,): ``e . p'' + w . omega'`` for a = 0, seen from frame 1, and the bend."""
        relative = state.between(self.first, self.second)
        (e, w), (dp, omega, ddp, domega) = self.pair.directions(*relative.placed), relative.rates
        return np.asarray(e @ ddp + w @ domega + self.pair.bend(*relative.placed, dp, omega))

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return the wrenches of multipliers, shape (.., m): joint index -> [f; m] at the world's origin, (.., 6)."""
        acting = moved(self.wrench(links, lam), links.frame(self.second)[1])
        return opposed(links.model, self.first, self.second, acting)

    def wrench(self, links: LinkPlacements, lam: Array) -> Array:
        """Return [f; m] of the first link on the second, at the origin of frame 2, world axes [N, N*m].

        Of multipliers of shape (n, m), or (n, k, m) of variants, as (n, 6) or (n, k, 6).
        """
        (turn, origin), (other, place) = links.frame(self.first), links.frame(self.second)
        if isinstance(self.pair, LowerPair):
            # numpy turns vectors whose components lie apart in memory in a third of the time
            columns = lam.reshape(-1, lam.shape[-1]).T
            inner = ((along.T @ columns).reshape(3, *lam.shape[:-1]) for along in (self.pair.e, self.pair.w))
            return joined(*(rotated(turn, states_first(part, 1)) for part in inner))
        axes, p = turn.swapaxes(-1, -2) @ other, vecmat(place - origin, turn)
        states = np.broadcast_shapes(axes.shape[:-2], p.shape[:-1], lam.shape[:-1])
        axes, p, lam = (
            np.broadcast_to(x, (*states, *x.shape[-tail:])).reshape(-1, *x.shape[-tail:])
            for x, tail in ((axes, 2), (p, 1), (lam, 1))
        )
        directions = self.pair.directions(p.T, axes.transpose(2, 1, 0))
        inner = (np.einsum("nk,kcn->nc", lam, _spread(along, len(lam))) for along in directions)
        return joined(*(rotated(turn, part.reshape(*states, 3)) for part in inner))


def _spread(directions: Array, n: int) -> Array:
    """Return directions, shape (k, 3) or (k, 3, n), at n configurations."""
    spread = directions[:, :, None] if directions.ndim == 2 else directions
    return np.broadcast_to(spread, (*directions.shape[:2], n))


SERIES = 1e-2
"""Angle [rad] below which coefficients of B are those of their series: the next term, theta^4 / 30240, is rounding."""


class RotationRow(Holding, frozen=True):
    """An angle of the rotation ``R = turn^T R_2`` of frame 2 against axes that are fixed in frame 1.

    Attributes:
        component: Number of the axis, or of the angle.
        turn: These axes in frame 1, columns, shape (3, 3).
    """

    kinds: ClassVar[str] = "w"
    component: int
    turn: Array

    def _turned(self, axes: Axes) -> Array:
        """Return the axes of frame 2 in the fixed axes, shape (3, 3) or (3, 3, n), the first index their number."""
        return np.array([self.turn.T @ axis for axis in axes])

    def _in_frame_1(self, direction: Array) -> tuple[Array, Array]:
        turned = (self.turn @ direction)[None]
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
        w, turning = rotation_vector(self._turned(axes)), self.turn.T @ omega
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
            (nothing + 1.0, slope * sine, slope * cosine),
            (nothing, cosine, -sine),
            (nothing, secant * sine, secant * cosine),
        )[self.component]
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

"""Bushings: linear stiffness and damping, in translation and rotation, between the frames of two links."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property, partial
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, Key, choices, within
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.input.yaml.schema import (
    AnyQuantity,
    Damping,
    InputStruct,
    RotationDamping,
    RotationStiffness,
    Stiffness,
    check_unit,
)
from pinarm.mechanics.coordinates import PairCoordinate, rotation
from pinarm.mechanics.forces.force_element import ElementQuantity, ForceElement
from pinarm.mechanics.geometry.link_placements import LinkPlacements, opposed
from pinarm.mechanics.geometry.vectors import Axes, joined, moved, rotation_vector
from pinarm.mechanics.joints import METRE, RADIAN, Joint, frames_of
from pinarm.records import AbstractRecord, Record

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.frame_pairs import FramePairs, RelativeMotion

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""The components of a deflection: displacements along the axes, then those of the rotation vector."""

NEAR = math.radians(5.0)
"""Largest distance to ``REACH`` of the last state of a motion that ends there, unless its steps are coarse [rad]."""

SEMIDEFINITE = 1e-9
"""Negative eigenvalue that rounding of typed digits explains, of a matrix scaled to a diagonal of ones."""


REACH = math.radians(170.0)
"""Largest rotation of one frame in the other [rad]: at half a turn the shortest way back changes sides."""

TINY = 1e-300
"""Angle that stands for 0 where one is divided by it [rad]."""


class Deflection(Record, frozen=True):
    """Where frame 2 is in frame 1, in n states, seen from the axes halfway between them; all vectors of shape (3, n).

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

    d: Array
    phi: Array
    axis: Array
    sine: Array
    cosine: Array
    scale: Array

    @classmethod
    def of(cls, p: Array, axes: Axes) -> Deflection:
        """Return the deflections of n placements; NaN beyond ``REACH``.

        Args:
            p: Origin of frame 2 [m], axes of frame 1, shape (3, n) or (3, 1).
            axes: Axes of frame 2 in those of frame 1, each of shape (3, n) or (3, 1).
        """
        places, phi = np.broadcast_arrays(p, rotation_vector(axes))
        theta = np.sqrt((phi * phi).sum(axis=0))
        half = np.where(theta > REACH, math.nan, 0.5 * np.where(theta == 0.0, TINY, theta))
        axis, sine, cosine = 0.5 / half * phi, np.sin(half), np.cos(half)
        return cls(_turned(places, axis, -sine, cosine), phi, axis, sine, cosine, half / sine)

    @property
    def both(self) -> Array:
        """Return d and phi, shape (6, n)."""
        return np.concatenate([self.d, self.phi])

    def rate(self, dp: Array, w: Array) -> Array:
        """Return d' [m/s] and phi' [rad/s], shape (6, n), from p' and w in the axes of frame 1."""
        dp, w = (_turned(x, self.axis, -self.sine, self.cosine) for x in (dp, w))
        halfway = 0.5 * (w - self._lag * _cross(self.axis, w))
        return np.concatenate([dp + _cross(self.d, halfway), self._mapped(w)])

    def wrench(self, f: Array, m: Array) -> tuple[Array, Array]:
        """Return the force on frame 2 and the moment at its origin, in the axes of frame 1: the transpose of ``rate``.

        Their power is ``f . d' + m . phi'``. In halfway axes the force is f, and with ``g = d x f`` the moment is
        ``c m + (1 - c) u (u . m) - (g - tan(theta / 4) g x u) / 2``.
        """
        g = _cross(self.d, f)
        moment = self._mapped(m) - 0.5 * (g - self._lag * _cross(g, self.axis))
        return _turned(f, self.axis, self.sine, self.cosine), _turned(moment, self.axis, self.sine, self.cosine)

    @property
    def _lag(self) -> Array:
        """tan(theta / 4)."""
        return self.sine / (1.0 + self.cosine)

    def _mapped(self, w: Array) -> Array:
        """Return ``c w + (1 - c) u (u . w)``: a symmetric map."""
        return np.asarray(self.scale * w + (1.0 - self.scale) * (self.axis * w).sum(axis=0) * self.axis)


def _cross(a: Array, b: Array) -> Array:
    return np.cross(a, b, axis=0)


def _turned(a: Array, axis: Array, sine: Array, cosine: Array) -> Array:
    """Return vectors turned about an axis (Rodrigues)."""
    return np.asarray(cosine * a + sine * _cross(axis, a) + (1.0 - cosine) * (axis * a).sum(axis=0) * axis)


class LinearBushing(AbstractRecord, ForceElement, frozen=True):
    """Stiffness and damping between two frames, which coincide where it is free.

    With the deflection ``x = [d; phi]`` (see ``Deflection``) the potential energy is ``x^T K x / 2``, the dissipated
    power ``x'^T D x'``, and the load exactly that of ``-K x - D x'`` on x, at any rotation up to ``REACH``. Beyond it
    nothing is a number: a motion that goes there ends. For small x the wrench on frame 2 is ``-K x - D x'``, and K the
    stiffness matrix of linear elasticity. What acts on the two links is opposite, and the same whichever comes first.

    Attributes:
        frames: Indices of the two frames, on different bodies.
        stiffness: K, symmetric [N/m, N/rad, N*m/rad], shape (6, 6).
        damping: D, symmetric [N*s/m, N*s/rad, N*m*s/rad], shape (6, 6).
    """

    unshown = ("model",)

    model: pin.Model
    frames: tuple[int, int]
    stiffness: Array
    damping: Array

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        motion, apart = self._apart(q)
        force, moment = self._pull(motion, apart, v)
        efforts = motion.efforts(force[:, None], moment[:, None])[:, 0].T
        tau[..., self.frame_pair.velocities[:, 0]] += efforts.reshape(*q.shape[:-1], -1)

    def _apart(self, q: Array) -> tuple[RelativeMotion, Deflection]:
        motion = self.frame_pair.at_configurations(_rows(q))
        return motion, Deflection.of(*motion.flat)

    def _rates(self, motion: RelativeMotion, apart: Deflection, v: Array) -> Array:
        """Return d' and phi' [m/s, rad/s], shape (6, n)."""
        dp, w, _, _ = (part[:, 0] for part in motion.rates(_rows(v).T))
        return apart.rate(dp, w)

    def _pull(self, motion: RelativeMotion, apart: Deflection, v: Array) -> tuple[Array, Array]:
        """Return force and moment on frame 2 at its origin [N, N*m], axes of frame 1, shape (3, n) each."""
        pull = self.stiffness @ apart.both
        if not self.conservative:
            pull = pull + self.damping @ self._rates(motion, apart, v)
        return apart.wrench(-pull[:3], -pull[3:])

    def potential_energy(self, q: Array) -> Array:
        x = self._apart(q)[1].both
        return np.asarray(0.5 * (x * (self.stiffness @ x)).sum(axis=0)).reshape(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        if self.conservative:
            return np.zeros(q.shape[:-1])
        x = self._rates(*self._apart(q), v)
        return np.asarray((x * (self.damping @ x)).sum(axis=0)).reshape(q.shape[:-1])

    @cached_property
    def conservative(self) -> bool:
        return not self.damping.any()

    @property
    def points(self) -> tuple[int, ...]:
        return self.frames

    def wrenches(self, links: LinkPlacements, t: Array, v: Array) -> dict[int, Array]:
        vectors = self._in_world(links, v)
        acting = joined(vectors["force"], vectors["moment"])
        return opposed(self.model, *self.frames, moved(acting, links.frame(self.frames[1])[1]))

    def _in_world(self, links: LinkPlacements, v: Array) -> dict[str, Array]:
        """Return displacement, rotation, force and moment in n states, world axes, shape (n, 3) each."""
        motion, apart = self._apart(links.q)
        force, moment = self._pull(motion, apart, v)
        inner = {"displacement": motion.p[:, 0], "rotation": apart.phi, "force": force, "moment": moment}
        turn = links.frame(self.frames[0])[0]
        return {name: np.matvec(turn, np.broadcast_to(part, (3, len(v))).T) for name, part in inner.items()}

    def refusal(self, q: Array) -> str:
        theta = float(np.linalg.norm(rotation_vector(self.frame_pair.at_configurations(q[None]).flat[1])))
        if theta < REACH - NEAR:
            return ""
        turned, most = (f"{math.degrees(angle):.4g} deg" for angle in (theta, REACH))
        return f"its frames {self.between} are turned by {turned} to one another, and a bushing acts up to {most}"

    def turned_between(self, q: Array) -> PairCoordinate | None:
        """Return part of the rotation of frame 2 in frame 1, unless they turn by less than from ``REACH`` to beyond it.

        Then a row at which there is no load stands between those on either side of half a turn.
        """
        if self.model.nq > self.model.nv:
            turns = np.moveaxis(self.frame_pair.at_configurations(q).turn[:, :, 0], 2, 0)
            way = np.array([np.linalg.norm(pin.log3(a.T @ b)) for a, b in pairwise(turns)])
        else:
            between = self.frame_pair.velocities[:, 0]
            turning = between[self.frame_pair.tree.subspace[3:, between].any(axis=0)]
            way = np.abs(np.diff(q[:, turning], axis=0)).sum(axis=1)
        if way.max(initial=0.0) < 2.0 * (math.pi - REACH):
            return None
        return rotation(self.frames[1], 0, self.frames[0])

    def measures(self) -> Mapping[str, ElementQuantity]:
        """Return the deflection of frame 2 from frame 1 and the load of the first link on the second, in world axes.

        ``displacement`` of the second origin from the first, ``rotation`` vector of the second frame in the first,
        ``force`` and ``moment`` at the origin of the second frame.
        """
        units = {"displacement": METRE, "rotation": RADIAN, "force": unit("N"), "moment": unit("N*m")}

        def values(name: str, t: Array, q: Array, v: Array) -> Array:
            return self._in_world(LinkPlacements.at(self.model, q), v)[name]

        return {name: ElementQuantity(each, partial(values, name), vector=True) for name, each in units.items()}

    @property
    def description(self) -> str:
        return f"bushing between {self.between}"

    @property
    def between(self) -> str:
        return " and ".join(self.model.frames[frame].name for frame in self.frames)

    @cached_property
    def frame_pair(self) -> FramePairs:
        from pinarm.mechanics.geometry.frame_pairs import FramePairs  # for many states only

        return FramePairs.between(self.model, *self.frames)


def _rows(values: Array) -> Array:
    return values.reshape(-1, values.shape[-1])


class SpringRates(InputStruct, frozen=True):
    """The stiffness of a bushing: a symmetric matrix of six rows.

    Attributes:
        translation: Force per displacement along x, y, z [N/m].
        rotation: Moment per angle about x, y, z [N*m/rad].
        coupling: Entries beside the diagonal, named by two of x, y, z, rx, ry, rz in this order, such as ``{y_rz: -6
            kN/rad}``.
    """

    translation: tuple[Stiffness, Stiffness, Stiffness] = (0.0, 0.0, 0.0)
    rotation: tuple[RotationStiffness, RotationStiffness, RotationStiffness] = (0.0, 0.0, 0.0)
    coupling: dict[str, AnyQuantity] = {}

    def check(self) -> None:
        _matrix(self, DIMENSIONLESS)


class DampingRates(InputStruct, frozen=True):
    """The damping of a bushing: a symmetric matrix of six rows.

    Attributes:
        translation: Force per velocity along x, y, z [N*s/m].
        rotation: Moment per angular velocity about x, y, z [N*m*s/rad].
        coupling: Entries beside the diagonal, named by two of x, y, z, rx, ry, rz in this order, such as ``{y_rz: 2
            N*s/rad}``.
    """

    translation: tuple[Damping, Damping, Damping] = (0.0, 0.0, 0.0)
    rotation: tuple[RotationDamping, RotationDamping, RotationDamping] = (0.0, 0.0, 0.0)
    coupling: dict[str, AnyQuantity] = {}

    def check(self) -> None:
        _matrix(self, unit("s"))


class Bushing(InputStruct, frozen=True, tag_field="kind", tag="bushing"):
    """Stiffness and damping in six directions between the frames of two links, free where they coincide.

    With the axes halfway between the two frames, d the displacement of the second from the first along them, and phi
    the rotation vector of the second in the first, the force and moment on the second are those of the potential energy
    ``x^T K x / 2`` of ``x = [d; phi]``, and of ``D x'``: -K x - D x' where x is small. Angles stay below 170 deg.

    Attributes:
        between: The two links; their frames coincide where the bushing is free.
        stiffness: K, of three displacements and three rotations.
        damping: D, likewise.
    """

    between: tuple[str, str]
    stiffness: SpringRates = msgspec.field(default_factory=SpringRates)
    damping: DampingRates = msgspec.field(default_factory=DampingRates)

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        first, second = frames_of(model, self.between)
        if model.frames[first].parentJoint == model.frames[second].parentJoint:
            with within("between"):
                raise InputError(
                    f"{' and '.join(self.between)} are on one body: nothing moves between them",
                    expected="links with a joint between them",
                )
        stiffness, damping = _matrix(self.stiffness, DIMENSIONLESS), _matrix(self.damping, unit("s"))
        return LinearBushing(model, (first, second), stiffness, damping)


def _matrix(rates: SpringRates | DampingRates, time: Unit) -> Array:
    """Return the matrix of a bushing, shape (6, 6)."""
    matrix = np.diag([*rates.translation, *rates.rotation])
    places = {f"{DIRECTIONS[i]}_{DIRECTIONS[j]}": (i, j) for i, j in combinations(range(6), 2)}
    for name, value in rates.coupling.items():
        with within("coupling", Key(name)):
            if name not in places:
                expected, hint = choices(name, places)
                raise InputError(f"a bushing has no entry '{name}'", expected=expected, hint=hint)
        i, j = places[name]
        with within("coupling", name):
            check_unit(value, unit(("N/m", "N/rad", "N*m/rad")[(i > 2) + (j > 2)]) * time)
        matrix[i, j] = matrix[j, i] = value
    _require_no_source(matrix)
    return matrix


def _require_no_source(matrix: Array) -> None:
    size = np.sqrt(np.diag(matrix))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    if values[0] < -SEMIDEFINITE:
        worst = [name for name, x in zip(DIRECTIONS, vectors[:, 0], strict=True) if abs(x) > 0.1]
        with within("coupling"):
            raise InputError(
                f"in {', '.join(worst)} together the matrix is negative: the bushing would give energy away",
                expected="a matrix without negative eigenvalues: of two directions, an entry whose square is at most "
                "the product of their own",
                hint="all digits of a computed matrix",
            )

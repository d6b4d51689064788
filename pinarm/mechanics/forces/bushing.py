"""Bushings: linear stiffness and damping, in translation and rotation, between the frames of two links."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property, partial
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Generic, TypeVar

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
from pinarm.mechanics.forces.along_coordinate import NONE, Coordinates
from pinarm.mechanics.forces.force_element import ElementQuantity, ForceElement
from pinarm.mechanics.geometry.kinematics import new_data
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
    """

    d: Vector[Number]
    phi: Vector[Number]
    axis: Vector[Number]
    sine: Number
    cosine: Number
    scale: Number

    @classmethod
    def one(cls, placement: pin.SE3) -> Deflection[float]:
        """Return the deflection of a placement of frame 2 in frame 1; NaN beyond ``REACH``."""
        x, y, z = pin.log3(placement.rotation).tolist()
        theta = math.sqrt(x * x + y * y + z * z)
        half = 0.5 * (theta or TINY) if theta <= REACH else math.nan
        p: Vector[float] = tuple(placement.translation.tolist())
        return Deflection._of(p, (x, y, z), half, math.sin(half), math.cos(half))

    @classmethod
    def many(cls, p: Array, axes: Axes) -> Deflection[Array]:
        """Return the deflections of n placements; NaN beyond ``REACH``.

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
    return a * x[0] + b * y[0], a * x[1] + b * y[1], a * x[2] + b * y[2]


def _turned(a: Vector[Number], axis: Vector[Number], sine: Number, cosine: Number) -> Vector[Number]:
    """Return a vector turned about an axis (Rodrigues)."""
    across = _sum(cosine, a, sine, _cross(axis, a))
    return _sum(1.0, across, (1.0 - cosine) * _dot(axis, a), axis)


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

    unshown = ("model", "data")

    model: pin.Model
    frames: tuple[int, int]
    stiffness: Array
    damping: Array
    data: pin.Data

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``: that of the wrench on frame 2 on its twist in frame 1."""
        if q.ndim == 1 and np.isrealobj(q):
            placement, jacobian = self._relative(q)
            wrench = self._wrench(placement, jacobian, v).reshape(2, 3)
            tau += wrench.dot(placement.rotation).ravel().dot(jacobian)
            return
        motion, apart = self._apart(_rows(q))
        force, moment = self._pull(motion, apart, _rows(v))
        efforts = motion.efforts(force[:, None], moment[:, None])[:, 0].T
        tau[..., self.frame_pair.velocities[:, 0]] += efforts.reshape(*q.shape[:-1], -1)

    def _apart(self, q: Array) -> tuple[RelativeMotion, Deflection[Array]]:
        motion = self.frame_pair.at_configurations(q)
        return motion, Deflection.many(*motion.flat)

    def _rates(self, motion: RelativeMotion, apart: Deflection[Array], v: Array) -> Array:
        """Return d' and phi' [m/s, rad/s], shape (6, n)."""
        dp, w, _, _ = (part[:, 0] for part in motion.rates(v.T))
        return np.concatenate(apart.rate(tuple(dp), tuple(w)))

    def _pull(self, motion: RelativeMotion, apart: Deflection[Array], v: Array) -> tuple[Array, Array]:
        """Return force and moment on frame 2 at its origin [N, N*m], axes of frame 1, shape (3, n) each."""
        pull = self.stiffness @ np.array([*apart.d, *apart.phi])
        if self._damped:
            pull = pull + self.damping @ self._rates(motion, apart, v)
        force, moment = apart.wrench(tuple(-pull[:3]), tuple(-pull[3:]))
        return np.array(force), np.array(moment)

    def potential_energy(self, q: Array) -> Array:
        _, apart = self._apart(_rows(q))
        x = np.array([*apart.d, *apart.phi])
        return np.asarray(0.5 * (x * (self.stiffness @ x)).sum(axis=0)).reshape(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        if not self._damped:
            return np.zeros(q.shape[:-1])
        x = self._rates(*self._apart(_rows(q)), _rows(v))
        return np.asarray((x * (self.damping @ x)).sum(axis=0)).reshape(q.shape[:-1])

    @property
    def conservative(self) -> bool:
        return not self._damped

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
        inner = {"displacement": motion.p[:, 0], "rotation": np.array(apart.phi), "force": force, "moment": moment}
        turn = links.frame(self.frames[0])[0]
        return {name: np.matvec(turn, np.broadcast_to(part, (3, len(v))).T) for name, part in inner.items()}

    def refusal(self, q: Array) -> str:
        """Return why it has no load: the frames are turned too far; empty where it has one."""
        theta = float(np.linalg.norm(pin.log3(self._relative(q)[0].rotation)))
        if theta < REACH - NEAR:
            return ""
        turned, most = (f"{math.degrees(angle):.4g} deg" for angle in (theta, REACH))
        return f"its frames {self.between} are turned by {turned} to one another, and a bushing acts up to {most}"

    def turned_between(self, q: Array) -> PairCoordinate | None:
        """Return part of the rotation of frame 2 in frame 1, unless they turn by less than from ``REACH`` to beyond it.

        Then a row at which there is no load stands between those on either side of half a turn.
        """
        if self.model.nq > self.model.nv:
            turns = [self._relative(state)[0].rotation for state in q]
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

    @cached_property
    def _damped(self) -> bool:
        return bool(self.damping.any())

    def _relative(self, q: Array) -> tuple[pin.SE3, Array]:
        """Return the placement of frame 2 in frame 1, and the Jacobian of its twist there, in axes of frame 2."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        first, second = (pin.updateFramePlacement(model, data, frame) for frame in self.frames)
        own, other = (pin.getFrameJacobian(model, data, frame, pin.LOCAL).reshape(6, -1) for frame in self.frames)
        placement = first.actInv(second)
        return placement, other - placement.toActionMatrixInverse().dot(own)

    def _wrench(self, placement: pin.SE3, jacobian: Array, v: Array) -> Array:
        """Return [f; m] on frame 2 at its origin [N, N*m], axes of frame 1, shape (6,)."""
        apart = Deflection.one(placement)
        pull = self.stiffness.dot([*apart.d, *apart.phi])
        if self._damped:
            pull += self.damping.dot(_rate(apart, placement, jacobian, v))
        fx, fy, fz, mx, my, mz = (-pull).tolist()
        force, moment = apart.wrench((fx, fy, fz), (mx, my, mz))
        return np.array([*force, *moment])


def _rate(apart: Deflection[float], placement: pin.SE3, jacobian: Array, v: Array) -> Array:
    """Return d' and phi' [m/s, rad/s], shape (6,); the Jacobian is that of the twist in the axes of frame 2."""
    dp, w = jacobian.dot(v).reshape(2, 3).dot(placement.rotation.T).tolist()
    rates = apart.rate(tuple(dp), tuple(w))
    return np.array([*rates[0], *rates[1]])


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

    def bind(self, model: pin.Model, joints: Mapping[str, Joint], coordinates: Coordinates = NONE) -> ForceElement:
        first, second = frames_of(model, self.between)
        if model.frames[first].parentJoint == model.frames[second].parentJoint:
            with within("between"):
                raise InputError(
                    f"{' and '.join(self.between)} are on one body: nothing moves between them",
                    expected="links with a joint between them",
                )
        stiffness, damping = _matrix(self.stiffness, DIMENSIONLESS), _matrix(self.damping, unit("s"))
        return LinearBushing(model, (first, second), stiffness, damping, new_data(model))


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

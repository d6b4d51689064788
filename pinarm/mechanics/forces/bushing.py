"""Bushings: linear stiffness and damping, in translation and rotation, between the frames of two links."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property, partial
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices, vecmat
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
from pinarm.mechanics.geometry.vectors import joined, moved, rotation_vector
from pinarm.mechanics.joints import METRE, RADIAN, Joint, frames_of
from pinarm.records import AbstractRecord, Record

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.frame_pairs import FramePairs

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
    """Where frame 2 is in frame 1, seen from the axes halfway between them.

    With the rotation ``R = exp([phi])`` of frame 2 in frame 1 and the place p of its origin, the halfway axes are those
    of frame 1 turned by ``H = exp([phi / 2])``, and ``d = H^T p``; phi has the same components in all three. Which
    frame comes first changes the signs of d and phi, and nothing else.

    A relative angular velocity w, in halfway axes, gives ``phi' = c w + (1 - c) u (u . w)`` with the axis u of phi, its
    angle theta and ``c = (theta / 2) / sin(theta / 2)``, as w is the integral of ``exp([s phi]) phi'`` over s from -1/2
    to 1/2. Over s from 0 to 1/2 it gives the angular velocity of the halfway axes in frame 1,
    ``(w - tan(theta / 4) u x w) / 2``.

    Attributes:
        x: Displacement d [m] and rotation vector phi [rad], shape (..., 6); NaN beyond ``REACH``.
        slope: From p' and w in the axes of frame 1 to d' and phi', shape (..., 6, 6).
    """

    x: Array
    slope: Array

    @classmethod
    def of(cls, p: Array, phi: Array) -> Deflection:
        """Return the deflection of places [m] and rotation vectors [rad] of frame 2 in frame 1, shape (..., 3)."""
        theta = np.sqrt((phi * phi).sum(axis=-1, keepdims=True))
        half = np.where(theta > REACH, math.nan, 0.5 * np.where(theta == 0.0, TINY, theta))
        u, half = _skew(0.5 * phi / half), half[..., None]
        sine, cosine, square = np.sin(half), np.cos(half), u @ u
        back = IDENTITY - sine * u + (1.0 - cosine) * square
        d = np.matvec(back, p)
        slope = np.zeros((*d.shape[:-1], 6, 6), d.dtype)
        slope[..., :3, :3] = back
        slope[..., :3, 3:] = _skew(0.5 * d) @ (back - sine / (1.0 + cosine) * (u @ back))
        slope[..., 3:, 3:] = back + (1.0 - half / sine) * (square @ back)
        return cls(np.concatenate([d, phi], axis=-1), slope)


IDENTITY, CROSS = np.eye(3), np.cross(np.eye(3)[:, None], -np.eye(3)).reshape(3, 9)
"""The unit matrix, and the products of unit vectors."""


def _skew(a: Array) -> Array:
    """Return ``[a]x``, shapes (..., 3) and (..., 3, 3)."""
    return (a @ CROSS).reshape(*a.shape, 3)


class Between(NamedTuple):
    """Frame 2 in frame 1, in one state or in n of them.

    Attributes:
        apart: The deflection.
        twists: Velocity of frame 2's origin and its angular velocity for unit velocities, axes of frame 1, (..., 6, k).
        moved: Indices in v of these velocities.
    """

    apart: Deflection
    twists: Array
    moved: Indices | slice


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
        between = self._relative(q)
        tau[..., between.moved] += vecmat(self._wrench(between, v), between.twists)

    def _relative(self, q: Array) -> Between:
        if q.ndim == 1 and np.isrealobj(q):
            return self._of_one(q)
        motion = self.frame_pair.at_configurations(q.reshape(-1, q.shape[-1]))
        p, axes = motion.flat
        places, turned = (part.T.reshape(*q.shape[:-1], 3) for part in (p, rotation_vector(axes)))
        twists = np.concatenate([motion.linear, motion.angular])[:, :, 0].transpose(2, 0, 1)
        moved = self.frame_pair.velocities[:, 0]
        return Between(Deflection.of(places, turned), twists.reshape(*q.shape[:-1], 6, -1), moved)

    def _of_one(self, q: Array) -> Between:
        """Return frame 2 in frame 1 in one real state by Pinocchio, in a tenth of the time that many take."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        first, second = (pin.updateFramePlacement(model, data, frame) for frame in self.frames)
        own, other = (pin.getFrameJacobian(model, data, frame, pin.LOCAL).reshape(6, -1) for frame in self.frames)
        placement = first.actInv(second)
        turn = placement.rotation
        twists = other - placement.toActionMatrixInverse().dot(own)  # in axes of frame 2
        twists = np.matmul(turn, twists.reshape(2, 3, -1)).reshape(6, -1)
        return Between(Deflection.of(placement.translation, pin.log3(turn)), twists, slice(None))

    def _rates(self, between: Between, v: Array) -> Array:
        """Return d' and phi' [m/s, rad/s], shape (..., 6)."""
        return np.asarray(np.matvec(between.apart.slope, np.matvec(between.twists, v[..., between.moved])))

    def _wrench(self, between: Between, v: Array) -> Array:
        """Return [f; m] on frame 2 at its origin [N, N*m], axes of frame 1, shape (..., 6)."""
        pull = between.apart.x @ self.stiffness
        if self._damped:
            pull = pull + self._rates(between, v) @ self.damping
        return np.asarray(-vecmat(pull, between.apart.slope))

    def potential_energy(self, q: Array) -> Array:
        x = self._relative(q).apart.x
        return np.asarray(0.5 * (x * (x @ self.stiffness)).sum(axis=-1))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        if not self._damped:
            return np.zeros(q.shape[:-1])
        rates = self._rates(self._relative(q), v)
        return np.asarray((rates * (rates @ self.damping)).sum(axis=-1))

    @property
    def conservative(self) -> bool:
        return not self._damped

    @property
    def points(self) -> tuple[int, ...]:
        return self.frames

    def wrenches(self, links: LinkPlacements, t: Array, v: Array) -> dict[int, Array]:
        acting = self._in_world(links, self._wrench(self._relative(links.q), v))
        return opposed(self.model, *self.frames, moved(acting, links.frame(self.frames[1])[1]))

    def _in_world(self, links: LinkPlacements, vectors: Array) -> Array:
        """Return pairs of vectors in the axes of frame 1 in world axes, shape (n, 6)."""
        turn = links.frame(self.frames[0])[0]
        return joined(*(np.matvec(turn, part) for part in np.split(vectors, 2, axis=-1)))

    def refusal(self, q: Array) -> str:
        """Return why it has no load: the frames are turned too far; empty where it has one."""
        first, second = (LinkPlacements.at(self.model, q[None]).frame(frame)[0][0] for frame in self.frames)
        theta = float(np.linalg.norm(pin.log3(first.T @ second)))
        if theta < REACH - NEAR:
            return ""
        turned, most = (f"{math.degrees(angle):.4g} deg" for angle in (theta, REACH))
        return f"its frames {self.between} are turned by {turned} to one another, and a bushing acts up to {most}"

    def turned_between(self, q: Array) -> PairCoordinate | None:
        """Return part of the rotation of frame 2 in frame 1, unless they turn by less than from ``REACH`` to beyond it.

        Then a row at which there is no load stands between those on either side of half a turn.
        """
        between = self.frame_pair.velocities[:, 0]
        turning = between[self.frame_pair.tree.subspace[3:, between].any(axis=0)]
        ways = (np.abs(pin.difference(self.model, *rows)[turning]).sum() for rows in pairwise(q))
        return (
            rotation(self.frames[1], 0, self.frames[0]) if max(ways, default=0.0) >= 2.0 * (math.pi - REACH) else None
        )

    def measures(self) -> Mapping[str, ElementQuantity]:
        """Return the deflection of frame 2 from frame 1 and the load of the first link on the second, in world axes.

        ``displacement`` of the second origin from the first, ``rotation`` vector of the second frame in the first,
        ``force`` and ``moment`` at the origin of the second frame.
        """
        units = {"displacement": METRE, "rotation": RADIAN, "force": unit("N"), "moment": unit("N*m")}

        def values(name: str, t: Array, q: Array, v: Array) -> Array:
            links, between = LinkPlacements.at(self.model, q), self._relative(q)
            if name in ("force", "moment"):
                vectors = self._in_world(links, self._wrench(between, v))
            else:
                first, second = (links.frame(frame)[1] for frame in self.frames)
                turned = np.matvec(links.frame(self.frames[0])[0], between.apart.x[..., 3:])
                vectors = joined(second - first, turned)
            return vectors[..., :3] if name in ("displacement", "force") else vectors[..., 3:]

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

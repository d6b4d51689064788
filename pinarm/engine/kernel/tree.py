"""Trees in the compiled library under springs, dampers and efforts, which are steady or follow laws."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.kernel.library import (
    DEGREE,
    DEGREE_STATE,
    LAW,
    LAW_NUMBERS,
    LAW_TERMS,
    LINK,
    LINK_STATE,
    POINT_SPRING,
    ROTATION_SPRING,
    SCREW,
    Flow,
    FlowStructure,
    HeldEfforts,
    TreeStructure,
    address,
    finite,
    library,
    pointer,
)
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.laws.interpolated import ClampedSpline
from pinarm.mechanics.laws.motion_law import PowerSeries, Values, Wave
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pinarm.mechanics.forces.joint_forces import SpringDamper
    from pinarm.mechanics.forces.points import TwoPointSpring

UNIAXIAL, CONTINUOUS, BALL, FLOATING, PLANAR, TRANSLATION = range(6)
"""Kinds of joints, see ``joints.h``."""

KINDS = {
    "RX": UNIAXIAL, "RY": UNIAXIAL, "RZ": UNIAXIAL, "RevoluteUnaligned": UNIAXIAL,
    "PX": UNIAXIAL, "PY": UNIAXIAL, "PZ": UNIAXIAL, "PrismaticUnaligned": UNIAXIAL,
    "HX": UNIAXIAL, "HY": UNIAXIAL, "HZ": UNIAXIAL, "HelicalUnaligned": UNIAXIAL,
    "RUBX": CONTINUOUS, "RUBY": CONTINUOUS, "RUBZ": CONTINUOUS, "RevoluteUnboundedUnaligned": CONTINUOUS,
    "Spherical": BALL, "FreeFlyer": FLOATING, "Planar": PLANAR, "Translation": TRANSLATION,
}  # fmt: skip
"""Pinocchio's name of a joint, without ``JointModel`` -> its kind."""

SYMMETRIC = np.array([4, 5, 7, 5, 6, 8, 7, 8, 9])
"""Places of a symmetric matrix's entries in Pinocchio's parameters of a body, where xx, xy, yy, xz, yz, zz are last."""

Screw = tuple[int, float, float]
"""Axis, slide and turn of a velocity: see ``library.SCREW``."""


def _frame(model: pin.Model, joint: pin.JointModel) -> tuple[int, list[Screw], Array] | None:
    """Return the kind of a joint, the screws of its velocities, and the axes of its link's frame in Pinocchio's."""
    kind = KINDS.get(joint.shortname().removeprefix("JointModel"))
    if kind is None:
        return None
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    linear, angular = np.reshape(data.S, (2, 3, joint.nv)).swapaxes(1, 2)
    if joint.nv > 1:  # each along, or about, an axis of the link
        places = np.abs(linear + angular).argmax(axis=1).tolist()
        return kind, [(k, float(x[k]), float(y[k])) for k, x, y in zip(places, linear, angular, strict=True)], np.eye(3)
    turns = bool(angular.any())
    axis = (angular if turns else linear)[0]
    axis = axis / np.linalg.norm(axis)
    slide = float(linear[0] @ axis) if turns else 1.0
    return kind, [(2, slide, float(turns))], _with_z_along(axis)


def _with_z_along(axis: Array) -> Array:
    """Return a rotation whose last column is a unit vector, shape (3, 3)."""
    x = np.cross(np.eye(3)[(int(np.abs(axis).argmax()) + 1) % 3], axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


EFFORT = -1
"""Place in q of what is no coordinate."""


class Followed(NamedTuple):
    """An effort or a coordinate that follows a law.

    Attributes:
        q: Index in q of the coordinate, whose joint's armature outweighs the tree; ``EFFORT`` where an effort does.
        function: The smooth piece of the law on the present interval.
    """

    v: int
    q: int
    function: Callable[[Array], Values] | None


def laws_of(followed: Sequence[Followed], steady: Array) -> NDArray[np.void] | None:
    """Return laws for the library, shape (k,), of ``library.LAW``: of a spline one for each of its cubics.

    ``steady`` is the sum of the steady loads [N*m or N], shape (nv,). It is ``None`` where a law is of no known kind on
    the interval, or where two have one velocity.
    """
    parts: list[NDArray[np.void]] = [np.zeros(0, LAW)]
    for law in followed:
        if (part := _laws(law.function)) is None:
            return None
        part["v"], part["q"], part["steady"] = law.v, law.q, steady[law.v]
        parts.append(part)
    return np.concatenate(parts) if len({law.v for law in followed}) == len(followed) else None


def _laws(function: Callable[[Array], Values] | None) -> NDArray[np.void] | None:
    """Return the laws of a function on its intervals, of ``LAW``, shape (k,); ``None`` for functions of other kinds."""
    laws = np.zeros(function.coefficients.shape[1] if isinstance(function, ClampedSpline) else 1, LAW)
    laws["from"], laws["until"] = -np.inf, np.inf
    if isinstance(function, ClampedSpline):  # its first and last cubic have no end
        laws["from"][1:] = laws["until"][:-1] = function.knots[1:-1]
        laws["origin"], laws["size"], laws["unit"] = function.knots[:-1], 1.0, 1.0
        laws["coefficients"][:, :4] = function.coefficients.T
        return laws
    numbers, coefficients = LAW_NUMBERS.split(), tuple[float, ...]()
    if isinstance(function, Wave) and function.rate > 0.0:
        wave = function.start, function.size, function.begin, 1.0 / function.rate, 1.0, function.phase
        laws[numbers], coefficients = wave, (0.0, function.slope)
    elif isinstance(function, PowerSeries) and len(function.coefficients) <= LAW_TERMS:
        laws[numbers] = function.start, function.size, function.origin, function.unit, 0.0, 0.0
        coefficients = function.coefficients
    else:
        return None
    laws["coefficients"][:, : len(coefficients)] = coefficients
    return laws


NO_FLOOR = np.zeros(1)
"""The smallest useful step of trees [s]."""

DEGREES, WORLD = 1, 5
"""Places among the arrays of a loaded tree: of the velocities, with what acts along each, and of the links' buffers,
the world's first."""


class LoadedTree(Record, frozen=True):
    """A tree with its loads, for the library."""

    structure: TreeStructure
    arrays: tuple[NDArray[Any], ...]

    @classmethod
    def of(cls, sizes: Sequence[int], arrays: Sequence[NDArray[Any]], gravity: Array) -> LoadedTree:
        """Return the tree of the sizes and arrays that the library reads, under gravity [m/s^2], shape (3,)."""
        world = np.zeros(1, LINK_STATE)
        world["rotation"], world["acceleration"][:, :3] = np.eye(3), -gravity
        return cls(TreeStructure(*sizes, *map(pointer, arrays)), (*arrays, world)).with_unknowns(sizes[2])

    def with_unknowns(self, count: int) -> LoadedTree:
        """Return the tree with buffers of its own, for velocities and the multipliers behind them."""
        structure, (*known, links) = TreeStructure.from_buffer_copy(self.structure), self.arrays[: WORLD + 1]
        links = np.concatenate([links[:1], np.zeros(structure.links, LINK_STATE)])
        unknowns = np.zeros(count, DEGREE_STATE), np.zeros(count)
        structure.link_state = pointer(links) + LINK_STATE.itemsize
        structure.degree_state, structure.tau = map(pointer, unknowns)
        return LoadedTree(structure, (*known, links, *unknowns))

    def flow(self, held: HeldEfforts | None = None) -> Flow:
        """Return the free motion of the tree under its loads."""
        compiled = library()
        assert compiled is not None
        size, place = self.structure.nq + self.structure.nv, ctypes.addressof(self.structure)
        structure = FlowStructure(size, address(compiled.tree_rates), None, pointer(NO_FLOOR), place)
        return Flow(structure, self, held)


class CompiledTree(Record, frozen=True):
    """A tree as the library knows it.

    Attributes:
        links: Its links, shape (njoints - 1,), of ``library.LINK``.
        screws: The screw of each velocity, shape (nv,), of ``library.SCREW``.
        axes: Axes of the frames of the world and of the links in Pinocchio's, as columns, shape (njoints, 3, 3).
    """

    model: pin.Model
    links: NDArray[np.void]
    screws: NDArray[np.void]
    axes: Array

    @classmethod
    def of(cls, model: pin.Model) -> CompiledTree | None:
        """Return the tree of a model; ``None`` where there is no library, or it does not know a joint of the model."""
        return links_of(model) if library() is not None and model.nv else None

    def under(
        self, steady: Array, changing: Sequence[ForceElement], guided: Sequence[Followed] = ()
    ) -> tuple[LoadedTree, HeldEfforts | None] | None:
        """Return the tree with its loads, and a load that is held between samples, if any; see ``loaded``."""
        held = [load for force in changing if (load := force.held) is not None]
        tree = self.loaded(steady, [force for force in changing if force.held is None], guided)
        if tree is None or len(held) > 1 or (held and tree.structure.laws):
            return None
        return tree, HeldEfforts(held[0], steady, tree.arrays[DEGREES]["effort"]) if held else None

    def loaded(
        self, steady: Array, changing: Sequence[ForceElement], guided: Sequence[Followed] = ()
    ) -> LoadedTree | None:
        """Return the tree with its loads; ``None`` where the library does not know one of them, or a number is none.

        Args:
            steady: The sum of the steady loads [N*m or N], shape (nv,).
            changing: The other force elements.
            guided: Coordinates that follow laws, whose joints have armatures that outweigh the tree.
        """
        from pinarm.mechanics.forces.along_coordinate import EffortAlong
        from pinarm.mechanics.forces.joint_forces import BallSpring, SpringDamper
        from pinarm.mechanics.forces.points import TwoPointSpring

        efforts = [
            Followed(force.coordinate.joint, EFFORT, force.law.function)
            for force in changing
            if isinstance(force, EffortAlong) and force.law.over_time_alone
            if isinstance(force.coordinate, LinearCoordinate) and force.coordinate.joint is not None
        ]
        springs = [force for force in changing if isinstance(force, SpringDamper)]
        balls = [(force.q, force.v, force.stiffness) for force in changing if isinstance(force, BallSpring)]
        lines = [self._between_points(force) for force in changing if isinstance(force, TwoPointSpring)]
        laws = laws_of([*guided, *efforts], steady)
        known = len(springs) + len(balls) + len(lines) + len(efforts)
        if laws is None or known < len(changing):
            return None
        model = self.model
        loads = (
            self._degrees(steady, SpringDamper.sum(springs)),
            np.array(balls, ROTATION_SPRING),
            np.array(lines, POINT_SPRING),
            laws,
        )
        if not all(map(finite, (self.links, *loads))) or not np.isfinite(model.gravity.linear).all():
            return None
        sizes = len(self.links), model.nq, model.nv, len(balls), len(lines), len(laws)
        return LoadedTree.of(sizes, (self.links.copy(), *loads), np.array(model.gravity.linear))

    def placed(self, joint: int, place: pin.SE3) -> tuple[int, Array, Array]:
        """Return the link, -1 for the world, of a frame at a joint, and its rotation and place in the link's frame."""
        axes = self.axes[joint]
        return joint - 1, axes.T @ place.rotation, axes.T @ place.translation

    def _between_points(self, spring: TwoPointSpring) -> tuple[object, ...]:
        frames = (self.model.frames[frame] for frame in spring.points)
        (first, _, begin), (second, _, end) = (self.placed(frame.parentJoint, frame.placement) for frame in frames)
        numbers = spring.stiffness, spring.damping, spring.rest, spring.force
        return (first, second), (begin, end), *numbers

    def _degrees(self, steady: Array, springs: SpringDamper) -> NDArray[np.void]:
        """Return each velocity with its rotor and what acts along it."""
        degrees = np.zeros(self.model.nv, DEGREE)
        degrees["screw"], degrees["armature"], degrees["effort"] = self.screws, self.model.armature, steady
        degrees["sprung"][springs.v], degrees["rest"][springs.v] = springs.q, springs.rest
        degrees["stiffness"][springs.v], degrees["damping"][springs.v] = springs.stiffness, springs.damping
        return degrees


def links_of(model: pin.Model) -> CompiledTree | None:
    """Return the tree of a model; ``None`` where a joint is of no known kind.

    With the axes A of a link's frame in Pinocchio's, and A_p of its parent's, placements are ``A_p^T R A`` and
    ``A_p^T r``, and of the body ``A^T m c`` and ``A^T I A``.
    """
    joints = [_frame(model, joint) for joint in model.joints.tolist()[1:]]
    frames = [frame for frame in joints if frame is not None]
    if len(frames) < len(joints):
        return None
    parents, links = np.array(model.parents.tolist())[1:], np.zeros(len(frames), LINK)
    axes = np.array([np.eye(3), *(rotation for _, _, rotation in frames)])
    placements = np.array([place.homogeneous for place in model.jointPlacements.tolist()[1:]])
    bodies = np.array([body.toDynamicParameters() for body in model.inertias.tolist()[1:]])
    links["parent"], links["kind"] = parents - 1, [kind for kind, _, _ in frames]
    links["q"], links["v"] = model.idx_qs.tolist()[1:], model.idx_vs.tolist()[1:]
    own, outwards = axes[1:], axes[parents].swapaxes(-1, -2)
    links["rotation"], links["translation"] = (
        outwards @ placements[:, :3, :3] @ own,
        np.matvec(outwards, placements[:, :3, 3]),
    )
    links["mass"], links["moment"] = bodies[:, 0], np.vecmat(bodies[:, 1:4], own)
    inertias = own.swapaxes(-1, -2) @ bodies[:, SYMMETRIC].reshape(-1, 3, 3) @ own
    links["inertia"] = inertias[:, *np.triu_indices(3)]
    return CompiledTree(model, links, np.array([screw for _, screws, _ in frames for screw in screws], SCREW), axes)

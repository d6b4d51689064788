"""Paths of points, arrows of forces, and connections of two points: springs, rods, cables and loop joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.reactions import Reactions
from pinarm.engine.series import ROUNDING
from pinarm.errors import InputError, choices
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.pinocchio_data import new_data
from pinarm.mechanics.joints import frame_of
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import ValueRecord
from pinarm.use.show.replay.tracks import Node

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint import Constraint
    from pinarm.use.show.replay.packing import Packing

ARROWS = {
    "forces": "weights and loads",
    "torques": "efforts of drives and end stops",
    "reactions": "reactions of the joints",
}
"""Kinds of arrows, and their names in the legend. Their colours are in ``overlays.js``."""


ConnectionKind = Literal["spring", "cylinder", "bushing", "rod", "cable", "loop", "slot"]


LOOPS: Mapping[str, ConnectionKind] = {"rod": "rod", "point_on_plane": "slot"}
"""Loop joints that have a mark of their own."""


class BodyPoint(ValueRecord, frozen=True):
    """A point that is fixed to a body.

    Attributes:
        node: The body.
        place: Where in it [m], shape (3,).
    """

    node: int
    place: Array

    def plain(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {"node": self.node, "point": np.asarray(self.place).tolist()}

    def path(self, places: Array) -> Array:
        """Return its positions in the world, shape (rows, 3), from placements of shape (rows, njoints, 4, 4)."""
        return np.asarray(places[:, self.node, :3, :3] @ self.place + places[:, self.node, :3, 3])


class Connection(ValueRecord, frozen=True):
    """A connection of two points.

    Attributes:
        kind: A ``spring``, a ``cylinder`` (a damper, a constant force, or a strut, which pushes), a ``bushing``, a
            ``rod``, a straight part of a ``cable``, the mark of a ``loop`` joint, or the pin in a ``slot``.
        ends: The two points.
    """

    kind: ConnectionKind
    ends: tuple[BodyPoint, BodyPoint]

    def lengths(self, places: Array) -> Array:
        """Return its lengths [m], shape (rows,), from placements of shape (rows, njoints, 4, 4)."""
        start, end = self.ends
        return np.asarray(np.linalg.norm(end.path(places) - start.path(places), axis=1))

    def plain(self, places: Array) -> dict[str, Any]:
        """Return it for JSON, with its extreme lengths."""
        (start, end), lengths = self.ends, self.lengths(places)
        extremes = {"shortest": float(lengths.min()), "longest": float(lengths.max())}
        return {"kind": self.kind, "a": start.plain(), "b": end.plain(), **extremes}


class Arrow(ValueRecord, frozen=True):
    """A force or a moment at a point, over the rows.

    Attributes:
        of: Its kind, one of ``ARROWS``.
        at: Where it acts.
        moment: Whether it is a moment: an arc, not an arrow.
        vectors: In world axes [N or N*m], shape (n, 3), or (3,) where it is constant; or along ``axis``, shape (n,).
        axis: In the body's frame; ``None`` where ``vectors`` are vectors.
        partial: Whether components are left out that rigid bodies do not determine.
    """

    of: str
    at: BodyPoint
    moment: bool
    vectors: Array
    axis: Array | None = None
    partial: bool = False

    @property
    def largest(self) -> float:
        """Its largest magnitude [N or N*m]."""
        sizes = np.abs(self.vectors) if self.axis is not None else np.linalg.norm(self.vectors, axis=-1)
        return float(np.max(sizes))

    def plain(self, packing: Packing, largest: float) -> dict[str, Any]:
        """Return it for JSON; ``largest`` is the magnitude of the longest arrow of its kind."""
        plain: dict[str, Any] = {"of": self.of, "moment": self.moment, "largest": largest, **self.at.plain()}
        if self.axis is not None:
            values = packing.add(self.vectors.astype(np.float32))
            return {**plain, "axis": self.axis.tolist(), "values": values}
        if self.vectors.ndim == 1 and not self.moment:
            return {**plain, "vector": self.vectors.tolist()}
        return {**plain, "vectors": packing.add(self.vectors.astype(np.float32))}


def point_of(model: pin.Model, frame: int) -> BodyPoint:
    """Return the origin of a frame."""
    return BodyPoint(int(model.frames[frame].parentJoint), np.array(model.frames[frame].placement.translation))


def traced(model: pin.Model, name: str) -> list[tuple[BodyPoint, float]]:
    """Return the points, with their weights, whose mean is traced: the origin of a link, or all masses for ``com``.

    Raises:
        InputError: There is no such link, or no mass.
    """
    if name != "com":
        return [(point_of(model, frame_of(model, name)), 1.0)]
    masses = [(BodyPoint(i, np.array(inertia.lever)), float(inertia.mass))
              for i, inertia in enumerate(model.inertias) if i and inertia.mass > 0.0]  # fmt: skip
    if not masses:
        raise InputError("the mechanism has no mass, and so no centre of mass")
    return masses


def pairs(mechanism: Mechanism, forces: Mapping[str, ForceElement]) -> list[Connection]:
    """Return the connections: springs, cylinders, bushings and cables among the forces, and loop joints."""
    model, elements = mechanism.model, list["ForceElement | Constraint"](forces.values())
    return [
        Connection(kind, (point_of(model, start), point_of(model, end)))
        for element in [*elements, *mechanism.constraints]
        for kind, frames in [_drawn_as(element)] for start, end in pairwise(frames)
    ]  # fmt: skip


def _drawn_as(element: ForceElement | Constraint) -> tuple[ConnectionKind, Sequence[int]]:
    """Return the kind and the frames of the connection that an element makes; no frames where it has no place."""
    if isinstance(element, LoopJoint):
        return LOOPS.get(element.kind, "loop"), (element.first, element.second)
    from pinarm.mechanics.forces.bushing import LinearBushing
    from pinarm.mechanics.forces.cable import TautSpring
    from pinarm.mechanics.forces.point import TwoPointSpring
    from pinarm.mechanics.loops.cable import CableLoop

    if isinstance(element, TwoPointSpring):
        return "spring" if element.stiffness > 0.0 and element.force >= 0.0 else "cylinder", element.frames
    if isinstance(element, LinearBushing):
        return "bushing", element.frames
    if isinstance(element, TautSpring | CableLoop):
        return "cable", element.path.frames
    return "rod", ()


def arrows(run: Trajectory, nodes: Sequence[Node], kinds: Sequence[str]) -> list[Arrow]:
    """Return the arrows of the wanted kinds.

    Args:
        run: The motion, of which every row is drawn.
        nodes: Its bodies.
        kinds: Of ``ARROWS``, or ``all``.

    Raises:
        InputError: There is no such kind, or the run has no forces.
    """
    wanted = dict.fromkeys(kind for name in kinds for kind in (ARROWS if name == "all" else [name]))
    for kind in wanted:
        if kind not in ARROWS:
            expected, hint = choices(kind, [*ARROWS, "all"])
            raise InputError(f"there are no arrows of '{kind}'", expected=expected, hint=hint)
    if wanted and run.no_efforts:
        raise InputError(f"arrows of {', '.join(wanted)}: {run.no_efforts}", hint="kind: inverse")
    makers = {"forces": _forces, "torques": _torques, "reactions": _felt}
    drawn = [arrow for kind in wanted for arrow in makers[kind](run, nodes)]
    return [arrow for arrow in drawn if arrow.largest > 0.0]


def _forces(run: Trajectory, nodes: Sequence[Node]) -> Iterator[Arrow]:
    """Yield the weights, and the forces of loads and springs at their points."""
    from pinarm.mechanics.forces.bushing import LinearBushing
    from pinarm.mechanics.forces.cable import TautSpring
    from pinarm.mechanics.forces.point import AppliedWrench, TwoPointSpring

    model = run.mechanism.model
    for node, inertia in enumerate(model.inertias):
        if node and inertia.mass > 0.0:
            weight = inertia.mass * np.asarray(model.gravity.linear)
            yield Arrow("forces", BodyPoint(node, np.array(inertia.lever)), False, weight)
    for name, force in run.dynamics.forces.items():
        if isinstance(force, AppliedWrench):
            yield from _at_frame(run, name, force.frame)
        elif isinstance(force, LinearBushing):
            yield from (arrow for frame in force.frames for arrow in _at_frame(run, name, frame))
        elif isinstance(force, TwoPointSpring | TautSpring):
            points = [point_of(model, frame) for frame in force.points]
            alone = [point for point in points if sum(other.node == point.node for other in points) == 1]
            yield from (Arrow("forces", point, False, _wrench(run, name, point.node)[:, :3]) for point in alone)


def _at_frame(run: Trajectory, name: str, frame: int) -> Iterator[Arrow]:
    """Yield the force and the moment of a force element on a link, at the origin of a frame."""
    model = run.mechanism.model
    wrench = _wrench(run, name, int(model.frames[frame].parentJoint))
    at = point_of(model, frame)
    yield Arrow("forces", at, False, wrench[:, :3])
    moments = wrench[:, 3:] - np.cross(_positions(run, frame), wrench[:, :3])
    if np.abs(moments).max() > 1e-9 * np.abs(wrench).max():  # less is rounding of the shift to the point
        yield Arrow("forces", at, True, moments)


def _wrench(run: Trajectory, name: str, joint: int) -> Array:
    """Return the wrench of a force element on a body, about the world's origin, shape (n, 6)."""
    rows = np.zeros((len(run), 6))
    for part, dynamics in run.intervals():
        for i in range(part.start, part.stop):
            acting = dynamics.forces[name].wrenches(float(run.grid.t[i]), run.q[i], run.v[i])
            rows[i] = acting.get(joint, np.zeros(6))
    return rows


def _positions(run: Trajectory, frame: int) -> Array:
    model, data = run.mechanism.model, new_data(run.mechanism.model)
    positions = np.empty((len(run), 3))
    for i, q in enumerate(run.q):
        pin.forwardKinematics(model, data, q)
        positions[i] = pin.updateFramePlacement(model, data, frame).translation
    return positions


def _torques(run: Trajectory, nodes: Sequence[Node]) -> Iterator[Arrow]:
    """Yield the efforts of the drives, about or along the axes of their joints."""
    for joint in run.mechanism.joints.values():
        node = nodes[joint.index]
        yield Arrow(
            "torques", BodyPoint(joint.index, np.zeros(3)), node.kind == "turn", run.supplied[:, joint.v], node.axis
        )


def _felt(run: Trajectory, nodes: Sequence[Node]) -> list[Arrow]:
    """Return the reactions without those that are rounding, as of a body in free flight."""
    drawn = list(_reactions(run, nodes))
    least = ROUNDING * Reactions(run).size() if drawn else 0.0
    return [arrow for arrow in drawn if arrow.largest > least]


def _reactions(run: Trajectory, nodes: Sequence[Node]) -> Iterator[Arrow]:
    """Yield the forces of the parents on the children at the joints, as far as rigid bodies determine them."""
    reactions, model, others = Reactions(run), run.mechanism.model, [Reactions(other) for other in run.others]
    size = np.abs(reactions.joints[:, 1:, :3]).max(initial=0.0) or 1.0
    for joint in range(1, model.njoints):
        added = [stressed[:, :3] for stressed in reactions.stressed_joint(joint)]
        added += [(other.joints - reactions.joints)[:, joint, :3] / size for other in others]
        yield _reaction(BodyPoint(joint, np.zeros(3)), reactions.joints[:, joint, :3], added)
    for name, loop in reactions.loops.items():
        added = [stressed[:, :3] for stressed in reactions.stressed_loop(name)]
        added += [(other.loop(name) - reactions.loop(name))[:, :3] / size for other in others]
        yield _reaction(point_of(model, loop.second), reactions.loop(name)[:, :3], added)
    for name in reactions.cables:
        yield from _tensions(run, reactions, name)


def _tensions(run: Trajectory, reactions: Reactions, name: str) -> Iterator[Arrow]:
    """Yield the forces of a cable that does not stretch at every point of its path: its tension along both parts."""
    (lam, stresses), frames = reactions.multiplier(name), reactions.cables[name].path.frames
    points = [_positions(run, frame) for frame in frames]
    parts = [(after - before) / np.linalg.norm(after - before, axis=1)[:, None] for before, after in pairwise(points)]
    ends = np.zeros_like(points[0])
    for frame, before, after in zip(frames, [ends, *parts], [*parts, ends], strict=True):
        pull = after - before
        added = [stress[:, None] * pull for stress in stresses]
        yield _reaction(point_of(run.mechanism.model, frame), -lam[:, None] * pull, added)


def _reaction(at: BodyPoint, forces: Array, added: Sequence[Array]) -> Arrow:
    """Return a reaction without the directions in which self-stresses, or other shares of frictions, can add to it.

    In planar loops of revolute joints, for example, the forces in the plane are determined, those across it are not.

    Args:
        at: Where it acts.
        forces: One choice of the reaction [N], shape (n, 3).
        added: Change of it by each self-stress of length 1, or by other static frictions, relative to the largest
            force, each of shape (n, 3).
    """
    _, sizes, axes = np.linalg.svd(np.concatenate([np.zeros((3, 3)), *added]), full_matrices=False)
    free = axes[sizes > ACTS]
    left = forces - forces @ free.T @ free if len(free) < 3 else np.zeros_like(forces)
    return Arrow("reactions", at, False, left, partial=len(free) > 0)

"""Arrows of forces, torques and reactions over a motion, and points whose paths are traced."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.reactions import Reactions
from pinarm.engine.series import ROUNDING
from pinarm.errors import InputError, choices
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import frame_of
from pinarm.records import ValueRecord
from pinarm.use.show.bodies import BodyPoint, Node, placed, point_of

ARROWS = {
    "forces": "weights and loads",
    "torques": "efforts of drives and end stops",
    "reactions": "reactions of the joints",
}
"""Kinds of arrows, and their names in the legend. Their colours are in ``overlays.js``."""


class Arrow(ValueRecord, frozen=True):
    """A force or a moment at a point, over the rows.

    Attributes:
        of: Its kind, one of ``ARROWS``.
        at: Where it acts.
        moment: Whether it is a moment: an arc, not an arrow.
        vectors: In world axes [N or N*m], shape (n, 3).
        partial: Whether components are left out that rigid bodies do not determine.
    """

    of: str
    at: BodyPoint
    moment: bool
    vectors: Array
    partial: bool = False

    @property
    def largest(self) -> float:
        """Its largest magnitude [N or N*m]."""
        return float(np.linalg.norm(self.vectors, axis=-1).max())


def traced(model: pin.Model, name: str) -> list[tuple[BodyPoint, float]]:
    """Return the points, with their weights, whose mean is traced: the origin of a link, or all masses for ``com``.

    Raises:
        InputError: There is no such link, or no mass.
    """
    if name != "com":
        return [(point_of(model, frame_of(model, name)), 1.0)]
    if not (centres := _centres(model)):
        raise InputError("the mechanism has no mass, and so no centre of mass")
    return centres


def _centres(model: pin.Model) -> list[tuple[BodyPoint, float]]:
    bodies = [(node, inertia) for node, inertia in enumerate(model.inertias) if node and inertia.mass > 0.0]
    return [(BodyPoint(node, np.array(inertia.lever)), float(inertia.mass)) for node, inertia in bodies]


def arrows_of(run: Trajectory, nodes: Sequence[Node], kinds: Sequence[str]) -> list[Arrow]:
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
    places = placed(run.mechanism.model, run.q, len(run)) if wanted else np.zeros(0)
    makers = {"forces": _forces, "torques": _torques, "reactions": _reactions}
    drawn = [arrow for kind in wanted for arrow in makers[kind](run, nodes, places)]
    least = ROUNDING * Reactions(run).size() if "reactions" in wanted else 0.0  # as of a body in free flight
    return [arrow for arrow in drawn if arrow.largest > (least if arrow.of == "reactions" else 0.0)]


def _forces(run: Trajectory, nodes: Sequence[Node], places: Array) -> Iterator[Arrow]:
    """Yield the weights, and the forces of loads and springs at their points."""
    from pinarm.mechanics.forces.bushing import LinearBushing
    from pinarm.mechanics.forces.points import AppliedWrench, PathElement

    model = run.mechanism.model
    for centre, mass in _centres(model):
        yield Arrow("forces", centre, False, np.tile(mass * np.asarray(model.gravity.linear), (len(run), 1)))
    for name, force in run.dynamics.forces.items():
        if isinstance(force, AppliedWrench | LinearBushing):
            for frame in force.frames if isinstance(force, LinearBushing) else [force.frame]:
                yield from _at_frame(run, name, point_of(model, frame), places)
        elif isinstance(force, PathElement):
            points = [point_of(model, frame) for frame in force.points]
            alone = [point for point in points if sum(other.node == point.node for other in points) == 1]
            yield from (Arrow("forces", point, False, _wrench(run, name, point.node)[:, :3]) for point in alone)


def _at_frame(run: Trajectory, name: str, at: BodyPoint, places: Array) -> Iterator[Arrow]:
    """Yield the force and the moment of a force element on a link, at a point of it."""
    wrench = _wrench(run, name, at.node)
    yield Arrow("forces", at, False, wrench[:, :3])
    moments = wrench[:, 3:] - np.cross(at.path(places), wrench[:, :3])
    if np.abs(moments).max() > 1e-9 * np.abs(wrench).max():  # less is rounding of the shift to the point
        yield Arrow("forces", at, True, moments)


def _wrench(run: Trajectory, name: str, joint: int) -> Array:
    """Return the wrench of a force element on a body, about the world's origin, shape (n, 6)."""
    rows, links = np.zeros((len(run), 6)), LinkPlacements.at(run.mechanism.model, run.q)
    for part, dynamics in run.intervals():
        here = links.some(np.arange(part.start, part.stop))
        acting = dynamics.forces[name].wrenches(here, run.grid.t[part], run.v[part])
        rows[part] = acting.get(joint, np.zeros(6))
    return rows


def _torques(run: Trajectory, nodes: Sequence[Node], places: Array) -> Iterator[Arrow]:
    for joint in run.mechanism.joints.values():
        node, at = nodes[joint.index], BodyPoint(joint.index, np.zeros(3))
        axis = places[:, joint.index, :3, :3] @ node.axis
        yield Arrow("torques", at, node.kind == "turn", run.supplied[:, joint.v, None] * axis)


def _reactions(run: Trajectory, nodes: Sequence[Node], places: Array) -> Iterator[Arrow]:
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
    for name, cable in reactions.cables.items():
        (lam, stresses), ends = reactions.multiplier(name), [point_of(model, frame) for frame in cable.path.frames]
        parts = [after.path(places) - before.path(places) for before, after in pairwise(ends)]
        ways = [np.zeros((len(run), 3)), *(part / np.linalg.norm(part, axis=1)[:, None] for part in parts)]
        for end, (before, after) in zip(ends, pairwise([*ways, ways[0]]), strict=True):
            pull = after - before  # of a tension of 1 N along both parts
            yield _reaction(end, -lam[:, None] * pull, [stress[:, None] * pull for stress in stresses])


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

"""Reactions: the wrenches that joints transmit, those of the tree and those that close loops.

The multipliers act on the tree as outside wrenches; one recursion then gives what every joint of the tree transmits.
Where constraints are redundant some multipliers do nothing: these self-stresses are added freely to any solution, so
that a component on which one of them acts is not determined by rigid bodies at all. Couplings whose forces are not
known leave components open likewise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, cast

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.checks.figures import relative, sampled
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import GuidedCoordinate, joint_ties, one_sided
from pinarm.engine.constraints.self_stresses import SelfStresses
from pinarm.engine.dynamics.dynamics import Dynamics, transmitted
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.coordinates import PairCoordinate
from pinarm.mechanics.couplings.coupling import JointRelation, OpenReaction, left_open
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import states_first
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.joints import screw_of
from pinarm.mechanics.loops.loop_joints import CableLoop, LoopJoint

if TYPE_CHECKING:
    from pinarm.mechanics.forces.along_coordinate import AlongCoordinate
    from pinarm.mechanics.friction.contact import FrictionContact

SAMPLE = 64
"""Largest number of rows at which self-stresses are looked for: they belong to the structure, not to an instant."""

APART = 1e-9
"""Gap, over ``1 + extent``, from which on a one-sided constraint holds nothing: one that is touched may share loads."""

NO_AXIS = ("fixed", "spherical")
"""Kinds of lower pairs without an axis."""


def tree_axis(model: pin.Model, joint: int) -> Array | None:
    """Return the axis of a joint of the tree, in the joint's frame, shape (3,); ``None`` where it has none."""
    screw = screw_of(model.joints[joint])
    return None if screw is None else screw[1]


def loop_axis(loop: LoopJoint) -> Array | None:
    """Return the axis of a loop joint, in the axes of frame 1, shape (3,); ``None`` where it has none."""
    from pinarm.mechanics.geometry.pairs import LowerPair

    return loop.pair.axis if isinstance(loop.pair, LowerPair) and loop.kind not in NO_AXIS else None


class Reactions:
    """Wrenches over the rows of one trajectory, kept once computed.

    Args:
        run: The trajectory.
        sample: Largest number of rows at which self-stresses are looked for; 0 for states of a run that tells of them.
    """

    def __init__(self, run: Trajectory, sample: int = SAMPLE) -> None:
        self.run, self.model, self.closure, self.sample = run, run.mechanism.model, run.closure, sample
        self.loops = {
            constraint.name: constraint for constraint in self.closure.constraints if isinstance(constraint, LoopJoint)
        }
        self.couplings = {one.name: one for one in self.closure.constraints if isinstance(one, JointRelation)}
        self.cables = {one.name: one for one in self.closure.constraints if isinstance(one, CableLoop)}

    @cached_property
    def links(self) -> LinkPlacements:
        """Placements of the links in all rows."""
        return LinkPlacements.at(self.model, self.run.q)

    @property
    def origins(self) -> Array:
        """Places of the joints' origins [m], world axes, shape (n, njoints, 3)."""
        return self.links.places

    @cached_property
    def reach(self) -> Array:
        """Distance of the farthest joint from the world's origin [m], shape (n,): arm of what moments are sums of."""
        return np.asarray(np.linalg.norm(self.origins, axis=-1).max(axis=-1))

    def markers(self, joint: int) -> Array:
        """Return the places of a joint on its parent [m], world axes, (n, 3): its origin where it does not slide."""
        parent, place = self.model.parents[joint], self.model.jointPlacements[joint].translation
        return np.asarray(self.links.places[:, parent] + self.links.turns[:, parent] @ place)

    def tree_axes(self, joint: int) -> Array | None:
        """Return the axis of a joint, world axes, shape (n, 3); ``None`` where it has none."""
        axis = tree_axis(self.model, joint)
        return None if axis is None else self.links.turns[..., joint, :, :] @ axis

    def loop_axes(self, name: str) -> Array | None:
        """Return the axis of a loop joint, world axes, shape (n, 3); ``None`` where it has none."""
        axis = loop_axis(self.loops[name])
        return None if axis is None else self.links.frame(self.loops[name].first)[0] @ axis

    @cached_property
    def multipliers(self) -> Array:
        """Multipliers of the constraints, and efforts of drives along task coordinates [N or N*m], shape (n, m)."""
        return np.asarray(self.run.lam)

    @cached_property
    def joints(self) -> Array:
        """Wrench of the parent on the child at every joint's origin, world axes [N, N*m], shape (n, njoints, 6)."""
        run = self.run

        def joints(dynamics: Dynamics, part: slice) -> Array:
            rows = np.arange(part.start, part.stop)
            links, acting = self.links.some(rows), self._acting(dynamics, rows)
            return transmitted(links, run.q[rows], run.v[rows], run.a[rows], acting)

        return run.gather(joints)

    def _acting(self, dynamics: Dynamics, rows: Indices) -> Array:
        """Return what loads and constraints do to the links at k rows, shape (k, njoints, 6)."""
        run, links, states = self.run, self.links.some(rows), self.run.q[rows].shape[:-1]
        wrenches = states_first(np.zeros((6, self.model.njoints, *states), run.q.dtype))
        for force in dynamics.forces.values():
            for joint, wrench in force.wrenches(links, run.grid.t[rows], run.v[rows]).items():
                wrenches[:, joint] += wrench
        if self.closure.size:
            wrenches = wrenches + self.closure.wrenches(links, self.multipliers[rows])
        for contact, f in zip(run.mechanism.frictions, run.friction.T, strict=True):
            for joint, wrench in contact.slip.wrenches(links, f[rows]).items():
                wrenches[:, joint] += wrench
        return wrenches

    def figures(self) -> dict[str, Array]:
        """Return how well the wrenches of the tree's joints keep every body in balance; nothing where none was asked.

        ``bodies``: what Newton's and Euler's equations of a body miss at most, at a sample of the rows, relative to the
        largest sum of the terms of one body: the wrenches of its joints, loads, weight, and the rate of its momentum,
        by forward kinematics, about the origin of its joint. Forces and moments each on their own. Shape (), or (k,) of
        variants.
        """
        if "joints" not in vars(self) or not len(self.run):
            return {}
        missed, terms = np.moveaxis(self.run.gather(self._balances), 1, 0)
        parts = [slice(0, 3), slice(3, 6)]
        sizes = (
            (np.linalg.norm(missed[..., k], axis=-1).max(axis=-1), terms[..., k].max(axis=(-2, -1))) for k in parts
        )
        return {"bodies": np.max([relative(left, size) for left, size in sizes], axis=0)}

    def size(self) -> float:
        """Return the largest sum of the terms of the forces on one body [N], of which reactions may be the rounding."""
        return float(self.run.gather(self._balances)[:, 1, :, :3].max(initial=0.0))

    def _balances(self, dynamics: Dynamics, part: slice) -> Array:
        """Return what is missed and the sums of absolute terms, body by body, shape (k, 2, njoints - 1, 6)."""
        run, parents = self.run, self.model.parents.tolist()
        checked = sampled(len(run))
        rows = checked[(checked >= part.start) & (checked < part.stop)]
        links, wrenches = run.link_motion_at(rows)[0], self.joints[rows]
        asked = links.outwards(run.looked_at(rows).demands)
        carried = moved(wrenches, links.places - links.places[..., parents, :])
        outside = moved(self._acting(dynamics, rows), -links.places)
        missed = wrenches + outside - asked.sum(axis=0)
        terms = np.abs(wrenches) + np.abs(outside) + np.abs(asked, out=asked).sum(axis=0)
        for joint, parent in enumerate(parents):
            missed[..., parent, :] -= carried[..., joint, :]
            terms[..., parent, :] += np.abs(carried[..., joint, :])
        return np.asarray(np.stack([missed, terms], axis=1)[..., 1:, :])

    def loop(self, name: str) -> Array:
        """Return the wrench of a loop joint's first link on its second, at frame 2, world axes, shape (n, 6).

        Friction, springs, efforts and drives along the joint's own coordinates are part of it, as they are of joints of
        the tree.
        """
        held = self._loop(name, self.multipliers)
        for coordinate, effort in self._own_efforts(name):
            held += coordinate.way.wrench(self.links, effort[:, None])
        if not self.run.mechanism.frictions:
            return held
        for contact, f in zip(self.run.mechanism.frictions, self.run.friction.T, strict=True):
            if isinstance(contact.slip, PairCoordinate) and contact.slip.loop == name:
                held += contact.slip.way.wrench(self.links, f[:, None])
        return held

    def _own_efforts(self, name: str) -> Iterator[tuple[PairCoordinate, Array]]:
        """Yield the coordinates of a loop joint with efforts along them, of drives and force elements, shape (n,)."""
        from pinarm.mechanics.forces.along_coordinate import AlongCoordinate

        run, guides = self.run, self.closure.constraints[len(self.run.mechanism.constraints) :]
        for guide in guides:
            guided = guide.coordinate if isinstance(guide, GuidedCoordinate) else None
            if isinstance(guided, PairCoordinate) and guided.loop == name:
                yield guided, self.multipliers[:, self.closure.slices[guide.name].start]
        for tie in joint_ties(run.mechanism.constraints):
            if isinstance(tie.coordinate, PairCoordinate) and tie.coordinate.loop == name:
                yield tie.coordinate, -self.multipliers[:, self.closure.slices[tie.name].start]
        for key, force in run.dynamics.forces.items():
            along = force.coordinate if isinstance(force, AlongCoordinate) else None
            if isinstance(along, PairCoordinate) and along.loop == name:
                yield along, run.gather(partial(self._efforts, key))

    def _efforts(self, name: str, dynamics: Dynamics, rows: slice) -> Array:
        run, force = self.run, cast("AlongCoordinate", dynamics.forces[name])
        return force.efforts(run.grid.t[rows], run.q[rows], run.v[rows])

    def loop_origins(self, name: str) -> Array:
        """Return the places of a loop joint's second frame [m], world axes, shape (n, 3)."""
        return self.links.frame(self.loops[name].second)[1]

    def cable_lengths(self, name: str) -> Array:
        """Return the lengths of the path of a cable [m], shape (n,)."""
        path = self.cables[name].path
        return np.array([path.value(self.closure.state(q)) for q in self.run.q])

    def _loop(self, name: str, lam: Array) -> Array:
        rows, part = np.zeros((*lam.shape[:-1], 6), lam.dtype), self.closure.slices[name]
        held = np.flatnonzero(lam[..., part].reshape(len(lam), -1).any(axis=1))
        if len(held):
            rows[held] = self.loops[name].wrench(self.links.some(held), lam[held][..., part])
        return rows

    @cached_property
    def left_open(self) -> dict[int, OpenReaction]:
        """Joint index -> what couplings leave open of the joint's reaction, whose forces are not known."""
        return left_open(self.model, list(self.couplings.values()))

    def open_wrenches(self, joint: int) -> list[Array]:
        """Return wrenches that span what is left open of a joint's reaction, world axes, each of shape (n, 6)."""
        if joint not in self.left_open:
            return []
        turns = self.links.turns[:, joint]
        parts = ((turns @ wrench[:3], turns @ wrench[3:]) for wrench in self.left_open[joint].wrenches)
        return [np.concatenate(both, axis=1) for both in parts]

    def multiplier(self, name: str) -> tuple[Array, list[Array]]:
        """Return the multiplier of a constraint of one row [N or N*m], and what self-stresses add to it, shape (n,)."""
        row = self.closure.slices[name].start
        return self.multipliers[:, row], self.stressed_multipliers({name: np.ones(len(self.run))})

    def transmitted(self, name: str) -> tuple[Array, Array, list[Array]]:
        """Return where a coupling acts on its second member [m], (n, 3), and [f; m] on it there, world axes, (n, 6).

        Friction between its members is part of it. And what each self-stress adds to the latter.
        """
        coupling, (lam, stresses) = self.couplings[name], self.multiplier(name)
        actions = [coupling.transmitted(self.links, x[:, None]) for x in (lam, np.zeros_like(lam), *stresses)]
        points, (wrench, idle, *stressed) = actions[0][0], [wrench for _, wrench in actions]
        for contact, f in self.friction_of(name):
            wrench = wrench + moved(contact.slip.wrenches(self.links, f)[coupling.second], -points)
        return points, wrench, [stress - idle for stress in stressed]

    def friction_of(self, name: str) -> list[tuple[FrictionContact, Array]]:
        """Return where the members of a coupling rub, with the friction there [N], shape (n,)."""
        frictions = self.run.mechanism.frictions
        pairs = zip(frictions, self.run.friction.T, strict=True) if frictions else ()
        return [(contact, f) for contact, f in pairs if contact.coupling and contact.coupling.name == name]

    @cached_property
    def stresses(self) -> list[tuple[Indices, SelfStresses]]:
        """The self-stresses at a sample of the rows: rows in which the same constraints hold, with those of these."""
        closure, q = self.run.mechanism.closure, np.real(self.run.q)
        if self.run.opened is None or not self.sample:
            some = sampled(len(q), self.sample)
            return [(some, SelfStresses(closure, q[some]))]
        sided, found = one_sided(closure.constraints), []
        gaps = closure.at(q)[0][:, [closure.slices[one.name].start for one in sided]]
        opened = gaps * [one.side for one in sided] > APART * (1.0 + closure.extent)
        for pattern in np.unique(opened, axis=0):
            names = {one.name for one, is_open in zip(sided, pattern, strict=True) if is_open}
            rows = np.flatnonzero((opened == pattern).all(axis=1))
            rows = rows[sampled(len(rows), self.sample)]
            holding = Closure.of(
                closure.model, [constraint for constraint in closure.constraints if constraint.name not in names]
            )
            found.append((rows, SelfStresses(holding, q[rows])))
        return found

    @property
    def degree(self) -> int:
        """Degree of hyperstatism: number of constraints that repeat others, where there are most."""
        return max(stresses.degree for _, stresses in self.stresses)

    def stressed_joint(self, joint: int) -> list[Array]:
        """Return what each self-stress adds to the wrench of a joint of the tree, shape (n, 6); see ``_at_sample``."""
        return self._at_sample([stresses.on_joint(joint) for _, stresses in self.stresses])

    def stressed_loop(self, name: str) -> list[Array]:
        """Return what each self-stress adds to the wrench of a loop joint, shape (n, 6); see ``_at_sample``."""
        return self._at_sample([stresses.on_loop(self.loops[name]) for _, stresses in self.stresses])

    def stressed_multipliers(self, weights: Mapping[str, Array]) -> list[Array]:
        """Return what each self-stress adds to a sum of multipliers, shape (n,); see ``_at_sample``."""
        added = []
        for rows, stresses in self.stresses:
            holding = {name: weight[rows] for name, weight in weights.items() if name in stresses.closure.slices}
            added.append(stresses.on_multipliers(holding))
        return self._at_sample(added)

    def _at_sample(self, added: Sequence[Array]) -> list[Array]:
        """Return what self-stresses of length 1 add at a sample of the rows, shape (s, ..), with 0 at the others."""
        found = np.zeros((max(map(len, added)), len(self.run), *added[0].shape[2:]))
        for (rows, _), part in zip(self.stresses, added, strict=True):
            found[: len(part), rows] = part
        return list(found)

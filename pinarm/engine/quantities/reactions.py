"""Reactions: the wrenches that joints transmit, those of the tree and those that close loops.

The multipliers act on the tree as outside wrenches; one recursion then gives what every joint of the tree transmits.
Where constraints are redundant some multipliers do nothing: these self-stresses are added freely to any solution, so
that a component on which one of them acts is not determined by rigid bodies at all. Couplings whose forces are not
known leave components open likewise. Wrenches of fixed joints, whose bodies the model has merged into one, follow by
Newton's and Euler's equations of the bodies beyond them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.checks.balance import relative, sampled
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import joint_ties, one_sided
from pinarm.engine.constraints.self_stresses import SelfStresses
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import GuidedCoordinate, PairCoordinate
from pinarm.mechanics.couplings.coupling import OpenReaction, left_open
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.link_placements import LinkPlacements, transmitted
from pinarm.mechanics.geometry.link_tree import states_first
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.joints import screw_of
from pinarm.mechanics.loops.loop_joints import CableLoop, LoopJoint

if TYPE_CHECKING:
    from pinarm.mechanics.forces.along_coordinate import AlongCoordinate
    from pinarm.mechanics.friction.contact import FrictionContact

ConstraintT = TypeVar("ConstraintT", LoopJoint, CableLoop)

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
        sample: Largest number of rows at which self-stresses are looked for; 0 for states of a run that tells of them.
    """

    def __init__(self, run: Trajectory, sample: int = SAMPLE) -> None:
        self.run, self.model, self.closure, self.sample = run, run.mechanism.model, run.closure, sample
        self.couplings = {relation.name: relation for relation in run.mechanism.relations}
        self.loops, self.cables = self._named(LoopJoint), self._named(CableLoop)

    def _named(self, kind: type[ConstraintT]) -> dict[str, ConstraintT]:
        return {constraint.name: constraint for constraint in self.closure.constraints if isinstance(constraint, kind)}

    @cached_property
    def links(self) -> LinkPlacements:
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

    @property
    def multipliers(self) -> Array:
        """Multipliers of the constraints, and efforts of drives along task coordinates [N or N*m], shape (n, m)."""
        return self.run.lam

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
        """Return the wrenches of loads, constraints and friction on the links at k rows, shape (k, njoints, 6)."""
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
        """Return the residual of the balance of every body under the tree's joints; empty where none was asked.

        ``bodies``: the largest residual of Newton's and Euler's equations of a body, at a sample of the rows, relative
        to the largest sum of the terms of a body: the wrenches of its joints, loads, weight, and the rate of its
        momentum, by forward kinematics, about the origin of its joint. Forces and moments are compared separately.
        Shape (), or (k,) of variants.
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
        """Return residuals and sums of absolute terms of the balance of each body, shape (k, 2, njoints - 1, 6)."""
        run, parents = self.run, self.model.parents.tolist()
        checked = sampled(len(run))
        rows = checked[(checked >= part.start) & (checked < part.stop)]
        links, wrenches = run.looked_at(rows).link_motion[0], self.joints[rows]
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
        actions = [coupling.known.transmitted(self.links, x) for x in (lam, np.zeros_like(lam), *stresses)]
        points, (wrench, idle, *stressed) = actions[0][0], [wrench for _, wrench in actions]
        for contact, f in self.friction_of(name):
            wrench = wrench + moved(contact.slip.wrenches(self.links, f)[coupling.known.second], -points)
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
        sided, parts = one_sided(closure.constraints), []
        gaps = closure.at(q)[0][:, [closure.slices[constraint.name].start for constraint in sided]]
        opened = gaps * [constraint.side for constraint in sided] > APART * (1.0 + closure.extent)
        for pattern in np.unique(opened, axis=0):
            names = {constraint.name for constraint, is_open in zip(sided, pattern, strict=True) if is_open}
            rows = np.flatnonzero((opened == pattern).all(axis=1))
            rows = rows[sampled(len(rows), self.sample)]
            holding = Closure.of(
                closure.model, [constraint for constraint in closure.constraints if constraint.name not in names]
            )
            parts.append((rows, SelfStresses(holding, q[rows])))
        return parts

    @property
    def degree(self) -> int:
        return max(stresses.degree for _, stresses in self.stresses)

    def stressed_joint(self, joint: int) -> list[Array]:
        """Return the wrench that each self-stress adds at a joint of the tree, shape (n, 6); see ``_at_sample``."""
        return self._at_sample([stresses.on_joint(joint) for _, stresses in self.stresses])

    def stressed_loop(self, name: str) -> list[Array]:
        """Return the wrench that each self-stress adds at a loop joint, shape (n, 6); see ``_at_sample``."""
        return self._at_sample([stresses.on_loop(self.loops[name]) for _, stresses in self.stresses])

    def stressed_multipliers(self, weights: Mapping[str, Array]) -> list[Array]:
        """Return the addition of each self-stress to a sum of multipliers, shape (n,); see ``_at_sample``."""
        added = []
        for rows, stresses in self.stresses:
            holding = {name: weight[rows] for name, weight in weights.items() if name in stresses.closure.slices}
            added.append(stresses.on_multipliers(holding))
        return self._at_sample(added)

    def _at_sample(self, added: Sequence[Array]) -> list[Array]:
        """Return the additions of self-stresses of length 1 at a sample of the rows, 0 at the others, s arrays."""
        samples = np.zeros((max(map(len, added)), len(self.run), *added[0].shape[2:]))
        for (rows, _), part in zip(self.stresses, added, strict=True):
            samples[: len(part), rows] = part
        return list(samples)


MERGED = 1e-9
"""Relative difference of the sum of the links' masses from those of the merged body that is rounding."""


def fixed_joints(model: pin.Model) -> Mapping[str, int]:
    """Return the indices of the frames of the fixed joints of a file, by name."""
    frames = [*enumerate(model.frames)][1:]  # the first is the world
    return {frame.name: index for index, frame in frames if frame.type == pin.FrameType.FIXED_JOINT}


def fixed_wrench(reactions: Reactions, name: str) -> Array:
    """Return the wrench of the parent on the child at a fixed joint's origin, world axes [N, N*m], shape (n, 6)."""
    run, model, frame = reactions.run, reactions.model, fixed_joints(reactions.model)[name]
    if not isinstance(model, pin.Model):
        raise VariantsDiffer(f"the wrench of the fixed joint '{name}'")
    carrier, links = model.frames[frame].parentJoint, _beyond(model, frame)
    body = _body(model, name, carrier, links)
    total = np.array([_demand(model, body, carrier, *state) for state in zip(run.q, run.v, run.a, strict=True)])
    for child in model.children[carrier].tolist():
        joint = model.getFrameId(model.names[child], pin.FrameType.JOINT)
        if joint == model.nframes:
            raise _unknown(name, f"{model.names[child]} hangs on no single link")
        if model.frames[joint].parentFrame in links:
            total += moved(reactions.joints[:, child], reactions.origins[:, child])
    total -= run.gather(lambda dynamics, part: _loads(reactions, dynamics, np.arange(part.start, part.stop), name))
    return moved(total, -reactions.links.frame(frame)[1])


def _beyond(model: pin.Model, frame: int) -> set[int]:
    frames, carrier = {frame}, model.frames[frame].parentJoint
    for index, other in enumerate(model.frames.tolist()):  # after those that carry them
        if other.parentFrame in frames and other.parentJoint == carrier:
            frames.add(index)
    return frames


def _body(model: pin.Model, name: str, carrier: int, links: set[int]) -> pin.Inertia:
    every, beyond = pin.Inertia.Zero(), pin.Inertia.Zero()
    for index, frame in enumerate(model.frames.tolist()):
        if frame.parentJoint == carrier:
            every += frame.placement.act(frame.inertia)
            beyond += frame.placement.act(frame.inertia) if index in links else pin.Inertia.Zero()
    merged = model.inertias[carrier].toDynamicParameters()
    if np.abs(every.toDynamicParameters() - merged).max() > MERGED * max(np.abs(merged).max(), 1e-300):
        raise _unknown(name, "the masses of the links that it ties are not known one by one")
    return beyond


def _demand(model: pin.Model, body: pin.Inertia, carrier: int, q: Array, v: Array, a: Array) -> Array:
    """Return the rate of the momentum of a body less its weight, [f; m] at the world's origin in one state, (6,)."""
    data = model.createData()
    pin.forwardKinematics(model, data, q, v, a)
    place, twist = data.oMi[carrier], data.v[carrier]
    rate = data.a[carrier] - place.actInv(model.gravity)
    return np.asarray(place.act(body * rate + body.vxiv(twist)).vector)


def _loads(reactions: Reactions, dynamics: Dynamics, rows: Indices, name: str) -> Array:
    """Return the wrench of loads on the links beyond a fixed joint, [f; m] at the world's origin, shape (k, 6)."""
    run, model, total = reactions.run, reactions.model, np.zeros((len(rows), 6))
    frame, links = fixed_joints(model)[name], reactions.links.some(rows)
    carrier, beyond = model.frames[frame].parentJoint, _beyond(model, frame)
    for key, force in dynamics.forces.items():
        acting = force.wrenches(links, run.grid.t[rows], run.v[rows])
        ends = {end for end in _ends(force) if model.frames[end].parentJoint == carrier}
        if (ends & beyond and ends - beyond) or (carrier in acting and not ends):
            raise _unknown(name, f"the force '{key}' acts on links on both sides, or on no single point")
        total += acting[carrier] if carrier in acting and ends & beyond else 0.0
    tied = reactions.closure.wrenches(links, reactions.multipliers[rows])[:, carrier] if reactions.closure.size else 0.0
    slips = [contact.slip.wrenches(links, np.ones(len(rows))) for contact in run.mechanism.frictions]
    if np.any(tied) or any(carrier in slip for slip in slips):
        raise _unknown(name, "a loop, a coupling or friction acts on the links that it ties")
    return total


def _ends(force: ForceElement) -> set[int]:
    along = getattr(force, "coordinate", None)
    return {along.way.first, along.way.second} if isinstance(along, PairCoordinate) else {*force.points}


def _unknown(name: str, why: str) -> InputError:
    return InputError(
        f"the wrench of the fixed joint '{name}' is not known: {why}",
        expected="a joint that moves, before or beyond it",
    )

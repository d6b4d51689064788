"""Actions on the bodies of a mechanism: the unknown ones per unit, and in one state all, with weights and inertias.

Unknown is what joints transmit, multipliers of couplings, efforts of drives. Each unknown is a wrench per unit on every
body that it acts on, so that inside a group of bodies it cancels, and at its border it is left. A body without mass
between two joints passes wrenches on: both joints transmit what either can.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.constraint_rows import joint_ties
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.coordinates import Constraint, Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.joints import moved_links
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, replace

SAME = 1e-9
"""Sine of the angle between a wrench and a space of wrenches below which it is in the space: rounding, of numbers near
1."""


class Carrier(Record, frozen=True):
    """Something that transmits unknown actions.

    Attributes:
        name: Name of the joint, loop joint, coupling, or of the coordinate that a drive acts along.
        kind: ``joint``, ``loop``, ``coupling``, ``drive``, or ``law`` of a coordinate whose effort is known.
        bodies: The bodies that it acts on, by joint index; 0 is the ground.
        columns: Its unknowns among all.
    """

    name: str
    kind: str
    bodies: tuple[int, ...]
    columns: slice

    @property
    def count(self) -> int:
        """Number of its unknowns."""
        return int(self.columns.stop - self.columns.start)

    def is_cut(self, group: Flags) -> bool:
        """Tell whether it acts between bodies inside and outside of a group, shape (njoints,)."""
        inside = group[list(self.bodies)]
        return bool(inside.any() and not inside.all())


class Actions(Record, frozen=True):
    """The unknown actions of a mechanism at c configurations.

    Attributes:
        mechanism: The mechanism.
        links: Where its links are.
        carriers: What transmits the unknowns.
        wrenches: Wrench per unit of each of K unknowns on every body, [f; m] at the world's origin, world axes, shape
            (c, njoints, K, 6).
        efforts: Efforts at joints per unit of those that act as such, shape (c, K, nv).
    """

    mechanism: Mechanism
    links: LinkPlacements
    carriers: tuple[Carrier, ...]
    wrenches: Array
    efforts: Array

    @cached_property
    def bodies(self) -> list[int]:
        return bodies_of(self.mechanism)

    def carrier(self, name: str, *kinds: str) -> Carrier | None:
        """Return the carrier of a name that has one of some kinds; ``None`` where there is none."""
        return next((carrier for carrier in self.carriers if carrier.name == name and carrier.kind in kinds), None)


def bodies_of(mechanism: Mechanism) -> list[int]:
    """Return the joint indices of the bodies of a mechanism: joints of rotors and counters move none."""
    idle = {tie.rotor.index for tie in joint_ties(mechanism.constraints)}
    return [index for index in range(1, mechanism.model.njoints) if index not in idle]


def body_name(model: pin.Model, body: int) -> str:
    """Return the name of a body: its first link."""
    return moved_links(model, body)[0] if body else "ground"


def unknown_actions(
    mechanism: Mechanism,
    q: Array,
    efforts: Mapping[str, Coordinate],
    balls: Iterable[str],
    law: str,
    senses: Mapping[str, float],
    *,
    loaded: bool,
) -> Actions:
    """Return the unknown actions.

    Args:
        mechanism: The mechanism.
        q: Configurations, shape (c, nq).
        efforts: Coordinates along which unknown efforts act, by name.
        balls: Ball joints with drives.
        law: Which of the coordinates has a known effort, and is asked for its law of motion; empty for none.
        senses: Sign of the multipliers of couplings in the state of the numbers; 1 of others.
        loaded: Whether forces act on bodies: those without mass then pass nothing on.
    """
    links, model = LinkPlacements.at(mechanism.model, q), mechanism.model
    parts = list[_Part]()
    for body, space in _joint_spaces(mechanism, links, efforts, set(balls), loaded).items():
        parts.append(_Part(str(model.names[body]), "joint", _on_both(mechanism, body, space)))
    for constraint in mechanism.constraints:
        name = constraint.name
        if isinstance(constraint, JointRelation) and not constraint.transmission:
            parts.append(_at_joints(mechanism, name, "coupling", constraint.rows_at(q)[:, None], links))
        elif not hasattr(constraint, "rotor"):
            kind = "loop" if isinstance(constraint, LoopJoint) else "coupling"
            parts.append(_Part(name, kind, per_unit(constraint, links, senses.get(name) or 1.0)))
    for name, along in efforts.items():
        kind = "law" if name == law else "drive"
        if isinstance(along, LinearCoordinate):
            parts.append(_at_joints(mechanism, name, kind, along.weights[None, None], links))
        else:
            acting = along.wrenches(links, np.ones(len(q)))
            parts.append(_Part(name, kind, {body: wrench[:, None] for body, wrench in acting.items()}))
    for name in balls:
        joint = model.joints[mechanism.balls[name].index]
        unit = np.eye(model.nv)[joint.idx_v : joint.idx_v + joint.nv]
        parts.append(_at_joints(mechanism, name, "drive", unit[None], links))
    return _assembled(mechanism, links, parts)


class _Part(NamedTuple):
    """A carrier: its name, its kind, wrenches per unit on bodies, shape (c, k, 6), and efforts, shape (c, k, nv)."""

    name: str
    kind: str
    acting: dict[int, Array]
    efforts: Array | None = None


def _assembled(mechanism: Mechanism, links: LinkPlacements, parts: Iterable[_Part]) -> Actions:
    carriers, start = list[Carrier](), 0
    c, bodies, nv = len(links.q), mechanism.model.njoints, mechanism.model.nv
    wrenches, efforts = [np.zeros((c, bodies, 0, 6))], [np.zeros((c, 0, nv))]
    for name, kind, acting, own in parts:
        count = next((wrench.shape[1] for wrench in acting.values()), 0)
        block = np.zeros((c, bodies, count, 6))
        for body, wrench in acting.items():
            block[:, body] += wrench
        carriers.append(Carrier(name, kind, tuple(sorted(acting)), slice(start, start + count)))
        wrenches.append(block)
        efforts.append(np.broadcast_to(0.0 if own is None else own, (c, count, nv)))
        start += count
    return Actions(mechanism, links, tuple(carriers), np.concatenate(wrenches, axis=2), np.concatenate(efforts, axis=1))


def _at_joints(mechanism: Mechanism, name: str, kind: str, efforts: Array, links: LinkPlacements) -> _Part:
    efforts = np.broadcast_to(efforts, (len(links.q), *efforts.shape[1:]))
    return _Part(name, kind, joint_efforts(mechanism, links, efforts), efforts)


def _on_both(mechanism: Mechanism, body: int, wrenches: Array) -> dict[int, Array]:
    """Return wrenches of the parent on the child as they act on both, shape (c, k, 6)."""
    return {int(mechanism.model.parents[body]): -wrenches, body: wrenches}


def motions(mechanism: Mechanism, links: LinkPlacements, body: int) -> Array:
    """Return the wrenches of unit efforts along the motions of a joint, shape (c, nv, 6)."""
    return _placed(links, body, np.asarray(np.linalg.pinv(_subspace(mechanism.model, body)), float))


def _subspace(model: pin.Model, body: int) -> Array:
    joint = model.joints[body]
    return LinkTree.of(model).subspace[:, joint.idx_v : joint.idx_v + joint.nv]


def _placed(links: LinkPlacements, body: int, wrenches: Array) -> Array:
    """Return wrenches in the axes of a link at its origin, shape (k, 6), at the world's origin, shape (c, k, 6)."""
    turn, place = links.turns[:, body], links.places[:, body]
    parts = np.einsum("cab,kpb->ckpa", turn, wrenches.reshape(-1, 2, 3))
    return moved(parts.reshape(len(turn), -1, 6), place[:, None, :])


def held(model: pin.Model, links: LinkPlacements, body: int) -> Array:
    """Return a basis of the wrenches that do no work in a tree joint, at the world's origin, shape (c, k, 6).

    Forces and moments are apart, and along the axes of the joint, where its motions are.
    """
    subspace = _subspace(model, body)
    slides, turns = subspace[:3].any(axis=0), subspace[3:].any(axis=0)
    if (slides & turns).any():
        return _placed(links, body, np.asarray(np.linalg.svd(subspace.T)[2][subspace.shape[1] :]))
    forces, moments = _normal(subspace[:3, slides]), _normal(subspace[3:, turns])
    apart = np.block([[forces, np.zeros_like(forces)], [np.zeros_like(moments), moments]])
    return _placed(links, body, apart)


def _normal(vectors: Array) -> Array:
    """Return unit vectors normal to independent ones, shape (3, k), as an array of shape (3 - k, 3)."""
    if vectors.shape[1] == 1 and np.count_nonzero(vectors) == 1:
        return np.asarray(np.eye(3)[vectors[:, 0] == 0.0])
    return np.asarray(np.linalg.svd(vectors.T)[2][vectors.shape[1] :]) if vectors.size else np.eye(3)


def per_unit(constraint: Constraint, links: LinkPlacements, sense: float = 1.0) -> dict[int, Array]:
    """Return wrenches of a constraint on bodies per unit of its multipliers, of one sense, shape (c, m, 6).

    A constant part, such as the pretension of a belt, is left out.
    """
    shape = len(links.q), constraint.size
    rows = [np.broadcast_to(row, shape) for row in sense * np.eye(constraint.size)]
    idle, each = constraint.wrenches(links, np.zeros(shape)), [constraint.wrenches(links, row) for row in rows]
    return {body: np.stack([(wrenches[body] - idle[body]) / sense for wrenches in each], axis=1) for body in idle}


def joint_efforts(mechanism: Mechanism, links: LinkPlacements, efforts: Array) -> dict[int, Array]:
    """Return the wrenches of generalised efforts at joints, shape (c, k, nv), on links, shape (c, k, 6)."""
    acting: dict[int, Array] = {}
    for body in bodies_of(mechanism):
        joint = mechanism.model.joints[body]
        own = efforts[..., joint.idx_v : joint.idx_v + joint.nv]
        if own.any():
            for link, part in _on_both(mechanism, body, own @ motions(mechanism, links, body)).items():
                acting[link] = acting.get(link, 0.0) + part
    return acting


def _joint_spaces(
    mechanism: Mechanism, links: LinkPlacements, efforts: Mapping[str, Coordinate], balls: set[str], loaded: bool
) -> dict[int, Array]:
    """Return wrenches that each tree joint can transmit beside efforts along it, shape (c, k, 6), by joint index."""
    model = mechanism.model
    spaces = {body: held(model, links, body) for body in bodies_of(mechanism)}
    tied = any(not isinstance(constraint, LoopJoint) for constraint in mechanism.constraints)
    if loaded or mechanism.frictions or tied:
        return spaces
    driven, whole = _driven(mechanism, efforts, balls), dict(spaces)
    for body in driven & spaces.keys():
        whole[body] = np.concatenate([spaces[body], motions(mechanism, links, body)], axis=1)
    scale = np.repeat([1.0, 1.0 / mechanism.closure.extent], 3)  # moments relative to the extent
    pushed = {body for along in efforts.values() for body in along.wrenches(links, np.ones(len(links.q)))}
    for before, after in _passing(mechanism, pushed):
        if after in spaces:
            whole[before] = _common(whole[before] * scale, whole[after] * scale) / scale
            spaces[before] = spaces[before] if before in driven else whole[before]
    return spaces


def _driven(mechanism: Mechanism, efforts: Mapping[str, Coordinate], balls: set[str]) -> set[int]:
    moved_by = np.asarray(mechanism.model.armature) != 0.0
    for along in efforts.values():
        if isinstance(along, LinearCoordinate):
            moved_by = moved_by | (along.weights != 0.0)
    tree = LinkTree.of(mechanism.model)
    return {*tree.moved[moved_by].tolist(), *(mechanism.balls[name].index for name in balls)}


def _passing(mechanism: Mechanism, pushed: set[int]) -> Iterator[tuple[int, int]]:
    """Yield joints with the next one, where the body between has no mass and nothing else acts on it, outermost first.

    Args:
        mechanism: The mechanism.
        pushed: Bodies that efforts along other coordinates than those of joints act on.
    """
    model, loops = mechanism.model, [tie for tie in mechanism.constraints if isinstance(tie, LoopJoint)]
    tied = {model.frames[frame].parentJoint for loop in loops for frame in (loop.first, loop.second)}
    for body in reversed(bodies_of(mechanism)):
        beyond = [k for k in range(1, model.njoints) if model.parents[k] == body]
        light = not model.inertias[body].mass and not np.any(model.inertias[body].inertia)
        if light and len(beyond) == 1 and body not in tied | pushed:
            yield body, beyond[0]


def _common(twist: Array, other: Array) -> Array:
    """Return a basis of the wrenches that two spaces share, shape (c, k, 6), of the least k among the configurations.

    Both are spanned by the rows of arrays of shape (c, k, 6).
    """
    points = []
    for spaces in zip(twist, other, strict=True):
        first, second = (np.linalg.svd(space, full_matrices=False)[1:] for space in spaces)
        a, b = (right[values > SAME * values.max(initial=0.0)] for values, right in (first, second))
        left, values, _ = np.linalg.svd(a @ b.T)
        points.append(left.T[: np.count_nonzero(values > 1.0 - SAME)] @ a)
    least = min(map(len, points))
    return np.stack([basis[:least] for basis in points])


def rows_along(mechanism: Mechanism, along: Coordinate, q: Array) -> Array:
    """Return the rows of a coordinate at configurations, shape (c, nq), as an array of shape (c, nv)."""
    if isinstance(along, LinearCoordinate):
        return np.broadcast_to(along.weights, (len(q), mechanism.model.nv))
    return np.array([along.row(Kinematics.at(mechanism.model, x)) for x in q])


class Source(Record, frozen=True):
    """Something that acts on bodies in one state.

    Attributes:
        name: Of the carrier, the force, or the body.
        kind: That of a carrier, or ``weight``, ``inertia``, ``force``, ``rotor``, ``friction``,
            ``pretension``, ``given``, ``tie``.
        wrenches: On every body, [f; m] at the world's origin, world axes, shape (njoints, 6); of an inertia what the
            motion demands.
    """

    name: str
    kind: str
    wrenches: Array

    def power(self, twists: Array) -> float:
        """Return the power in the motions of bodies, shape (njoints, 6): a term of the equation."""
        return float((self.wrenches * twists).sum())

    def size(self, twists: Array, extent: float) -> float:
        """Return the size of that term whatever its directions are: what its rounding is relative to.

        A force has a moment by an arm of up to the extent [m].
        """
        force, moment, velocity, spin = (
            np.linalg.norm(half, axis=1) for whole in (self.wrenches, twists) for half in (whole[:, :3], whole[:, 3:])
        )
        return float((force * (velocity + extent * spin) + moment * spin).max())


def sources(state: Quantities, actions: Actions, *, split: bool) -> list[Source]:
    """Return everything that acts on the bodies in one state, each inside and outside of any group.

    Args:
        state: Quantities of one row, which has efforts.
        actions: The unknown actions at the configuration of that row.
        split: Whether what accelerations and what velocities demand are told apart.
    """
    run = state.trajectory
    still = np.zeros_like(run.a)
    parts = {", accelerations": replace(run, v=still), ", velocities": replace(run, a=still)} if split else {"": run}
    inertias = (inertia for words, part in parts.items() for inertia in inertias_of(part, words))
    acting = [*_carried(state, actions), *forces_of(run), *weights_of(run), *inertias]
    return [source for source in acting if source.wrenches.any()]


def _spread(run: Trajectory, acting: Mapping[int, Array]) -> Array:
    spread = np.zeros((run.mechanism.model.njoints, 6))
    for body, wrench in acting.items():
        spread[body] += np.reshape(wrench, 6)
    return spread


def _efforts(run: Trajectory, load: Array) -> Array:
    return _spread(run, joint_efforts(run.mechanism, run.link_motion[0], np.reshape(load, (1, 1, -1))))


def _carried(state: Quantities, actions: Actions) -> Iterator[Source]:
    run, model = state.trajectory, state.trajectory.mechanism.model
    links, total = run.link_motion[0], state.reactions.joints
    inner = links.inwards(moved(total, links.places))[0]
    for body in bodies_of(run.mechanism):
        joint = model.joints[body]
        subspace = LinkTree.of(model).subspace[:, joint.idx_v : joint.idx_v + joint.nv]
        part = np.zeros_like(total)
        part[0, body] = inner[body] - np.linalg.pinv(subspace).T @ (subspace.T @ inner[body])
        wrench = moved(links.outwards(part), links.places)[0, body]
        yield Source(str(model.names[body]), "joint", _spread(run, {int(model.parents[body]): -wrench, body: wrench}))
    for constraint in run.mechanism.constraints:
        yield from _of_constraint(run, constraint)
    rest = run.tau[0].copy()
    for carrier in actions.carriers:
        if carrier.kind in ("drive", "law"):
            wrenches, used = _of_drive(run, carrier.name, carrier.kind)
            rest -= used
            yield Source(carrier.name, carrier.kind, wrenches)
    yield Source("end stops and given efforts", "given", _efforts(run, rest))


def _of_constraint(run: Trajectory, constraint: Constraint) -> Iterator[Source]:
    """Yield the action of a constraint but for its part without a multiplier; see ``forces_of``."""
    kind = "loop" if isinstance(constraint, LoopJoint) else "tie" if hasattr(constraint, "rotor") else "coupling"
    links, lam = run.link_motion[0], run.lam[:, run.closure.slices[constraint.name]]
    if acting := constraint.wrenches(links, lam):
        idle = _spread(run, constraint.wrenches(links, 0.0 * lam))
        yield Source(constraint.name, kind, _spread(run, acting) - idle)
    else:
        rows = constraint.rows(run.mechanism.closure.state(run.q[0]))
        yield Source(constraint.name, kind, _efforts(run, lam[0] @ rows))


def _of_drive(run: Trajectory, name: str, kind: str) -> tuple[Array, Array]:
    """Return the wrenches on bodies of a drive, or a known effort at a joint, and its part of ``tau``, shape (nv,)."""
    mechanism, load = run.mechanism, np.zeros(run.v.shape[-1])
    if name in mechanism.balls:
        ball = mechanism.model.joints[mechanism.balls[name].index]
        load[ball.idx_v : ball.idx_v + ball.nv] = run.tau[0, ball.idx_v : ball.idx_v + ball.nv]
        return _efforts(run, load), load
    along = mechanism.coordinates[name]
    if isinstance(along, LinearCoordinate):
        effort = run.tau[:, along.joint] if kind == "law" and along.joint is not None else run.effort_along(name)
        load = load if effort is None else effort[0] * along.weights
        return _efforts(run, load), load
    if name not in run.closure.slices or kind == "law":
        return _spread(run, {}), load
    effort = run.lam[:, run.closure.slices[name].start]
    return _spread(run, along.wrenches(run.link_motion[0], effort)), load


def forces_of(run: Trajectory) -> Iterator[Source]:
    """Yield the actions of forces, pretensions of belts, frictions and rotors in one state."""
    links, [(_, dynamics)] = run.link_motion[0], run.intervals()
    for constraint in run.mechanism.constraints:
        yield Source(
            constraint.name, "pretension", _spread(run, constraint.wrenches(links, np.zeros((1, constraint.size))))
        )
    for name, force in dynamics.forces.items():
        acting, load = force.wrenches(links, run.grid.t, run.v), np.zeros_like(run.v)
        if not acting:
            force.add_load(run.grid.t, run.q, run.v, load)
        yield Source(name, "force", _spread(run, acting) if acting else _efforts(run, load))
    if run.mechanism.frictions:
        from pinarm.mechanics.friction.contact import slip_rows

        rows = slip_rows(run.mechanism.model, run.mechanism.frictions, run.q)[0]
        for contact, f, row in zip(run.mechanism.frictions, run.friction.T, rows, strict=True):
            acting = contact.slip.wrenches(links, f)
            yield Source(contact.name, "friction", _spread(run, acting) if acting else _efforts(run, f[0] * row))
    rotors = -run.mechanism.model.armature * run.a[0]
    for name, joint in run.mechanism.joints.items():
        yield Source(name, "rotor", _efforts(run, np.where(np.arange(len(rotors)) == joint.v, rotors, 0.0)))


def weights_of(run: Trajectory) -> Iterator[Source]:
    """Yield the weights of the bodies."""
    for body, name, demands in _demands(run):
        yield Source(name, "weight", _spread(run, {body: -demands[2]}))


def inertias_of(run: Trajectory, words: str = "") -> Iterator[Source]:
    """Yield the inertia terms of the bodies; ``words`` are added to their names."""
    for body, name, demands in _demands(run):
        yield Source(name + words, "inertia", _spread(run, {body: demands[:2].sum(axis=0)}))


def _demands(run: Trajectory) -> Iterator[tuple[int, str, Array]]:
    """Yield bodies, their names, and the wrenches of accelerations, velocities and gravity, shape (3, 6)."""
    links = run.link_motion[0]
    demands = moved(links.outwards(run.demands), links.places)[:, 0]
    for body in bodies_of(run.mechanism):
        yield body, body_name(run.mechanism.model, body), demands[:, body]

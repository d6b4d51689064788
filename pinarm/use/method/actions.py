"""Unknown actions on the bodies of a mechanism: what joints transmit, multipliers of couplings, efforts of drives.

Each unknown is a wrench per unit on every body that it acts on, so that inside a group of bodies it cancels, and at its
border it is left. A body without mass between two joints passes wrenches on: both joints transmit what either can.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.constraint_rows import Constraint, joint_ties
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.joints import moved_links
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record

SAME = 1e-9
"""Sine of the angle between a wrench and a space of wrenches below which it is in the space: rounding, of numbers near
1."""

LARGE = 2.0**30
"""Multiplier at which a coupling's wrenches are taken per unit, beyond the pretension of belts [N or N*m]."""


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
        """Joint indices of the bodies: joints of rotors and counters move none."""
        return bodies_of(self.mechanism)

    def carrier(self, name: str, kind: str) -> Carrier | None:
        """Return the carrier of a name and a kind; ``None`` where there is none."""
        return next((carrier for carrier in self.carriers if (carrier.name, carrier.kind) == (name, kind)), None)

    def on(self, groups: Flags) -> Array:
        """Return the wrenches of unit unknowns on groups of bodies, shape (g, njoints), in the shape (g, c, K, 6)."""
        return np.asarray(np.einsum("gb,cbkw->gckw", groups.astype(float), self.wrenches))


def bodies_of(mechanism: Mechanism) -> list[int]:
    """Return the joint indices of the bodies of a mechanism."""
    idle = {tie.rotor.index for tie in joint_ties(mechanism.constraints)}
    return [index for index in range(1, mechanism.model.njoints) if index not in idle]


def body_name(model: pin.Model, body: int) -> str:
    """Return the name of a body: its first link."""
    return moved_links(model, body)[0] if body else "ground"


def unknown_actions(
    mechanism: Mechanism, q: Array, efforts: Mapping[str, Coordinate], balls: Iterable[str], law: str = "",
    senses: Mapping[str, float] | None = None, *, loaded: bool = True,
) -> Actions:  # fmt: skip
    """Return the unknown actions.

    Args:
        mechanism: The mechanism.
        q: Configurations, shape (c, nq).
        efforts: Coordinates along which unknown efforts act, by name.
        balls: Ball joints with drives.
        law: Which of the coordinates has a known effort, and is asked for its law of motion; empty for none.
        senses: Sign of the multipliers of couplings in the state of the numbers; others have an unknown for each sign.
        loaded: Whether forces act on bodies: those without mass then pass nothing on.
    """
    links = LinkPlacements.at(mechanism.model, q)
    parts = list[_Part]()
    for body, space in _joint_spaces(mechanism, links, efforts, set(balls), loaded).items():
        parts.append(_Part(str(mechanism.model.names[body]), "joint", _on_both(mechanism, body, space)))
    for constraint in mechanism.constraints:
        if isinstance(constraint, LoopJoint):
            parts.append(_Part(constraint.name, "loop", per_unit(constraint, links)))
        elif not hasattr(constraint, "rotor"):
            parts.append(_of_coupling(mechanism, constraint, links, (senses or {}).get(constraint.name, 0.0)))
    for name, along in efforts.items():
        parts.append(_of_drive(mechanism, name, "law" if name == law else "drive", along, links))
    for name in balls:
        joint = mechanism.model.joints[mechanism.balls[name].index]
        unit = np.eye(mechanism.model.nv)[joint.idx_v : joint.idx_v + joint.nv]
        parts.append(_at_joints(mechanism, name, "drive", unit[None], links))
    return _assembled(mechanism, links, parts)


class _Part(NamedTuple):
    """A carrier: its name, its kind, wrenches per unit on bodies, shape (c, k, 6), and efforts, shape (c, k, nv)."""

    name: str
    kind: str
    acting: dict[int, Array]
    efforts: Array | None = None


def _assembled(mechanism: Mechanism, links: LinkPlacements, parts: Sequence[_Part]) -> Actions:
    """Return the actions of all carriers."""
    carriers, start, wrenches, efforts = list[Carrier](), 0, [], []
    c, bodies, nv = len(links.q), mechanism.model.njoints, mechanism.model.nv
    for name, kind, acting, own in parts:
        count = next((wrench.shape[1] for wrench in acting.values()), 0)
        block = np.zeros((c, bodies, count, 6))
        for body, wrench in acting.items():
            block[:, body] += wrench
        carriers.append(Carrier(name, kind, tuple(sorted(acting)), slice(start, start + count)))
        wrenches.append(block)
        efforts.append(np.zeros((c, count, nv)) if own is None else np.broadcast_to(own, (c, count, nv)))
        start += count
    every = np.concatenate([np.zeros((c, bodies, 0, 6)), *wrenches], axis=2)
    return Actions(mechanism, links, tuple(carriers), every, np.concatenate([np.zeros((c, 0, nv)), *efforts], axis=1))


def _at_joints(mechanism: Mechanism, name: str, kind: str, efforts: Array, links: LinkPlacements) -> _Part:
    """Return a carrier whose unknowns are efforts at joints, shape (c or 1, k, nv)."""
    efforts = np.broadcast_to(efforts, (len(links.q), *efforts.shape[1:]))
    return _Part(name, kind, joint_efforts(mechanism, links, efforts), efforts)


def _on_both(mechanism: Mechanism, body: int, wrenches: Array) -> dict[int, Array]:
    """Return wrenches of the parent on the child as they act on both, shape (c, k, 6)."""
    return {int(mechanism.model.parents[body]): -wrenches, body: wrenches}


def motions(mechanism: Mechanism, links: LinkPlacements, body: int) -> Array:
    """Return the wrenches of unit efforts along the motions of a joint, shape (c, nv, 6)."""
    joint = mechanism.model.joints[body]
    subspace = LinkTree.of(mechanism.model).subspace[:, joint.idx_v : joint.idx_v + joint.nv]
    return _placed(links, body, np.asarray(np.linalg.pinv(subspace), float))


def _placed(links: LinkPlacements, body: int, wrenches: Array) -> Array:
    """Return wrenches in the axes of a link at its origin, shape (k, 6), at the world's origin, shape (c, k, 6)."""
    turn, place = links.turns[:, body], links.places[:, body]
    parts = np.einsum("cab,kpb->ckpa", turn, wrenches.reshape(-1, 2, 3))
    return moved(parts.reshape(len(turn), -1, 6), place[:, None, :])


def held(model: pin.Model, links: LinkPlacements, body: int) -> Array:
    """Return a basis of the wrenches that do no work in a tree joint, at the world's origin, shape (c, k, 6)."""
    joint = model.joints[body]
    return _placed(links, body, _workless(LinkTree.of(model).subspace[:, joint.idx_v : joint.idx_v + joint.nv]))


def _workless(subspace: Array) -> Array:
    """Return wrenches that do no work in motions, shape (6, nv): forces and moments apart where these are, (k, 6)."""
    slides, turns = subspace[:3].any(axis=0), subspace[3:].any(axis=0)
    if (slides & turns).any():
        return np.asarray(np.linalg.svd(subspace.T)[2][subspace.shape[1] :])
    forces, moments = _normal(subspace[:3, slides]), _normal(subspace[3:, turns])
    return np.block([[forces, np.zeros_like(forces)], [np.zeros_like(moments), moments]])


def _normal(vectors: Array) -> Array:
    """Return unit vectors normal to independent ones, shape (3, k), as an array of shape (3 - k, 3)."""
    if vectors.shape[1] == 1 and np.count_nonzero(vectors) == 1:
        return np.asarray(np.eye(3)[vectors[:, 0] == 0.0])
    return np.asarray(np.linalg.svd(vectors.T)[2][vectors.shape[1] :]) if vectors.size else np.eye(3)


def per_unit(constraint: Constraint, links: LinkPlacements, size: float = 1.0) -> dict[int, Array]:
    """Return wrenches of a constraint on bodies per unit of its multipliers, at a size of these, shape (c, m, 6)."""
    wrenches: dict[int, list[Array]] = {}
    for row in np.eye(constraint.size) * size:
        for body, wrench in constraint.wrenches(links, np.broadcast_to(row, (len(links.q), constraint.size))).items():
            wrenches.setdefault(body, []).append(wrench / size)
    return {body: np.stack(each, axis=1) for body, each in wrenches.items()}


def _of_coupling(mechanism: Mechanism, constraint: Constraint, links: LinkPlacements, sense: float) -> _Part:
    """Return the unknowns of a coupling, whose wrenches may differ from one sense to the other, or of a cable."""
    if not isinstance(constraint, JointRelation):
        return _Part(constraint.name, "coupling", per_unit(constraint, links))
    if not constraint.known:
        return _at_joints(mechanism, constraint.name, "coupling", constraint.rows_at(links.q)[:, None], links)
    ways = [per_unit(constraint, links, size) for size in ((sense * LARGE,) if sense else (LARGE, -LARGE))]
    return _Part(
        constraint.name, "coupling", {body: np.concatenate([way[body] for way in ways], axis=1) for body in ways[0]}
    )


def joint_efforts(mechanism: Mechanism, links: LinkPlacements, efforts: Array) -> dict[int, Array]:
    """Return the wrenches of generalised efforts at joints, shape (c, k, nv), on links, shape (c, k, 6)."""
    found: dict[int, Array] = {}
    for body in bodies_of(mechanism):
        joint = mechanism.model.joints[body]
        own = efforts[..., joint.idx_v : joint.idx_v + joint.nv]
        if own.any():
            wrench = own @ motions(mechanism, links, body)
            for link, part in _on_both(mechanism, body, wrench).items():
                found[link] = found.get(link, 0.0) + part
    return found


def _of_drive(mechanism: Mechanism, name: str, kind: str, along: Coordinate, links: LinkPlacements) -> _Part:
    """Return the unknown effort along a coordinate."""
    if isinstance(along, LinearCoordinate):
        return _at_joints(mechanism, name, kind, along.weights[None, None], links)
    acting = along.wrenches(links, np.ones(len(links.q)))
    return _Part(name, kind, {body: wrench[:, None] for body, wrench in acting.items()})


def _joint_spaces(
    mechanism: Mechanism, links: LinkPlacements, efforts: Mapping[str, Coordinate], balls: set[str], loaded: bool
) -> dict[int, Array]:
    """Return wrenches that each tree joint can transmit beside efforts along it, shape (c, k, 6), by joint index."""
    model = mechanism.model
    spaces = {body: held(model, links, body) for body in bodies_of(mechanism)}
    if (
        loaded
        or mechanism.frictions
        or any(not isinstance(constraint, LoopJoint) for constraint in mechanism.constraints)
    ):
        return spaces
    driven = _driven(mechanism, efforts, balls)
    whole = {
        body: np.concatenate([space, motions(mechanism, links, body)], axis=1) if body in driven else space
        for body, space in spaces.items()
    }
    scale = np.repeat([1.0, 1.0 / mechanism.closure.extent], 3)  # moments relative to the extent
    pushed = {body for along in efforts.values() for body in along.wrenches(links, np.ones(len(links.q)))}
    for before, after in _passing(mechanism, pushed):
        if after in spaces:
            whole[before] = _common(whole[before] * scale, whole[after] * scale) / scale
            spaces[before] = spaces[before] if before in driven else whole[before]
    return spaces


def _driven(mechanism: Mechanism, efforts: Mapping[str, Coordinate], balls: set[str]) -> set[int]:
    """Return the joints along which efforts act, those of rotors too."""
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
    model = mechanism.model
    tied = {
        model.frames[frame].parentJoint
        for constraint in mechanism.constraints
        if isinstance(constraint, LoopJoint)
        for frame in (constraint.first, constraint.second)
    }
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
    for first, second in zip(twist, other, strict=True):
        a, b = (_basis(space) for space in (first, second))
        left, values, _ = np.linalg.svd(a @ b.T)
        points.append(left.T[: np.count_nonzero(values > 1.0 - SAME)] @ a)
    least = min(map(len, points))
    return np.stack([basis[:least] for basis in points])


def _basis(space: Array) -> Array:
    """Return orthonormal rows that span those of a matrix, shape (k, 6)."""
    _, values, right = np.linalg.svd(space, full_matrices=False)
    return right[values > SAME * max(float(values.max(initial=0.0)), SAME)]


def rows_along(mechanism: Mechanism, along: Coordinate, q: Array) -> Array:
    """Return the rows of a coordinate at configurations, shape (c, nq), as an array of shape (c, nv)."""
    if isinstance(along, LinearCoordinate):
        return np.broadcast_to(along.weights, (len(q), mechanism.model.nv))
    return np.array([along.row(Kinematics.at(mechanism.model, x)) for x in q])

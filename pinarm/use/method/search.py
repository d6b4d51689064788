"""Search for the groups of bodies and the theorems whose equation has the wanted unknown and no other.

Each group and test motion give one equation: the row of powers of all unknowns. The wanted unknown is a row f of the
same length. One isolation gives it where a row is a multiple of f; several do where f is a combination of theirs. Both
are told by ranks at several closed configurations of no special kind, so that they hold in all.

A test motion gives every body of the isolated group a twist. The power of a wrench in a translation is its component
along the direction, in a rotation about an axis its moment about this axis; the power in a motion that the joints
allow is that of the theorem of kinetic energy, per unit rate of the coordinate.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.engine.kinematics.assembly import GOLDEN, beside
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.reactions import loop_axis, tree_axis
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.geometry.kinematics import moved_by
from pinarm.mechanics.geometry.link_placements import LinkPlacements, moving
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record
from pinarm.use.method.actions import Actions, Carrier, bodies_of, rows_along

WHOLE = 12
"""Bodies up to which all connected groups are looked at, at most 4095; of more the single bodies, and all that is
beyond a joint."""

NOTHING = 1e-9
"""Power of a unit unknown in a unit motion, distance relative to the extent, or sine of an angle, that is rounding."""

SPREAD = 3
"""Configurations of no special kind at which rows are compared."""


class Screw(NamedTuple):
    """A translation along a direction, or a rotation about an axis through a point.

    Attributes:
        direction: Its place among the directions of ``Landmarks``.
        point: Its place among the points; ``None`` of a translation.
    """

    direction: int
    point: int | None = None


class Landmarks(Record, frozen=True):
    """Points and directions of a mechanism at c configurations, in an order that does not depend on these.

    Attributes:
        points: Origins of joints, of the second frames of loop joints, and of links [m], shape (p, c, 3).
        point_names: Their names.
        directions: Axes of joints and loop joints, of the world, and of links, shape (d, c, 3).
        direction_names: Their names.
        extent: Length of the longest branch of links [m].
    """

    points: Array
    point_names: tuple[str, ...]
    directions: Array
    direction_names: tuple[str, ...]
    extent: float

    @classmethod
    def at(cls, mechanism: Mechanism, links: LinkPlacements) -> Landmarks:
        """Return the landmarks of a mechanism whose links are placed."""
        model, bodies = mechanism.model, bodies_of(mechanism)
        loops = [constraint for constraint in mechanism.constraints if isinstance(constraint, LoopJoint)]
        frames = [k for k, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY]
        placed = [links.frame(k) for k in frames]
        points = {str(model.names[body]): links.places[:, body] for body in bodies}
        points |= {loop.name: links.frame(loop.second)[1] for loop in loops}
        points |= {str(model.frames[k].name): place for k, (_, place) in zip(frames, placed, strict=True)}
        axes = {
            f"axis of {model.names[body]}": links.turns[:, body] @ axis
            for body in bodies
            if (axis := tree_axis(model, body)) is not None
        }
        axes |= {
            f"axis of {loop.name}": links.frame(loop.first)[0] @ axis
            for loop in loops
            if (axis := loop_axis(loop)) is not None
        }
        axes |= {name: np.broadcast_to(np.eye(3)[k], (len(links.q), 3)) for k, name in enumerate("xyz")}
        for k, (turn, _) in zip(frames, placed, strict=True):
            axes |= {f"{name} of {model.frames[k].name}": turn[..., column] for column, name in enumerate("xyz")}
        extent = float(mechanism.closure.extent)
        return cls(np.array([*points.values()]), (*points,), np.array([*axes.values()]), (*axes,), extent)

    def place(self, name: str) -> Array | None:
        """Return the point of a name at the first configuration, shape (3,); ``None`` where there is none."""
        return self.points[self.point_names.index(name), 0] if name in self.point_names else None

    @cached_property
    def screws(self) -> list[Screw]:
        """Rotations about axes through points, then translations; no point and no direction twice."""
        points = _distinct(self.points / self.extent)
        ways = _distinct(self.directions, lines=True)
        return [*(Screw(way, point) for way in ways for point in points), *map(Screw, ways)]

    def twists(self, screws: list[Screw]) -> Array:
        """Return the twists [linear; angular] of screws at the world's origin, world axes, shape (s, c, 6)."""
        twists = np.zeros((len(screws), self.points.shape[1], 6))
        for k, (way, point) in enumerate(screws):
            axis = self.directions[way]
            if point is None:
                twists[k, :, :3] = axis
            else:
                twists[k, :, :3], twists[k, :, 3:] = crossed(self.points[point], axis), axis
        return twists


def _distinct(vectors: Array, *, lines: bool = False) -> list[int]:
    """Return the places of vectors, shape (k, c, 3), that differ from all before; lines do not from their opposites."""
    kept: list[int] = []
    for k, vector in enumerate(vectors):
        others = vectors[kept]
        gaps = crossed(np.broadcast_to(vector, others.shape), others) if lines else vector - others
        if not len(kept) or np.abs(gaps).max(axis=(1, 2)).min() > NOTHING:
            kept.append(k)
    return kept


def motion_of_whole(
    mechanism: Mechanism, q: Array, efforts: dict[str, Coordinate], wanted: str
) -> tuple[Array, bool] | None:
    """Return the motion that the joints allow in which a coordinate has the rate 1 and those of other drives stand.

    Args:
        mechanism: The mechanism.
        q: Configurations, shape (c, nq).
        efforts: Coordinates along which unknown efforts act, by name.
        wanted: Name of one of them.

    Returns:
        The twists of all bodies at the world's origin, shape (c, njoints, 6), and whether the mechanism has no other
        motion; ``None`` where there is no such motion.
    """
    closure, model = mechanism.closure, mechanism.model
    still = np.zeros((len(q), model.nv))
    columns, supports = moving(model, q, still, still)[3], moved_by(model)
    rows = {name: rows_along(mechanism, along, q) for name, along in efforts.items()}
    motions, alone = [], True
    for k, x in enumerate(q):
        free = closure.split(closure.rows(closure.state(x))).free if closure.size else np.eye(model.nv)
        asked = np.array([rows[name][k] for name in rows]) @ free
        unit = np.array([float(name == wanted) for name in rows])
        part = np.linalg.lstsq(asked, unit, rcond=None)[0]
        if np.abs(asked @ part - unit).max() > NOTHING:
            return None
        motions.append((supports * (free @ part)) @ columns[k].T)
        alone &= free.shape[1] == 1
    return np.array(motions), alone


class Step(Record, frozen=True):
    """One equation: a group of bodies and a theorem.

    Attributes:
        group: Which bodies are isolated, shape (njoints,).
        screw: The test motion; ``None`` of the motion of the whole.
        rows: Powers of all unknowns in it, shape (c, K).
        left: Which unknowns are left in it, shape (K,).
        twists: The motion that it gives the bodies, [linear; angular] at the world's origin, shape (c, njoints, 6).
    """

    group: Flags
    screw: Screw | None
    rows: Array
    left: Flags
    twists: Array

    def unknowns(self, actions: Actions) -> list[Carrier]:
        """Return the carriers of unknowns that are left in the equation."""
        return [carrier for carrier in actions.carriers if self.left[carrier.columns].any()]


class Chain(Record, frozen=True):
    """Equations that give the wanted unknown together.

    Attributes:
        steps: The equations, those of other unknowns first.
        opened: What they have as unknowns beside the wanted one.
    """

    steps: tuple[Step, ...]
    opened: tuple[Carrier, ...] = ()


class Search(Record, frozen=True):
    """The groups of a mechanism with its unknowns.

    Attributes:
        actions: The unknowns at c configurations.
        landmarks: Points and directions there.
        wanted: The wanted unknown as a function f of all, shape (c, K).
    """

    actions: Actions
    landmarks: Landmarks
    wanted: Array

    @cached_property
    def groups(self) -> Flags:
        """Connected groups of bodies, the smallest first, shape (g, njoints)."""
        return connected_groups(self.actions.mechanism, self.actions)

    @property
    def complete(self) -> bool:
        """Whether all connected groups are looked at."""
        return len(self.actions.bodies) <= WHOLE

    @cached_property
    def _scale(self) -> Array:
        """Factors that make lengths relative to the extent, of motions, shape (6,)."""
        return np.repeat([1.0, 1.0 / self.landmarks.extent], 3)

    @cached_property
    def _unknowns(self) -> Array:
        """Wrenches of the unknowns on all groups, scaled to the length 1, shape (g, c, K, 6)."""
        sized = self.actions.wrenches * self._scale / self.sizes[:, None, :, None]
        return np.asarray(np.einsum("gb,cbkw->gckw", self.groups.astype(float), sized))

    @cached_property
    def sizes(self) -> Array:
        """Lengths of the unknowns' wrenches where they act most, shape (c, K)."""
        lengths = np.linalg.norm(self.actions.wrenches * self._scale, axis=-1).max(axis=1)
        return np.where(lengths > 0.0, lengths, 1.0)

    @cached_property
    def _wanted(self) -> Array:
        """The wanted function of unknowns of the length 1, of the length 1 itself, shape (c, K)."""
        function = self.wanted / self.sizes
        return np.asarray(function / np.linalg.norm(function, axis=-1, keepdims=True))

    @cached_property
    def _twists(self) -> Array:
        twists = self.landmarks.twists(self.landmarks.screws) / self._scale
        return np.asarray(twists / np.linalg.norm(twists, axis=-1, keepdims=True))

    @cached_property
    def possible(self) -> list[int]:
        """Groups for which some motion leaves the wanted unknown alone, whether by a theorem of ``Screw`` or not."""
        rows, wanted = self._unknowns, np.broadcast_to(self._wanted[None, :, :, None], (*self._unknowns.shape[:3], 1))
        best = np.linalg.pinv(rows, rcond=NOTHING) @ wanted
        missed = np.abs(rows @ best - wanted).max(axis=(1, 2, 3))
        return np.flatnonzero(missed < NOTHING).tolist()

    def single(self) -> list[Step]:
        """Return the isolations that give the wanted unknown alone, those with the fewest bodies with mass first."""
        steps = []
        for place in self.possible:
            rows = np.einsum("ckw,scw->sck", self._unknowns[place], self._twists)
            along = np.einsum("sck,ck->sc", rows, self._wanted)
            left = np.abs(rows - along[..., None] * self._wanted).max(axis=(1, 2))
            alone = (left < NOTHING) & (np.abs(along).min(axis=1) > NOTHING)
            steps += [self._step(place, int(k)) for k in np.flatnonzero(alone)]
        return sorted(steps, key=self.cost)

    def _step(self, place: int, screw: int) -> Step:
        group, motion = self.groups[place], self.landmarks.screws[screw]
        return self.step(group, motion, group[None, :, None] * self.landmarks.twists([motion])[0][:, None])

    def step(self, group: Flags, motion: Screw | None, twists: Array) -> Step:
        """Return the equation of a group and the motions of its bodies, shape (c, njoints, 6)."""
        rows = np.einsum("cbkw,cbw->ck", self.actions.wrenches, twists)
        size = np.linalg.norm(twists / self._scale, axis=-1).max(axis=1, keepdims=True)
        return Step(group, motion, rows, np.abs(rows / (self.sizes * size)).max(axis=0, initial=0.0) > NOTHING, twists)

    def cost(self, step: Step) -> tuple[int, ...]:
        """Return the sort key of an equation: unknowns, bodies with mass, bodies, and axes of joints before others."""
        inertias = self.actions.mechanism.model.inertias
        massive = sum(bool(inertias[body].mass) for body in np.flatnonzero(step.group).tolist())
        way = () if step.screw is None else (step.screw.direction, step.screw.point or 0)
        return int(step.left.sum()), massive, int(step.group.sum()), *way

    def chain(self) -> Chain | None:
        """Return equations that give the wanted unknown together; ``None`` where nothing does: it is not determined.

        Joints are opened one at a time, those with the fewest unknowns first, then the loop joints together: open
        there, what is left is a tree.
        """
        free = [carrier for carrier in self.actions.carriers if carrier.kind in ("joint", "loop", "coupling")]
        ordered = sorted(free, key=lambda place: (place.count, place.kind == "joint"))
        ties = tuple(place for place in free if place.kind != "joint")
        alone = [(place,) for place in ordered] if self.complete and self.actions.mechanism.closure.size else []
        for opened in (*alone, ties):
            if opened and (through := self._through(opened)):
                return through
        return None

    def _through(self, opened: tuple[Carrier, ...]) -> Chain | None:
        inner = np.zeros(self.wanted.shape[1], dtype=bool)
        for place in opened:
            inner[place.columns] = True
        steps = list(self._equations(inner))
        if not steps:
            return None
        rows = np.array([self._reduced(step.rows, inner) for step in steps])  # (e, c, 1 + k)
        unit = self._reduced(self.wanted, inner)
        chosen = _fewest(rows, unit)
        place = np.abs(rows[:, 0]) > NOTHING  # the equation with the wanted unknown comes last
        chosen.sort(key=lambda k: (bool(place[k, 0]), np.count_nonzero(place[k, 1:]), self.cost(steps[k])))
        return Chain(tuple(steps[k] for k in chosen), opened) if chosen else None

    def _reduced(self, rows: Array, inner: Flags) -> Array:
        """Return rows as powers of the wanted unknown and of the opened ones, shape (c, 1 + k)."""
        rows, wanted = rows / self.sizes, self.wanted / self.sizes
        outside = np.where(inner, 0.0, wanted)
        square = np.maximum((outside**2).sum(axis=-1), NOTHING**2)
        part = (rows * outside).sum(axis=-1) / square
        return np.concatenate([part[:, None], rows[:, inner]], axis=1)

    def _equations(self, inner: Flags) -> Iterator[Step]:
        """Yield equations without other unknowns than some and the wanted one, the simplest first, none twice."""
        outer, wanted = self._unknowns[:, :, ~inner], self._wanted[:, ~inner]
        length = np.linalg.norm(wanted, axis=-1, keepdims=True)
        unit = wanted / np.where(length > 0.0, length, 1.0)
        others = outer - np.einsum("ck,gclw,cl->gckw", unit, outer, unit)
        values = np.linalg.svd(others, compute_uv=False)
        sizes = values.shape[-1]
        ranks = (values > NOTHING).sum(axis=-1).max(axis=1) if sizes else np.zeros(len(others), int)
        equations = []
        for place in np.flatnonzero(ranks < 6).tolist():
            left = np.einsum("ckw,scw->sck", others[place], self._twists)
            row = np.einsum("ckw,scw->sck", self._unknowns[place], self._twists)
            size, any_left = np.abs(left).max(axis=(1, 2), initial=0.0), np.abs(row).max(axis=2).min(axis=1)
            equations += [self._step(place, int(k)) for k in np.flatnonzero((size < NOTHING) & (any_left > NOTHING))]
        kept = np.zeros((0, len(self.wanted) * (1 + int(inner.sum()))))
        for step in sorted(equations, key=self.cost):
            row = self._reduced(step.rows, inner).ravel()
            row = row / np.linalg.norm(row)
            if all(np.abs(kept - way).max(axis=1).min(initial=1.0) > NOTHING for way in (row, -row)):
                kept = np.vstack([kept, row])
                yield step


def _fewest(rows: Array, wanted: Array) -> list[int]:
    """Return the places of few rows, shape (e, c, k), of which the wanted one, shape (c, k), is a combination.

    Rows come simplest first: each one with the wanted unknown in turn, completed by the simplest that are independent.
    Empty where they do not give it.
    """
    best: list[int] = []
    heads = np.flatnonzero(np.abs(rows[:, :, 0]).min(axis=1) > NOTHING).tolist()
    for head in heads or range(len(rows)):
        basis = _independent(rows[:, 0], head)
        weights = np.linalg.lstsq(rows[basis, 0].T, wanted[0], rcond=None)[0]
        chosen = [place for place, weight in zip(basis, weights, strict=True) if abs(weight) > NOTHING]
        if chosen and (not best or len(chosen) < len(best)) and _give(rows[chosen], wanted):
            best = chosen
    return best


def _independent(rows: Array, head: int) -> list[int]:
    """Return the places of independent rows, shape (e, k): a first one, then each that those before do not span."""
    rest, basis = rows, list[int]()
    while len(new := np.flatnonzero(np.linalg.norm(rest, axis=1) > NOTHING)):
        place = int(new[0]) if basis else head
        unit = rest[place] / np.linalg.norm(rest[place])
        rest = rest - np.outer(rest @ unit, unit)
        basis.append(place)
    return basis


def _give(rows: Array, wanted: Array) -> bool:
    weights = (np.linalg.lstsq(rows[:, k].T, unknown, rcond=None)[0] for k, unknown in enumerate(wanted))
    missed = [np.abs(rows[:, k].T @ weight - wanted[k]).max() for k, weight in enumerate(weights)]
    return bool(max(missed) < NOTHING * 1e2 * max(1.0, float(np.abs(wanted).max())))


def connected_groups(mechanism: Mechanism, actions: Actions) -> Flags:
    """Return connected groups of bodies, the smallest first, shape (g, njoints); see ``WHOLE``."""
    model, near = mechanism.model, _near(mechanism, actions)
    groups = {frozenset([body]) for body in actions.bodies}
    if len(near) > WHOLE:
        groups |= {frozenset(near.keys() & map(int, model.subtrees[body])) for body in near}
    border = groups if len(near) <= WHOLE else set()
    while border:
        border = {group | {tied} for group in border for body in group for tied in near[body]} - groups
        groups = groups | border
    ordered = sorted(groups, key=lambda group: (len(group), sorted(group, reverse=True)))
    return np.array([np.isin(np.arange(model.njoints), [*group]) for group in ordered])


def _near(mechanism: Mechanism, actions: Actions) -> dict[int, set[int]]:
    """Return the bodies that joints, loop joints and couplings tie to each body, without the ground."""
    model, near = mechanism.model, {body: set[int]() for body in actions.bodies}
    ties = [(int(model.parents[body]), body) for body in actions.bodies]
    for constraint in mechanism.constraints:
        if isinstance(constraint, LoopJoint):
            first, second = (int(model.frames[k].parentJoint) for k in (constraint.first, constraint.second))
            ties.append((first, second))
    couplings = (carrier.bodies for carrier in actions.carriers if carrier.kind == "coupling")
    for first, second in (*ties, *(pair for bodies in couplings for pair in combinations(bodies, 2))):
        if first and second:
            near[first].add(second)
            near[second].add(first)
    return near


def configurations(mechanism: Mechanism, start: Array) -> Array:
    """Return closed configurations of no special kind, shape (c, nq), near one, shape (nq,)."""
    if mechanism.closure.size:
        return np.array(beside(mechanism, start)[-SPREAD:])
    states, model = [], mechanism.model
    for step in range(SPREAD):
        way = 2.0 * np.remainder(GOLDEN * np.arange(1 + step * model.nv, 1 + (step + 1) * model.nv), 1.0) - 1.0
        states.append(pin.integrate(model, start, mechanism.closure.scale * way))
    return np.array(states)

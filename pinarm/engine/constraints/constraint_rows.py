"""Gaps, rows of G and drifts of constraints and coordinates, at many states at once.

Loop joints, distances, points and rotations of links are pairs of frames: those whose paths have like joints and that
hold the same are evaluated together. Couplings are functions of the joint coordinates.

States lead, q has the shape (.., nq); of variants of a model it is (n, k, nq), or (n, 1, nq) where all move alike.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from pinarm.arrays import Array, Indices, constants_of
from pinarm.input.units import Unit
from pinarm.mechanics.ball_joints import BallCoordinate
from pinarm.mechanics.coordinates import Coordinate, HeldCoordinate, LinearCoordinate, PairCoordinate, PathLength
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.frame_pairs import FramePairs, RelativeMotion, likeness, power
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import LinkTree, components_first, states_first
from pinarm.mechanics.geometry.model_variants import Model, ModelVariants, VariantsDiffer
from pinarm.mechanics.geometry.pairs import TiedFrames
from pinarm.mechanics.joints import Joint
from pinarm.mechanics.loops.loop_joints import CableLoop, LoopJoint
from pinarm.mechanics.loops.lower_pairs import TurnedAbout
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.pairs import Pair
    from pinarm.mechanics.rotors import GearedRotor


class Constraint(Protocol):
    """m rows of G that belong together, such as those of one joint."""

    @property
    def name(self) -> str: ...

    @property
    def size(self) -> int:
        """Number m of rows."""

    @property
    def side(self) -> float:
        """Sense in which its multiplier can act, 1 or -1, as of a cam that only pushes; 0 where it holds both ways.

        A constraint with a side may open: its gap then has that sign.
        """

    def unit(self, row: int) -> Unit:
        """Return the unit of the gap in a row: m or rad."""

    def gap(self, state: Kinematics) -> Array: ...

    def rows(self, state: Kinematics) -> Array: ...

    def drift(self, state: Kinematics) -> Array:
        """Return G' v, shape (m,)."""

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return the wrenches on links of lam, shape (n, m): joint index -> [f; m] at the world's origin, (n, 6)."""


class GuidedCoordinate(HeldCoordinate, frozen=True):
    """A coordinate that follows a law, or that drives hold."""


class OneSidedConstraint(Constraint, Protocol):
    """A constraint of one row that pushes only, or pulls only, and opens where it would have to do the other."""

    @property
    def kind(self) -> str: ...

    @property
    def opens(self) -> str:
        """Effect of the opening, in words, such as "the follower lifts off"."""

    def push(self, q: Array, lam: Array) -> Array:
        """Return with what multipliers, shape (n,), act [N, or N*m], negative against its sense; shape (n,)."""

    def push_unit(self) -> Unit: ...

    def whereabouts(self, q: Array) -> str:
        """Return the place of a configuration, shape (nq,), along the constraint, in words; may be empty."""


class JointTie(Constraint, Protocol):
    """Tie of a joint without a body to a coordinate: the joint of a rotor, or a joint that counts turns."""

    @property
    def rotor(self) -> Joint: ...

    @property
    def coordinate(self) -> Coordinate: ...


def one_sided(constraints: Iterable[Constraint]) -> list[OneSidedConstraint]:
    """Return the constraints with a side."""
    return [cast("OneSidedConstraint", constraint) for constraint in constraints if constraint.side]


def joint_ties(constraints: Iterable[Constraint]) -> list[JointTie]:
    """Return the constraints that tie joints without a body."""
    return [cast("JointTie", constraint) for constraint in constraints if hasattr(constraint, "rotor")]


BLOCK = 4000
"""Links times states that are worked on at once: arrays of more would not stay in the processor's cache."""

Measured = Constraint | Coordinate
"""Constraint or coordinate: an object with rows of G, or with rows of the same form."""


class PairRows(Record, frozen=True):
    """Rows of pairs of frames that hold the same.

    Attributes:
        sense: 1, or -1 of rows with the opposite sign.
        rows: The rows of each, shape (m, L).
    """

    pair: Pair
    sense: float
    frames: FramePairs
    rows: Indices


class ConstraintRows(Record, frozen=True):
    """Rows of constraints and coordinates, numbered through: gaps, G and drifts.

    Attributes:
        constants: Constants that the gaps are measured from, such as the length of a cable [m or rad], shape (m,).
        relations: First row of each relation of joint coordinates, and the relation.
        turning: Row of each angle that is known up to whole turns, and the coordinate or rotor that counts them.
    """

    model: Model
    pairs: tuple[PairRows, ...]
    constants: Array
    relations: tuple[tuple[int, JointRelation | LinearCoordinate], ...]
    turning: tuple[tuple[int, TurnedAbout | GearedRotor], ...]

    @classmethod
    def of(cls, model: Model, ones: Sequence[Measured]) -> ConstraintRows:
        """Return the rows of constraints or coordinates of a model."""
        alike: dict[Hashable, tuple[Pair, float, list[tuple[int, int]], list[range]]] = {}
        relations, turning = list[tuple[int, JointRelation | LinearCoordinate]](), []
        constants = list[float]()
        for measured in ones:
            coordinate = measured.coordinate if isinstance(measured, GuidedCoordinate) else measured
            rows = range(start := len(constants), start + getattr(coordinate, "size", 1))
            constants += [coordinate.length if isinstance(coordinate, CableLoop) else 0.0] * len(rows)
            if isinstance(coordinate, TurnedAbout) or (
                hasattr(coordinate, "rotor") and cast("GearedRotor", coordinate).coordinate.wraps
            ):
                turning.append((start, cast("TurnedAbout | GearedRotor", coordinate)))
            for number, (sense, part) in enumerate(parts_of(model, coordinate)):
                if isinstance(part, LinearCoordinate):
                    relations.append((start, part if sense > 0.0 else replace(part, weights=-part.weights)))
                    continue
                if not isinstance(part, TiedFrames):
                    relations.append((start, part))
                    continue
                alikeness = likeness(model, part.first, part.second)
                key = constants_of(part.pair), sense, alikeness, number  # one row of a cable
                _, _, frames, places = alike.setdefault(key, (part.pair, sense, [], []))
                frames.append((part.first, part.second))
                places.append(rows)
        known = {tuple(frames): FramePairs.of(model, frames) for _, _, frames, _ in alike.values()}
        pairs = (
            PairRows(pair, sense, known[tuple(frames)], np.array(places).T)
            for pair, sense, frames, places in alike.values()
        )
        return cls(model, tuple(pairs), np.array(constants), tuple(relations), tuple(turning))

    @property
    def size(self) -> int:
        return len(self.constants)

    def at(self, q: Array) -> EvaluatedRows:
        return EvaluatedRows(self, q)


def parts_of(model: Model, element: Measured) -> Sequence[tuple[float, TiedFrames | JointRelation | LinearCoordinate]]:
    """Return the signed pairs of frames and relations whose rows, added up, are those of a constraint or coordinate."""
    if isinstance(element, JointRelation | LinearCoordinate | LoopJoint):
        return [(1.0, element)]
    if isinstance(element, BallCoordinate) and isinstance(model, ModelVariants):
        raise VariantsDiffer("the placement of a ball joint")
    if hasattr(element, "rotor"):
        tie = cast("GearedRotor", element)
        weights, places = np.zeros(model.nv), np.zeros(model.nv, dtype=np.intp)
        weights[tie.rotor.v], places[tie.rotor.v] = 1.0, tie.rotor.q
        turned = [(-sense, part) for sense, part in parts_of(model, tie.coordinate)]
        return [(1.0, LinearCoordinate(tie.coordinate.unit, weights, places)), *turned]
    measured = element.path if isinstance(element, CableLoop) else element
    assert isinstance(measured, PairCoordinate | PathLength), f"no rows of {type(element).__name__}"
    return [(1.0, way) for way in measured.ways]


class EvaluatedRows(Record, frozen=True):
    """The rows at configurations; each kind of number is computed when it is asked for."""

    rows: ConstraintRows
    q: Array

    @cached_property
    def states(self) -> tuple[int, ...]:
        """Shape of the states, all variants counted where they are placed differently."""
        placed = [motion.p.shape[3:] for _, motions in self._motions[:1] for motion in motions]
        return (len(self.q), *np.broadcast_shapes(self.q.shape[1:-1], *placed))

    @cached_property
    def _motions(self) -> list[tuple[slice, list[RelativeMotion]]]:
        """The relative motions of all pairs, block by block of states."""
        if not self.rows.pairs:
            return []
        tree, motions = LinkTree.of(self.rows.model), []
        frames = {id(pairs.frames): pairs.frames for pairs in self.rows.pairs}  # one motion serves all they measure
        length = max(1, BLOCK // (len(tree.parents) * max(1, int(np.prod(self.q.shape[1:-1])))))
        for start in range(0, max(1, len(self.q)), length):
            part = slice(start, start + length)
            turns, arms = tree.placed(self.q[part])
            places = tree.summed(arms)
            moved = {key: own.at(turns, places) for key, own in frames.items()}
            motions.append((part, [moved[id(pairs.frames)] for pairs in self.rows.pairs]))
        return motions

    def _pairs(self) -> Iterator[tuple[slice, PairRows, RelativeMotion]]:
        for part, motions in self._motions:
            yield from ((part, pairs, motion) for pairs, motion in zip(self.rows.pairs, motions, strict=True))

    @cached_property
    def gaps(self) -> Array:
        """The gaps, or the values of coordinates [m or rad], shape (.., m)."""
        gaps = np.zeros((self.rows.size, *self.states), self.q.dtype)
        for part, pairs, motion in self._pairs():
            for row, gap in zip(pairs.rows, pairs.pair.gap(*motion.flat), strict=True):
                gaps[row, part] += pairs.sense * _spread(gap, motion)
        flat = self.q.reshape(-1, self.q.shape[-1])
        for row, relation in self.rows.relations:
            own = relation.at(flat) if isinstance(relation, LinearCoordinate) else relation.gaps_at(flat)
            gaps[row] += own.reshape(self.q.shape[:-1])
        for row, coordinate in self.rows.turning:
            gaps[row] += coordinate.missing_turns(gaps[row], self.q)
        return states_first(gaps - self.rows.constants.reshape(-1, *(1,) * len(self.states)), 1)

    @cached_property
    def columns(self) -> Array:
        """G, components first, shape (m, nv, ..)."""
        columns = np.zeros((self.rows.size, self.rows.model.nv, *self.states), self.q.dtype)
        for part, pairs, motion in self._pairs():
            columns[pairs.rows[:, None], pairs.frames.velocities, part] += pairs.sense * motion.rows(pairs.pair)
        flat = self.q.reshape(-1, self.q.shape[-1])
        for row, relation in self.rows.relations:
            if isinstance(relation, LinearCoordinate):
                columns[row] += relation.weights.reshape(-1, *(1,) * len(self.states))
            else:
                columns[row] += relation.rows_at(flat).T.reshape(columns.shape[1:])
        return columns

    @cached_property
    def matrices(self) -> Array:
        """G, shape (.., m, nv)."""
        return np.ascontiguousarray(np.moveaxis(self.columns, (0, 1), (-2, -1)))

    def drifts(self, v: Array) -> Array:
        """Return ``G' v`` for velocities, shape (.., nv), as an array of shape (.., m)."""
        drifts = np.zeros((self.rows.size, *self.states), np.result_type(self.q, v))
        rates = components_first(v, 1)
        for part, pairs, motion in self._pairs():
            e, w = motion.directions(pairs.pair)
            dp, omega, ddp, domega = motion.rates(rates[:, part])
            bend = pairs.pair.bend(*motion.flat, *(x.reshape(3, -1) for x in (dp, omega)))
            own = (power(e, ddp[:, None]) + power(w, domega[:, None]))[:, 0]
            drifts[pairs.rows, part] += pairs.sense * (own + _spread(bend, motion))
        flat, speeds = self.q.reshape(-1, self.q.shape[-1]), v.reshape(-1, v.shape[-1])
        for row, relation in self.rows.relations:
            if isinstance(relation, JointRelation):
                drifts[row] += relation.drifts_at(flat, speeds).reshape(self.q.shape[:-1])
        return states_first(drifts, 1)


def _spread(x: Array, motion: RelativeMotion) -> Array:
    """Return a number of all pairs, shape (.., N), by pairs and states; 1 in place of N where all are alike."""
    return x.reshape(*x.shape[:-1], *(motion.p.shape[1:] if x.shape[-1] > 1 else (1,) * (motion.p.ndim - 1)))


def rows_of(model: Model, coordinates: Sequence[Coordinate], q: Array) -> Array:
    """Return the rows of coordinates at configurations, shape (n, nq), as an array of shape (n, d, nv)."""
    return ConstraintRows.of(model, coordinates).at(q).matrices

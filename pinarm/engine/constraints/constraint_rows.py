"""Gaps, rows of G and drifts of constraints and coordinates, at many states at once.

Loop joints, distances, points and rotations of links are pairs of frames: those whose paths have like joints and that
hold the same are evaluated together. Couplings are functions of the joint coordinates.

States lead, q has the shape (.., nq); of variants of a model it is (n, k, nq), or (n, 1, nq) where all move alike.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from pinarm.arrays import Array, Indices, constants_of
from pinarm.mechanics.ball_joints import BallCoordinate
from pinarm.mechanics.coordinates import Constraint, Coordinate, FrameCoordinate, Relation
from pinarm.mechanics.geometry.frame_pairs import FramePairs, RelativeMotion, likeness, power
from pinarm.mechanics.geometry.link_tree import LinkTree, components_first, states_first
from pinarm.mechanics.geometry.model_variants import Model, ModelVariants, VariantsDiffer
from pinarm.mechanics.geometry.pairs import TiedFrames
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.pairs import Pair
    from pinarm.mechanics.rotors import GearedRotor


def one_sided(constraints: Iterable[Constraint]) -> list[Constraint]:
    """Return the constraints with a side."""
    return [constraint for constraint in constraints if constraint.side]


def joint_ties(constraints: Iterable[Constraint]) -> list[GearedRotor]:
    """Return the constraints that tie joints without a body."""
    return [cast("GearedRotor", constraint) for constraint in constraints if hasattr(constraint, "rotor")]


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
        relations: Row and sign of each relation of joint coordinates, and the relation.
        turning: Row of each angle that is known up to whole turns, and the coordinate or rotor that counts them.
    """

    model: Model
    pairs: tuple[PairRows, ...]
    constants: Array
    relations: tuple[tuple[int, float, Relation], ...]
    turning: tuple[tuple[int, FrameCoordinate | GearedRotor], ...]

    @classmethod
    def of(cls, model: Model, elements: Sequence[Measured]) -> ConstraintRows:
        """Return the rows of constraints or coordinates of a model."""
        alike: dict[Hashable, tuple[Pair, float, list[tuple[int, int]], list[range]]] = {}
        relations, turning, constants = list[tuple[int, float, Relation]](), [], list[float]()
        for element in elements:
            if isinstance(element, BallCoordinate) and isinstance(model, ModelVariants):
                raise VariantsDiffer("the placement of a ball joint")
            size, offset = (element.size, element.offset) if isinstance(element, Constraint) else (1, 0.0)
            rows = range(start := len(constants), start + size)
            constants += [offset] * size
            if element.turning is not None:
                turning.append((start, cast("FrameCoordinate | GearedRotor", element.turning)))
            for number, (sense, part) in enumerate(element.parts):
                if not isinstance(part, TiedFrames):
                    relations.append((start, sense, part))
                    continue
                key = constants_of(part.pair), sense, likeness(model, part.first, part.second), number
                _, _, frames, places = alike.setdefault(key, (part.pair, sense, [], []))  # one row of a cable
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
        for row, sense, relation in self.rows.relations:
            gaps[row] += sense * relation.at(flat).reshape(self.q.shape[:-1])
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
        for row, sense, relation in self.rows.relations:
            columns[row] += sense * relation.rows_at(flat).T.reshape(len(columns[row]), *self.q.shape[:-1])
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
        for row, sense, relation in self.rows.relations:
            drifts[row] += sense * relation.drifts_at(flat, speeds).reshape(self.q.shape[:-1])
        return states_first(drifts, 1)


def _spread(x: Array, motion: RelativeMotion) -> Array:
    """Return a number of all pairs, shape (.., N), by pairs and states; 1 in place of N where all are alike."""
    return x.reshape(*x.shape[:-1], *(motion.p.shape[1:] if x.shape[-1] > 1 else (1,) * (motion.p.ndim - 1)))


def rows_of(model: Model, coordinates: Sequence[Coordinate], q: Array) -> Array:
    """Return the rows of coordinates at configurations, shape (n, nq), as an array of shape (n, d, nv)."""
    return ConstraintRows.of(model, coordinates).at(q).matrices

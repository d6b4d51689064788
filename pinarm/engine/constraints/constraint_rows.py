"""Gaps, rows of G and drifts of constraints and coordinates, at many states at once.

Loop joints, distances, points and rotations of links are pairs of frames: those whose paths have like joints and that
hold the same are evaluated together. Couplings are functions of the joint coordinates.

States lead, q has the shape (.., nq); of variants of a model it is (n, k, nq), or (n, 1, nq) where all move alike.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from pinarm.arrays import Array, Indices, constants_of
from pinarm.engine.constraints.constraint import Constraint, GuidedCoordinate
from pinarm.mechanics.ball_joints import BallCoordinate
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, PairCoordinate, PathLength
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.frame_pairs import FramePairs, RelativeMotion, likeness, power
from pinarm.mechanics.geometry.link_tree import LinkTree, components_first, states_first
from pinarm.mechanics.geometry.model_variants import Model
from pinarm.mechanics.geometry.pairs import TiedFrames
from pinarm.mechanics.loops.cable import CableLoop
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.relative import TurnedAbout
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.pairs import Pair
    from pinarm.mechanics.geometry.vectors import Axes
    from pinarm.mechanics.rotors import GearedRotor

BLOCK = 4000
"""Links times states that are worked on at once: arrays of more would not stay in the processor's cache."""

Measured = Constraint | Coordinate
"""What has rows of G, or rows like those."""


class PairRows(Record, frozen=True):
    """Rows of pairs of frames that hold the same.

    Attributes:
        pair: What they hold.
        frames: The frames.
        rows: The rows of each, shape (m, L).
        entries: Places of their coefficients among the entries of G, shape (m, s, L).
    """

    pair: Pair
    frames: FramePairs
    rows: Indices
    entries: Indices


class ConstraintRows(Record, frozen=True):
    """What constraints and coordinates measure, their rows numbered through.

    Attributes:
        model: The model, or variants of one.
        pairs: Pairs of frames.
        constants: What the gaps are measured from, such as the length of a cable [m or rad], shape (m,).
        relations: First row of each relation of joint coordinates, and the relation.
        turning: Row of each angle that is known but for whole turns, and the coordinate or rotor that counts them.
        pattern: Where G has entries.
    """

    model: Model
    pairs: tuple[PairRows, ...]
    constants: Array
    relations: tuple[tuple[int, JointRelation | LinearCoordinate], ...]
    turning: tuple[tuple[int, TurnedAbout | GearedRotor], ...]
    pattern: Pattern

    @classmethod
    def of(cls, model: Model, ones: Sequence[Measured]) -> ConstraintRows:
        """Return the rows of constraints or coordinates of a model."""
        alike: dict[Hashable, tuple[Pair, list[tuple[int, int]], list[range]]] = {}
        relations, turning = list[tuple[int, JointRelation | LinearCoordinate]](), []
        constants = list[float]()
        for given in ones:
            one = given.coordinate if isinstance(given, GuidedCoordinate) else given
            rows = range(start := len(constants), start + getattr(one, "size", 1))
            constants += [one.length if isinstance(one, CableLoop) else 0.0] * len(rows)
            if isinstance(one, TurnedAbout) or (hasattr(one, "rotor") and cast("GearedRotor", one).coordinate.wraps):
                turning.append((start, cast("TurnedAbout | GearedRotor", one)))
            for number, part in enumerate(parts_of(model, one)):
                if not isinstance(part, TiedFrames):
                    relations.append((start, part))
                    continue
                key = constants_of(part.pair), likeness(model, part.first, part.second), number  # one row of a cable
                _, frames, places = alike.setdefault(key, (part.pair, [], []))
                frames.append((part.first, part.second))
                places.append(rows)
        groups = [(pair, FramePairs.of(model, frames), np.array(places).T) for pair, frames, places in alike.values()]
        pattern = Pattern.of(model.nv, len(constants), groups, relations)
        pairs = (
            PairRows(pair, frames, rows, pattern.entries(rows, frames.velocities)) for pair, frames, rows in groups
        )
        return cls(model, tuple(pairs), np.array(constants), tuple(relations), tuple(turning), pattern)

    @property
    def size(self) -> int:
        """Number m of rows."""
        return len(self.constants)

    def at(self, q: Array) -> EvaluatedRows:
        """Return the rows at configurations, shape (.., nq)."""
        return EvaluatedRows(self, q)


class Pattern(Record, frozen=True):
    """Where G may have entries other than 0, row by row.

    Attributes:
        nv: Number of velocities.
        rows: Row of every entry, ascending, shape (z,).
        columns: Its velocity, ascending in each row, shape (z,).
        starts: First entry of every row, shape (m + 1,).
    """

    nv: int
    rows: Indices
    columns: Indices
    starts: Indices

    @classmethod
    def of(
        cls, nv: int, size: int, pairs: Sequence[tuple[Pair, FramePairs, Indices]],
        relations: Sequence[tuple[int, JointRelation | LinearCoordinate]],
    ) -> Pattern:  # fmt: skip
        """Return the pattern of m rows."""
        numbers = [
            (rows[:, None] * nv + frames.velocities).ravel() for _, frames, rows in pairs
        ] + [start * nv + moved_by(relation) for start, relation in relations]  # fmt: skip
        every = np.array(sorted({place for part in numbers for place in part.tolist()}), dtype=np.intp)
        rows, columns = np.divmod(every, nv) if nv else (every, every)
        return cls(nv, rows, columns, np.searchsorted(rows, np.arange(size + 1)))

    def entries(self, rows: Indices, columns: Indices) -> Indices:
        """Return the places of entries, shape (m, s, L), in rows, shape (m, L), and columns, shape (s, L)."""
        return np.searchsorted(self.rows * self.nv + self.columns, rows[:, None] * self.nv + columns)


def parts_of(model: Model, one: Measured) -> Sequence[TiedFrames | JointRelation | LinearCoordinate]:
    """Return the pairs of frames and the relations whose rows, added up, are those of a constraint or coordinate."""
    if isinstance(one, JointRelation | LinearCoordinate | LoopJoint):
        return [one]
    if isinstance(one, BallCoordinate):
        return [one.way(model)]
    if hasattr(one, "rotor"):
        tie = cast("GearedRotor", one)
        return [_rotor(model, tie), *map(_reversed, parts_of(model, tie.coordinate))]
    measured = one.path if isinstance(one, CableLoop) else one
    assert isinstance(measured, PairCoordinate | PathLength), f"no rows of {type(one).__name__}"
    return measured.ways


def _rotor(model: Model, one: GearedRotor) -> LinearCoordinate:
    weights, places = np.zeros(model.nv), np.zeros(model.nv, dtype=np.intp)
    weights[one.rotor.v], places[one.rotor.v] = 1.0, one.rotor.q
    return LinearCoordinate(one.coordinate.unit, weights, places)


def _reversed(part: TiedFrames | JointRelation | LinearCoordinate) -> TiedFrames | LinearCoordinate:
    if isinstance(part, TiedFrames):
        return TiedFrames(part.first, part.second, Reversed(part.pair))
    assert isinstance(part, LinearCoordinate), "coordinates of rotors are no couplings"
    return replace(part, weights=-part.weights)


class Reversed(Record, frozen=True):
    """A pair whose rows have the opposite sign.

    Attributes:
        pair: The pair.
    """

    pair: Pair

    @property
    def along(self) -> Sequence[bool]:
        return self.pair.along

    @property
    def about(self) -> Sequence[bool]:
        return self.pair.about

    @property
    def constant(self) -> tuple[Array, Array] | None:
        constant = self.pair.constant
        return None if constant is None else (-constant[0], -constant[1])

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        return [-gap for gap in self.pair.gap(p, axes)]

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        e, w = self.pair.directions(p, axes)
        return -e, -w

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        return -self.pair.bend(p, axes, dp, omega)


def moved_by(relation: JointRelation | LinearCoordinate) -> Indices:
    """Return the velocities that a relation of joint coordinates ties."""
    return relation.moved if isinstance(relation, LinearCoordinate) else relation.joints


class EvaluatedRows(Record, frozen=True):
    """The rows at configurations; each kind of number is computed when it is asked for.

    Attributes:
        rows: What is evaluated.
        q: The configurations, shape (.., nq).
    """

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
        tree, found = LinkTree.of(self.rows.model), []
        length = max(1, BLOCK // (len(tree.parents) * max(1, int(np.prod(self.q.shape[1:-1])))))
        for start in range(0, max(1, len(self.q)), length):
            part = slice(start, start + length)
            turns, arms = tree.placed(self.q[part])
            found.append((part, [pairs.frames.at(turns, arms) for pairs in self.rows.pairs]))
        return found

    def _pairs(self) -> Iterator[tuple[slice, PairRows, RelativeMotion]]:
        for part, motions in self._motions:
            yield from ((part, pairs, motion) for pairs, motion in zip(self.rows.pairs, motions, strict=True))

    @cached_property
    def gaps(self) -> Array:
        """The gaps, or the values of coordinates [m or rad], shape (.., m)."""
        found = np.zeros((self.rows.size, *self.states), self.q.dtype)
        for part, pairs, motion in self._pairs():
            for row, gap in zip(pairs.rows, pairs.pair.gap(*motion.flat), strict=True):
                found[row, part] += _spread(gap, motion)
        flat = self.q.reshape(-1, self.q.shape[-1])
        for row, relation in self.rows.relations:
            own = relation.at(flat) if isinstance(relation, LinearCoordinate) else relation.gaps_at(flat)
            found[row] += own.reshape(self.q.shape[:-1])
        for row, one in self.rows.turning:
            found[row] += one.missing_turns(found[row], self.q)
        return states_first(found - self.rows.constants.reshape(-1, *(1,) * len(self.states)), 1)

    @cached_property
    def entries(self) -> Array:
        """The entries of G in the order of the pattern, shape (z, ..)."""
        pattern, found = self.rows.pattern, np.zeros((len(self.rows.pattern.rows), *self.states), self.q.dtype)
        for part, pairs, motion in self._pairs():
            found[pairs.entries, part] += motion.rows(pairs.pair)
        flat = self.q.reshape(-1, self.q.shape[-1])
        for row, relation in self.rows.relations:
            own = slice(*pattern.starts[row : row + 2])
            if isinstance(relation, LinearCoordinate):
                found[own] += relation.weights[pattern.columns[own]].reshape(-1, *(1,) * len(self.states))
            else:
                rows = relation.rows_at(flat)[:, pattern.columns[own]]
                found[own] += rows.T.reshape(-1, *self.q.shape[:-1])
        return found

    def times(self, x: Array) -> tuple[Array, Array]:
        """Return ``G x``, of shape (.., m), for x of shape (.., nv), and the sums of the sizes of its terms."""
        pattern, terms = self.rows.pattern, self.entries * components_first(x, 1)[self.rows.pattern.columns]
        held = np.diff(pattern.starts) > 0
        total, sizes = np.zeros((2, self.rows.size, *terms.shape[1:]))
        if held.any():
            total[held] = np.add.reduceat(terms, pattern.starts[:-1][held])
            sizes[held] = np.add.reduceat(np.abs(terms), pattern.starts[:-1][held])
        return states_first(total, 1), states_first(sizes, 1)

    def some(self, rows: Indices, columns: Indices) -> Array:
        """Return some rows and columns of G, ascending, components first, shape (r, c, ..)."""
        pattern, place = self.rows.pattern, np.zeros(self.rows.pattern.nv, dtype=np.intp)
        place[columns] = np.arange(len(columns))
        found = np.zeros((len(rows), len(columns), *self.states))
        for k, row in enumerate(rows.tolist()):
            own = slice(pattern.starts[row], pattern.starts[row + 1])
            found[k, place[pattern.columns[own]]] = self.entries[own]
        return found

    @cached_property
    def matrices(self) -> Array:
        """G, shape (.., m, nv)."""
        pattern = self.rows.pattern
        found = np.zeros((*self.states, self.rows.size, pattern.nv), self.q.dtype)
        found[..., pattern.rows, pattern.columns] = np.moveaxis(self.entries, 0, -1)
        return found

    def drifts(self, v: Array) -> Array:
        """Return ``G' v`` for velocities, shape (.., nv), as an array of shape (.., m)."""
        found = np.zeros((self.rows.size, *self.states), np.result_type(self.q, v))
        rates = components_first(v, 1)
        for part, pairs, motion in self._pairs():
            e, w = motion.directions(pairs.pair)
            dp, omega, ddp, domega = motion.rates(rates[:, part])
            bend = pairs.pair.bend(*motion.flat, *(x.reshape(3, -1) for x in (dp, omega)))
            own = (power(e, ddp[:, None]) + power(w, domega[:, None]))[:, 0]
            found[pairs.rows, part] += own + _spread(bend, motion)
        flat, speeds = self.q.reshape(-1, self.q.shape[-1]), v.reshape(-1, v.shape[-1])
        for row, relation in self.rows.relations:
            if isinstance(relation, JointRelation):
                found[row] += relation.drifts_at(flat, speeds).reshape(self.q.shape[:-1])
        return states_first(found, 1)


def _spread(x: Array, motion: RelativeMotion) -> Array:
    """Return a number of all pairs, shape (.., N), by pairs and states; 1 in place of N where all are alike."""
    return x.reshape(*x.shape[:-1], *(motion.p.shape[1:] if x.shape[-1] > 1 else (1,) * (motion.p.ndim - 1)))


def rows_of(model: Model, coordinates: Sequence[Coordinate], q: Array) -> Array:
    """Return the rows of coordinates at configurations, shape (n, nq), as an array of shape (n, d, nv)."""
    return ConstraintRows.of(model, coordinates).at(q).matrices

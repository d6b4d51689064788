"""Constraints of one mechanism: loop joints, couplings and guided coordinates, as rows ``G v = 0``.

An open chain has no rows; nothing else distinguishes it.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices, vecmat
from pinarm.engine.constraints.constraint_rows import ConstraintRows
from pinarm.engine.constraints.nullspace import (
    RANK,
    ROUNDING,
    UNCLOSED,
    VANISHED,
    Decomposition,
)
from pinarm.mechanics.coordinates import Constraint, Coordinate, GuidedCoordinate
from pinarm.mechanics.geometry.frame_pairs import Path
from pinarm.mechanics.geometry.kinematics import Kinematics, cached_by_model
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import LinkTree, states_first
from pinarm.mechanics.geometry.model_variants import Model, ModelVariants, VariantsDiffer, placements_of
from pinarm.mechanics.geometry.vectors import lengths, moved
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, replace

SMALL = 0.01
"""Part of its reach below which a row may be that of a joint which repeats others but is a little out of line."""

SEVERAL = 8
"""Configurations times constraints from which on numpy evaluates all in less time than Pinocchio one by one."""

BLOCK = 512
"""Configurations whose G is held at once."""

GUIDED = 4
"""Closures with guides that are kept: states between the rows of a motion ask for that of the rows."""


WIDE = 24
"""Velocities up to which all variants are evaluated at once."""


class Closure(Record, frozen=True):
    """Constraints of one mechanism, stacked."""

    model: pin.Model
    constraints: tuple[Constraint, ...]

    @classmethod
    def of(cls, model: pin.Model, constraints: Sequence[Constraint] = ()) -> Closure:
        """Return the closure of a model."""
        return cls(model, tuple(constraints))

    @property
    def extent(self) -> float:
        """Length [m] of the longest branch of links, from the origin of the world to a joint or a frame.

        Places are rounded relative to it. It is 1 m for a model without lengths.
        """
        return extent(self.model)

    @cached_property
    def scale(self) -> Array:
        """The unit of every coordinate's velocity, shape (nv,): 1 for angles, else a length that suits the extent."""
        return np.where(slides(self.model), unit_of_length(self.extent), 1.0)

    @cached_property
    def measure(self) -> Array:
        """The unit of the gap in every row, shape (m,): 1 for angles, else a length that suits the extent."""
        return self._lengths(float(unit_of_length(self.extent)))

    @cached_property
    def reach(self) -> Array:
        """The length that every row of G can have, shape (m,): the extent, or 1 where it measures an angle."""
        return self._lengths(self.extent)

    def _lengths(self, length: float) -> Array:
        return np.array([length ** float(constraint.unit(row).dimension[0]) for constraint, row in self.owners()])

    @cached_property
    def groups(self) -> Indices:
        """A number for every velocity, shape (nv,): those that rows tie, over others too, have the same one."""
        groups = np.arange(self.model.nv)
        for tied in self._tied:
            groups[np.isin(groups, groups[tied])] = groups[tied].min(initial=self.model.nv)
        return groups

    @cached_property
    def parts(self) -> tuple[tuple[Indices, tuple[Constraint, ...]], ...]:
        """Places of velocities and constraints of every group that rows tie.

        The velocities are those in its loops, or all of one without loops: what gears tie to a loop moves as it does.
        """
        groups: dict[int, list[tuple[Constraint, list[int]]]] = {}
        for constraint, tied in zip(self.constraints, self._tied, strict=True):
            if tied:
                groups.setdefault(int(self.groups[tied[0]]), []).append((constraint, tied))
        parts = []
        for own in groups.values():
            looped = [tied for constraint, tied in own if isinstance(constraint, LoopJoint)] or [
                tied for _, tied in own
            ]
            joints = np.array(sorted({number for tied in looped for number in tied}), dtype=np.intp)
            parts.append((joints, tuple(constraint for constraint, _ in own)))
        return tuple(parts)

    @cached_property
    def _tied(self) -> list[list[int]]:
        """Places of the velocities that every constraint ties."""
        tied, anywhere = list[list[int]](), None
        for constraint in self.constraints:
            if isinstance(constraint, LoopJoint):
                tied.append(Path.between(self.model, constraint.first, constraint.second).velocities(self.model))
            else:
                anywhere = anywhere or self._anywhere
                tied.append(np.flatnonzero(constraint.rows(anywhere).any(axis=0)).tolist())
        return tied

    @property
    def coarseness(self) -> float:
        """Largest factor by which rounding of places exceeds that of numbers of about 1, in the units of the rows."""
        return float((self.reach / self.measure).max(initial=1.0))

    @cached_property
    def slack(self) -> Array:
        """Tolerated gap of every row where it repeats others [m or rad], shape (m,); 0 of guided coordinates."""
        own = [not isinstance(constraint, GuidedCoordinate) for constraint, _ in self.owners()]
        return np.asarray(UNCLOSED * self.reach * np.array(own, dtype=np.float64))

    @cached_property
    def redundant(self) -> bool:
        """Whether some of its rows repeat others, of couplings, whose rows are the same everywhere.

        A third gear pair in a train repeats two.
        """
        free = self.split(self.rows(self._anywhere)).free.shape[1] if self.size else self.model.nv
        return bool(free + self.size > self.model.nv)

    @property
    def _anywhere(self) -> Kinematics:
        """Return a state of no special kind, at rest; slides are within the extent."""
        way = np.where(slides(self.model), self.extent, 1.0) * np.sin(np.arange(1.0, self.model.nv + 1.0))
        return self.state(pin.integrate(self.model, pin.neutral(self.model), way))

    def split(self, rows: Array) -> Decomposition:
        """Return G, shape (.., m, nv), decomposed."""
        return Decomposition.of(rows, self.reach)

    def split_at(self, q: Array) -> Decomposition:
        """Return G at configurations, shape (n, nq), or at one, shape (nq,), decomposed."""
        return self.split(self.at(q)[1] if q.ndim > 1 else self.rows(self.state(q)))

    def with_guides(self, names: Sequence[str], coordinates: Sequence[Coordinate]) -> Closure:
        """Return the closure with the rows of guided coordinates after its own; the last ones are kept."""
        if not names:
            return self
        asked = (*names, *map(id, coordinates))  # which are not reused, as the closure has these coordinates
        if (closure := self._guided.get(asked)) is None:
            guides = [GuidedCoordinate(name, coordinate) for name, coordinate in zip(names, coordinates, strict=True)]
            closure = self._guided[asked] = Closure.of(self.model, (*self.constraints, *guides))
            for first in [*self._guided][:-GUIDED]:
                self._guided.pop(first, None)
        return closure

    @cached_property
    def _guided(self) -> dict[Hashable, Closure]:
        return {}

    @cached_property
    def size(self) -> int:
        return sum(constraint.size for constraint in self.constraints)

    @cached_property
    def rolling(self) -> Indices:
        """Rows that bind velocities alone, shape (r,)."""
        loops = [constraint for constraint in self.constraints if isinstance(constraint, LoopJoint)]
        places = [self.slices[loop.name].start + row for loop in loops for row in loop.pair.rolling]
        return np.array(places, dtype=np.intp)

    @property
    def rolls(self) -> bool:
        """Whether some rows bind velocities alone, so that positions hang on the whole way."""
        return bool(len(self.rolling))

    @cached_property
    def holonomic(self) -> Closure:
        """The constraints on positions: the closure without the rows that bind velocities alone."""
        return Closure.of(self.model, [*filter(None, map(_holding, self.constraints))]) if self.rolls else self

    @cached_property
    def slices(self) -> Mapping[str, slice]:
        """The rows of every constraint, by its name."""
        slices, start = {}, 0
        for constraint in self.constraints:
            slices[constraint.name] = slice(start, start + constraint.size)
            start += constraint.size
        return slices

    def owners(self) -> list[tuple[Constraint, int]]:
        """Return the constraint of every row, and the row's place in it."""
        return [(constraint, row) for constraint in self.constraints for row in range(constraint.size)]

    def state(self, q: Array, v: Array | None = None) -> Kinematics:
        """Return the evaluated state (q, v), shapes (nq,) and (nv,); at rest where the velocity is left out."""
        return Kinematics.at(self.model, q, v)

    def gap(self, state: Kinematics) -> Array:
        return np.concatenate([np.zeros(0), *(constraint.gap(state) for constraint in self.constraints)])

    def rows(self, state: Kinematics) -> Array:
        nothing = np.zeros((0, self.model.nv))
        return np.concatenate([nothing, *(constraint.rows(state) for constraint in self.constraints)])

    def drift(self, state: Kinematics) -> Array:
        return np.concatenate([np.zeros(0), *(constraint.drift(state) for constraint in self.constraints)])

    @cached_property
    def constraint_rows(self) -> ConstraintRows:
        """The rows of the constraints, for evaluation at many configurations."""
        return ConstraintRows.of(self.model, self.constraints)

    def at(self, q: Array) -> tuple[Array, Array]:
        """Return the gaps, shape (n, m), and G, shape (n, m, nv), at configurations, shape (n, nq); to be read only."""
        if len(q) * len(self.constraints) >= SEVERAL:
            rows = self.constraint_rows.at(q)
            return rows.gaps, rows.matrices
        states = [*map(self.state, q if self.size else ())]
        gaps, matrices = [*map(self.gap, states)], [*map(self.rows, states)]
        return np.array(gaps).reshape(len(q), self.size), np.array(matrices).reshape(len(q), self.size, self.model.nv)

    def drifts(self, q: Array, v: Array) -> Array:
        """Return G' v in states, shapes (n, nq) and (n, nv), as an array of shape (n, m)."""
        if len(q) * len(self.constraints) >= SEVERAL:
            return self.constraint_rows.at(q).drifts(v)
        states = map(self.state, q, v) if self.size else ()
        return np.array([*map(self.drift, states)]).reshape(len(q), self.size)

    def terms(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return the gaps, G and G' v in states, as ``at`` and ``drifts`` do."""
        if len(q) * len(self.constraints) >= SEVERAL:
            rows = self.constraint_rows.at(q)
            return rows.gaps, rows.matrices, rows.drifts(v)
        states = [*map(self.state, q, v)]
        gaps, matrices, drifts = ([*map(part, states)] for part in (self.gap, self.rows, self.drift))
        shape = len(q), self.size
        return np.reshape(gaps, shape), np.reshape(matrices, (*shape, self.model.nv)), np.reshape(drifts, shape)

    def multipliers(self, q: Array, held: Array, along: Array | None = None) -> Array:
        """Return the least multipliers that hold what drives do not, and these drives' efforts, shape (n, m).

        Args:
            q: Configurations, shape (n, nq).
            held: ``M a + nle - loads - tau``, shape (n, nv).
            along: Efforts of drives along the coordinates of the last g rows [N*m or N], shape (n, g).
        """
        lam, own = np.zeros((len(q), self.size)), self.size
        if along is not None and along.size:
            own -= along.shape[1]
            lam[:, own:] = along
        for start in range(0, len(q) if own else 0, BLOCK):
            some = slice(start, start + BLOCK)
            rows = self.at(q[some])[1]
            force = held[some] - np.vecmat(lam[some, own:], rows[:, own:])
            lam[some, :own] = Decomposition.of(rows[:, :own], self.reach[:own]).multipliers(force)
        return lam

    def values(self, q: Array) -> Array:
        """Return the singular values of G at configurations, shape (n, nq); see ``values_of``."""
        return self.values_of(self.at(q)[1])

    def values_of(self, rows: Array) -> Array:
        """Return the singular values of G, shape (.., m, nv), descending, lengths in the unit of the mechanism.

        Rows are not scaled to the length 1: where bars are in line a row itself may vanish. Rows that are 0 in all
        configurations, as those that hold a plane linkage in its plane, cost nothing.
        """
        scaled = rows * (self.scale / self.measure[:, None])
        sizes = np.abs(scaled).max(axis=(*range(rows.ndim - 2), -1), initial=0.0)
        acting = np.linalg.svd(scaled[..., sizes > ROUNDING * sizes.max(initial=0.0), :], compute_uv=False)
        values = np.zeros((*rows.shape[:-2], min(rows.shape[-2:])))
        values[..., : acting.shape[-1]] = acting
        return values

    def rank(self, values: Array) -> int:
        """Return the rank that singular values, shape (n, .., s), have at most; see ``values_of``."""
        least = np.maximum(RANK * values[..., :1], VANISHED * self.coarseness)
        return int((values > least).sum(axis=-1).max())

    def wrenches(self, links: LinkPlacements, lam: Array) -> Array:
        """Return the wrenches of multipliers, shape (n, m), on the links, shape (n, njoints, 6).

        [f; m] at the world's origin, world axes [N, N*m]. Couplings whose forces are not known are left out.
        """
        states = np.broadcast_shapes(links.places.shape[:-2], lam.shape[:-1])
        total = states_first(np.zeros((6, self.model.njoints, *states), np.result_type(lam, links.places)))
        for constraint, rows in zip(self.constraints, self.slices.values(), strict=True):
            for joint, wrench in constraint.wrenches(links, lam[..., rows]).items():
                total[..., joint, :] += wrench
        return total

    def acting(self, links: LinkPlacements, q: Array, lam: Array) -> tuple[Array, Array, Array]:
        """Return the wrenches of multipliers on the links, and G^T lam of couplings whose forces are not known.

        Returns:
            [f; m] at the origins of the links, world axes [N, N*m], shape (n, njoints, 6); the sums of the sizes of
            these forces and moments, to the latter added the forces times the longest arm of a loop joint on the link,
            shape (n, njoints, 2); and loads [N*m or N], shape (n, nv).
        """
        states = np.broadcast_shapes(links.places.shape[:-2], q.shape[:-1], lam.shape[:-1])
        total, sizes = (states_first(np.zeros((width, self.model.njoints, *states))) for width in (6, 2))
        loads = np.zeros((*states, self.model.nv))
        for constraint, rows in zip(self.constraints, self.slices.values(), strict=True):
            wrenches = constraint.wrenches(links, lam[..., rows])
            for joint, wrench in wrenches.items():
                own = moved(wrench, -links.places[..., joint, :])
                total[..., joint, :] += own
                sizes[..., joint, :] += lengths(own)
            if not wrenches:
                loads += vecmat(lam[..., rows], replace(self, constraints=(constraint,)).at(q)[1])
        sizes[..., 1] += self._arms * sizes[..., 0]
        return total, sizes, loads

    @cached_property
    def _arms(self) -> Array:
        """Distance from the origin of each link to the farthest point at which a loop joint holds it [m]."""
        arms = [np.zeros(1 if isinstance(self.model, ModelVariants) else ())] * self.model.njoints
        for constraint in self.constraints:
            if isinstance(constraint, LoopJoint):
                for frame in (self.model.frames[index] for index in (constraint.first, constraint.second)):
                    arm = np.linalg.norm(frame.placement.translation, axis=-1)
                    arms[frame.parentJoint] = np.maximum(arms[frame.parentJoint], arm)
        return np.stack(np.broadcast_arrays(*arms), axis=-1)


def _holding(constraint: Constraint) -> Constraint | None:
    """Return a constraint with those of its rows that hold positions; ``None`` where there are none."""
    if not isinstance(constraint, LoopJoint):
        return constraint
    return replace(constraint, pair=constraint.pair.holding) if constraint.pair.holding else None


def extents(model: Model, frames: Iterable[pin.Frame]) -> Array:
    """Return the length of the longest branch of links, from the world to a joint or one of the frames [m].

    Shape (), of variants (k,) or (1,). It is 1 m for a model without lengths.
    """
    along = LinkTree.of(model).summed(np.moveaxis(np.linalg.norm(placements_of(model)[1], axis=-1)[None], -1, 1))[0]
    extent = along.max(axis=0)
    for frame in frames:
        extent = np.maximum(extent, along[frame.parentJoint] + np.linalg.norm(frame.placement.translation, axis=-1))
    return np.where(extent > 0.0, extent, 1.0)


def unit_of_length(size: Array | float) -> Array:
    """Return the units in which sizes [m] are numbers near 1: 1e-6, 1e-3, 1, 1e3, 1e6, ... m, of the same shape.

    A size of 0, where all stands in one point, is measured in metres.
    """
    lengths = np.where(np.asarray(size) > 0.0, size, 1.0)
    return np.asarray(10.0 ** (3.0 * np.round(np.log10(lengths) / 3.0)))


@cached_by_model
def extent(model: pin.Model) -> float:
    """Return the length of the longest branch of links of a model, from the world to a joint or a frame [m]."""
    return float(extents(model, model.frames))


@cached_by_model
def slides(model: pin.Model) -> Flags:
    """Return a mask of the translational velocities, shape (nv,)."""
    return np.asarray(~LinkTree.of(model).subspace[3:].any(axis=0))


class VariantClosure(Closure, frozen=True):
    """Constraints of variants of one mechanism, stacked; ``model`` are the variants."""

    model: ModelVariants
    constraints: tuple[Constraint, ...]

    @cached_property
    def first(self) -> Closure:
        """The constraints of the first variant."""
        return Closure.of(self.model.first, self.constraints)

    @property
    def extent(self) -> float:
        """Length of all links of the first variant from end to end [m]; see ``alike_in_size``."""
        return self.first.extent

    @property
    def groups(self) -> Indices:
        """The groups of the first variant: constraints tie the joints of all variants alike."""
        return self.first.groups

    @cached_property
    def alike_in_size(self) -> Flags:
        """Mask of the variants with the same units of length as the first, shape (k,) or (1,)."""
        whole = extents(self.model, [frame for frame in self.model.frames if frame.placed is not None])
        return np.asarray(unit_of_length(whole) == unit_of_length(self.extent))

    @cached_property
    def constraint_rows(self) -> ConstraintRows:
        """Rows of the constraints."""
        if self.model.nv > WIDE:
            raise VariantsDiffer("loops or couplings of many joints")
        if self.first.rolls:
            raise VariantsDiffer("rolling, whose positions hang on the way of each")
        return ConstraintRows.of(self.model, self.constraints)

    def with_guides(self, names: Sequence[str], coordinates: Sequence[Coordinate]) -> VariantClosure:
        """Return the closure with the rows of guided coordinates after its own."""
        return VariantClosure(self.model, self.first.with_guides(names, coordinates).constraints)

    def spread(self, *arrays: Array) -> list[Array]:
        """Return arrays of shape (n, k or 1, w), spread over the variants where the constraints differ."""
        k = 1 if self.model.in_place else len(self.model)
        count = max(k, *(x.shape[1] for x in arrays))
        return [np.broadcast_to(x, (len(x), count, x.shape[-1])) for x in arrays]

    def at(self, q: Array) -> tuple[Array, Array]:
        (q,) = self.spread(q)
        measured = self.constraint_rows.at(q)
        return measured.gaps, measured.matrices

    def drifts(self, q: Array, v: Array) -> Array:
        """Return ``G' v``, shape (n, k, m)."""
        q, v = self.spread(q, v)
        return self.constraint_rows.at(q).drifts(v)

    def split(self, rows: Array) -> Decomposition:
        """Return G, shape (n, k, m, nv), decomposed; NaN where a variant has another rank than the first."""
        return super().split(rows).of_one_rank()

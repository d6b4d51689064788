"""Constraints of variants of one mechanism, stacked along an axis of variants after the rows."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import Closure, extents, unit_of_length
from pinarm.engine.constraints.constraint_rows import Constraint, ConstraintRows
from pinarm.engine.constraints.nullspace import RowDecompositions, of_one_rank
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.geometry.model_variants import ModelVariants, VariantsDiffer

WIDE = 24
"""Velocities up to which all variants are evaluated at once."""


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

    def splits(self, q: Array, rows: Array | None = None) -> RowDecompositions:
        """Return G decomposed, shape (n, k, ..) in one part; NaN where a variant has another rank than the first."""
        rows = self.at(q)[1] if rows is None else rows
        return RowDecompositions([(np.arange(len(rows)), of_one_rank(rows, self.reach))], rows.shape)

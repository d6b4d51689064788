"""The constraints of variants of a mechanism: G and what follows from it in n states of each of k variants.

States are rows, shape (n, k, nq), or (n, 1, nq) where all variants stand alike. Rows of G that repeat others are the
same in all variants: those of a flat mechanism, which hold it in its plane. A variant in which they are others, or in
which G loses rank, has numbers that are not finite, and is to be looked at alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint import Constraint
from pinarm.engine.constraints.constraint_rows import ConstraintRows
from pinarm.engine.constraints.loop_sizes import extents, unit_of_length
from pinarm.engine.constraints.nullspaces.nullspace import VANISHED, split_rows
from pinarm.engine.constraints.nullspaces.orthogonal_rows import (
    REGULAR,
    OrthogonalRows,
    along,
    independent_rows,
    singular_values,
)
from pinarm.engine.constraints.nullspaces.refinement import refined
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.geometry.model_variants import ModelVariants, VariantsDiffer

if TYPE_CHECKING:
    from pinarm.engine.constraints.sparse_matrices import Matrices

WIDE = 24
"""Velocities up to which matrices of all variants are taken apart entry by entry."""

WEAK = 1e-3
"""Least length of what a row adds to those before it, relative to the length that it can have."""


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
        """Those of the first variant: the joints of all are tied alike."""
        return self.first.groups

    @property
    def scale(self) -> Array:
        """The units of the first variant's velocities."""
        return self.first.scale

    @property
    def measure(self) -> Array:
        """The units of the first variant's rows."""
        return self.first.measure

    @cached_property
    def alike_in_size(self) -> Flags:
        """Which variants are measured in the same units of length as the first, shape (k,) or (1,)."""
        whole = extents(self.model, [frame for frame in self.model.frames if frame.placed is not None])
        same = unit_of_length(self.loop_sizes.sizes) == unit_of_length(self.first.loop_sizes.sizes)
        return np.asarray((unit_of_length(whole) == unit_of_length(self.extent)) & same.all(axis=-1))

    @cached_property
    def constraint_rows(self) -> ConstraintRows:
        """What the constraints measure.

        Raises:
            VariantsDiffer: It cannot be had of many states at once.
        """
        if self.model.nv > WIDE:
            raise VariantsDiffer("loops or couplings of many joints")
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
        """Return the gaps, shape (n, k, m), and G, shape (n, k, m, nv)."""
        (q,) = self.spread(q)
        measured = self.constraint_rows.at(q)
        return measured.gaps, measured.matrices

    def drifts(self, q: Array, v: Array) -> Array:
        """Return ``G' v``, shape (n, k, m)."""
        q, v = self.spread(q, v)
        return self.constraint_rows.at(q).drifts(v)

    def gaps(self, q: Array) -> Array:
        """Return the gaps, shape (n, k, m)."""
        return self.at(q)[0]

    def splits(self, q: Array, rows: Array | None = None) -> VariantDecomposition:  # type: ignore[override]
        """Return G taken apart; ``rows`` are what ``at`` says of the configurations, if known."""
        rows = self.at(q)[1] if rows is None else rows
        return VariantDecomposition.of(self.independent(rows[0, 0]), rows, self.reach)

    def free_motions(self, q: Array) -> Iterator[tuple[Indices, Array]]:
        """Yield all configurations of n rows of k variants, shape (n k, nq), and T there, shape (f, n k, nv)."""
        states = q.reshape(-1, len(self.model), q.shape[-1])
        free = self.splits(states).free
        yield np.arange(len(q)), np.moveaxis(free.reshape(len(q), *free.shape[2:]), -1, 0)

    def independent(self, rows: Array) -> list[int]:
        """Return rows of G that say what all do, given G of a state of the first variant, shape (m, nv).

        Raises:
            VariantsDiffer: G is too near to losing rank there.
        """
        if not (np.abs(rows) > VANISHED * self.reach[:, None]).any():
            return []
        split = split_rows(rows, self.reach)
        if split.regularity < REGULAR:
            raise VariantsDiffer("a motion that begins near a singular position")
        return independent_rows(rows, split.rank, self.reach)

    def values_of(self, rows: Matrices) -> Array:
        """Return the singular values of given rows G, shape (n, k, m, nv), without those of rows that are 0 in all."""
        full = np.asarray(rows)
        counts = full.any(axis=(0, 1, 3))
        scaled = full[..., counts, :] * self.scale / self.measure[counts, None]
        return singular_values(np.moveaxis(scaled, (-2, -1), (0, 1)))


@dataclass(frozen=True, eq=False)
class VariantDecomposition:
    """G taken apart in n states of k variants; see ``nullspace.RowDecomposition`` and ``RowDecompositions``.

    Attributes:
        kept: Independent rows.
        orthogonal: What they span, states of shape (n, k).
        free: T, shape (n, k, nv, f).
        rows: G, shape (m, nv, n, k).
    """

    kept: list[int]
    orthogonal: OrthogonalRows
    free: Array
    rows: Array

    @classmethod
    def of(cls, kept: list[int], rows: Array, reach: Array) -> VariantDecomposition:
        """Return the parts of G, shape (n, k, m, nv), of which some rows are independent."""
        rows = np.ascontiguousarray(rows.transpose(2, 3, 0, 1))
        with np.errstate(all="ignore"):  # of variants that are to be looked at alone
            orthogonal = OrthogonalRows.of(rows[kept])
            free, sound = orthogonal.complement(), np.ones(rows.shape[2:], dtype=bool)
            for i, row in enumerate(kept):
                sound &= orthogonal.shares[i, i] > WEAK * reach[row]
            for row in sorted(set(range(len(rows))) - set(kept)):
                for motion in free if rows[row].any() else ():
                    sound &= np.abs(along(rows[row], motion)) <= VANISHED * reach[row]
            free = np.where(sound, free, np.nan)
        return cls(kept, orthogonal, np.ascontiguousarray(free.transpose(2, 3, 1, 0)), rows)

    @property
    def parts(self) -> list[tuple[Indices, VariantDecomposition]]:
        """All states and what is theirs: they have the same rank."""
        return [(np.arange(self.rows.shape[2]), self)]

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right``, shape (n, k, m) to (n, k, nv)."""
        return _last(self.orthogonal.shortest(_first(right)[self.kept]))

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, shape (n, k, m).

        ``(G Q)^T lam = Q^T force``, of which it is the shortest solution.
        """
        return refined(
            lambda left: _last(self._spanned.shortest(self.orthogonal.components(_first(left)))),
            np.moveaxis(self.rows, (0, 1), (-2, -1)), self.free, force,
        )  # fmt: skip

    @cached_property
    def _spanned(self) -> OrthogonalRows:
        """``(G Q)^T``, made orthogonal."""
        spanned = np.zeros((len(self.kept), len(self.rows), *self.rows.shape[2:]))
        for row, coefficients in enumerate(self.rows):
            if coefficients.any():
                spanned[:, row] = self.orthogonal.components(coefficients)
        return OrthogonalRows.of(spanned)

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return len(self.kept)

    def stresses_on(self, functions: Array) -> Array:
        """Return all multipliers of length 1 that do nothing, shape (n, k, m, s)."""
        return self._stresses

    @cached_property
    def _stresses(self) -> Array:
        return np.ascontiguousarray(self._spanned.complement().transpose(2, 3, 1, 0))


def _first(x: Array) -> Array:
    """Return an array of shape (n, k, w) as (w, n, k)."""
    return np.ascontiguousarray(np.moveaxis(x, -1, 0))


def _last(x: Array) -> Array:
    """Return an array of shape (w, n, k) as (n, k, w)."""
    return np.ascontiguousarray(np.moveaxis(x, 0, -1))

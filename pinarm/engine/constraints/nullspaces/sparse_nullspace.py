"""The rows of G of many joints: range, null space, rank and redundant rows, at a cost in proportion to their number.

As ``dense_nullspace.RowDecomposition``, with ``sparse_rows.BlockDecomposition`` in place of singular values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.nullspaces.dense_nullspace import (
    RANK,
    SHORT,
    VANISHED,
    RowDecomposition,
    SplitRows,
    dense_parts,
    of_length_1,
)
from pinarm.engine.constraints.nullspaces.refinement import refined
from pinarm.engine.constraints.nullspaces.sparse_rows import BlockDecomposition

ROUNDING, LEFT = 1e-14, 0.5
"""Size of a projection, relative to what is projected, that is rounding; part of a unit vector that is left when it is
projected once more, unless it was rounding."""

MOTIONS = 3
"""Steps of the power method that see whether a singular value is beyond doubt: one at 1e-8 of the largest among 1e4
others at 1e-4 and above shows in two."""


@dataclass(frozen=True, eq=False)
class SparseRowDecomposition:
    """The rows of G taken apart at several configurations with the same rank, or at one.

    Attributes:
        scales: Diagonal of D that gives rows the length 1, or 0, shape (m,) each.
        blocks: ``D G`` taken apart.
        matrices: G.
        states: (k,) for k configurations, () for a single one.
    """

    scales: list[Array]
    blocks: list[BlockDecomposition]
    matrices: list[csr_array]
    states: tuple[int, ...]

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return self.blocks[0].rank

    @cached_property
    def regularity(self) -> float:
        """Smallest singular value of the independent rows, relative to the largest; of a single configuration."""
        largest, smallest = self.blocks[0].extremes(diags_array(self.scales[0]) @ self.matrices[0])
        return smallest / largest if largest else 0.0

    @cached_property
    def free(self) -> Array:
        """T, an orthonormal basis of the motions that the rows allow, ``G T = 0``, shape (.., nv, nv - r)."""
        found = np.array([blocks.free for blocks in self.blocks])
        return found.reshape(*self.states, *found.shape[1:])

    def stresses_on(self, functions: Array) -> Array:
        """Return at most as many multipliers that do nothing as there are functions; see ``SplitRows.stresses_on``."""
        some = functions.reshape(-1, *functions.shape[-2:])
        found = [_stresses_on(*each) for each in zip(some, self.scales, self.blocks, strict=True)]
        stresses = np.zeros((len(some), some.shape[1], max(each.shape[1] for each in found)))
        for stress, columns in zip(stresses, found, strict=True):
            stress[:, : columns.shape[1]] = columns
        return stresses.reshape(*self.states, *stresses.shape[1:])

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (.., nv)."""
        return self._each(lambda k, x: self.blocks[k].solve(self.scales[k] * x), right)

    def reached(self, right: Array) -> Array:
        """Return the part of a right-hand side that some x gives, shape (.., m)."""
        return self._each(lambda k, x: self.matrices[k] @ self.blocks[k].solve(self.scales[k] * x), right)

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, shape (.., m)."""
        some = force.reshape(-1, force.shape[-1])
        matrices = self.matrices if self.states else self.matrices * len(some)
        found = refined(self._multipliers, matrices, self.free, some)
        return found.reshape(*force.shape[:-1], found.shape[-1])

    def _multipliers(self, force: Array) -> Array:
        return self._each(lambda k, x: self._measured[k].solve_transposed(x), force)

    @cached_property
    def _measured(self) -> list[BlockDecomposition]:
        """G itself taken apart, its rows in their own lengths."""
        return [
            BlockDecomposition.of(rows, RANK / float(scale[scale > 0.0].max(initial=0.0) or 1.0))
            for rows, scale in zip(self.matrices, self.scales, strict=True)
        ]

    def _each(self, function: Callable[[int, Array], Array], given: Array) -> Array:
        """Return a function of a configuration and what is given for it, shape (.., k)."""
        some = given.reshape(-1, given.shape[-1])
        found = np.array([function(k if self.states else 0, x) for k, x in enumerate(some)])
        return found.reshape(*given.shape[:-1], found.shape[-1])


def sparse_split(rows: csr_array, reach: Array | float) -> SplitRows:
    """Return the parts of G at a single configuration, shape (m, nv)."""
    part = _part(rows, reach)
    if part is None:
        return RowDecomposition.of(rows.toarray(), reach)
    return SparseRowDecomposition([part[0]], [part[1]], [part[2]], ())


def sparse_parts(rows: Sequence[csr_array], reach: Array | float) -> list[tuple[Indices, SplitRows]]:
    """Return the parts of G, n of shape (m, nv), at configurations with the same rank together.

    Where a block of rows does not tell the rank beyond doubt, singular values do.
    """
    found: list[tuple[Indices, SplitRows]] = []
    alike: dict[int, list[int]] = {}
    parts = [_part(matrix, reach) for matrix in rows]
    for k, part in enumerate(parts):
        if part is None:
            ((_, dense),) = dense_parts(rows[k].toarray()[None], reach)
            found.append((np.array([k]), dense))
        else:
            alike.setdefault(part[1].rank, []).append(k)
    for some in alike.values():
        scales, blocks, matrices = (list(each) for each in zip(*(parts[k] for k in some), strict=True))
        found.append((np.array(some), SparseRowDecomposition(scales, blocks, matrices, (len(some),))))
    return found


def _stresses_on(functions: Array, scale: Array, blocks: BlockDecomposition) -> Array:
    """Return multipliers of length 1 that do nothing and span all of those which add to functions, shape (m, s).

    With P the projection onto the null space of ``(D G)^T``: those of ``D P`` at right angles to its columns ``P D w``,
    of functions w, add nothing to them.

    Args:
        functions: Of the multipliers, shape (m, k).
        scale: Diagonal of D, 0 for rows that are 0, shape (m,).
        blocks: ``D G`` taken apart.
    """
    weights = np.where(scale > 0.0, scale, 1.0)[:, None]
    wanted = weights * functions
    projected = wanted - blocks.reached(wanted)
    some = projected.any(axis=1)
    spanned, sizes, _ = np.linalg.svd(projected[some], full_matrices=False)
    basis = np.zeros((len(functions), int(np.count_nonzero(sizes > ROUNDING * np.abs(wanted).max(initial=0.0)))))
    basis[some] = spanned[:, : basis.shape[1]]
    basis -= blocks.reached(basis)  # once more: of what is small the first projection leaves rounding
    return of_length_1(weights * basis[:, np.linalg.norm(basis, axis=0) > LEFT])


def _part(rows: csr_array, reach: Array | float) -> tuple[Array, BlockDecomposition, csr_array] | None:
    """Return scale, parts and matrix of G, shape (m, nv); ``None`` where the rank is in doubt."""
    length = np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1)).ravel())
    counts = length > VANISHED * reach
    scale = counts / np.where(counts, np.maximum(length, SHORT * reach), 1.0)
    scaled = csr_array(diags_array(scale) @ rows)
    scaled.eliminate_zeros()
    blocks = _clear(scaled)
    return (scale, blocks, rows) if blocks else None


def _clear(rows: csr_array) -> BlockDecomposition | None:
    """Return a matrix taken apart; ``None`` where its rank is in doubt."""
    largest = float(np.sqrt(abs(rows).sum(axis=0).max() * abs(rows).sum(axis=1).max()))
    blocks = BlockDecomposition.of(rows, RANK * largest)
    return blocks if rank_is_clear(blocks, largest) else None


def rank_is_clear(blocks: BlockDecomposition, largest: float) -> bool:
    """Return whether no singular value that counts is as small as those that do not."""
    if not blocks.rank:
        return True
    x = np.cos(np.arange(1.0, blocks.shape[1] + 1.0))
    for _ in range(MOTIONS):
        x /= np.linalg.norm(x)
        x = blocks.solve(blocks.solve_transposed(x))
    return bool(np.linalg.norm(x) < (RANK * largest) ** -2)


def extreme_values(rows: csr_array) -> Array:
    """Return the largest and the smallest singular value of G that is not 0, shape (m, nv) to (min(m, nv),).

    They are at the places that they have in the order of all, which is descending; those between are not known and
    given as the largest, those behind, below ``RANK`` of the largest, as 0.
    """
    blocks = _clear(rows)
    if blocks is None:
        return np.asarray(np.linalg.svd(rows.toarray(), compute_uv=False))
    values, (largest, smallest) = np.zeros(min(rows.shape)), blocks.extremes(rows)
    values[: blocks.rank] = largest
    values[blocks.rank - 1 : blocks.rank] = smallest
    return values


def damped(rows: Array, right: Array, damping: float) -> Array:
    """Return the x that minimises ``|G x - right|^2 + damping^2 |x|^2``, shape (nv,); the shortest without damping."""
    if not damping:
        return sparse_split(csr_array(rows), 0.0).particular(right)
    matrix = csr_array(rows)
    return np.asarray(spsolve(csc_array(matrix.T @ matrix + damping**2 * eye_array(rows.shape[1])), matrix.T @ right))

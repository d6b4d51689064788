"""The rows of G of many joints taken apart, block of columns by block, at a cost in proportion to their number.

The columns are put in an order in which rows that share joints are close together (reverse Cuthill-McKee), and
eliminated in blocks. The rows that begin in a block, and what earlier blocks have left of theirs, are a front

    F = [F_1 F_2],    F_1 = U S V^T,    F_1 = U_1 S_1 V_1^T where S is not 0.

``U_1^T F`` determines the combinations ``V_1^T x`` of the block from later columns; ``U_2^T F``, which is 0 in this
block, goes into later fronts; and the combinations ``V_2^T x`` are free, as no later row knows them. So
``G = Q R V^T`` with orthogonal Q and V and R triangular by blocks: all numbers are as accurate as those of a singular
value decomposition. A rank is counted block by block; singular values are extreme ones of G and of its inverse.

Source: Björck, Numerical Methods for Least Squares Problems (1996), sections 6.2 and 6.6; Heath, Some extensions of an
algorithm for sparse linear least squares problems, SIAM J. Sci. Stat. Comput. 3 (1982), 223-237; George, Liu, Computer
Solution of Large Sparse Positive Definite Systems (1981), chapter 4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import LinearOperator, eigsh

from pinarm.arrays import Array, Flags, Indices

WIDTH = 24
"""Columns of a block: fewer are more calls, more are more zeros."""

ACCURATE = 1e-3
"""Relative accuracy of the squares of singular values."""

FEW = 5
"""Products of Lanczos' method with a matrix between restarts, where an eigenvector nearby is known."""


@dataclass(frozen=True, eq=False)
class ColumnBlock:
    """What a front determines of a block of columns.

    Attributes:
        columns: Places of the block in the order of columns.
        later: Places of the columns of ``F_2``.
        rows: Rows of G that begin in the block.
        carried: Number of rows of the front that earlier blocks have left.
        determined: ``U_1``, shape (p, r).
        left: Orthonormal basis of what later fronts get, shape (p, l).
        sizes: ``S_1``, shape (r,).
        combined: ``V^T``, those that are determined first, shape (w, w).
        coupling: ``U_1^T F_2``, shape (r, c).
    """

    columns: slice
    later: slice
    rows: Indices
    carried: int
    determined: Array
    left: Array
    sizes: Array
    combined: Array
    coupling: Array


@dataclass(frozen=True, eq=False)
class BlockDecomposition:
    """G taken apart.

    Attributes:
        order: Column of G at every place, shape (nv,).
        blocks: The blocks, in the order of elimination.
        shape: Of G.
    """

    order: Indices
    blocks: list[ColumnBlock]
    shape: tuple[int, int]

    @classmethod
    def of(cls, rows: csr_array, least: float) -> BlockDecomposition:
        """Return the parts of G, shape (m, nv).

        Args:
            rows: G; its rows have lengths of about 1.
            least: Size of a singular value of a front up to which it is 0.
        """
        m, nv = rows.shape
        pattern = abs(rows)
        order = np.asarray(reverse_cuthill_mckee((pattern.T @ pattern).tocsr(), symmetric_mode=True), dtype=np.intp)
        permuted = csr_array(rows[:, order])
        permuted.sort_indices()
        counts = np.diff(permuted.indptr)
        some = np.flatnonzero(counts)
        first, last = np.zeros(m, dtype=np.intp), np.zeros(m, dtype=np.intp)
        first[some], last[some] = (
            permuted.indices[permuted.indptr[some]],
            permuted.indices[permuted.indptr[some + 1] - 1],
        )
        return cls(order, list(_eliminated(permuted, some[np.argsort(first[some], kind="stable")], first, last, least)),
                   (m, nv))  # fmt: skip

    @cached_property
    def rank(self) -> int:
        """Number of combinations of velocities that the rows determine."""
        return sum(len(block.sizes) for block in self.blocks)

    @cached_property
    def _begun(self) -> Flags:
        """Which rows are not 0, shape (m,)."""
        found = np.zeros(self.shape[0], dtype=bool)
        found[np.concatenate([block.rows for block in self.blocks])] = True
        return found

    @cached_property
    def repeated(self) -> int:
        """Number of rows that are not 0 and repeat others."""
        return int(self._begun.sum()) - self.rank

    @cached_property
    def free(self) -> Array:
        """Orthonormal basis T of the motions that the rows allow, ``G T = 0``, shape (nv, nv - rank)."""
        count, start = self.shape[1] - self.rank, 0
        x = np.zeros((self.shape[1], count))
        for block in self.blocks:
            combined = block.combined[len(block.sizes) :]
            x[block.columns, start : start + len(combined)] = combined.T
            start += len(combined)
        return np.asarray(np.linalg.qr(self._completed([np.zeros((len(b.sizes), count)) for b in self.blocks], x))[0])

    def solve(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (nv,)."""
        x = self._completed(self._determined(right), np.zeros(self.shape[1]))
        return np.asarray(x - self.free @ (self.free.T @ x))

    def reached(self, right: Array) -> Array:
        """Return the part of right-hand sides that some x gives, shape (m, ..)."""
        if not self.repeated:
            return np.where(self._begun.reshape(-1, *(1,) * (right.ndim - 1)), right, 0.0)
        return self._rows_of(self._determined(right))

    def solve_transposed(self, force: Array) -> Array:
        """Return the shortest lam with ``G^T lam = force`` in the sense of least squares, shape (m,)."""
        left, parts = (force - self.free @ (self.free.T @ force))[self.order], []
        for block in self.blocks:
            y = block.combined[: len(block.sizes)] @ left[block.columns] / block.sizes
            left[block.later] -= y @ block.coupling
            parts.append(y)
        return self._rows_of(parts)

    def extremes(self, rows: csr_array) -> tuple[float, float]:
        """Return the largest and the smallest singular value of G that is not 0."""
        if not self.rank:
            return 0.0, 0.0
        nv, transposed = self.shape[1], rows.T.tocsr()
        largest = largest_eigenvalue(nv, lambda x: transposed @ (rows @ x))
        inverse = largest_eigenvalue(nv, lambda x: self.solve(self.solve_transposed(x)))
        return largest**0.5, inverse**-0.5

    def _determined(self, right: Array) -> list[Array]:
        """Return ``U_1^T`` of the fronts' right-hand sides."""
        carried, found = right[:0], []
        for block in self.blocks:
            front = np.concatenate([carried, right[block.rows]])
            found.append(block.determined.T @ front)
            carried = block.left.T @ front
        return found

    def _completed(self, parts: list[Array], x: Array) -> Array:
        """Return x in the order of G from what the fronts determine, shape (r, ..) each, and free ones, (nv, ..)."""
        for block, part in zip(reversed(self.blocks), reversed(parts), strict=True):
            wanted = part - block.coupling @ x[block.later]
            x[block.columns] += block.combined[: len(block.sizes)].T @ (wanted.T / block.sizes).T
        found = np.empty_like(x)
        found[self.order] = x
        return found

    def _rows_of(self, parts: list[Array]) -> Array:
        """Return Q times what belongs to the fronts, shape (r, ..) each, as an array of shape (m, ..)."""
        tail = parts[0].shape[1:]
        found, carried = np.zeros((self.shape[0], *tail)), np.zeros((0, *tail))
        for block, part in zip(reversed(self.blocks), reversed(parts), strict=True):
            front = block.determined @ part + block.left @ carried[: block.left.shape[1]]
            found[block.rows], carried = front[block.carried :], front[: block.carried]
        return found


def _eliminated(rows: csr_array, order: Indices, first: Indices, last: Indices, least: float) -> Iterator[ColumnBlock]:
    """Yield the blocks of rows in their order, whose first and last columns are given."""
    nv, begins, carried, end = rows.shape[1], first[order], np.zeros((0, 0)), 0
    for start in range(0, nv, WIDTH):
        stop = min(start + WIDTH, nv)
        new = order[np.searchsorted(begins, start) : np.searchsorted(begins, stop)]
        end = max(stop, end, int(last[new].max(initial=0)) + 1)
        front = np.zeros((len(carried) + len(new), end - start))
        front[: len(carried), : carried.shape[1]] = carried
        _fill(front[len(carried) :], rows, new, start)
        u, s, vt = np.linalg.svd(front[:, : stop - start], full_matrices=True)
        r, beyond = int((s > least).sum()), front[:, stop - start :]
        left, rest = u[:, r:], u[:, r:].T @ beyond
        if len(rest) > rest.shape[1]:  # rows that repeat others
            q, rest = np.linalg.qr(rest)
            left = left @ q
        yield ColumnBlock(
            slice(start, stop), slice(stop, end), new, len(carried), u[:, :r], left, s[:r], vt, u[:, :r].T @ beyond
        )
        carried = rest


def _fill(block: Array, rows: csr_array, some: Indices, start: int) -> None:
    """Write some rows, from a column on, into a block of zeros."""
    starts, counts = rows.indptr[some], np.diff(rows.indptr)[some]
    which = np.repeat(np.arange(len(some)), counts)
    entries = np.arange(len(which)) + np.repeat(starts - np.cumsum(counts) + counts, counts)
    block[which, rows.indices[entries] - start] = rows.data[entries]


def largest_eigenvalue(size: int, product: Callable[[Array], Array]) -> float:
    """Return the largest eigenvalue of a symmetric positive semidefinite matrix of which there are products."""
    return largest_eigenpair(size, product)[0]


def largest_eigenpair(size: int, product: Callable[[Array], Array], near: Array | None = None) -> tuple[float, Array]:
    """Return the same with an eigenvector, shape (size,); where one is known nearby, after a third of the products."""
    start, kept = (np.cos(np.arange(1.0, size + 1.0)), None) if near is None else (near, FEW)
    values, vectors = eigsh(LinearOperator((size, size), product), 1, v0=start, ncv=kept, tol=ACCURATE)
    return float(values[0]), vectors[:, 0]

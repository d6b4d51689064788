"""Multipliers of the constraints at the rows of a run, computed where they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import BLOCK, Closure
from pinarm.engine.constraints.nullspace import RowDecompositions, one_blas_thread
from pinarm.records import Record


class Multipliers(Record, frozen=True):
    """Multipliers of the constraints, and the efforts of drives along task coordinates, at the n rows of a run.

    Like an array of shape (n, m + g): ``lam[row]`` is that of one row, those of the mechanism's constraints first, and
    ``np.asarray(lam)`` that of all.

    Attributes:
        own: Indices of k rows -> multipliers of the constraints there [N or N*m], shape (k, m).
        along: Efforts of the drives along task coordinates [N or N*m], shape (n, g).
    """

    own: Callable[[Indices], Array]
    along: Array

    @classmethod
    def known(cls, lam: Array, m: int) -> Multipliers:
        return cls(lam[..., :m].__getitem__, lam[..., m:])

    @classmethod
    def zero(cls, n: int, m: int) -> Multipliers:
        """Return n rows of zeros for m constraints: nothing acts, or nobody asks."""
        return cls.known(np.zeros((n, m)), m)

    @classmethod
    def least(cls, closure: Closure, q: Array, held: Array, along: Array) -> Multipliers:
        """Return the least multipliers that hold what the drives do not; each row is computed when it is asked for.

        Args:
            closure: The constraints, then the coordinates that drives act along.
            held: ``M a + nle - loads - tau``, shape (n, nv).
            along: Efforts of the drives along the coordinates, shape (n, g).
        """
        m = closure.size - along.shape[-1]

        def own(rows: Indices) -> Array:
            least = np.empty((len(rows), *held.shape[1:-1], m))
            with one_blas_thread(held.shape[-1]):
                for start in range(0, len(rows), BLOCK):
                    some = rows[start : start + BLOCK]
                    least[start : start + BLOCK] = block(some)
            return least

        def block(some: Indices) -> Array:
            if not along.size:
                return closure.splits(q[some]).multipliers(held[some])
            g = closure.at(q[some])[1]
            force = held[some] - np.vecmat(along[some], g[..., m:, :])
            return RowDecompositions.of(g[:, :m], closure.reach[:m]).multipliers(force)

        return cls(own, along)

    @classmethod
    def joined(cls, parts: Sequence[Multipliers]) -> Multipliers:
        """Return the rows of several runs, one after the other."""
        starts = np.cumsum([0, *(len(part) for part in parts)])

        def own(rows: Indices) -> Array:
            owner = np.searchsorted(starts, rows, side="right") - 1
            lam = np.empty((len(rows), parts[0].own(rows[:0]).shape[1]))
            for k in set(owner.tolist()):
                lam[owner == k] = parts[k].own(rows[owner == k] - starts[k])
            return lam

        return cls(own, np.concatenate([part.along for part in parts]))

    def plus(self, added: Array, m: int) -> Multipliers:
        """Return the sums with others, shape (n, m + g), the first m of which are those of the constraints."""
        return Multipliers(lambda rows: self.own(rows) + added[rows, :m], self.along + added[:, m:])

    def spread(self, rows: Indices, m: int) -> Multipliers:
        """Return the multipliers of m constraint rows, of which these belong to some; the others are 0."""

        def own(wanted: Indices) -> Array:
            lam = np.zeros((len(wanted), m))
            lam[:, rows] = self.own(wanted)
            return lam

        return Multipliers(own, self.along)

    def __len__(self) -> int:
        return len(self.along)

    def __getitem__(self, row: int) -> Array:
        return np.asarray(self.at(np.array([row]))[0])

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> Array:
        return self._every if dtype is None else self._every.astype(dtype)

    @cached_property
    def _every(self) -> Array:
        """Multipliers of all rows, shape (n, m + g), kept for the loads of joints and the files of a result."""
        return np.concatenate([self.own(np.arange(len(self))), self.along], axis=-1)

    def at(self, rows: Indices) -> Array:
        if "_every" in vars(self):
            return np.asarray(self._every[rows])
        return np.concatenate([self.own(rows), self.along[rows]], axis=-1)

    def some(self, rows: Indices) -> Multipliers:
        return Multipliers(lambda wanted: self.own(rows[wanted]), self.along[rows])

"""Multipliers at the rows of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.closure import Closure, Split


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Multipliers of the constraints, and the efforts of drives along task coordinates, at the n rows of a run.

    Like an array of shape (n, m + g): ``lam[row]`` is that of one row, those of the mechanism's constraints first, and
    ``np.asarray(lam)`` that of all.

    Attributes:
        own: Row -> multipliers of the constraints [N or N*m], shape (m,).
        along: Efforts of the drives along task coordinates [N or N*m], shape (n, g).
    """

    own: Callable[[int], Array] = field(repr=False)
    along: Array = field(repr=False)

    @classmethod
    def known(cls, lam: Array, m: int) -> Multipliers:
        """Return multipliers that have been computed, shape (n, m + g)."""
        return cls(lam[:, :m].__getitem__, lam[:, m:])

    @classmethod
    def zero(cls, n: int, m: int) -> Multipliers:
        """Return n rows of zeros for m constraints: nothing acts, or nobody asks."""
        return cls.known(np.zeros((n, m)), m)

    @classmethod
    def least(cls, closure: Closure, q: Array, held: Array, along: Array) -> Multipliers:
        """Return the least multipliers that hold what the drives do not; each row is computed when it is asked for.

        Args:
            closure: The constraints, then the coordinates that drives act along.
            q: Configurations, shape (n, nq).
            held: ``M a + nle - loads - tau``, shape (n, nv).
            along: Efforts of the drives along the coordinates, shape (n, g).
        """
        m, own_buffers = closure.size - along.shape[1], cache(lambda: Closure.of(closure.model, closure.constraints))

        def own(row: int) -> Array:
            here = own_buffers()
            here.place(q[row])
            rows = here.rows()
            return Split.of(rows[:m]).multipliers(held[row] - along[row] @ rows[m:])

        return cls(own, along)

    @classmethod
    def joined(cls, parts: Sequence[Multipliers]) -> Multipliers:
        """Return the rows of several runs, one after the other."""
        starts = np.cumsum([0, *(len(part) for part in parts)])

        def own(row: int) -> Array:
            k = int(np.searchsorted(starts, row, side="right")) - 1
            return parts[k].own(row - starts[k])

        return cls(own, np.concatenate([part.along for part in parts]))

    def __len__(self) -> int:
        return len(self.along)

    def __getitem__(self, row: int) -> Array:
        return np.concatenate([self.own(row), self.along[row]])

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> Array:
        return np.array([self[row] for row in range(len(self))], dtype=dtype)

    def some(self, rows: Indices) -> Multipliers:
        """Return the multipliers at some of the rows."""
        return Multipliers(lambda row: self.own(rows[row]), self.along[rows])

"""Multipliers at the rows of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.closure import Closure, Split


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Multipliers of the constraints, and the efforts of drives along task coordinates, at the rows of a run.

    ``multipliers[row]`` has the shape (m + g,): those of the mechanism's constraints come first.

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
    def least(cls, closure: Closure, q: Array, held: Array, along: Array) -> Multipliers:
        """Return the least multipliers that hold what the drives do not; each is computed where it is asked for.

        Args:
            closure: The constraints, then the coordinates that drives act along.
            q: Configurations, shape (n, nq).
            held: ``M a + nle - loads - tau``, shape (n, nv).
            along: Efforts of the drives along the coordinates, shape (n, g).
        """
        m = closure.size - along.shape[1]

        def own(row: int) -> Array:
            closure.place(q[row])
            rows = closure.rows()
            return Split.of(rows[:m]).multipliers(held[row] - along[row] @ rows[m:])

        return cls(own, along)

    def __getitem__(self, row: int) -> Array:
        return np.concatenate([self.own(row), self.along[row]])

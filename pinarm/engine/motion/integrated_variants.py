"""Integrated motions of variants of a mechanism: states with an axis of variants after the rows.

Each motion is integrated, and its states are completed, by itself: the steps follow from its own errors. What is asked
of the states is computed of all of them at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class IntegratedVariants:
    """Free motions of variants of a tree.

    Attributes:
        run: The rows of the first variant.
        mechanism: The variants.
        motions: Their motions, without jumps and events.
        grids: The rows of each of them, as many; the same object where they are the same.
    """

    run: Trajectory
    mechanism: Mechanism
    motions: Sequence[IntegratedMotion]
    grids: Sequence[Grid]

    @property
    def motion(self) -> IntegratedMotion:
        """The motion of the first variant."""
        return self.motions[0]

    def some(self, mechanism: Mechanism, variants: Indices, grids: Sequence[Grid]) -> IntegratedVariants:
        """Return some of the variants, of which these are the mechanism, at other rows."""
        motions = [self.motions[k] for k in variants.tolist()]
        return replace(self, mechanism=mechanism, motions=motions, grids=grids)

    def rows(self) -> tuple[Trajectory, Flags]:
        """Return the states, and that all of them are sound, shape (k,)."""
        found = [motion.motion.complete(grid) for motion, grid in zip(self.motions, self.grids, strict=True)]
        q, v, a = (np.stack([getattr(states, name) for states in found], axis=1) for name in ("q", "v", "a"))
        closure = self.mechanism.closure
        lam = Multipliers.known(np.zeros((*q.shape[:2], 0)), 0)
        dynamics = Dynamics.of_variants(self.mechanism.model, self.motion.hybrid.dynamics.forces)
        rows = replace(self.run, grid=grid_of_variants(self.grids), mechanism=self.mechanism, q=q, v=v, a=a,
                       tau=np.zeros_like(v), lam=lam, closure=closure, dynamics=dynamics)  # fmt: skip
        return rows, np.ones(len(found), dtype=bool)

    def at(self, near: Array) -> tuple[Trajectory, Flags]:
        """Return the states; what they are near to is not needed."""
        return self.rows()


def grid_of_variants(grids: Sequence[Grid]) -> Grid:
    """Return the rows of variants as those of one grid: of all, shape (n,), or of each, shape (n, k)."""
    first = grids[0]
    alike = all(grid is first for grid in grids)
    return first if alike else replace(first, t=np.stack([grid.t for grid in grids], axis=1))

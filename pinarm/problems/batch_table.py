"""Many motions of one question as the rows of one table: what is asked of every row is computed for all of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Indices
from pinarm.engine.integration.ensemble import Ensemble
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.integrated_motion import states
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.forward import Forward


@dataclass(frozen=True, eq=False)
class BatchTable:
    """Rows of motions, those of an interval between jumps together.

    Attributes:
        run: The rows.
        motion: Which motion each belongs to, shape (rows,).
        instant: Which instant it stands at, shape (rows,).
    """

    run: Trajectory = field(repr=False)
    motion: Indices = field(repr=False)
    instant: Indices = field(repr=False)

    @classmethod
    def of(cls, problem: Forward, mechanism: Mechanism, hybrid: HybridSystem, ensemble: Ensemble) -> BatchTable:
        """Return the motions of an ensemble at the instants of the table, as far as each has come.

        Args:
            problem: The question.
            mechanism: What is solved.
            hybrid: What was integrated; without stops, at which motions would end their segments.
            ensemble: The motions.
        """
        grid = hybrid.grid_of_each(problem.time.instants())
        reached = ensemble.reached(grid.t)
        parts = [np.nonzero(reached[:, rows]) for _, _, rows in grid.intervals()]
        motion = np.concatenate([motions for motions, _ in parts])
        instant = np.concatenate([low + instants for low, (_, instants) in zip(grid.rows, parts, strict=False)])
        rows = Grid(grid.t[instant], grid.cuts, (0, *map(int, np.cumsum([len(some) for some, _ in parts]))))
        q, v = (x[motion, instant] for x in ensemble.states(grid.t))
        run = states(mechanism, hybrid, rows, hybrid.system().complete(hybrid.dynamics, rows, q, v))
        return cls(run, motion, instant)

"""Positions at many states at once, each reached from one start while its coordinates go straight to their values.

The way of every state is cut into 1 step, and where that may leave the branch into 4, 16 and 64 steps. A step is
predicted by velocity and acceleration, and corrected by Newton's method (``batch_closing``). Motions that the
coordinates leave free rest: ``d . (q - q0) = 0`` for every free direction d at the start. Where there are more
coordinates than degrees of freedom, independent ones are followed, and all have their values at the end. A state
depends on no other.
"""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.kinematics.assembly import null_space
from pinarm.engine.kinematics.continuation import BLOCK, SIZES, BatchClosing
from pinarm.engine.kinematics.newton import NewtonSolver
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.input.units import DIMENSIONLESS
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.records import Record

STEPS = (1, 4, 16, 64)
"""Numbers of steps that are tried one after the other: the last ones turn a crank by 0.1 rad on a whole turn."""

GROWTH = 4.0
"""Largest ratio of the largest entry of J^-1 before and after a step: beyond it a singular position may be near."""


class StraightWays(Record, frozen=True):
    """Ways from one closed configuration.

    Attributes:
        closing: Newton's method on the constraints, the coordinates and the free motions, which rest.
        start: The configuration, shape (nv,).
        first: Values of coordinates and free motions there, shape (k + f,).
        judged: Joints whose limits count: those that are not given, as indices in q.
    """

    closing: BatchClosing
    start: Array
    first: Array
    judged: list[int]

    @classmethod
    def of(cls, closure: Closure, prescribed: PrescribedCoordinates, start: Array) -> StraightWays | None:
        """Return the ways from a configuration, shape (nq,); ``None`` where states have to be solved one by one.

        Those are mechanisms with ball joints, screws, or sizes far from 1 m, and starts in singular positions.
        """
        solver, model = NewtonSolver(closure, prescribed), closure.model
        if model.nq > model.nv or not solver.sliding.all() or not SIZES[0] < closure.extent < SIZES[1]:
            return None
        state, places = closure.state(start), np.arange(model.nv)
        free = null_space(solver.rows(state)) / solver.scale
        resting = [LinearCoordinate(DIMENSIONLESS, direction, places) for direction in free]
        names = (*prescribed.names, *(f"free motion {k}" for k in range(len(resting))))
        coordinates = (*prescribed.coordinates, *resting)
        whole = closure.holonomic.with_guides(names, coordinates)
        closing = BatchClosing.of(whole, solver.closure.size, whole.rows(state))
        first = np.array([one.value(state) for one in coordinates])
        given = {getattr(one, "joint", None) for one in prescribed.coordinates}
        return None if closing is None else cls(closing, start, first, [q for q in range(model.nq) if q not in given])

    def ends(self, w: Array) -> tuple[Array, Flags]:
        """Return configurations, shape (n, nv), and where they are surely on the branch and within the limits.

        Args:
            w: Values of the coordinates, shape (n, k).
        """
        rest = np.broadcast_to(self.first[w.shape[1] :], (len(w), len(self.first) - w.shape[1]))
        w, q, good = np.hstack([w, rest]), np.tile(self.start, (len(w), 1)), np.zeros(len(w), dtype=bool)
        for steps in STEPS:
            left = np.flatnonzero(~good)
            for part in (left[start : start + BLOCK] for start in range(0, len(left), BLOCK)):
                with np.errstate(all="ignore"):  # beyond the branch anything may come out: it is not accepted
                    q[part], good[part] = self._followed(w[part], steps)
        return q, good

    def _followed(self, w: Array, steps: int) -> tuple[Array, Flags]:
        """Return the ends of ways of some equal steps, and where each of these surely stays on the branch."""
        share, h, model = (w - self.first) / steps, np.ones(len(w)), self.closing.rows.model
        q, good, still = np.tile(self.start, (len(w), 1)), np.ones(len(w), dtype=bool), np.zeros_like(w)
        before, closed = self.closing.rates(self.closing.at(q), share, still), good
        for step in range(1, steps + 1):
            slope, laws = before.v + before.a, np.array([self.first + step * share, share, still])
            found = self.closing.corrected(q + before.v + 0.5 * before.a, slope, h, laws)
            growth = found.rates.size / before.size
            good &= found.near & (found.rates.sense == before.sense) & (growth <= GROWTH) & (growth >= 1.0 / GROWTH)
            q, before, closed = found.q, found.rates, found.closed
        low, high = model.lowerPositionLimit[self.judged], model.upperPositionLimit[self.judged]
        within = (q[:, self.judged] >= low) & (q[:, self.judged] <= high)
        return q, good & closed & within.all(axis=1)

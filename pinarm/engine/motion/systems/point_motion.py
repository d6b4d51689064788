"""The motion of loops that are closed by points, step by step, past singular positions too."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.coordinate_partition import Targets
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.pinocchio_constraints import PointConstraints
from pinarm.engine.integration.integrator import Acceleration
from pinarm.engine.motion.systems.batch_rows import ITERATIONS, ROUNDED
from pinarm.engine.motion.systems.row_motion import require_closed_accelerations

FLOOR = 0.3
"""Least step close to singular positions, relative to the last one that was taken far from them."""

STALLED = 1e-9
"""Gap below which Newton's method may end because rounding lets it shrink no more, relative to the extent."""

NEAR = 0.05
"""Smallest singular value of the rows, relative to the largest, and this to what it is at positions of no special kind,
below which every stage is brought back onto the constraints. Four-bars of equal rods end as close to the truth as with
0.2, in three quarters of the time, at 160 tolerances from 1e-3 to 1e-13, none on another branch."""

AHEAD, COARSE, CLOSE = 1.5, 0.65, 0.1
"""Every stage is also brought back in a step that may pass a singular position in one go: where the regularity, falling
1.5 times as much as it fell over the last step, is 0 or less, and either that fall was more than 0.65 or the regularity
is less than 0.1. Errors of stages there grow with 1 over the regularity, and the estimate of so long a step does not
show it: at tolerance 1e-3 one motion in a hundred went on on another branch. Finer steps are shortened by their errors
until they are as near as ``NEAR``."""

BLIND, ASIDE, ACROSS = 5e-4, 1e-3, np.array([-1.0, 4.0, 4.0, -1.0]) / 6.0
"""The same below which a position says little of the acceleration there; it is then interpolated between positions at
once and twice that distance, before and behind it on the way, with these weights. The motion is smooth."""

VANISHED = 1e-14
"""Square of a singular value, relative to the largest, that is 0 but for rounding."""


class PointMotion:
    """The motion on one interval; it looks at every accepted state how close a singular position is."""

    def __init__(self, points: PointConstraints, rows: Closure, dynamics: Dynamics, targets: Targets) -> None:
        self.points, self.extent, self.scale, self.targets = points, rows.extent, rows.scale, targets
        self.places = [points.tied.model.joints[int(points.joint_at(v))].idx_q for v in points.tied.driven]
        self.dynamics, self.exact = dynamics, points.exact
        self.free = points.acceleration(dynamics, targets, self.exact)
        self.tolerant: tuple[pin.ProximalSettings, Acceleration] | None = None
        self.near, self.rank, self.looked, self.rows = True, 0, False, np.empty((0, 0))
        self.regular, self.singular = 0.0, True
        self.t, self.step, self.least = -np.inf, 0.0, 0.0
        self.choices: dict[float, tuple[bool, int]] = {}

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration, near singular positions that of the closed state."""
        if self.near:
            self.points.factorise(q)
            if self.looked and v.any() and self.blind():
                return self.across(t, q, v)
            q, v = self.closed(q, v)
            if not self.looked:
                self.look(q)
        tolerant = self.tolerant if not self.near and self.rank < self.points.tied.rank else None
        a = (tolerant[1] if tolerant else self.free)(t, q, v)
        if t == self.t:
            require_closed_accelerations(self.rows, a, self.points.right(), t, q)
        return a

    def settings(self, rank: int) -> pin.ProximalSettings | None:
        """Return how stages in regular steps are solved for; ``None`` where the rank is low and it is not known yet."""
        if rank == self.points.tied.rank:
            return self.exact
        return self.tolerant[0] if self.tolerant else None

    def blind(self) -> bool:
        """Return whether the position last factorised is too close to a singular one."""
        return self.regularity() < BLIND

    def across(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration at a singular position that is passed, from both sides of it."""
        model, aside = self.points.tied.model, (ASIDE / float(np.abs(v / self.scale).max())) * v
        there = []
        for k in (-2, -1, 1, 2):
            beside = pin.integrate(model, q, k * aside)
            self.points.factorise(beside)
            there.append(self.free(t, *self.closed(beside, v)).copy())
        return np.asarray(ACROSS @ np.array(there))

    def floor(self) -> float:
        """Return the least step here: a fraction of the last one that was taken far from singular positions [s]."""
        return self.least

    def settle(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the closed state, and choose by it how to go on."""
        if self.places:
            q[self.places], v[self.points.tied.driven], _ = self.targets(t)
        self.points.factorise(q)
        q, v = self.closed(q, v)
        self.look(q)
        if not self.singular and self.t > -np.inf:
            self.step = t - self.t
        self.least = FLOOR * self.step if self.singular else 0.0
        self.t = t
        self.choices[t] = self.near, self.rank
        return q, v

    def chosen(self, t: float) -> tuple[bool, int]:
        """Return whether stages are closed in the step that begins at t, and the rank; at first they are."""
        return self.choices.get(t, (True, self.rank))

    def since(self, t: float) -> Acceleration:
        """Return the acceleration as it was chosen at the start of a step, at the first instant as close as can be."""
        chosen = self.chosen(t)

        def acceleration(instant: float, q: Array, v: Array) -> Array:
            now, (self.near, self.rank) = (self.near, self.rank), chosen
            try:
                return self.acceleration(instant, q, v)
            finally:
                self.near, self.rank = now

        return acceleration

    def look(self, q: Array) -> None:
        """Choose how to go on, by how regular the position is, which is the one last closed."""
        before, self.regular = self.regular, self.regularity(closed=True)
        self.looked, self.singular = True, self.regular < NEAR
        fall = before - self.regular
        self.near = self.singular or (self.regular < AHEAD * fall and (fall > COARSE or self.regular < CLOSE))
        if not self.near and self.rank < self.points.tied.rank and not self.tolerant:
            settings = self.points.tolerant(q, self.rank)
            self.tolerant = settings, self.points.acceleration(self.dynamics, self.targets, settings)

    def regularity(self, *, closed: bool = False) -> float:
        """Return how regular the rows are at the position last factorised, relative to the usual.

        ``s_r / s_1``, s being the singular values of G in descending order and r the rank along the motion: the largest
        one found so far at closed positions. A singular position lowers the rank there, but not r: its regularity is 0.
        """
        self.rows = rows = self.points.rows()
        try:
            squares = np.linalg.eigvalsh(rows @ rows.T).tolist()  # quicker than singular values, and exact enough
        except np.linalg.LinAlgError:  # a stage that is not finite; the step will be refused
            return float("nan")
        if closed:
            self.rank = max(self.rank, sum(square > VANISHED * squares[-1] for square in squares))
        return float(max(squares[-self.rank] / squares[-1], 0.0) ** 0.5) / self.points.tied.regularity

    def closed(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the closed state nearest to (q, v), q last factorised, the distance measured by the masses."""
        points, before, extent = self.points, np.inf, self.extent
        for _ in range(ITERATIONS):
            gap = points.gap()
            size = float(gap.dot(gap)) ** 0.5
            if size <= ROUNDED * extent or (size < STALLED * extent and size > 0.5 * before):
                break
            q, before = pin.integrate(points.tied.model, q, points.step(gap)), size
            points.factorise(q)
        return q, v - points.step(points.rows() @ v)

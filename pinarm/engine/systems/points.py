"""Loops that are closed by points: integrated by Pinocchio's own constrained dynamics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.closure import Closure
from pinarm.engine.dynamics import Dynamics
from pinarm.engine.integrators import Manifold, Stretch
from pinarm.engine.native import ACCURATE, TRUNCATED, PointClosure
from pinarm.engine.reduction import Targets
from pinarm.engine.systems.constrained import ConstrainedSystem
from pinarm.engine.systems.contract import Initial, Motion
from pinarm.mechanics.motion import Grid

ITERATIONS = 12

FLOOR = 0.3
"""Least step close to singular positions, relative to the last one that was taken far from them."""

ROUNDED = 1e-15
"""Gap that is rounding, relative to the extent: close to singular positions less than that is still felt."""

STALLED = 1e-9
"""Gap below which Newton's method may end because rounding lets it shrink no more, relative to the extent."""

NEAR, CLOSE = 0.2, 0.03
"""Smallest singular value of the rows, relative to the largest, and this to what it is at positions of no special kind:
below the first every stage is brought back onto the constraints, as it always is where loops are overconstrained; below
the second the proximal term is the truncating one, which is less exact where masses differ much."""

VANISHED = 1e-14
"""Square of a singular value, relative to the largest, that is 0 but for rounding."""


@dataclass(frozen=True, eq=False)
class PointSystem:
    """The whole state of a mechanism whose loops are closed by points.

    Attributes:
        general: The same system by its rows: it begins and completes the motion.
        points: The loops as points.
    """

    general: ConstrainedSystem
    points: PointClosure

    @property
    def manifold(self) -> Manifold:
        """Return the space of configurations."""
        return self.general.manifold

    @property
    def closure(self) -> Closure:
        """Return the constraints."""
        return self.general.closure

    def begin(self, initial: Initial, start: float, end: float) -> tuple[Array, Array]:
        """Return the closed state nearest to the initial one."""
        return self.general.begin(initial, start, end)

    def stretch(self, dynamics: Dynamics, start: float, end: float) -> Stretch:
        """Return the motion on an interval without jumps."""
        general = self.general
        motion = _PointMotion(self.points, general.rows.extent, dynamics.on(start, end), general.imposed.on(start, end))
        return Stretch(start, end, motion.acceleration, motion.settle, motion.floor, self.general.energy(dynamics))

    def part(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the state itself."""
        return q, v

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the states themselves."""
        return q, v

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> Motion:
        """Return the motion, closed at every row, with accelerations and multipliers."""
        return self.general.complete(dynamics, grid, q, v)


class _PointMotion:
    """The motion on one stretch; it looks at every accepted state how close a singular position is."""

    def __init__(self, points: PointClosure, extent: float, dynamics: Dynamics, targets: Targets) -> None:
        self.points, self.extent, self.targets = points, extent, targets
        self.places = [points.model.joints[int(points.joint_at(v))].idx_q for v in points.driven]
        self.usual = points.acceleration(dynamics, ACCURATE, targets)
        self.truncated = points.acceleration(dynamics, TRUNCATED, targets)
        self.free, self.near, self.looked = self.usual, True, False
        self.t, self.step, self.least = -np.inf, 0.0, 0.0

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration, near singular positions that of the closed state."""
        if self.near:
            q, v = self.closed(q, v)
            if not self.looked:
                self.look()
        return self.free(t, q, v)

    def floor(self) -> float:
        """Return the least step here: a fraction of the last one that was taken far from singular positions [s]."""
        return self.least

    def settle(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the closed state, and choose by it how to go on."""
        if self.places:
            q[self.places], v[self.points.driven], _ = self.targets(t)
        q, v = self.closed(q, v)
        self.look()
        if not self.near:
            self.step = t - self.t
        self.least = FLOOR * self.step if self.near else 0.0
        self.t = t
        return q, v

    def look(self) -> None:
        """Choose how to go on, by how regular the position last closed is."""
        rows = self.points.rows()
        squares = np.linalg.eigvalsh(rows @ rows.T)  # quicker than singular values, and exact enough
        held = squares[squares > VANISHED * squares[-1]]
        regularity = (held[0] / held[-1]) ** 0.5 / self.points.regularity
        self.near = regularity < NEAR or len(held) < self.points.rank
        self.free = self.truncated if regularity < CLOSE else self.usual
        self.looked = True

    def closed(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the closed state nearest to (q, v), the distance measured by the masses."""
        points, before, extent = self.points, np.inf, self.extent
        for _ in range(ITERATIONS):
            points.factorise(q)
            gap = points.gap()
            size = float(np.abs(gap).max())
            if size <= ROUNDED * extent or (size < STALLED * extent and size > 0.5 * before):
                break
            q, before = pin.integrate(points.model, q, points.step(gap)), size
        return q, v - points.step(points.rows() @ v)

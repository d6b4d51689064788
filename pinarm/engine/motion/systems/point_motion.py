"""The motion of loops that are closed by points, step by step, past singular positions too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.coordinate_partition import Targets
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.pinocchio_constraints import PointConstraints, joint_at
from pinarm.engine.integration.integrator import Acceleration
from pinarm.engine.motion.systems.row_motion import ITERATIONS, ROUNDED, require_closed_accelerations
from pinarm.errors import NumericsError

if TYPE_CHECKING:
    from pinarm.engine.dynamics.many_points import ManyPointConstraints

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

BLIND, ASIDE, ACROSS = 2.5e-3, 8e-3, np.array([-1.0, 8.0, -28.0, 56.0, 56.0, -28.0, 8.0, -1.0]) / 70.0
"""The same, s, below which a position says little of the state, whose place is known to eps / s and whose velocity to
eps / s^2, and of the acceleration there. The state is then not closed: it would lose energy. The acceleration is
interpolated between positions at once to four times that distance [rad], before and behind it on the way, with these
weights. The motion is smooth, and the error is of the eighth order, below 1e-14 of the motion; with six positions it
would be as large as ``PASSED``. None of them should come close to the singular position itself: of four-bars, whose
regularity changes by 0.5 per radian, a blind state is up to 5e-3 from it. If it changes by less than 0.3, one may."""

PASSED, TURNED = 1e-11, 1e-9
"""Gap of the loops, relative to the extent, at the position so interpolated. Up to the first a singular position is
passed. Above the second the loops do not close there: the motion turns sharply beside it, which takes short steps. A
gap between them, as where a rod is 1e-9 longer than would give a singular position, leaves the way to rounding."""

CLEAR = 0.5
"""Motion within a step, over the smaller one of the regularities at its ends, or 1, below which no singular position is
within [rad]: four-bars take 1 from one end, and 2 from one end to the other. It is taken as ``h (v + h a / 4)`` of the
larger speed and the larger acceleration at the ends: more than a harmonic swing moves from rest to rest."""

VANISHED = 1e-14
"""Square of a singular value, relative to the largest, that is 0 but for rounding."""


class PointMotion:
    """The motion on one interval; it looks at every accepted state how close a singular position is."""

    def __init__(
        self, points: PointConstraints | ManyPointConstraints, rows: Closure, dynamics: Dynamics, targets: Targets
    ) -> None:
        self.points, self.extent, self.scale, self.targets = points, rows.extent, rows.scale, targets
        self.places = [joint_at(points.tied.model, v).idx_q for v in points.tied.driven]
        self.dynamics, self.exact = dynamics, points.exact
        self.free = points.acceleration(dynamics, targets, self.exact)
        self.beside = points.acceleration(dynamics, targets, points.beside)
        self.tolerant: tuple[pin.ProximalSettings, Acceleration] | None = None
        self.near, self.rank, self.looked, self.rows = True, 0, False, np.empty((0, 0))
        self.regular, self.singular, self.open = 0.0, True, 0.0
        self.t, self.step, self.least, self.speed, self.largest = -np.inf, 0.0, 0.0, 0.0, 0.0
        """Of the last accepted state the instant, of the last regular step the length, the least step now [s], and the
        largest velocity and acceleration of that state in the units of velocities."""
        self.ranks: dict[float, int] = {}
        self.clear: set[float] = set()
        """Starts of the steps that are clear of singular positions [s]."""
        self.ended: tuple[float, float, float] | None = None
        """Start and length of the step that ended last [s], and the motion that is clear; ``None`` where none is."""
        self.unchecked = np.nan
        """Instant of an accepted state whose acceleration is still to be looked at, when it is first asked for [s]."""

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration, near singular positions that of the closed state."""
        if self.near:
            self.points.factorise(q)
            if self.looked and v.any() and self.blind(self.regularity()):
                a = self.across(t, q, v)
                if not self.turns:
                    return a
                self.points.factorise(q)
            q = self.closed(q)
            if not self.looked:
                self.begin(t, q, v)
            v = self.tangent(v)
        tolerant = self.tolerant if not self.near and self.rank < self.points.tied.rank else None
        a = (self.beside if self.near else tolerant[1] if tolerant else self.free)(t, q, v)
        if t == self.unchecked:  # stages of steps that end there are not closed
            self.unchecked = np.nan
            require_closed_accelerations(self.rows, a, self.points.right(), t, q)
            self._note_clear(v, a)
        return a

    def settings(self, rank: int) -> pin.ProximalSettings | None:
        """Return how stages in regular steps are solved for; ``None`` where the rank is low and it is not known yet."""
        if rank == self.points.tied.rank:
            return self.exact
        return self.tolerant[0] if self.tolerant else None

    def blind(self, regularity: float) -> bool:
        """Return whether a position is too close to a singular one that is passed."""
        return regularity < BLIND and not self.turns

    @property
    def turns(self) -> bool:
        """Whether the motion turns beside a singular position, where the loops do not close."""
        return self.open > PASSED * self.extent

    def require_known_way(self, t: float) -> None:
        """Raise where rounding would decide whether a singular position is passed.

        Raises:
            NumericsError: If it would.
        """
        if PASSED * self.extent < self.open <= TURNED * self.extent:
            low, high = PASSED * self.extent, TURNED * self.extent
            raise NumericsError(
                f"at t = {t:.9g} s the loops almost close in a singular position: they are open by {self.open:.2g} m "
                "there, too little to tell whether the mechanism goes through it or turns beside it",
                expected=f"a gap below {low:.1g} m, which counts as a position that is passed, or above {high:.1g} m",
                hint="give lengths with all their digits, so that the position is exact, or change one by 1e-7 of it",
            )

    def across(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration at a singular position that is passed, from both sides of it; see if it is one."""
        model, aside = self.points.tied.model, (ASIDE / float(np.abs(v / self.scale).max())) * v
        accelerations, changes = [], []
        for k in (-4, -3, -2, -1, 1, 2, 3, 4):
            beside = pin.integrate(model, q, k * aside)
            self.points.factorise(beside)
            closed = self.closed(beside)
            accelerations.append(self.beside(t, closed, self.tangent(v)).copy())
            changes.append(pin.difference(model, beside, closed))
        self.points.factorise(pin.integrate(model, q, ACROSS @ np.array(changes)))
        self.open = float(np.linalg.norm(self.points.gap()))
        return np.asarray(ACROSS @ np.array(accelerations))

    def floor(self) -> float:
        """Return the least step where a singular position is passed: a fraction of the last one far from them [s]."""
        return 0.0 if self.turns else self.least

    def settle(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the closed state, and choose by it how to go on."""
        if self.places:
            q[self.places], v[self.points.tied.driven], _ = self.targets(t)
        self.points.factorise(q)
        closed, (near, regular, rank) = self.closed(q), (self.near, self.regular, self.rank)
        self.look(closed)
        if not self.blind(self.regular):
            q, v = closed, self.tangent(v)
        if not self.singular and self.t > -np.inf:
            self.step = t - self.t
        self.least = FLOOR * self.step if self.singular else 0.0
        known = not near and self.rank == rank
        self.ended = (self.t, t - self.t, CLEAR * min(1.0, regular, self.regular)) if known else None
        self.t = self.unchecked = t
        self.ranks[t] = self.rank
        self.require_known_way(t)
        return q, v

    def _note_clear(self, v: Array, a: Array) -> None:
        """Note whether the step that ended in a state is clear of singular positions."""
        speed, largest = self.speed, self.largest
        self.speed, self.largest = (float(np.abs(x / self.scale).max()) for x in (v, a))
        if self.ended is not None:
            start, h, most = self.ended
            if h * (max(speed, self.speed) + 0.25 * h * max(largest, self.largest)) < most:
                self.clear.add(start)

    def outlook(self, t: float) -> tuple[bool, int]:
        """Return whether the step from t [s] on is clear of singular positions, and the rank of the rows in it.

        A step is not clear where the rank has grown since it began: it began at a singular position.
        """
        rank = self.ranks.get(t, self.rank)
        return t in self.clear and rank == self.rank, rank

    def since(self, t: float) -> Acceleration:
        """Return the acceleration for the dense output of the step that begins at t [s].

        The error of a step says nothing of the further stages of its dense output: in a long step that passes a
        singular position in one go they may lie right beside it, where states that are a little open have accelerations
        of any size. They are closed, but in steps that are clear.
        """
        clear, rank = self.outlook(t)
        chosen = not clear, rank

        def acceleration(instant: float, q: Array, v: Array) -> Array:
            now, (self.near, self.rank) = (self.near, self.rank, self.open), chosen
            try:
                return self.acceleration(instant, q, v)
            finally:
                self.near, self.rank, self.open = now

        return acceleration

    def begin(self, t: float, q: Array, v: Array) -> None:
        """Choose how to go on from the start; next to a singular position a regular step is the time to get away."""
        self.look(q)
        self.ranks[t] = self.rank
        if not self.near:
            self.t = self.unchecked = t
        speed = float(np.abs(v / self.scale).max())
        if self.singular and speed:
            self.step = NEAR / speed
            self.least = FLOOR * self.step

    def look(self, q: Array) -> None:
        """Choose how to go on, by how regular the position is, which is the one last closed."""
        before, self.regular = self.regular, self.regularity(closed=True)
        self.looked, self.singular = True, self.regular < NEAR
        self.open = self.open if self.singular else 0.0
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
        self.rows = self.points.rows()
        try:
            squares = self.points.squares().tolist()
        except np.linalg.LinAlgError:  # a stage that is not finite; the step will be refused
            return float("nan")
        if closed:
            self.rank = max(self.rank, sum(square > VANISHED * squares[-1] for square in squares))
        return float(max(squares[-self.rank] / squares[-1], 0.0) ** 0.5) / self.points.tied.regularity

    def closed(self, q: Array) -> Array:
        """Return the closed position nearest to q, which was last factorised, the distance measured by the masses."""
        points, before, extent = self.points, np.inf, self.extent
        for _ in range(ITERATIONS):
            gap = points.gap()
            size = float(gap.dot(gap)) ** 0.5
            if size <= ROUNDED * extent or (size < STALLED * extent and size > 0.5 * before):
                break
            q, before = pin.integrate(points.tied.model, q, points.step(gap)), size
            points.factorise(q)
        return q

    def tangent(self, v: Array) -> Array:
        """Return the velocity nearest to v that keeps the loops closed at the position last factorised."""
        return v - self.points.step(self.points.rows() @ v)

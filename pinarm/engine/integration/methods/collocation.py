"""Gauss-Legendre collocation over long windows, all of whose nodes are evaluated in one call."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integration.dense_output import DenseOutput
from pinarm.engine.integration.first_step import first_step
from pinarm.engine.integration.integrator import BATCH_ROUNDING, Count, Doubt, Interval, Manifold, Solution
from pinarm.engine.integration.methods import for_all_motions
from pinarm.engine.integration.methods.collocation_window import SlopePolynomial, Window
from pinarm.engine.integration.methods.gauss_legendre import gauss
from pinarm.engine.integration.steps import StepTable
from pinarm.errors import MethodError

SAFETY, GAIN, SLOWEST, FASTEST = 0.8, 0.5, 0.3, 4.0
"""Step control as in ``step_control``, with other values: windows are so long that the motion changes within them."""

SHRINKING, FEW, MOST = 0.1, 6, 16
"""Largest mean ratio of the changes of successive sweeps wanted in the next window (it grows with the square of the
window's length); number of sweeps that are accepted whatever their ratio; largest number of sweeps."""

ENOUGH = 0.02
"""Change of a sweep, over the tolerance, at which the sweeps end."""

ROUNDING = 1e-15
"""Relative change of a sweep that is rounding."""

KEPT, SPARED = 2, 4
"""Extrapolation beyond a window uses as many coefficients of its polynomial as the tolerance has digits and ``KEPT``
more, and leaves out at least ``SPARED``: high coefficients grow fast there, and are inaccurate at wide tolerances."""

TINY = 1e-9
"""Smallest ratio of changes, which limits nothing; it avoids a division by 0."""

REACH = 1.3
"""Length, over that of a rejected window, up to which its polynomial is a better start than the previous window's."""

NEEDLESS, LIMITED = 1e-6, 0.5
"""Error of a window over the tolerance at which it could be twice as long if its sweeps converged; share of such
windows from which a motion is reported as stiff."""


@dataclass(frozen=True)
class Collocation:
    """Gauss-Legendre collocation in windows so long that all their nodes are evaluated in one call.

    ``v_i = v_0 + h sum_j a_ij a(t_j, q_j, v_j)``, ``q_i = q_0 + h sum_j a_ij velocity(q_j, v_j)``, solved
    by fixed-point sweeps: the accelerations of the last sweep are put into the right side. The first sweep begins with
    the extrapolated polynomial of the previous window. The error is estimated from the last coefficients of the
    Legendre series of the slopes; this bounds the error of the dense output, the collocation polynomial. The ends of
    windows are far more accurate, of order 2s.

    For smooth motions of open chains at tight tolerances. To errors of 1e-9 and 1e-11 a run takes 0.75 and 0.7 of the
    time that it takes with ``Adaptive`` for a double pendulum, 0.6 and 0.45 for a tumbling satellite with two arms, 1.0
    and 0.85 for an arm of seven joints; above 1e-6 it mostly takes longer. It refuses loops, on which it took 1.2 to 4
    times as long, state by state. Sweeps do not converge on stiff problems: windows then follow the fastest decay or
    oscillation, which ``diagnose`` reports.

    Sources: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.7; sweeps and their start:
    Hairer, Lubich, Wanner, Geometric Numerical Integration, sections VIII.6.1 and VIII.6.2.

    Attributes:
        tolerance: Local error per window, relative to ``size + |y|``, see ``Interval.size``; good values 1e-5 to 1e-13.
        nodes: Number of nodes s of a window.
    """

    tolerance: float
    nodes: int = 16
    name = "Gauss-Legendre collocation"
    remedy = "a wider tolerance"
    tangent = False
    pair = None

    @property
    def order(self) -> int:
        """Order at the ends of windows."""
        return 2 * self.nodes

    @property
    def subdivisions(self) -> int:
        """Parts of a window for the location of events: the dense output has the degree s."""
        return max(4, (self.nodes + 1) // 2)

    def prepare(self, intervals: Sequence[Interval], q: Array, v: Array) -> Sequence[Interval]:
        """Return the intervals unchanged.

        Raises:
            MethodError: There are no accelerations of many states at once, or there are constraints.
        """
        if any(interval.batch is None or interval.settle for interval in intervals):
            raise MethodError(
                "the method collocation needs the accelerations of many states at once, as open chains have them; here "
                "loops, coordinates that follow laws, or controllers are solved state by state",
                expected=f"one of {', '.join(for_all_motions())}", hint="accuracy.method: dop853",
            )  # fmt: skip
        return intervals

    def stepper(self, manifold: Manifold, count: Count) -> CollocationStepper:
        """Return a stepper of this method."""
        return CollocationStepper(self, manifold, count)

    def dense_output(self, interval: Interval, manifold: Manifold, steps: StepTable) -> DenseOutput:
        """Return the terms of the collocation polynomial: ``h terms @ (series @ k)``."""
        table = gauss(self.nodes)
        terms = steps.h[:, None, None] * (table.terms @ (table.series @ steps.slopes))
        return DenseOutput.whole(steps.y, terms)

    def diagnose(self, solution: Solution) -> list[Doubt]:
        """Return a note where the convergence of the sweeps, not the error, keeps windows short."""
        share = solution.count.limited / max(len(solution.steps), 1)
        if share < LIMITED:
            return []
        text = (
            f"stiff: on {share:.0%} of the windows {self.name} is limited by the convergence of its sweeps, not by "
            "accuracy; accuracy.method: stiff takes longer steps where motions decay, dop853 where they swing"
        )
        return [Doubt("stiff", share, text)]


class CollocationStepper:
    """The stepper of the collocation."""

    def __init__(self, method: Collocation, manifold: Manifold, count: Count) -> None:
        s, n = method.nodes, manifold.nq + manifold.nv
        self.tolerance, self.manifold, self.count = method.tolerance, manifold, count
        self.y, self.slope = np.zeros(n), np.zeros(n)
        self.window = Window(s, manifold)
        self.last: SlopePolynomial | None = None
        self.refused: SlopePolynomial | None = None
        self.exponent, self.ceiling, self.sweeps, self.ratio = -1.0 / s, FASTEST, 0, 0.0
        self.kept = max(min(s - SPARED, KEPT - round(math.log10(self.tolerance))), 1)

    @property
    def finite(self) -> bool:
        """Whether the accelerations last computed are finite."""
        return bool(np.isfinite(self.window.accelerations).all())

    def begin(self, interval: Interval, y: Array) -> None:
        """Set the state at the start of an interval."""
        self.interval, self.last, self.refused = interval, None, None
        self.together = interval.unchecked_batch or interval.batch or self._one_by_one
        self.y[:] = y
        self.slope = self._slope(interval.start, self.y)
        self.window.slopes[:] = self.slope

    def _one_by_one(self, t: Array, q: Array, v: Array) -> Array:
        return np.array([self.interval.acceleration(float(at), *state) for at, *state in zip(t, q, v, strict=True)])

    def _slope(self, t: float, y: Array) -> Array:
        nq = self.manifold.nq
        q, v = self.manifold.project(y[:nq]), y[nq:]
        self.count.evaluations += 1
        return np.concatenate([self.manifold.velocity(q, v), self.interval.acceleration(t, q, v)])

    def first(self, h: float) -> float:
        """Return the window proposed in the previous interval, or one from two slopes."""
        start, end, order = self.interval.start, self.interval.end, len(self.window.t) - 1
        return h or float(
            first_step(start, end, self.y, self.slope, self._slope, self.tolerance, order, self.interval.size)
        )

    def attempt(self, t: float, h: float) -> float:
        """Compute a window from the present state; return its error over the tolerance, inf without convergence.

        ``e = h / (2s - 1) rms(sqrt(c_(s-1)^2 + 0.01 c_(s-2)^2))`` with the Legendre coefficients c of the slopes over
        ``tol (size + |y|)``.
        """
        window, self.t = self.window, t
        window.begin(t, h, self.y, self._guess(t, h))
        scale = self.tolerance * (self.interval.size + np.abs(self.y))
        if not self._converge(h / scale[self.manifold.nq :]):
            return np.inf
        if not self._agrees():
            self.together = self._one_by_one
            return self.attempt(t, h)
        tail = window.table.series[-2:] @ window.slopes / scale
        before, last = tail[0].dot(tail[0]), tail[1].dot(tail[1])
        return h / (2 * len(window.t) - 1) * math.sqrt((last + 0.01 * before) / len(scale))

    def _guess(self, t: float, h: float) -> Callable[[Array], Array]:
        """Return ``t -> slopes`` with which the sweeps begin."""
        if self.refused and t + h <= self.refused.t + REACH * self.refused.h:
            return self.refused.at
        return self.last.at if self.last else lambda t: self.slope

    def _converge(self, unit: Array) -> bool:
        """Sweep until the remaining change is below ``ENOUGH``; return whether the sweeps converged.

        Args:
            unit: ``h / (tol (size + |v|))``, shape (nv,): from changes of acceleration to those of v
                over the tolerance.
        """
        window, change, together, least, before, first = self.window, self.window.change, self.together, 0.0, 0.0, 0.0
        unit = unit / change.size**0.5
        for self.sweeps in range(1, MOST + 1):
            new = window.sweep(together)
            change *= unit
            size = math.sqrt(np.vdot(change, change))
            first, least = first or size, least or ROUNDING * math.sqrt(np.vdot(new * unit, new * unit))
            done = size * min(size / before if before else 1.0, 1.0) <= ENOUGH or size <= least
            if done or not size < np.inf or (self.sweeps > 3 and self._hopeless(size, size / first)):
                break
            before = size
        self.count.evaluations += self.sweeps * len(window.t)
        self.ratio = (size / first) ** (1.0 / (self.sweeps - 1)) if before else 0.0
        return done

    def _hopeless(self, size: float, shrunk: float) -> bool:
        """Return whether the change predicted for the last allowed sweep, at the present rate, is above ``ENOUGH``."""
        return bool(shrunk > 1.0 or size * shrunk ** ((MOST - self.sweeps) / (self.sweeps - 1)) > ENOUGH)

    def _agrees(self) -> bool:
        """Return whether the batch acceleration of the last node equals that of the single state."""
        window = self.window
        alone = self.interval.acceleration(float(window.t[-1]), window.on[-1], window.v[-1])
        return bool(np.abs(window.accelerations[-1] - alone).max() <= BATCH_ROUNDING * np.abs(alone).max())

    def along(self, t: float, h: float) -> tuple[Array, Array]:
        """Return the start, the nodes and the end of the window attempted."""
        inner = np.hstack([self.window.on, self.window.v])
        return np.array([t, *self.window.t, t + h]), np.vstack([self.y, inner, self._end(h)])

    def _end(self, h: float) -> Array:
        """Return the state at the end of the window."""
        nq, new = self.manifold.nq, self.y + h * (self.window.table.b @ self.window.slopes)
        new[:nq] = self.manifold.project(new[:nq])
        return new

    def retry(self, h: float, error: float) -> float:
        """Return a shorter window; its sweeps begin with the polynomial of the rejected one if that converged."""
        self.ceiling = 1.0
        if error == np.inf:
            return 0.5 * h
        self.refused = self.window.course(self.t, h, len(self.window.t))
        return float(h * max(SLOWEST, SAFETY * error**self.exponent))

    def accept(self, t: float, h: float, error: float) -> tuple[Array, float]:
        """Move to the end of the window; return its slopes and the next window [s]."""
        self.y[:] = self._end(h)
        self.last = self.window.course(t - h, h, self.kept)
        wider = SAFETY * error ** (GAIN * self.exponent) if error else FASTEST
        possible = max(math.sqrt(SHRINKING / max(self.ratio, TINY)), FEW / self.sweeps)
        self.count.limited += error < NEEDLESS and possible < wider
        h *= min(wider, possible, self.ceiling)
        self.ceiling = FASTEST
        left = self.interval.end - t
        return self.window.slopes.copy(), left / math.ceil(left / h) if left > h else h

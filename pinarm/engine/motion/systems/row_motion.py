"""The motion under constraints, state by state, by the rows of G: for loops of any kind, and guided coordinates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import RowDecompositions
from pinarm.engine.dynamics.coordinate_partition import Targets
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import masses
from pinarm.errors import DynamicsError
from pinarm.mechanics.joints import format_configuration

Settled = Callable[[Array, Array, Array, Array, Array], tuple[Array, Array, RowDecompositions]]
"""``(q, v, w, dw, t) -> q, v`` closed, of many states, and the rows there; see ``ConstrainedSystem.settled``."""

CLOSED = 1e-13
"""Gap at which a state counts as closed [m or rad]; one step more ends at rounding."""

ROUNDED = 1e-15
"""Gap that is rounding, relative to the extent: close to singular positions less than that is still felt."""

TURNED = 1e-15
"""What rounding of an angle of many turns leaves open, over the angle."""

ITERATIONS = 12
"""Steps of Newton's method at most, which close a state that is nearly closed in two or three."""

MET, LEAST = 1e-6, 1.0
"""Part of its terms that ``G a + G' v`` may be at accepted states, where closed loops leave less than 1e-10; and the
size that terms have at least, since at rest all of them vanish [m/s^2 or rad/s^2]."""

TOLD = 1e-6
"""Smallest singular value of the rows, relative to the largest, from which on branches are told apart: closed to
rounding, a linkage is known to the root of it."""


class RowMotion:
    """The motion on one interval; it looks at accepted states whether rounding would choose the way on.

    Args:
        rows: The constraints, then the prescribed coordinates.
        settled: Closes states.
        dynamics: The equation of motion.
        targets: What the prescribed coordinates are to be.
    """

    def __init__(self, rows: Closure, settled: Settled, dynamics: Dynamics, targets: Targets) -> None:
        self.rows, self.settled, self.dynamics, self.targets = rows, settled, dynamics, targets
        self.rank, self.begun, self.close = 0, False, False
        self.unchecked = np.nan
        """Instant of an accepted state whose acceleration is still to be looked at, when it is first asked for [s]."""

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration."""
        closure, dynamics, ddw = self.rows, self.dynamics, self.targets(t)[2]
        state = closure.state(q, v)
        rows = closure.rows(state)
        split, right = closure.split(rows), -closure.drift(state)
        right[len(right) - len(ddw) :] += ddw
        force = dynamics.loads(t, q, v) - pin.nonLinearEffects(dynamics.model, dynamics.data, q, v)
        a = solve(split, masses(dynamics.model, q), force, right)
        if t == self.unchecked:  # stages of steps that end there are not closed
            self.unchecked = np.nan
            require_closed_accelerations(rows, a, right, t, q)
        return a

    def settle(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the closed state nearest to (q, v)."""
        w, dw, _ = self.targets(t)
        closed, rates, splits = self.settled(q[None], v[None], w[None], dw[None], np.array([t]))
        ((_, split),) = splits.parts
        self._require_apart(t, closed[0], self.rows.values(closed)[0, : split.rank])
        self.unchecked = t
        return closed[0], rates[0]

    def _require_apart(self, t: float, q: Array, values: Array) -> None:
        """Raise where a second step in a row ends at a singular position: rounding would choose the way on.

        Passed by a step of ordinary length, it is left on the branch on which it was reached.
        """
        self.rank = max(self.rank, len(values))
        regular = len(values) == self.rank and bool((values[-1:] > TOLD * values[:1]).all())
        if self.close and not regular:
            raise DynamicsError(
                f"at t = {t:.9g} s the position is singular but for rounding, which would choose among the motions "
                f"that meet there: {format_configuration(self.dynamics.model, q)}",
                expected="a motion that passes singular positions at some speed",
                hint="lengths that differ by more than rounding, or masses for light links",
                t=t, q=q,
            )  # fmt: skip
        self.begun, self.close = self.begun or regular, self.begun and not regular


def require_closed_accelerations(rows: Array, a: Array, right: Array, t: float, q: Array) -> None:
    """Raise where the acceleration at an accepted state leaves the constraints: ``G a + G' v`` is not 0.

    Args:
        rows: G, shape (m, nv).
        a: The acceleration, shape (nv,).
        right: ``-G' v``, shape (m,).
        t: Instant [s].
        q: Configuration, shape (nq,).

    Raises:
        DynamicsError: It is off by more than ``MET`` of its terms.
    """
    off = rows @ a - right
    if off.dot(off) <= (MET * LEAST) ** 2:  # nearly always
        return
    left, size = np.abs(off).max(), (abs(rows) @ np.abs(a) + np.abs(right)).max()
    if not left <= MET * max(size, LEAST):
        raise DynamicsError(
            f"at t = {t:.9g} s the accelerations tear the loops: G a + G' v is {left:.3g}, its terms reach {size:.3g} "
            "[m/s^2 or rad/s^2]",
            expected=f"no more than {MET:g} of its terms",
            hint="masses many orders apart in one loop, or a position all but singular, may be the reason",
            t=t, q=q,
        )  # fmt: skip

"""Prescribed motions with rolling: positions follow from velocities over the whole way.

Rows of rolling bind velocities alone. With as many laws as velocities are left, ``G v = 0`` and ``w' = w_d'(t)`` give
``v(t, q)``, and the configuration solves ``q' = v(t, q)``, by the explicit method of order 8 with its dense output of
order 7. At every row the loops are closed, and velocities and accelerations are those of the rows, to rounding: only
how far something has rolled carries the error of the integration.

Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (1993), section II.10.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.kinematics.assembly import first_position
from pinarm.engine.kinematics.joint_motion import JointMotion, JointTrajectory
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.kinematics.prescribed import Assembly
from pinarm.engine.kinematics.singular import check_rank
from pinarm.errors import AssemblyError
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

TOLERANCE = 1e-12
"""Error of a step, relative to 1 and to the coordinates: nearly the least that the method can keep."""


class RolledWay(Record, frozen=True):
    """The configurations of a motion on one interval.

    Attributes:
        start: First instant [s].
        end: Last instant [s].
        at: Instants, shape (n,) -> configurations, not yet closed, shape (nq, n).
        steps: Number of steps.
    """

    start: float
    end: float
    at: Callable[[Array], Array]
    steps: int


class RolledMotion(JointMotion, frozen=True):
    """The motion of a mechanism that rolls, with as many prescribed coordinates as velocities are left.

    Attributes:
        ways: Its configurations, interval by interval; empty before they are solved.
    """

    ways: tuple[RolledWay, ...] = ()

    @cached_property
    def closure(self) -> Closure:
        """The constraints, then the prescribed coordinates."""
        return self.mechanism.closure.with_guides(self.prescribed.names, self.prescribed.coordinates)

    def begin(self, grid: Grid, start: Array) -> Assembly:
        """Return the first position: that of the start, closed; see ``first_position``."""
        prescribed = self.prescribed
        return first_position(self.mechanism.closure, prescribed, prescribed.first(grid), float(grid.t[0]), start)

    def follow(self, grid: Grid, start: Array) -> JointTrajectory:
        """Return the motion; the first time it is integrated from the start, then read from what is known."""
        solved = self if self.ways else replace(self, ways=self._integrated(grid, start))
        arrays = [solved.states(begin, end, grid.t[rows]) for begin, end, rows in grid.intervals()]
        q, v, a = (np.concatenate([part[k] for part in arrays]) for k in range(3))
        return JointTrajectory(solved, grid, q, v, a)

    def rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        """Return velocities and accelerations: see ``JointMotion``."""
        found = [self._rates(t, x, dw, ddw) for x in q]
        nv = self.mechanism.model.nv
        v, a = (np.array([pair[k] for pair in found]).reshape(-1, nv) for k in range(2))
        return v, a

    def figures(self, states: JointTrajectory) -> Mapping[str, float]:
        """Return the error of what has rolled: that of the steps, added up."""
        steps = sum(way.steps for way in self.ways)
        return {"rolled": TOLERANCE * steps * max(1.0, float(np.abs(states.q).max(initial=0.0)))}

    def _integrated(self, grid: Grid, start: Array) -> tuple[RolledWay, ...]:
        """Return the ways from the first row on.

        Raises:
            AssemblyError: The laws determine the velocity no more.
        """
        from scipy.integrate import solve_ivp

        ways, q, model, begin = list[RolledWay](), start, self.mechanism.model, float(grid.t[0])
        for first, end, _ in grid.intervals():
            target = self.prescribed.on(first, end)

            def velocity(t: float, q: Array, target: Callable[[float], tuple[Array, Array, Array]] = target) -> Array:
                q = pin.normalize(model, q)
                return np.asarray(pin.tangentMap(model, q) @ self._velocity(t, q, target(t)[1]))

            solution = solve_ivp(
                velocity, (begin, end), q, method="DOP853", dense_output=True, rtol=TOLERANCE, atol=TOLERANCE
            )
            if not solution.success:
                raise AssemblyError(
                    f"what has rolled cannot be followed beyond t = {solution.t[-1]:.9g} s: {solution.message}",
                    expected="a motion that keeps clear of singular positions",
                    t=float(solution.t[-1]), q=solution.y[:, -1],
                )  # fmt: skip
            ways.append(RolledWay(first, end, solution.sol, len(solution.t) - 1))
            q, begin = solution.y[:, -1], end
        return tuple(ways)

    def states(self, start: float, end: float, t: Array) -> tuple[Array, Array, Array]:
        """Return closed configurations, velocities and accelerations at instants of an interval, shape (n,)."""
        model, target = self.mechanism.model, self.prescribed.on(start, end)
        way = min(self.ways, key=lambda one: abs(one.start - start) + abs(one.end - end))
        q, v, a = np.zeros((len(t), model.nq)), np.zeros((len(t), model.nv)), np.zeros((len(t), model.nv))
        for row, (instant, rough) in enumerate(zip(t.tolist(), way.at(t).T, strict=True)):
            w, dw, ddw = target(instant)
            q[row] = assembled(self.mechanism.closure, self.prescribed, pin.normalize(model, rough), w, instant)
            v[row], a[row] = self._rates(instant, q[row], dw, ddw)
        return q, v, a

    def _velocity(self, t: float, q: Array, dw: Array) -> Array:
        rows = self.closure.rows(self.closure.state(q))
        split = self.closure.split(rows)
        if split.free.shape[1]:
            check_rank(rows, [one.name for one, _ in self.closure.owners()], t)
        return split.particular(self._right(dw))

    def _rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        v = self._velocity(t, q, dw)
        state = self.closure.state(q, v)
        right = self._right(ddw) - self.closure.drift(state)
        return v, self.closure.split(self.closure.rows(state)).particular(right)

    def _right(self, targets: Array) -> Array:
        return np.concatenate([np.zeros(self.closure.size - len(targets)), targets])

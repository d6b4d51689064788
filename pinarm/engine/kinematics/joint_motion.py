"""Inverse kinematics: positions, velocities and accelerations of joints from those of coordinates, to rounding.

With coordinates w of a mechanism prescribed, the constraints phi of its loops and couplings, and J the rows of both:
``phi(q) = 0`` and ``w(q) = w_d(t)``, then ``J v = (0, w_d')`` and ``J a = (0, w_d'') - J' v``. All rows of the table
are solved at once where the equations are linear; elsewhere a branch is continued (``continuation``).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.kinematics.assembly import check_excess, first_position
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.kinematics.singular import SINGULAR, check_rank
from pinarm.errors import AssemblyError
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw, Values
from pinarm.records import AbstractRecord, Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


class JointMotion(AbstractRecord, frozen=True):
    """Motion of the joints of a mechanism by prescribed coordinates."""

    mechanism: Mechanism
    prescribed: PrescribedCoordinates

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        return self.prescribed.coordinates

    @property
    def laws(self) -> tuple[MotionLaw, ...]:
        return self.prescribed.laws

    @property
    def jumps(self) -> tuple[str, ...]:
        return ()

    @abstractmethod
    def begin(self, grid: Grid, start: Array) -> Assembly:
        """Return a configuration at the first of some rows, given that of the drawing or of the start, shape (nq,)."""

    @abstractmethod
    def follow(self, grid: Grid, start: Array) -> JointTrajectory:
        """Return the motion at the rows of a grid.

        Args:
            start: A configuration near the first one, shape (nq,): it chooses the branch.
        """

    @abstractmethod
    def rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        """Return velocities and accelerations at configurations of the motion, each of shape (n, nv)."""

    def figures(self, states: JointTrajectory) -> Mapping[str, float]:
        """Return the errors of the rows against the prescribed motion, by name; empty where they are rounding."""
        return {}


class JointTrajectory(Record, frozen=True):
    """The motion of the joints at the rows of a grid.

    Attributes:
        motion: The motion, which has the same branch at other instants.
        grid: The rows, cut also where velocities jump though the laws do not.
    """

    motion: JointMotion
    grid: Grid
    q: Array
    v: Array
    a: Array


class DeterminedMotion(JointMotion, frozen=True):
    """The motion of a mechanism with as many prescribed coordinates as degrees of freedom."""

    def begin(self, grid: Grid, start: Array) -> Assembly:
        """Return the first position: see ``first_position``."""
        closure, prescribed = self.mechanism.closure, self.prescribed
        if prescribed.linear_in(closure):
            return Assembly(start)
        try:
            return first_position(closure, prescribed, prescribed.first(grid), float(grid.t[0]), start)
        except AssemblyError:
            with suppress(AssemblyError):  # whose loops may not close elsewhere either
                check_excess(self.mechanism, prescribed)
            raise

    def follow(self, grid: Grid, start: Array) -> JointTrajectory:
        mechanism, prescribed = self.mechanism, self.prescribed
        if prescribed.linear_in(mechanism.closure):
            return JointTrajectory(self, grid, *_follow_linear(mechanism, prescribed, grid))
        from pinarm.engine.kinematics.continuation import follow_branch  # open chains do not pay for it

        near = prescribed_at_start(mechanism, prescribed, grid, start)
        return JointTrajectory(self, grid, *follow_branch(mechanism, prescribed, grid, near))

    def rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        if not dw.any() and not ddw.any():  # at rest, which a singular position does not hinder
            return np.zeros((len(q), self.mechanism.model.nv)), np.zeros((len(q), self.mechanism.model.nv))
        return joint_rates(self.mechanism.closure.holonomic, self.prescribed, q, dw, ddw)


def joint_rates(
    closure: Closure, prescribed: PrescribedCoordinates, q: Array, dw: Array, ddw: Array
) -> tuple[Array, Array]:
    """Return velocities and accelerations of the joints, shape (n, nv) each, at closed configurations, shape (n, nq).

    By the least solutions of ``J v = (0, dw)`` and ``J a = (0, ddw) - J' v``. The velocities dw and accelerations ddw
    of the coordinates have the shape (k,), or (n, k) where they differ.
    """
    whole = closure.with_guides(prescribed.names, prescribed.coordinates)
    here, right = whole.constraint_rows.at(q), np.zeros((2, len(q), whole.size))
    right[0, :, closure.size :], right[1, :, closure.size :] = dw, ddw
    rows = here.matrices * (whole.scale / whole.measure[:, None])
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    regular = (s[:, -1:] > SINGULAR * s[:, :1]).all(axis=1) & (s.shape[1] == whole.model.nv)
    for k in np.flatnonzero(~regular)[:1].tolist():
        check_rank(rows[k], [constraint.name for constraint, _ in whole.owners()], float(k))

    def least(right: Array) -> Array:
        return np.asarray(whole.scale * np.vecmat(np.vecmat(right / whole.measure, u) / s, vt))

    v = least(right[0])
    return v, least(right[1] - here.drifts(v))


def prescribed_at_start(mechanism: Mechanism, prescribed: PrescribedCoordinates, grid: Grid, start: Array) -> Array:
    """Return the start with the first values of laws that joints follow: from elsewhere the branch may be another."""
    q = start.copy()
    for name, w in zip(prescribed.names, prescribed.first(grid), strict=True):
        if name in mechanism.joints:
            q[mechanism.joints[name].q] = w
    return q


def _follow_linear(mechanism: Mechanism, prescribed: PrescribedCoordinates, grid: Grid) -> tuple[Array, Array, Array]:
    """Solve for all instants at once: the rows are constant and there is no drift."""
    couplings = [constraint for constraint in mechanism.constraints if isinstance(constraint, Coupling)]
    linear = [c for c in prescribed.coordinates if isinstance(c, LinearCoordinate)]
    rows = np.array([coordinate.weights for coordinate in [*(coupling.coordinate for coupling in couplings), *linear]])
    if len(rows) != mechanism.model.nv:
        raise prescribed.miscounted(mechanism, mechanism.model.nv - len(couplings))
    check_rank(rows, (*(coupling.name for coupling in couplings), *prescribed.names), grid.t[0])
    still, n = np.zeros(len(grid.t)), len(grid.t)
    values: list[Values] = [(np.full(n, coupling.constant), still, still) for coupling in couplings]
    values += [grid.evaluate(law) for law in prescribed.laws]
    solved = [np.linalg.solve(rows, np.array([value[k] for value in values])).T for k in range(3)]
    q = np.empty_like(solved[0])
    q[:, linear[0].places] = solved[0]
    return q, np.ascontiguousarray(solved[1]), np.ascontiguousarray(solved[2])


TOLERANCE = 1e-12
"""Error of a step, relative to 1 and to the coordinates: nearly the least that the method can keep."""


class RolledWay(NamedTuple):
    """An interval [s] of a motion, its configurations at instants, (n,) to (nq, n), not yet closed, and its steps."""

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

    def begin(self, grid: Grid, start: Array) -> Assembly:
        prescribed = self.prescribed
        return first_position(self.mechanism.closure, prescribed, prescribed.first(grid), float(grid.t[0]), start)

    def follow(self, grid: Grid, start: Array) -> JointTrajectory:
        """Return the motion; the first time it is integrated from the start, then read from what is known."""
        solved, states = self if self.ways else replace(self, ways=self._integrated(grid, start)), []
        for begin, end, rows in grid.intervals():
            target = self.prescribed.on(begin, end)
            way = min(solved.ways, key=lambda span: abs(span.start - begin) + abs(span.end - end))
            for t, rough in zip(grid.t[rows].tolist(), way.at(grid.t[rows]).T, strict=True):
                w, dw, ddw = target(t)
                near = pin.normalize(self.mechanism.model, rough)
                q = assembled(self.mechanism.closure, self.prescribed, near, w, t)
                states.append((q, *(rate[0] for rate in self.rates(t, q[None], dw, ddw))))
        q, v, a = (np.array(part) for part in zip(*states, strict=True))
        return JointTrajectory(solved, grid, q, v, a)

    def rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        return joint_rates(self.mechanism.closure, self.prescribed, q, dw, ddw)

    def figures(self, states: JointTrajectory) -> Mapping[str, float]:
        """Return the error of what has rolled: that of the steps, added up."""
        steps = sum(way.steps for way in self.ways)
        return {"rolled": TOLERANCE * steps * max(1.0, float(np.abs(states.q).max(initial=0.0)))}

    def _integrated(self, grid: Grid, start: Array) -> tuple[RolledWay, ...]:
        """Return the ways from the first row on."""
        from scipy.integrate import solve_ivp

        ways, q, model, begin = list[RolledWay](), start, self.mechanism.model, float(grid.t[0])
        for first, end, _ in grid.intervals():
            target = self.prescribed.on(first, end)

            def velocity(t: float, q: Array, target: Callable[[float], tuple[Array, Array, Array]] = target) -> Array:
                q = pin.normalize(model, q)
                return np.asarray(pin.tangentMap(model, q) @ self.rates(t, q[None], *target(t)[1:])[0][0])

            solution = solve_ivp(
                velocity, (begin, end), q, method="DOP853", dense_output=True, rtol=TOLERANCE, atol=TOLERANCE
            )
            if not solution.success:
                raise AssemblyError(
                    f"what has rolled cannot be followed beyond t = {solution.t[-1]:.9g} s: {solution.message}",
                    expected="a motion that keeps clear of singular positions",
                    t=float(solution.t[-1]),
                    q=solution.y[:, -1],
                )
            ways.append(RolledWay(first, end, solution.sol, len(solution.t) - 1))
            q, begin = solution.y[:, -1], end
        return tuple(ways)

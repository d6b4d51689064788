"""Motion of a redundant mechanism on a path, nearest to a posture, with joints that reach limits and leave them.

At every instant the configuration on a path is nearest to a posture q0 where, with prescribed coordinates w,

    q(t) = argmin |W (q - q0)|^2 / 2    subject to    phi(q) = 0,  w(q) = w_d(t),  q_min <= q <= q_max.

With J the rows of phi, w and the joints at limits, and Z a basis of the null space of J, the part of the pull that no
row of J holds vanishes:

    r(q) = Z Z^T W^2 (q - q0) = 0,    dr/dq = Z Z^T H,    H = W^2 - sum_k lam_k Hess(w_k),    J^T lam = W^2 (q - q0)

With the path these rows determine the motion, which ``NewtonSolver`` continues. It is a strict minimum, and smooth,
where J has its full rank and ``Z^T H Z`` is positive definite (Nocedal and Wright, Numerical Optimization, theorem
12.6; Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, theorem 3.2.2). Limits that
hold a joint have a multiplier that presses it inwards. Derivatives of J are complex steps, exact to rounding; second
ones, of the acceleration alone, differences of order 6 of these.

The first configuration is found by sequential quadratic programming.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import ConstraintRows
from pinarm.engine.kinematics.joint_motion import JointMotion, JointTrajectory, prescribed_at_start
from pinarm.engine.kinematics.newton import NewtonSolver, Target
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.kinematics.singular import SINGULAR, instant
from pinarm.errors import AssemblyError, InputError
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.mechanics.coordinates import Constraint, Parts
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws.motion_law import ROUNDING, Grid, MotionLaw
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


IMAGINARY, STEP, DIFFERENCES = 1e-20, 0.01, np.array([3 / 4, -3 / 20, 1 / 60])
"""Complex step; distance of the configurations between which derivatives of J are differentiated [rad, or units of
length of the mechanism]; weights of the central difference of order 6."""

TINY = 1e-300
"""Least divisor."""


class Posture(Record, frozen=True):
    """A target q0 with weights w: ``sum_i (w_i (q_i - q0_i))^2`` is to be least, with q within limits.

    Attributes:
        target: q0 [rad or m]; 0 where the weight is, shape (nv,).
        weights: w; 0 of joints that nothing pulls, shape (nv,).
        lower: Lower limits [rad or m], infinite where there is none, shape (nv,).
        upper: Upper limits, likewise.
        places: Index in q of the coordinates that have a weight or a limit, by their index in v, shape (nv,).
    """

    target: Array
    weights: Array
    lower: Array
    upper: Array
    places: Indices
    names: tuple[str, ...]

    def margins(self, q: Array) -> Array:
        """Return the margins of a configuration to the lower and upper limits, shape (2, nv)."""
        return np.stack([q[self.places] - self.lower, self.upper - q[self.places]])

    def limit(self, joint: int, side: int) -> float:
        """Return the lower (0) or the upper (1) limit of a joint, by its index in v [rad or m]."""
        return float((self.lower, self.upper)[side][joint])

    @cached_property
    def sizes(self) -> Array:
        """``1 + |limit|``, shape (2, nv)."""
        limits = np.stack([self.lower, self.upper])
        return 1.0 + np.where(np.isfinite(limits), np.abs(limits), 0.0)


class FreePull(Constraint):
    """The part r(q) of the pull towards a posture that no row of J holds, as a constraint of nv rows.

    In coordinates ``q / unit``, in which W is 1 for every joint that is pulled and 0 for the others.

    Args:
        path: The rows of J: constraints, coordinates of the path and joints at limits.
        rank: That of J in a position of no special kind.
    """

    name = "the posture"

    def __init__(self, path: NewtonSolver, posture: Posture, rank: int) -> None:
        self.path, self.posture, self.rank = path, posture, rank
        weights = posture.weights / max(float((posture.weights * path.scale).max(initial=0.0)), TINY)
        self.pulled = (weights > 0.0).astype(np.float64)
        self.units = np.where(weights > 0.0, 1.0 / np.where(weights > 0.0, weights, 1.0), path.scale)
        self._last: PullAt | None = None

    @property
    def size(self) -> int:
        return int(self.path.model.nv)

    def unit(self, row: int) -> Unit:
        return DIMENSIONLESS

    def gap(self, state: Kinematics) -> Array:
        here = self.at(state.q)
        return np.asarray(here.free @ (here.free.T @ here.whole))

    def rows(self, state: Kinematics) -> Array:
        """Return the derivative of r where it is 0, shape (nv, nv)."""
        here = self.at(state.q)
        return np.asarray(here.free @ here.bent.T / self.units)

    def drift(self, state: Kinematics) -> Array:
        """Return the second derivative of r, where it is 0, along the velocity of the state, shape (nv,)."""
        here, way = self.at(state.q), state.v / self.units
        first, second = self.rates(state.q, way[None])[0], self._second(state.q, way)
        rate = here.inverse.T @ (self.pulled * way - first.T @ here.lam)
        return np.asarray(-here.free @ (here.free.T @ (2.0 * first.T @ rate + second.T @ here.lam)))

    @property
    def parts(self) -> Parts:
        raise NotImplementedError

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        return {}

    def at(self, q: Array) -> PullAt:
        """Return the pull at a configuration, shape (nq,); the last one is kept."""
        if self._last is None or not np.array_equal(self._last.q, q):
            self._last = PullAt(self, q)
        return self._last

    def whole(self, q: Array) -> Array:
        """Return the pull W (q - q0), shape (nv,)."""
        return np.asarray(self.pulled * (q[self.posture.places] - self.posture.target) / self.units)

    def jacobian(self, q: Array) -> Array:
        return np.asarray(self.path.rows(self.path.closure.state(q)) * (self.units / self.path.scale))

    def moved(self, q: Array, step: Array) -> Array:
        return np.asarray(pin.integrate(self.path.model, q, self.units * step))

    def rates(self, q: Array, ways: Array) -> Array:
        """Return the derivatives of J along ways, shape (k, nv), as an array of shape (k, m, nv).

        At a configuration, shape (nq,), or at one for each way, shape (k, nq).
        """
        maps = np.array([pin.tangentMap(self.path.model, row) for row in np.atleast_2d(q)])
        steps = 1j * IMAGINARY * np.matvec(maps, ways * self.units)
        rows = np.imag(self.path.whole.constraint_rows.at(q + steps).matrices) / IMAGINARY
        return np.asarray(rows * (self.units / self.path.measure[:, None]))

    def _second(self, q: Array, way: Array) -> Array:
        """Return the second derivative of J along a way, shape (m, nv)."""
        h = STEP / max(float(np.abs(self.units * way / self.path.scale).max(initial=0.0)), TINY)
        steps = h * np.array([1, 2, 3, -1, -2, -3])
        after, before = np.split(self.rates(np.array([self.moved(q, s * way) for s in steps]), np.tile(way, (6, 1))), 2)
        return np.asarray(np.tensordot(DIFFERENCES, after - before, 1) / h)


class PullAt:
    """The pull at one configuration q, shape (nq,).

    Attributes:
        regularity: Least singular value of J that counts, over the largest; 1 where none counts.
        inverse: Pseudo-inverse of J, shape (nv, m).
        free: Z, shape (nv, f).
        whole: W (q - q0), shape (nv,).
        lam: Multipliers of J, shape (m,).
    """

    def __init__(self, pull: FreePull, q: Array) -> None:
        u, s, vt = np.linalg.svd(pull.jacobian(q))
        r = min(pull.rank, len(s))
        self.pull, self.q, self.whole = pull, q, pull.whole(q)
        self.regularity = 0.0 if len(s) < pull.rank else float(s[r - 1] / s[0]) if r else 1.0
        self.inverse, self.free = (vt[:r].T / np.maximum(s[:r], TINY)) @ u[:, :r].T, vt[r:].T
        self.lam = self.whole @ self.inverse

    @cached_property
    def bent(self) -> Array:
        """H Z, shape (nv, f)."""
        bend = np.einsum("fmv,m->vf", self.pull.rates(self.q, self.free.T), self.lam)
        return np.asarray(self.pull.pulled[:, None] * self.free - bend)

    @cached_property
    def stiffness(self) -> tuple[float, Array]:
        """Least eigenvalue of ``Z^T H Z``, infinite without freedom, and the motion that belongs to it, shape (nv,)."""
        reduced = self.free.T @ self.bent
        if not len(reduced):
            return np.inf, np.zeros(len(self.free))
        values, ways = np.linalg.eigh(0.5 * (reduced + reduced.T))
        return float(values[0]), self.free @ ways[:, 0]


AT_LIMIT, NEAR = 1e-9, 1e-5
"""Distances from a limit, relative to ``1 + |limit|``, below which a joint and the rough minimum are at it."""

CURVED = 1e-5
"""Least eigenvalue of ``Z^T H Z``, which is 1 where the path does not bend, at which the nearest configuration still
counts as determined: it moves as its reciprocal."""

CHANGED = 2.0
"""Largest ratio of the least eigenvalues before and after a step: where one minimum vanishes, another has another."""

WEAK, FLAT = 1e-3, 0.1
"""Ratio of singular values of J, and least eigenvalue of ``Z^T H Z``, below which they are why a branch ends."""

LIFTED = 1e-9
"""Part of the pull of the posture by which a limit may hold a joint the wrong way: rounding of multipliers."""

CLOSE = 1e-6
"""Largest gap of the rough minimum: differences of the constraints leave 1e-8."""

AtLimits = tuple[tuple[int, int], ...]
"""Joints at limits, by their index in v, and 0 for the lower or 1 for the upper limit; sorted."""


class PathState(NamedTuple):
    """The nearest configuration at an instant, shape (nq,), with its velocity and acceleration, shape (nv,)."""

    t: float
    q: Array
    v: Array
    a: Array


class LimitedPath(NewtonSolver):
    """Newton's method on a path, on joints held at limits, and on the free pull of a posture.

    Steps stay near the minimum that they begin in. ``path`` is the method without the pull.
    """

    def __init__(
        self, mechanism: Mechanism, path: PrescribedCoordinates, posture: Posture, mobility: int, held: AtLimits
    ) -> None:
        names = [posture.names[v] for v, _ in held]
        limits = [posture.limit(*limit) for limit in held]
        known = path.holding(names, [mechanism.coordinates[name] for name in names], limits)
        self.path = NewtonSolver(mechanism.closure, known)
        self.held, self.posture, self.prescribed = held, posture, known
        self.pull = FreePull(self.path, posture, mechanism.model.nv - mobility + len(known.names))
        super().__init__(Closure.of(mechanism.model, (*mechanism.closure.constraints, self.pull)), known)
        self.least = np.inf

    def nearest(self, q: Array, w: Array, t: float) -> Array:
        """Return the nearest configuration near a rough one, shape (nq,), with the values w, shape (k,)."""
        try:
            nearest = self.assemble(q, w, t)
        except AssemblyError as error:
            raise self.explained(error, q, t, w, t) from None
        self.require_minimum(nearest, t)
        return nearest

    def state(self, q: Array, t: float, begin: float, end: float) -> PathState:
        """Return the state at a nearest configuration on an interval without jumps."""
        _, dw, ddw = self.prescribed.on(begin, end)(t)
        return PathState(t, q, *self.rates(q, dw, ddw, t))

    def states(self, state: PathState, to: float, target: Target) -> Iterator[PathState]:
        """Yield the states after every step from one to another instant, on the same branch."""
        self.least = self.pull.at(state.q).stiffness[0]
        try:
            for step in self.steps(*state[1:], state.t, to, target):
                state = PathState(*step)
                yield state
        except AssemblyError as error:
            raise self.explained(error, state.q, state.t, target(to)[0], to) from None

    def continues(self, turned: Array, predicted: Array, solution: Array) -> bool:
        least, before = self.pull.at(solution).stiffness[0], self.least
        if not before <= CHANGED * least <= CHANGED**2 * before or not super().continues(turned, predicted, solution):
            return False
        self.least = least
        return True

    def last(self, state: PathState, to: float, target: Target) -> PathState:
        """Return the state at another instant, on the same branch."""
        *_, last = self.states(state, to, target)
        return last

    def require_minimum(self, q: Array, t: float) -> None:
        """Raise where the nearest configuration is not determined."""
        if self.pull.at(q).stiffness[0] <= CURVED:
            raise self._undetermined(q, t)

    def pressing(self, q: Array) -> Array:
        """Return the pull of held joints against their limits, negative where a joint would come off, shape (h,)."""
        lam = self.pull.at(q).lam
        signs = np.array([1.0 if side == 0 else -1.0 for _, side in self.held])
        return np.asarray(signs * lam[len(lam) - len(self.held) :])

    def margins(self, q: Array) -> Array:
        """Return the margins that must not be negative, shape (2 nv + h,).

        Margins of joints that are not at limits, lower limits first, then ``pressing``.
        """
        free = self.posture.margins(q)
        for joint, side in self.held:
            free[side, joint] = np.inf
        return np.concatenate([free.ravel(), self.pressing(q)])

    def rounding(self, q: Array) -> Array:
        """Return the rounding by which ``margins`` may be below 0, shape (2 nv + h,)."""
        pull = float(np.abs(self.pull.at(q).whole).max(initial=0.0))
        return np.append(AT_LIMIT * self.posture.sizes.ravel(), np.full(len(self.held), LIFTED * (1.0 + pull)))

    def crossing(
        self, before: PathState, after: PathState, target: Target, slack: float
    ) -> tuple[PathState, int] | None:
        """Return the state at the first change of limits in a step, and its place in ``margins``; ``None`` without."""
        from scipy.optimize import brentq

        states = list[tuple[PathState, int]]()
        for place in np.flatnonzero(self.margins(after.q) < -self.rounding(before.q)).tolist():

            def margin(t: float, place: int = place) -> float:
                return float(self.margins(self.last(before, t, target).q)[place])

            state = before
            if self.margins(before.q)[place] > 0.0:
                state = self.last(before, brentq(margin, before.t, after.t, xtol=0.01 * slack), target)
            states.append((state, place))
        return min(states, key=lambda change: change[0].t, default=None)

    def explained(self, error: AssemblyError, q: Array, t: float, w: Array, to: float) -> AssemblyError:
        """Return why a branch that has come to q at t does not go on to the values w at ``to``."""
        try:
            self.path.assemble(q, w, to)
        except AssemblyError as beyond:
            return beyond
        here = self.pull.at(q)
        return self._undetermined(q, t) if here.regularity > WEAK and here.stiffness[0] < FLAT else error

    def _undetermined(self, q: Array, t: float) -> AssemblyError:
        weak = np.abs(self.pull.units * self.pull.at(q).stiffness[1] / self.path.scale)
        moving = [name for name, size in zip(self.posture.names, weak, strict=True) if size > 0.3 * weak.max()]
        message = (
            f"the configuration nearest to the posture is not determined at {instant(t)}: {', '.join(moving)} can "
        )
        return _refused(message + "move and leave the distance to it as it is", t, q)


class NearestMotion(JointMotion, frozen=True):
    """A mechanism that follows a path of fewer coordinates than degrees of freedom, nearest to a posture.

    Attributes:
        mobility: Degrees of freedom of the assembled mechanism.
        bounds: Instants at which limits change, ascending [s].
        held: Joints at limits before the first of them, between them and after the last; none where not yet known.
    """

    posture: Posture
    mobility: int
    bounds: tuple[float, ...] = ()
    held: tuple[AtLimits, ...] = ()
    jumps: tuple[str, ...] = ()

    @classmethod
    def of(cls, mechanism: Mechanism, motion: Mapping[str, MotionLaw], posture: Posture) -> NearestMotion:
        """Return the motion of a mechanism under laws, which are fewer than its degrees of freedom."""
        from pinarm.engine.kinematics.assembly import generic_near

        prescribed, closure = PrescribedCoordinates.bound(mechanism, motion), mechanism.closure
        mobility = closure.split_at(generic_near(mechanism, {})).free.shape[1]
        if len(prescribed.names) == mobility:
            raise InputError(
                f"{mobility} coordinates follow a law and determine the motion: nothing is left to resolve",
                expected="fewer laws than degrees of freedom",
                hint="resolve left out",
            )
        if len(prescribed.names) > mobility:
            raise prescribed.miscounted(mechanism, mobility)
        return cls(mechanism, prescribed, posture, mobility)

    @cached_property
    def _paths(self) -> dict[AtLimits, LimitedPath]:
        return {}

    def begin(self, grid: Grid, start: Array) -> Assembly:
        """Return the start itself: the posture chooses the first configuration."""
        return Assembly(start)

    def follow(self, grid: Grid, start: Array) -> JointTrajectory:
        """Return the motion; the first time with the changes of limits, at which the grid is cut and has two rows."""
        q = prescribed_at_start(self.mechanism, self.prescribed, grid, start)
        if self.held:
            return self._rows(grid, q)
        search = _Search(self, grid, q)
        states = search.through(grid)
        located = replace(self, bounds=(*search.bounds,), held=(*search.held,), jumps=(*search.jumps,))
        if located.bounds:
            return located._rows(grid.parted(located.bounds), states[0].q)
        return _joint_trajectory(located, grid, states)

    def rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        path = self._path_at(t)
        still = np.zeros(len(path.held))
        v, a = zip(*(path.rates(row, np.append(dw, still), np.append(ddw, still), t) for row in q), strict=True)
        return np.array(v), np.array(a)

    def figures(self, states: JointTrajectory) -> Mapping[str, float]:
        rows = ConstraintRows.of(self.mechanism.model, self.coordinates).at(states.q)
        rates, bends = np.matvec(rows.matrices, states.v), np.matvec(rows.matrices, states.a)
        reached = np.array([rows.gaps, rates, bends + rows.drifts(states.v)])
        wanted = np.array([states.grid.evaluate(law) for law in self.laws])
        off = np.abs(reached - wanted.transpose(1, 2, 0)).max(axis=(1, 2), initial=0.0)
        return dict(zip(("path", "path rate", "path acceleration"), off.tolist(), strict=True))

    def path(self, held: AtLimits) -> LimitedPath:
        """Return the path with joints held at limits; each is kept."""
        if held not in self._paths:
            self._paths[held] = LimitedPath(self.mechanism, self.prescribed, self.posture, self.mobility, held)
        return self._paths[held]

    def _path_at(self, t: float) -> LimitedPath:
        """Return the path at an instant between changes of limits."""
        return self.path(self.held[bisect_right(self.bounds, t)])

    def _rows(self, grid: Grid, q: Array) -> JointTrajectory:
        """Return the motion where it is known which joints are at limits, from a configuration near the first."""
        states = list[PathState]()
        for begin, end, part in grid.intervals():
            path = self._path_at(0.5 * (begin + end))
            target = path.prescribed.on(begin, end)
            for t in grid.t[part].tolist():
                if states and t != states[-1].t:
                    states.append(path.last(states[-1], t, target))
                else:
                    near = states[-1].q if states else path.nearest(q, target(t)[0], t)
                    states.append(path.state(near, t, begin, end))
        return _joint_trajectory(self, grid, states)

    def first(self, q: Array, w: Array, t: float) -> tuple[Array, AtLimits]:
        """Return the configuration nearest to the posture, shape (nq,), and the joints that limits hold there.

        Sequential quadratic programming (SLSQP of scipy) comes near it, all limits being bounds; Newton's method then
        finds it to rounding, the joints at limits being those whose multipliers hold them there.
        """
        posture, rough = self.posture, _rough_minimum(self.path(()), q, w, t)
        held = [(int(joint), int(side)) for side, joint in np.argwhere(posture.margins(rough) <= NEAR * posture.sizes)]
        path = self.path(tuple(sorted(held)))
        q = path.nearest(rough, np.append(w, [posture.limit(*limit) for limit in path.held]), t)
        if (path.margins(q) >= -path.rounding(q)).all():
            return q, path.held
        raise _refused(f"which joints are at their limits is not determined at {instant(t)}", t, q)


def _rough_minimum(path: LimitedPath, q: Array, w: Array, t: float) -> Array:
    """Return a configuration near the minimum, shape (nq,), from a rough one."""
    from scipy.optimize import minimize

    newton, pull, posture = path.path, path.pull, path.posture
    q = newton.assemble(q, w, t)
    if pull.at(q).regularity <= SINGULAR:
        raise path.explained(AssemblyError("singular"), q, t, w, t)
    independent = np.linalg.svd(pull.jacobian(q))[0][:, : pull.rank].T  # SLSQP cannot take rows that repeat others

    def distance(x: Array) -> float:
        whole = pull.whole(pull.moved(q, x))
        return 0.5 * float(whole @ whole)

    def gap(x: Array) -> Array:
        return np.asarray(independent @ (newton.gap(newton.closure.state(pull.moved(q, x)), w) / newton.measure))

    below, above = posture.margins(q) / pull.units
    solution = minimize(
        distance,
        np.clip(np.zeros(len(below)), -below, above),
        method="SLSQP",
        bounds=np.stack([-below, above], axis=1),
        constraints={"type": "eq", "fun": gap},
        options={"maxiter": 500, "ftol": 1e-12},
    )
    if np.abs(gap(solution.x)).max(initial=0.0) < CLOSE:
        return pull.moved(q, solution.x)
    raise _refused(f"no configuration on the path at {instant(t)} is found within the limits of the joints", t, q)


class _Search:
    """A motion on the way through its rows, on which joints reach limits and come off them."""

    def __init__(self, motion: NearestMotion, grid: Grid, q: Array) -> None:
        (begin, end, _), t = grid.intervals()[0], float(grid.t[0])
        q, held = motion.first(q, motion.prescribed.on(begin, end)(t)[0], t)
        self.motion, self.path = motion, motion.path(held)
        self.state, self.start = self.path.state(q, t, begin, end), t
        self.slack = ROUNDING * (grid.cuts[-1] - grid.cuts[0])
        self.bounds, self.held, self.jumps = list[float](), [held], list[str]()
        self.last = -1, -np.inf

    def through(self, grid: Grid) -> list[PathState]:
        """Return the states at all rows of the grid."""
        states = list[PathState]()
        for begin, end, part in grid.intervals():
            for t in grid.t[part].tolist():
                if t == self.state.t:  # the first row, or laws that jump: the same position
                    self.state = self.path.state(self.state.q, t, begin, end)
                while self._changed(t, begin, end):
                    pass
                states.append(self.state)
        return states

    def _changed(self, to: float, begin: float, end: float) -> bool:
        """Go on to a row, or through the first change of limits before it; tell whether there was one."""
        before, target = self.state, self.path.prescribed.on(begin, end)
        for after in self.path.states(before, to, target) if to != before.t else ():
            self.path.require_minimum(after.q, after.t)
            if crossing := self.path.crossing(before, after, target, self.slack):
                self._change(*crossing, begin, end)
                return True
            before = after
        self.state = before
        return False

    def _change(self, before: PathState, place: int, begin: float, end: float) -> None:
        """Let a joint reach its limit or leave it."""
        path, names, nv = self.path, self.motion.posture.names, len(self.motion.posture.names)
        reached = place < 2 * nv
        limit = (place % nv, place // nv) if reached else path.held[place - 2 * nv]
        if limit[0] == self.last[0] and before.t - self.last[1] <= self.slack:
            message = f"whether {names[limit[0]]} stays at its limit is not determined at t = {before.t:.9g} s"
            raise _refused(message, before.t, before.q)
        if reached and path.path.model.nv == path.pull.rank:
            others = ", ".join(names[joint] for joint, _ in path.held)
            message = f"the path cannot be followed within the limits of the joints beyond t = {before.t:.9g} s: there "
            raise _refused(f"{message}{names[limit[0]]} reaches its limit, as {others} did before", before.t, before.q)
        self.last, self.path = (limit[0], before.t), self.motion.path(tuple(sorted({*path.held} ^ {limit})))
        self.state = self.path.state(before.q, before.t, begin, end)
        if before.t == self.start:  # it only touches its limit where the motion begins
            self.held = [self.path.held]
            return
        self.bounds.append(before.t)
        self.held.append(self.path.held)
        self.jumps.append(_words(self.motion, limit, before, self.state, reached=reached))


def _joint_trajectory(motion: NearestMotion, grid: Grid, states: list[PathState]) -> JointTrajectory:
    q, v, a = (np.array(part) for part in zip(*(state[1:] for state in states), strict=True))
    return JointTrajectory(motion, grid, q, v, a)


def _words(motion: NearestMotion, limit: tuple[int, int], before: PathState, after: PathState, *, reached: bool) -> str:
    """Return the note on a joint that reaches or leaves its limit, with the largest jump of velocity."""
    posture, coordinates = motion.posture, motion.mechanism.coordinates
    jump = np.abs(after.v - before.v)
    fastest, joint = posture.names[int(jump.argmax())], posture.names[limit[0]]
    rate = "m/s" if fastest in coordinates and coordinates[fastest].unit == METRE else "rad/s"
    return (
        f"at t = {before.t:.9g} s {joint} {'reaches' if reached else 'comes off'} its limit "
        f"{posture.limit(*limit):.6g} {coordinates[joint].unit}, and velocities jump: that of {fastest} by "
        f"{jump.max():.3g} {rate}"
    )


def _refused(message: str, t: float, q: Array) -> AssemblyError:
    return AssemblyError(
        message,
        expected="a path within reach, on which joints reach limits and come off them, and do not just touch them",
        hint="another posture, or one with more joints in nearest_to, wider limits, or a start on the path within them",
        t=t,
        q=q,
    )

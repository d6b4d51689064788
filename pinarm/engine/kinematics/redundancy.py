"""Motion of a redundant mechanism on a path, nearest to a posture, with joints that reach limits and leave them.

See ``free_pull`` for the equations. The first configuration is found by sequential quadratic programming.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import ConstraintRows
from pinarm.engine.kinematics.free_pull import FreePull, Posture
from pinarm.engine.kinematics.joint_motion import JointMotion, JointTrajectory, prescribed_at_start
from pinarm.engine.kinematics.newton import NewtonSolver, Target
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.kinematics.singular import SINGULAR, instant
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws.motion_law import ROUNDING, Grid, MotionLaw
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

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
        return AssemblyError(
            f"the configuration nearest to the posture is not determined at {instant(t)}: {', '.join(moving)} can move "
            "and leave the distance to it as it is",
            expected="a posture that names enough joints, and that is nearer than half-way to another configuration",
            hint="more joints in nearest_to, another posture, or another start",
            t=t,
        )


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
        raise AssemblyError(
            f"which joints are at their limits is not determined at {instant(t)}",
            t=t,
            q=q,
            expected="a path that does not begin where a joint just touches its limit",
            hint="another posture or start",
        )


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
    raise AssemblyError(
        f"no configuration on the path at {instant(t)} is found within the limits of the joints",
        expected="a path that the arm can follow within its limits",
        hint="start: joint values on the path, within the limits",
        t=t,
        q=q,
    )


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
            raise _undecided(names[limit[0]], before)
        if reached and path.path.model.nv == path.pull.rank:
            raise _blocked(path, names[limit[0]], before)
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


def _undecided(name: str, state: PathState) -> AssemblyError:
    return AssemblyError(
        f"whether {name} stays at its limit is not determined at t = {state.t:.9g} s",
        t=state.t,
        q=state.q,
        expected="a path on which joints reach limits and come off them, and do not just touch them",
        hint="another posture, or wider limits",
    )


def _blocked(path: LimitedPath, name: str, state: PathState) -> AssemblyError:
    others = ", ".join(path.posture.names[joint] for joint, _ in path.held)
    there = f"{others} are at theirs" if len(path.held) > 1 else f"{others} is at its own"
    return AssemblyError(
        f"the path cannot be followed within the limits of the joints beyond t = {state.t:.9g} s: there {name} reaches "
        f"its limit, and {there}",
        expected="a path within reach",
        hint="another posture or start, which take another way",
        t=state.t,
        q=state.q,
    )

"""Motion of a redundant mechanism on a path, nearest to a posture, with joints that reach limits and leave them.

See ``free_pull`` for the equations. The first configuration is found by sequential quadratic programming.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.kinematics.free_pull import AT_LIMIT, FreePull, Posture, PullAt
from pinarm.engine.kinematics.joint_motion import JointMotion, JointTrajectory, prescribed_at_start
from pinarm.engine.kinematics.newton import NewtonSolver, Target
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.kinematics.singular import SINGULAR, dependent, instant, tied
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws.motion_law import ROUNDING, Grid, MotionLaw
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

CURVED = 1e-5
"""Least eigenvalue of ``Z^T H Z``, which is 1 where the path does not bend, at which the nearest configuration still
counts as determined: it moves as its reciprocal."""

CHANGED = 2.0
"""Largest ratio of the least eigenvalues before and after a step: where one minimum vanishes, another has another."""

WEAK, FLAT = 1e-3, 0.1
"""Ratio of singular values of J, and least eigenvalue of ``Z^T H Z``, below which they are why a branch ends."""

LOOKED = 8
"""Points of every step at which limits are looked at, on the polynomials through its two ends."""

LIFTED = 1e-9
"""Part of the pull of the posture by which a limit may hold a joint the wrong way: rounding of multipliers."""

NEAR = 1e-5
"""Distance from a limit, relative to ``1 + |limit|``, within which the rough minimum counts as at it."""

CLOSE = 1e-6
"""Largest gap of the rough minimum: differences of the constraints leave 1e-8."""

TURN = 3.0
"""Largest move of a joint from the rough configuration, within its limits [rad, or units of length]."""

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
        with self._explaining(q, t, w, t):
            nearest = self.assemble(q, w, t)
        self.require_minimum(nearest, t)
        return nearest

    def state(self, q: Array, t: float, begin: float, end: float) -> PathState:
        """Return the state at a nearest configuration on an interval without jumps."""
        w, dw, ddw = self.prescribed.on(begin, end)(t)
        with self._explaining(q, t, w, t):
            return PathState(t, q, *self.rates(q, dw, ddw, t))

    def states(self, state: PathState, to: float, target: Target) -> Iterator[PathState]:
        """Yield the states after every step from one to another instant, on the same branch."""
        self.least = self.pull.at(state.q).least
        steps = self.steps(*state[1:], state.t, to, target)
        while True:
            with self._explaining(state.q, state.t, target(to)[0], to):
                if (step := next(steps, None)) is None:
                    return
            state = PathState(*step)
            yield state

    def continues(self, turned: Array, predicted: Array, solution: Array) -> bool:
        least, before = self.pull.at(solution).least, self.least
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
        if self.pull.at(q).least <= CURVED:
            raise self._undetermined(q, t)

    def margins(self, positions: Array) -> Array:
        """Return the margins of joints that are not at limits, lower limits first, shape (.., 2 nv)."""
        margins = self.posture.margins(positions)
        for joint, side in self.held:
            margins[..., side, joint] = np.inf
        return margins.reshape(*margins.shape[:-2], -1)

    def pressing(self, q: Array) -> Array:
        """Return the pull of held joints against their limits, negative where a joint would come off, shape (h,)."""
        lam = self.pull.at(q).lam
        signs = np.array([1.0 if side == 0 else -1.0 for _, side in self.held])
        return np.asarray(signs * lam[len(lam) - len(self.held) :])

    def rounding(self, q: Array) -> Array:
        """Return the rounding by which margins, and then ``pressing``, may be below 0, shape (2 nv + h,)."""
        pull = float(np.abs(self.pull.at(q).whole).max(initial=0.0))
        return np.concatenate([self.posture.slack.ravel(), np.full(len(self.held), LIFTED * (1.0 + pull))])

    @contextmanager
    def _explaining(self, q: Array, t: float, w: Array, to: float) -> Iterator[None]:
        """Say why a branch that has come to q at t does not go on to the values w at ``to``."""
        try:
            yield
        except AssemblyError as error:
            raise self.explained(error, q, t, w, to) from None

    def explained(self, error: AssemblyError, q: Array, t: float, w: Array, to: float) -> AssemblyError:
        """Return why a branch that has come to q at t does not go on to the values w at ``to``."""
        try:
            self.path.assemble(q, w, to)
        except AssemblyError as beyond:
            return beyond
        here = self.pull.at(q)
        if here.regularity < WEAK:
            names = tied(self.path.rows(self.path.closure.state(q)), self.pull.rank, self.path.names)
            return AssemblyError(
                f"the position is singular at {instant(t)}: {dependent(names)} there",
                expected="a path on which the prescribed coordinates, and joints held at their limits, are independent",
                hint="a path that keeps clear of the stretched or folded arm, or another posture",
                t=t,
            )
        return self._undetermined(q, t) if here.least < FLAT else error

    def _undetermined(self, q: Array, t: float) -> AssemblyError:
        weak = np.abs(self.pull.units * self.pull.at(q).stiffness[1][:, 0] / self.path.scale)
        moving = [name for name, size in zip(self.posture.names, weak, strict=True) if size > 0.3 * weak.max()]
        return AssemblyError(
            f"the configuration nearest to the posture is not determined at {instant(t)}: {', '.join(moving)} can move "
            "and leave the distance to it as it is",
            expected="a posture that names enough joints, and that is nearer than half-way to another configuration",
            hint="more joints in nearest_to, another posture, or another start",
            t=t,
        )

    def crossing(
        self, before: PathState, after: PathState, target: Target, slack: float
    ) -> tuple[PathState, tuple[int, int]] | None:
        """Return the state at the first change of limits between two states, and the limit; ``None`` without one.

        Positions are looked at on the polynomials of degree 5 through both states, multipliers at the second one.
        """
        if not np.isfinite([self.posture.lower, self.posture.upper]).any():
            return None
        from scipy.interpolate import BPoly

        places, h, x = self.posture.places, after.t - before.t, np.linspace(0.0, 1.0, LOOKED + 1)[1:]
        ends = [[state.q[places], h * state.v, h * h * state.a] for state in (before, after)]
        pressing = np.where(x[:, None] == 1.0, self.pressing(after.q), np.inf)
        margins = np.concatenate([self.margins(BPoly.from_derivatives([0, 1], ends)(x)), pressing], axis=1)
        nv, first = len(self.posture.names), None
        for place in np.flatnonzero((margins < -self.rounding(before.q)).any(axis=0)).tolist():
            instants = before.t + h * x[margins[:, place] < 0.0]
            state = self._root(before, instants.tolist(), place, target, slack)
            if state is not None and (first is None or state.t < first[0].t):
                first = state, (place % nv, place // nv) if place < 2 * nv else self.held[place - 2 * nv]
        return first

    def _root(self, before: PathState, ends: list[float], place: int, target: Target, slack: float) -> PathState | None:
        """Return the state in which a margin vanishes, ``None`` where it does not before any of some instants."""
        from scipy.optimize import brentq

        def margin(q: Array) -> float:
            return float(np.concatenate([self.margins(q[self.posture.places]), self.pressing(q)])[place])

        def margin_at(t: float) -> float:
            return margin(self.last(before, t, target).q)

        rounding = float(self.rounding(before.q)[place])
        end = next((end for end in ends if margin_at(end) < -rounding), None)
        if end is None:
            return None
        if margin(before.q) <= 0.0:  # at the limit already
            return before
        return self.last(before, float(brentq(margin_at, before.t, end, xtol=0.01 * slack)), target)


def first_configuration(
    path_of: Callable[[AtLimits], LimitedPath], posture: Posture, q: Array, w: Array, t: float
) -> tuple[Array, AtLimits]:
    """Return the configuration nearest to the posture, shape (nq,), and the joints that limits hold there.

    Sequential quadratic programming (SLSQP of scipy) comes near it, all limits being bounds; Newton's method then finds
    it to rounding, the joints at limits being those whose multipliers hold them there.
    """
    rough = _rough_minimum(path_of(()), q, w, t)
    near = posture.margins(rough[posture.places]) <= NEAR / AT_LIMIT * posture.slack
    held = {(int(joint), int(side)) for side, joint in np.argwhere(near)}
    for _ in range(2 * len(posture.target) + 1):
        path = path_of(tuple(sorted(held)))
        q = path.nearest(rough, np.append(w, [posture.limit(*limit) for limit in path.held]), t)
        pressing = path.pressing(q)
        if pressing.min(initial=0.0) < 0.0:
            held.discard(path.held[int(pressing.argmin())])
            continue
        beyond = posture.margins(q[posture.places]) + posture.slack
        if (beyond >= 0.0).all():
            return q, path.held
        side, joint = np.unravel_index(int(beyond.argmin()), beyond.shape)
        held.add((int(joint), int(side)))
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
        whole = PullAt(pull, pull.moved(q, x)).whole
        return 0.5 * float(whole @ whole)

    def gap(x: Array) -> Array:
        return np.asarray(independent @ (newton.gap(newton.closure.state(pull.moved(q, x)), w) / newton.measure))

    below, above = posture.margins(q[posture.places]) / pull.units
    reach = TURN * newton.scale / pull.units
    low, high = np.maximum(-reach, -below), np.minimum(reach, above)
    if (low <= high).all():
        solution = minimize(
            distance,
            np.clip(np.zeros(len(low)), low, high),
            method="SLSQP",
            bounds=np.stack([low, high], axis=1),
            constraints={"type": "eq", "fun": gap},
            options={"maxiter": 500, "ftol": 1e-12},
        )
        if np.abs(gap(solution.x)).max(initial=0.0) < CLOSE:
            return pull.moved(q, solution.x)
    out = [name for name, off in zip(posture.names, (below < 0.0) | (above < 0.0), strict=True) if off]
    beyond = f": on the way, {', '.join(out)} are beyond them" if out else ""
    raise AssemblyError(
        f"no configuration on the path at {instant(t)} is found within the limits of the joints{beyond}",
        expected="a path that the arm can follow within its limits",
        hint="start: joint values on the path, within the limits",
        t=t,
        q=q,
    )


class NearestMotion(JointMotion, frozen=True):
    """A mechanism that follows a path of fewer coordinates than degrees of freedom, nearest to a posture.

    Attributes:
        mobility: Degrees of freedom of the assembled mechanism.
        bounds: Instants at which limits change, ascending [s].
        held: Joints at limits before the first of them, between them and after the last; none where not yet known.
        jumps: What happens at these instants, in words.
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
        q = prescribed_at_start(self.mechanism, self.prescribed, grid, start)
        return self._between_known_changes(grid, q) if self.held else _Search(self, grid, q).through(grid)

    def rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        path = self.path(self.held_at(t))
        still = np.zeros(len(path.held))
        states = [path.rates(row, np.append(dw, still), np.append(ddw, still), t) for row in q]
        return np.array([v for v, _ in states]), np.array([a for _, a in states])

    def figures(self, states: JointTrajectory) -> Mapping[str, float]:
        closure, off = self.mechanism.closure, np.zeros(3)
        wanted = np.array([states.grid.evaluate(law) for law in self.laws])
        for row, (q, v, a) in enumerate(zip(states.q, states.v, states.a, strict=True)):
            state = closure.state(q, v)
            for k, coordinate in enumerate(self.coordinates):
                along = coordinate.row(state)
                reached = coordinate.value(state), along @ v, along @ a + coordinate.drift(state)
                off = np.maximum(off, np.abs(np.array(reached) - wanted[k, :, row]))
        return dict(zip(("path", "path rate", "path acceleration"), off.tolist(), strict=True))

    def held_at(self, t: float) -> AtLimits:
        """Return the joints at limits at an instant between changes."""
        return self.held[bisect_right(self.bounds, t)]

    def path(self, held: AtLimits) -> LimitedPath:
        """Return the path with joints held at limits; each is kept."""
        if held not in self._paths:
            self._paths[held] = LimitedPath(self.mechanism, self.prescribed, self.posture, self.mobility, held)
        return self._paths[held]

    def _between_known_changes(self, grid: Grid, q: Array) -> JointTrajectory:
        """Return the motion where it is known which joints are at limits, from a configuration near the first."""
        states = list[PathState]()
        for begin, end, part in grid.intervals():
            path = self.path(self.held_at(0.5 * (begin + end)))
            target = path.prescribed.on(begin, end)
            for t in grid.t[part].tolist():
                if states and t != states[-1].t:
                    states.append(path.last(states[-1], t, target))
                else:
                    near = states[-1].q if states else path.nearest(q, target(t)[0], t)
                    states.append(path.state(near, t, begin, end))
        return _joint_states(self, grid, states)


class _Search:
    """A motion on the way through its rows, on which joints reach limits and come off them."""

    def __init__(self, motion: NearestMotion, grid: Grid, q: Array) -> None:
        (begin, end, _), t = grid.intervals()[0], float(grid.t[0])
        q, held = first_configuration(motion.path, motion.posture, q, motion.prescribed.on(begin, end)(t)[0], t)
        self.motion, self.path = motion, motion.path(held)
        self.state = self.path.state(q, t, begin, end)
        self.slack = ROUNDING * (grid.cuts[-1] - grid.cuts[0])
        self.states, self.cuts, self.starts = list[PathState](), [grid.cuts[0]], [0]
        self.bounds, self.held, self.jumps = list[float](), [held], list[str]()
        self.last: tuple[int, float] | None = None

    def through(self, grid: Grid) -> JointTrajectory:
        """Return the motion through all rows, with the grid cut where velocities jump."""
        for begin, end, part in grid.intervals():
            for t in grid.t[part].tolist():
                if t == self.state.t:  # the first row, or laws that jump: the same position
                    self.state = self.path.state(self.state.q, t, begin, end)
                else:
                    self._advance(t, begin, end)
                if len(self.states) == self.starts[-1] or t - self.states[-1].t > self.slack:
                    self.states.append(self.state)
            self._cut(end)
        located = replace(self.motion, bounds=tuple(self.bounds), held=tuple(self.held), jumps=tuple(self.jumps))
        whole = Grid(np.array([state.t for state in self.states]), tuple(self.cuts), tuple(self.starts))
        return _joint_states(located, whole, self.states)

    def _advance(self, to: float, begin: float, end: float) -> None:
        """Go on to a row, through all changes of limits before it."""
        while crossing := self._crossing(to, self.path.prescribed.on(begin, end)):
            state, limit = crossing
            if self.last and limit[0] == self.last[0] and state.t - self.last[1] <= self.slack:
                raise _undecided(self.motion.posture.names[limit[0]], state)
            self.last = limit[0], state.t
            self._change(state, limit, begin, end)

    def _crossing(self, to: float, target: Target) -> tuple[PathState, tuple[int, int]] | None:
        """Go on to a row, or return the change of limits before it."""
        before = self.state
        for after in self.path.states(before, to, target):
            self.path.require_minimum(after.q, after.t)
            if crossing := self.path.crossing(before, after, target, self.slack):
                return crossing
            before = after
        self.state = before
        return None

    def _change(self, before: PathState, limit: tuple[int, int], begin: float, end: float) -> None:
        """Let a joint reach its limit or leave it: a row before and a row after, and a cut between them."""
        if self.path.path.model.nv == self.path.pull.rank and limit not in self.path.held:
            raise _blocked(self.path, self.motion.posture.names[limit[0]], before)
        self.path = self.motion.path(tuple(sorted({*self.path.held} ^ {limit})))
        self.state = self.path.state(before.q, before.t, begin, end)
        if len(self.states) <= 1 and before.t == self.cuts[0]:  # it only touches its limit where the motion begins
            self.held, self.states = [self.path.held], [self.state][: len(self.states)]
            return
        if before.t - self.states[-1].t > self.slack:
            self.states.append(before)
        self._cut(before.t)
        self.states.append(self.state)
        self.bounds.append(before.t)
        self.held.append(self.path.held)
        self.jumps.append(_words(self.motion, limit, before, self.state, reached=limit in self.path.held))

    def _cut(self, t: float) -> None:
        self.cuts.append(t)
        self.starts.append(len(self.states))


def _joint_states(motion: NearestMotion, grid: Grid, states: list[PathState]) -> JointTrajectory:
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

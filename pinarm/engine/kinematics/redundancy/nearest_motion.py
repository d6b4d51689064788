"""The motion of a redundant mechanism along a path, as near to a posture as the path and limits of joints let it.

Between the instants at which joints reach limits or come off them it is smooth (``nearest``); there
its velocity jumps. These instants are found to rounding and cut the table: each has two rows.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.joint_motion import JointMotion, JointTrajectory, prescribed_at_start
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.kinematics.redundancy.limited_path import (
    AtLimits,
    LimitCrossing,
    LimitedPath,
    first_configuration,
    first_crossing,
)
from pinarm.engine.kinematics.redundancy.nearest import NearestState
from pinarm.engine.kinematics.redundancy.posture import Posture
from pinarm.errors import AssemblyError
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws.motion_law import ROUNDING, Grid, MotionLaw
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


class NearestMotion(JointMotion, frozen=True):
    """A mechanism that follows a path of fewer coordinates than degrees of freedom, nearest to a posture.

    Attributes:
        posture: What is to be near, and limits.
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
        """Return the motion of a mechanism under laws.

        Raises:
            InputError: There are as many laws as degrees of freedom, or more.
        """
        from pinarm.engine.kinematics.closed_configurations import generic_near

        prescribed, closure = PrescribedCoordinates.bound(mechanism, motion), mechanism.closure
        q = generic_near(mechanism, {})
        mobility = closure.split(closure.rows(closure.state(q))).free.shape[1]
        prescribed.check_redundant(mechanism, mobility)
        return cls(mechanism, prescribed, posture, mobility)

    @cached_property
    def _paths(self) -> dict[AtLimits, LimitedPath]:
        return {}

    def begin(self, grid: Grid, start: Array) -> Assembly:
        """Return the start itself: the posture chooses the first configuration."""
        return Assembly(start)

    def follow(self, grid: Grid, start: Array) -> JointTrajectory:
        """Return the motion of the joints: see ``JointMotion``.

        Raises:
            AssemblyError: The path is out of reach, or singular, or what is nearest is not determined.
        """
        q = prescribed_at_start(self.mechanism, self.prescribed, grid, start)
        return self._between_known_changes(grid, q) if self.held else _Search(self, grid, q).through(grid)

    def rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        """Return the velocities and accelerations of the joints, shape (n, nv): see ``JointMotion``."""
        path = self.path(self.held_at(t))
        still = np.zeros(len(path.held))
        states = [path.solver.at(row, t, np.concatenate([dw, still]), np.concatenate([ddw, still])) for row in q]
        return np.array([state.v for state in states]), np.array([state.a for state in states])

    def figures(self, states: JointTrajectory) -> Mapping[str, float]:
        """Return how well the path is held: see ``JointMotion``."""
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
        """Return the path with joints held at limits, kept for the next that asks."""
        if held not in self._paths:
            self._paths[held] = LimitedPath.of(self.mechanism, self.prescribed, self.posture, self.mobility, held)
        return self._paths[held]

    def _between_known_changes(self, grid: Grid, q: Array) -> JointTrajectory:
        """Return the motion where it is known which joints are at limits, from a configuration near the first."""
        states = list[NearestState]()
        for begin, end, part in grid.intervals():
            path = self.path(self.held_at(0.5 * (begin + end)))
            target = path.prescribed.on(begin, end)
            for t in grid.t[part].tolist():
                w, dw, ddw = target(t)
                if states and t != states[-1].t:
                    states.append(path.solver.advance(states[-1], t, target))
                else:
                    near = states[-1].q if states else path.solver.settled(q, w, t)
                    states.append(path.solver.at(near, t, dw, ddw))
        return _joint_states(self, grid, states)


class _Search:
    """A motion on the way through its rows, on which joints reach limits and come off them.

    Args:
        motion: The motion.
        grid: Its rows.
        q: A rough configuration at the first of them, shape (nq,).
    """

    def __init__(self, motion: NearestMotion, grid: Grid, q: Array) -> None:
        (begin, end, _), t = grid.intervals()[0], float(grid.t[0])
        w = motion.prescribed.on(begin, end)(t)[0]
        q, held = first_configuration(motion.path, motion.posture, q, w, t)
        self.motion, self.path = motion, motion.path(held)
        self.state = self._restarted(q, t, begin, end)
        self.slack = ROUNDING * (grid.cuts[-1] - grid.cuts[0])
        self.states, self.cuts, self.starts = list[NearestState](), [grid.cuts[0]], [0]
        self.bounds, self.held, self.jumps = list[float](), [held], list[str]()
        self.last: tuple[int, float] | None = None

    def through(self, grid: Grid) -> JointTrajectory:
        """Return the motion through all rows, with the grid cut where velocities jump."""
        for begin, end, part in grid.intervals():
            for t in grid.t[part].tolist():
                if t == self.state.t:  # the first row, or laws that jump: the same position
                    self.state = self._restarted(self.state.q, t, begin, end)
                else:
                    self._advance(t, begin, end)
                if len(self.states) == self.starts[-1] or t - self.states[-1].t > self.slack:
                    self.states.append(self.state)
            self._cut(end)
        located = replace(self.motion, bounds=tuple(self.bounds), held=tuple(self.held), jumps=tuple(self.jumps))
        whole = Grid(np.array([state.t for state in self.states]), tuple(self.cuts), tuple(self.starts))
        return _joint_states(located, whole, self.states)

    def _restarted(self, q: Array, t: float, begin: float, end: float) -> NearestState:
        _, dw, ddw = self.path.prescribed.on(begin, end)(t)
        return self.path.solver.at(q, t, dw, ddw)

    def _advance(self, to: float, begin: float, end: float) -> None:
        """Go on to a row, through all changes of limits before it."""
        while True:
            target = self.path.prescribed.on(begin, end)
            states, error = self.path.solver.steps(self.state, to, target)
            crossings = (first_crossing(self.path, *pair, target, self.slack) for pair in pairwise(states))
            crossing = next((crossing for crossing in crossings if crossing is not None), None)
            if crossing is None and error is not None:
                raise error
            if crossing is None:
                self.state = states[-1]
                return
            at = crossing.joint, crossing.state.t
            if self.last and at[0] == self.last[0] and at[1] - self.last[1] <= self.slack:
                raise _undecided(self.motion.posture.names[at[0]], crossing.state)
            self.last = at
            self._change(crossing, begin, end)

    def _change(self, crossing: LimitCrossing, begin: float, end: float) -> None:
        """Let a joint reach its limit or leave it: a row before and a row after, and a cut between them."""
        limit, before = (crossing.joint, crossing.side), crossing.state
        if not self.path.solver.freedom and limit not in self.path.held:
            raise _blocked(self.path, self.motion.posture.names[crossing.joint], before)
        self.path = self.motion.path(tuple(sorted({*self.path.held} ^ {limit})))
        self.state = self._restarted(before.q, before.t, begin, end)
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


def _joint_states(motion: NearestMotion, grid: Grid, states: list[NearestState]) -> JointTrajectory:
    q, v, a = (np.array(part) for part in zip(*((state.q, state.v, state.a) for state in states), strict=True))
    return JointTrajectory(motion, grid, q, v, a)


def _words(
    motion: NearestMotion, limit: tuple[int, int], before: NearestState, after: NearestState, *, reached: bool
) -> str:
    """Return what happens where a joint reaches its limit or leaves it."""
    posture, coordinates = motion.posture, motion.mechanism.coordinates
    jump = np.abs(after.v - before.v)
    fastest, joint = posture.names[int(jump.argmax())], posture.names[limit[0]]
    rate = "m/s" if fastest in coordinates and coordinates[fastest].unit == METRE else "rad/s"
    return (
        f"at t = {before.t:.9g} s {joint} {'reaches' if reached else 'comes off'} its limit "
        f"{posture.limit(*limit):.6g} {coordinates[joint].unit}, and velocities jump: that of {fastest} by "
        f"{jump.max():.3g} {rate}"
    )


def _undecided(name: str, state: NearestState) -> AssemblyError:
    return AssemblyError(
        f"whether {name} stays at its limit is not determined at t = {state.t:.9g} s", t=state.t, q=state.q,
        expected="a path on which joints reach limits and come off them, and do not just touch them",
        hint="another posture, or wider limits",
    )  # fmt: skip


def _blocked(path: LimitedPath, name: str, state: NearestState) -> AssemblyError:
    others = ", ".join(path.posture.names[joint] for joint, _ in path.held)
    there = f"{others} are at theirs" if len(path.held) > 1 else f"{others} is at its own"
    return AssemblyError(
        f"the path cannot be followed within the limits of the joints beyond t = {state.t:.9g} s: there {name} reaches "
        f"its limit, and {there}",
        expected="a path within reach", hint="another posture or start, which take another way", t=state.t, q=state.q,
    )  # fmt: skip

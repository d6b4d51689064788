"""Free motions of a tree from many states: steps in compiled code one motion after another, states of all at once.

Each motion has the steps that it would have alone. Where one would not, since it is small, or cannot be followed to its
end, it is left to be integrated alone.
"""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.integrator import Interval, Solution
from pinarm.engine.integration.methods.explicit import Adaptive, AdaptiveStepper, CompiledSteps
from pinarm.engine.integration.runge_kutta import FASTEST, first_step
from pinarm.engine.motion.guards import acting_on_angles
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.motion.segmented.segments import OFFSET, SMALL
from pinarm.engine.motion.standstill import lossy


def free_interval(motion: IntegratedMotion) -> Interval | None:
    """Return the one interval of a motion of a tree on which nothing can happen; ``None`` for other motions."""
    mechanism, hybrid = motion.mechanism, motion.hybrid
    if lossy(mechanism) or acting_on_angles(mechanism.constraints, hybrid.dynamics.forces):
        return None
    held = hybrid.closure.size or hybrid.prescribed.names or hybrid.bounds or hybrid.frictions or hybrid.controls
    if held or hybrid.watches or hybrid.knots or len(hybrid.cuts) > 2 or not isinstance(hybrid.method, Adaptive):
        return None
    (interval,) = hybrid.intervals(hybrid.closed_system, [hybrid.time])
    return interval if interval.compiled is not None and not hybrid.dynamics.leaps else None


def follow(hybrid: HybridSystem, interval: Interval, q: Array, v: Array, t: Array) -> tuple[Array, Flags]:
    """Return the states of b motions at n instants, and which motions are those that they would be alone.

    Args:
        hybrid: The system.
        interval: That of all motions; see ``free_interval``.
        q: Configurations at the start, shape (b, nq).
        v: Velocities at the start, shape (b, nv).
        t: Instants [s], shape (n,).

    Returns:
        [q, v], shape (b, n, nq + nv), and flags, shape (b,).
    """
    manifold = hybrid.closed_system.manifold
    solution, y = Solution(hybrid.method, manifold, [interval]), np.hstack([manifold.project(q), v])
    followed, index = _steps(hybrid, solution, y, t)
    states, good = np.full((len(y), len(t), y.shape[1]), np.nan), np.zeros(len(y), bool)
    if len(followed):
        steps, first = solution.steps, index[:, 0]
        begun = np.hstack([y[followed, : q.shape[1]], np.zeros((len(followed), v.shape[1]))])
        moved = np.abs(steps.y - begun.repeat(np.diff(np.append(first, len(steps))), axis=0)).max(axis=1)
        size, moved = (np.maximum.reduceat(x, first) for x in (np.abs(steps.y).max(axis=1), moved))
        there = solution.states_in(index.ravel(), np.tile(t, len(followed)))
        states[followed] = np.hstack(there).reshape(len(followed), len(t), -1)
        good[followed] = (size >= SMALL) & (moved >= OFFSET * (1.0 + size))
    return states, good & np.isfinite(states).all(axis=(1, 2))


def _steps(hybrid: HybridSystem, solution: Solution, y: Array, t: Array) -> tuple[Indices, Indices]:
    """Take the steps of motions; return which come to their end, shape (k,), and steps of instants, shape (k, n)."""
    method, (interval,), most = solution.method, solution.intervals, hybrid.max_steps
    flow, start, end = interval.compiled, interval.start, interval.end
    assert isinstance(method, Adaptive) and flow is not None
    flow.ready()
    slopes = flow.all_rates(np.full(len(y), start), y)
    order, size = method.tableau.error_order, interval.size
    lengths = first_step((start, end), y, slopes, flow.all_rates, method.tolerance, order, size)
    stepper = AdaptiveStepper(method, solution, None)
    stepper.interval, compiled = interval, CompiledSteps(stepper)
    followed, index = list[int](), list[Indices]()
    for k, h in enumerate(lengths.tolist()):
        stepper.y[:], stepper.slopes[0], stepper.ceiling = y[k], slopes[k], FASTEST
        now, begun, taken = start, len(solution.steps), -1
        while now < end and taken < (taken := len(solution.steps) - begun) < most:
            now, h = compiled.take(now, h, most - taken)
        if now < end:
            solution.truncate(begun)
            continue
        followed.append(k)
        index.append(begun + solution.steps.t[begun:].searchsorted(t, side="right") - 1)
    return np.array(followed, np.intp), np.array(index, np.intp)

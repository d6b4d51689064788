"""Path of a redundant mechanism with joints held at limits: its first configuration, and changes of limits on it.

From a rough configuration, sequential quadratic programming (SLSQP of scipy) comes near the first one, all limits being
bounds; Newton's method then finds it to rounding, the joints at limits being those whose multipliers hold them there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.abscissa import instant
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.kinematics.redundancy.nearest import NearestSolver, NearestState, Target
from pinarm.engine.kinematics.redundancy.posture import AT_LIMIT, Posture
from pinarm.errors import AssemblyError
from pinarm.mechanics.laws import Constant
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

AtLimits = tuple[tuple[int, int], ...]
"""Joints at limits, by their index in v, and 0 for the lower or 1 for the upper limit; sorted."""

LOOKED = 8
"""Points of every step at which limits are looked at, on the polynomials through its two ends."""

LIFTED = 1e-9
"""Part of the pull of the posture by which a limit may hold a joint the wrong way: rounding of multipliers."""

NEAR = 1e-5
"""Distance from a limit, relative to ``1 + |limit|``, within which the rough minimum counts as at it."""

CLOSE = 1e-6
"""Largest gap of the rough minimum: differences of the constraints leave 1e-8."""

TURN = 3.0
"""How far a joint may be moved from the rough configuration [rad, or units of length], as far as limits let it."""


class LimitedPath(Record, frozen=True):
    """The path with joints held at limits.

    Attributes:
        held: These joints.
        posture: What is to be near, and limits.
        prescribed: The coordinates of the path, then those of the joints.
        solver: The equations of the nearest configuration on it.
    """

    held: AtLimits
    posture: Posture
    prescribed: PrescribedCoordinates
    solver: NearestSolver

    @classmethod
    def of(
        cls, mechanism: Mechanism, path: PrescribedCoordinates, posture: Posture, mobility: int, held: AtLimits
    ) -> LimitedPath:
        """Return a path with joints held at limits, of a mechanism with so many degrees of freedom."""
        names = [posture.names[v] for v, _ in held]
        prescribed = PrescribedCoordinates(
            (*path.names, *names),
            (*path.coordinates, *(mechanism.coordinates[name] for name in names)),
            (*path.laws, *(Constant(value=posture.limit(v, side)) for v, side in held)),
        )
        return cls(held, posture, prescribed, NearestSolver(mechanism.closure, prescribed, posture, mobility))

    def target(self, begin: float, end: float) -> Target:
        """Return ``t -> w_d, w_d', w_d''`` on an interval without jumps."""
        return self.prescribed.on(begin, end)

    def pressing(self, lam: Array) -> Array:
        """Return how hard limits press on the joints that they hold, negative where one would come off.

        Args:
            lam: Multipliers of all rows, shape (..., m).

        Returns:
            Shape (..., h).
        """
        signs = np.array([1.0 if side == 0 else -1.0 for _, side in self.held])
        return np.asarray(signs * lam[..., lam.shape[-1] - len(self.held) :])


class LimitCrossing(Record, frozen=True):
    """Where a joint reaches a limit, or comes off it.

    Attributes:
        state: The state there, of the motion before.
        joint: Index of the joint in v.
        side: 0 for its lower limit, 1 for the upper one.
    """

    state: NearestState
    joint: int
    side: int


def first_crossing(
    path: LimitedPath, before: NearestState, after: NearestState, target: Target, slack: float
) -> LimitCrossing | None:
    """Return the first change of limits between two states of a path, ``None`` where there is none.

    Args:
        path: The path, with the joints that are at limits from the first state on.
        before: The first state.
        after: The second one.
        target: Prescribed values over time.
        slack: Difference of instants that does not count [s].
    """
    if not path.posture.limited:
        return None
    x, (positions, lam) = _points(path.posture, before, after)
    margins, first = _margins(path, positions, lam), None
    for place in np.flatnonzero((margins < -_rounding(path, before)).any(axis=0)).tolist():
        ends = before.t + (after.t - before.t) * x[margins[:, place] < 0.0]
        state = _root(path, before, ends.tolist(), place, target, slack)
        if state is not None and (first is None or state.t < first.state.t):
            first = LimitCrossing(state, *_limit(path, place))
    return first


def _root(
    path: LimitedPath, before: NearestState, ends: list[float], place: int, target: Target, slack: float
) -> NearestState | None:
    """Return the state in which a margin vanishes, ``None`` where it does not before any of some instants."""
    from scipy.optimize import brentq

    def margin(state: NearestState) -> float:
        return float(_margins(path, path.posture.positions(state.q), state.lam)[place])

    def margin_at(t: float) -> float:
        return margin(path.solver.advance(before, t, target))

    rounding = float(_rounding(path, before)[place])
    end = next((end for end in ends if margin_at(end) < -rounding), None)
    if end is None:
        return None
    if margin(before) <= 0.0:  # at the limit already
        return before
    return path.solver.advance(before, float(brentq(margin_at, before.t, end, xtol=0.01 * slack)), target)


def _points(posture: Posture, before: NearestState, after: NearestState) -> tuple[Array, tuple[Array, Array]]:
    """Return points between two states, the second one the last of them, as parts of the way, shape (n,).

    And there, on polynomials with the values and rates of both ends, the positions of the joints, of degree 5, shape
    (n, nv), and the multipliers, of degree 3, shape (n, m).
    """
    from scipy.interpolate import BPoly

    h, x, ends = after.t - before.t, np.linspace(0.0, 1.0, LOOKED + 1)[1:], (before, after)
    positions = BPoly.from_derivatives([0, 1], [[posture.positions(s.q), h * s.v, h * h * s.a] for s in ends])
    lam = BPoly.from_derivatives([0, 1], [[s.lam, h * s.lam_rate] for s in ends])
    return x, (positions(x), lam(x))


def _margins(path: LimitedPath, positions: Array, lam: Array) -> Array:
    """Return what changes its sign where limits change: margins of free joints, then the pressing on held ones.

    Args:
        path: The path.
        positions: In the order of v, shape (..., nv).
        lam: Multipliers, shape (..., m).

    Returns:
        Lower limits, upper limits, held joints, shape (..., 2 nv + h).
    """
    margins = path.posture.margins(positions)
    for joint, side in path.held:
        margins[..., side, joint] = np.inf
    return np.concatenate([margins.reshape(*margins.shape[:-2], -1), path.pressing(lam)], axis=-1)


def _rounding(path: LimitedPath, state: NearestState) -> Array:
    """Return how far beyond 0 these may be, shape (2 nv + h,)."""
    pull = float(np.abs(path.posture.pull(state.q)).max(initial=0.0))
    return np.concatenate([path.posture.slack.ravel(), np.full(len(path.held), LIFTED * (1.0 + pull))])


def _limit(path: LimitedPath, place: int) -> tuple[int, int]:
    """Return joint and side of one of these."""
    nv = len(path.posture.names)
    return (place % nv, place // nv) if place < 2 * nv else path.held[place - 2 * nv]


def first_configuration(
    path_of: Callable[[AtLimits], LimitedPath], posture: Posture, q: Array, w: Array, t: float
) -> tuple[Array, AtLimits]:
    """Return the configuration nearest to the posture, shape (nq,), and the joints that limits hold there.

    Args:
        path_of: Gives the path with joints held at limits.
        posture: What is to be near.
        q: A rough configuration, shape (nq,).
        w: Values of the prescribed coordinates, shape (k,).
        t: The instant, for messages.

    Raises:
        AssemblyError: The path is out of reach, within the limits or at all.
    """
    free = path_of(()).solver
    rough = _rough_minimum(free, posture, free.newton.assemble(q, w, t), w, t)
    near = posture.margins(posture.positions(rough)) <= NEAR / AT_LIMIT * posture.slack
    held = {(int(joint), int(side)) for side, joint in np.argwhere(near)}
    for _ in range(2 * len(posture.target) + 1):
        path = path_of(tuple(sorted(held)))
        levels = [posture.limit(*limit) for limit in path.held]
        q = path.solver.settled(rough, np.concatenate([w, levels]), t)
        pressing = path.pressing(path.solver.point(q, t).lam)
        if pressing.min(initial=0.0) < 0.0:
            held.discard(path.held[int(pressing.argmin())])
            continue
        beyond = posture.margins(posture.positions(q)) + posture.slack
        if (beyond >= 0.0).all():
            return q, path.held
        side, joint = np.unravel_index(int(beyond.argmin()), beyond.shape)
        held.add((int(joint), int(side)))
    raise AssemblyError(
        f"which joints are at their limits is not determined at {instant(t)}", t=t, q=q,
        expected="a path that does not begin where a joint just touches its limit", hint="another posture or start",
    )  # fmt: skip


def _rough_minimum(solver: NearestSolver, posture: Posture, q: Array, w: Array, t: float) -> Array:
    """Return a configuration near the minimum, shape (nq,), from one on the path."""
    from scipy.optimize import minimize

    newton, n = solver.newton, solver.newton.model.nv
    rows = solver.rows(newton.closure.state(q))
    independent = np.linalg.svd(rows)[0][:, : solver.rank].T  # SLSQP cannot take rows that repeat others

    def distance(x: Array) -> float:
        pull = posture.pull(solver.moved(q, x))
        return 0.5 * float(pull @ pull)

    def gap(x: Array) -> Array:
        state = newton.closure.state(solver.moved(q, x))
        return np.asarray(independent @ (newton.gap(state, w) / newton.measure))

    below, above = posture.margins(posture.positions(q)) / solver.unit
    low, high = np.maximum(-TURN / solver.finer, -below), np.minimum(TURN / solver.finer, above)
    if (low <= high).all():
        found = minimize(
            distance, np.clip(np.zeros(n), low, high), method="SLSQP", bounds=np.stack([low, high], axis=1),
            constraints={"type": "eq", "fun": gap}, options={"maxiter": 500, "ftol": 1e-12},
        )  # fmt: skip
        if np.abs(gap(found.x)).max(initial=0.0) < CLOSE:
            return solver.moved(q, found.x)
    out = [name for name, off in zip(posture.names, (below < 0.0) | (above < 0.0), strict=True) if off]
    beyond = f": on the way, {', '.join(out)} are beyond them" if out else ""
    raise AssemblyError(
        f"no configuration on the path at {instant(t)} is found within the limits of the joints{beyond}",
        expected="a path that the arm can follow within its limits", hint="start: joint values on the path, within "
        "the limits", t=t, q=q,
    )  # fmt: skip

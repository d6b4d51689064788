"""A path on which joints are held at limits, and where on it one reaches a limit or comes off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.kinematics.redundancy.nearest import NearestSolver, NearestState, Target
from pinarm.engine.kinematics.redundancy.posture import Posture
from pinarm.mechanics.laws import Constant

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

AtLimits = tuple[tuple[int, int], ...]
"""Joints at limits, by their index in v, and 0 for the lower or 1 for the upper limit; sorted."""

LOOKED = 8
"""Points of every step at which limits are looked at, on the polynomials through its two ends."""

LIFTED = 1e-9
"""Part of the pull of the posture by which a limit may hold a joint the wrong way: rounding of multipliers."""


@dataclass(frozen=True, eq=False)
class LimitedPath:
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


@dataclass(frozen=True, eq=False)
class LimitCrossing:
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
    h, x = after.t - before.t, np.linspace(0.0, 1.0, LOOKED + 1)[1:]
    start, end = posture.positions(before.q), posture.positions(after.q)
    rise, u, w = end - start, h * before.v, h * after.v
    b, c = h * h * before.a, h * h * after.a
    third, fourth = 10 * rise - 6 * u - 4 * w + (c - 3 * b) / 2, (3 * b - 2 * c) / 2 - 15 * rise + 8 * u + 7 * w
    quintic = [start, u, b / 2, third, fourth, 6 * rise - 3 * (u + w) + (c - b) / 2]
    rise, u, w = after.lam - before.lam, h * before.lam_rate, h * after.lam_rate
    cubic = [before.lam, u, 3 * rise - 2 * u - w, u + w - 2 * rise]
    return x, (np.vander(x, 6, increasing=True) @ quintic, np.vander(x, 4, increasing=True) @ cubic)


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

"""The first configuration of a path that is nearest to a posture, and the limits at which joints are there.

From a rough configuration, sequential quadratic programming (SLSQP of scipy) comes near it with all limits as bounds;
Newton's method then finds it to rounding, the joints at limits being those whose multipliers hold them there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.abscissa import instant
from pinarm.engine.kinematics.redundancy.limited_path import AtLimits, LimitedPath
from pinarm.engine.kinematics.redundancy.posture import AT_LIMIT, Posture
from pinarm.errors import AssemblyError

if TYPE_CHECKING:
    from pinarm.engine.kinematics.redundancy.nearest import NearestSolver

NEAR = 1e-5
"""Distance from a limit, relative to ``1 + |limit|``, within which the rough minimum counts as at it."""

CLOSE = 1e-6
"""Largest gap of the rough minimum: differences of the constraints leave 1e-8."""

TURN = 3.0
"""How far a joint may be moved from the rough configuration [rad, or units of length], as far as limits let it."""


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

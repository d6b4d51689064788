"""Margins of decisions: how errors of states change a watched value, and what is decided where it turns."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.motion.decision import Decision
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.integration.events import Watch
    from pinarm.engine.integration.turns import Turn
    from pinarm.engine.motion.segmented.hybrid_system import HybridSystem

PART = 1e-6
"""Change of a state, over the size that errors are relative to, by which a sensitivity is measured: larger than the
rounding of loads, and so small that their curvature does not matter."""

Margin = Callable[[Array, Array, Array], Array]
"""``(t, q, v) -> margins`` of n states of a mechanism, shape (n,)."""


def deciding(hybrid: HybridSystem, watch: Watch) -> Watch:
    """Return what is watched of a mechanism's states, with the sensitivity of its margin where it decides something."""
    if not watch.what:
        return watch
    return replace(watch, sensitivity=partial(sensitivity, hybrid, watch.margin or watch.value))


def sensitivity(hybrid: HybridSystem, margin: Margin, t: Array, q: Array, v: Array) -> float:
    """Return the change of a margin by errors of 1 in all coordinates and velocities of one state.

    The errors are relative to ``size + |y|``, as those of steps are. Their effects are added up.

    Args:
        hybrid: What is integrated.
        margin: The margin.
        t: The instant [s], shape (1,).
        q: Configuration, shape (1, nq).
        v: Velocity, shape (1, nv).
    """
    model, n = hybrid.closure.model, hybrid.closure.model.nv
    moves = PART * np.diag(hybrid.size + (np.abs(q[0]) if model.nq == n else np.ones(n)))
    positions = [q[0], *(pin.integrate(model, q[0], move) for move in moves), *np.repeat(q, n, axis=0)]
    velocities = np.vstack([np.repeat(v, n + 1, axis=0), v + PART * np.diag(hybrid.size + np.abs(v[0]))])
    found = margin(np.repeat(t, 2 * n + 1), np.array(positions), velocities)
    return float(np.abs(found[1:] - found[0]).sum()) / PART


def decision(watch: Watch, turn: Turn, event: str = "") -> Decision:
    """Return what is decided where a watched value turns.

    Args:
        watch: What is watched.
        turn: Where it turns.
        event: Name of the event that is only recorded there; empty for what changes the motion.
    """
    passed = -turn.sign * turn.margin
    if watch.loaded:  # what is watched for its end
        return Decision(watch.what, turn.t, -passed, turn.error, watch.unit, passed < 0.0)
    touches = turn.is_open and watch.level is not None
    happens = watch.direction in (0, -turn.sign) if touches else passed > 0.0
    return Decision(watch.what, turn.t, passed, turn.error, watch.unit, happens, event)

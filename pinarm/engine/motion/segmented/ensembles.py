"""Motions from many initial states, integrated together."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pinarm.arrays import Array
from pinarm.engine.motion.lost_turns import acting_on_angles
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem, Mode
from pinarm.engine.motion.segmented.segment_ends import steps_over, watched

if TYPE_CHECKING:
    from pinarm.engine.integration.ensemble import Ensemble


def is_batchable(hybrid: HybridSystem) -> bool:
    """Tell whether motions from several initial states can be integrated together: none has events or decisions."""
    if hybrid.frictions or hybrid.controls or hybrid.bounds or hybrid.watches:
        return False
    if acting_on_angles(hybrid.closure.constraints, hybrid.dynamics.forces):
        return False  # where angles leap is looked for motion by motion
    system = hybrid.system()
    free = system.manifold.nv > 0 and not watched(hybrid, Mode(), system, frozenset())
    return free and hybrid.method.pair is not None and all(interval.batch for interval in hybrid.free_intervals)


def integrate_together(hybrid: HybridSystem, q: Array, v: Array) -> Ensemble | None:
    """Return motions from many initial states that touch no stop; ``None`` where each is to be integrated alone.

    Args:
        hybrid: What is integrated.
        q: Configurations, shape (b, nq), assembled.
        v: Velocities, shape (b, nv).
    """
    from pinarm.engine.integration.ensemble import integrate_batch

    system, pair = hybrid.system(), hybrid.method.pair
    if pair is None or not is_batchable(hybrid):
        return None
    return integrate_batch(
        hybrid.free_intervals,
        system.manifold,
        q,
        v,
        pair,
        max_steps=hybrid.max_steps,
        steps_over=steps_over(hybrid, system),
    )

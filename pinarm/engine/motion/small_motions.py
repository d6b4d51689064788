"""Motions much smaller than 1 in SI, integrated with errors relative to their own size.

The error of a step is relative to ``size + |y|``. A size of 1 suits motions of mechanisms, but an oscillation of
1e-12 m would have errors as large as itself at a tolerance of 1e-9, with no sign of it.
"""

from __future__ import annotations

from pinarm.arrays import Array
from pinarm.engine.motion.segmented.hybrid_motion import FirstSegment, HybridSystem
from pinarm.engine.motion.segmented.segments import SegmentedMotion
from pinarm.errors import IntegrationError
from pinarm.records import replace

SMALL = 0.1
"""Size over that which errors are relative to, below which a motion is integrated again: its errors are then more than
ten times as large as the tolerance says."""

REST = 1e-15
"""Size of a motion in SI that rounding explains where there is gravity: the mechanism hangs at rest."""

MOST = 20_000
"""Steps that a second integration may take: where rounding is as large as the motion, no step is short enough."""


def integrate_to_size(hybrid: HybridSystem, q: Array, v: Array, first: FirstSegment | None = None) -> SegmentedMotion:
    """Return the motion from an initial state, its errors relative to its own size where that is below 1.

    See ``HybridSystem.integrate`` for arguments and errors. Where rounding does not allow the finer integration, the
    motion is that of the coarser one, of which ``--verify`` tells how wrong it is.
    """
    motion = hybrid.integrate(q, v, first)
    while (size := finer_size(hybrid, motion.size)) is not None:
        hybrid = replace(hybrid, size=size, max_steps=min(hybrid.max_steps, MOST))
        try:
            motion = hybrid.integrate(q, v)
        except IntegrationError:
            break
    return motion


def finer_size(hybrid: HybridSystem, size: float) -> float | None:
    """Return what the errors of a motion of some size should be relative to; ``None`` where they already are."""
    at_rest = REST if hybrid.dynamics.model.gravity.linear.any() else 0.0
    wanted = max(size, hybrid.least_size)
    return wanted if size > at_rest and wanted < SMALL * hybrid.size else None

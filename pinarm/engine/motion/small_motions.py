"""Motions much smaller than 1 in SI, integrated with errors relative to their own size.

The error of a step is relative to ``size + |y|``. A size of 1 suits motions of mechanisms, but an oscillation of
1e-12 m would have errors as large as itself at a tolerance of 1e-9, with no sign of it. Where rounding of the
accelerations is as large as a motion no step is short enough, and the coarser motion is kept; a motion below ``REST``
is rounding itself. A small motion about a coordinate of 1 is limited by |y|: its tolerance is made finer by how much
smaller it is, as far as the rounding of the coordinate allows.
"""

from __future__ import annotations

from pinarm.arrays import Array
from pinarm.engine.motion.segmented.hybrid_motion import integrate
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.motion.segmented.segments import FINEST, OFFSET, REST, SMALL, SegmentedMotion
from pinarm.errors import IntegrationError
from pinarm.records import replace

MOST = 20_000
"""Steps that a second integration may take: where rounding is as large as the motion, no step is short enough."""

MOST_ROUNDING = 1e-15
"""Largest error of a step in SI that is explained by rounding; what looks like more is a load with corners."""


def integrate_to_size(hybrid: HybridSystem, q: Array, v: Array) -> SegmentedMotion:
    """Return the motion from an initial state, its errors relative to its own size where that is below 1.

    See ``hybrid_motion.integrate`` for arguments and errors. Where rounding does not allow the finer integration, the
    motion is that of the coarser one; ``SegmentedMotion.rounding`` tells how wrong it is.
    """
    motion = integrate(hybrid, q, v)
    while is_small(hybrid, motion.size) and motion.size > REST:
        hybrid = hybrid.of_size(motion.size, min(hybrid.max_steps, MOST))
        try:
            motion = integrate(hybrid, q, v)
        except IntegrationError:
            break
    return _integrate_to_displacement(hybrid, motion, q, v)


def _integrate_to_displacement(hybrid: HybridSystem, motion: SegmentedMotion, q: Array, v: Array) -> SegmentedMotion:
    """Return a motion, integrated again where it is small beside its coordinates: errors are relative to its course."""
    moved, scale = motion.displacement, hybrid.size + motion.size
    tolerance = max(hybrid.method.tolerance * moved / scale, FINEST)
    if not is_offset(hybrid, moved, scale) or tolerance >= hybrid.method.tolerance:
        return motion
    try:
        method, most = replace(hybrid.method, tolerance=tolerance), min(hybrid.max_steps, MOST)
        return integrate(replace(hybrid, method=method, max_steps=most), q, v)
    except IntegrationError:
        return motion


def is_offset(hybrid: HybridSystem, moved: float, scale: float) -> bool:
    """Tell whether a displacement is small, but more than rounding, beside what errors of steps are relative to."""
    return hybrid.method.tolerance > 0.0 and REST * scale < moved < OFFSET * scale


def is_small(hybrid: HybridSystem, size: float) -> bool:
    """Tell whether a motion is small beside what the errors of its steps have been relative to."""
    return hybrid.method.tolerance > 0.0 and 0.0 < size < SMALL * hybrid.size

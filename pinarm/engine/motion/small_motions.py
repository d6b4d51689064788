"""Motions much smaller than 1 in SI, integrated with errors relative to their own size.

The error of a step is relative to ``size + |y|``. A size of 1 suits motions of mechanisms, but an oscillation of
1e-12 m would have errors as large as itself at a tolerance of 1e-9, with no sign of it.

Steps cannot err less than rounding of the accelerations lets them. What that is depends on what cancels in them: for a
mass on a level slide and a pendulum that hangs along an axis nothing does, and they are as accurate at 1e-12 as at 1;
where a spring carries a weight, 1e-16 of the weight is left over. So it is measured, not concluded from gravity.

A small motion about a coordinate of 1 is limited by |y|: its tolerance is made finer by how much smaller it is, as far
as the rounding of the coordinate allows.
"""

from __future__ import annotations

import math

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.motion.segmented.hybrid_motion import integrate
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.motion.segmented.segments import FINEST, OFFSET, REST, SMALL, MotionSegment, SegmentedMotion
from pinarm.errors import IntegrationError
from pinarm.records import replace

MOST = 20_000
"""Steps that a second integration may take: where rounding is as large as the motion, no step is short enough."""

STATES, ORDER = 33, 6
"""States at which accelerations are computed to see their rounding, and the order of the differences that leave nothing
else of them: of a smooth function, over a thirtieth of a size below 0.1, at most 1e-15 of it."""

MOST_OF_THEM = 0.7
"""Part of the differences that is looked at: a corner of a load is in 7 of 27. Of a normal variable with standard
deviation 1, it is below 1.04 in size."""

PART = 0.1
"""Error of a step over what rounding of the accelerations does to a velocity in it: smaller, and errors of steps no
longer matter beside rounding."""

MOST_ROUNDING = 1e-15
"""Largest error of a step in SI that is explained by rounding; what looks like more is a load with corners."""


def integrate_to_size(hybrid: HybridSystem, q: Array, v: Array) -> SegmentedMotion:
    """Return the motion from an initial state, its errors relative to its own size where that is below 1.

    See ``hybrid_motion.integrate`` for arguments and errors. Where rounding does not allow the finer integration, the
    motion is that of the coarser one; ``SegmentedMotion.rounding`` tells how wrong it is.
    """
    motion = integrate(hybrid, q, v)
    least = least_size(hybrid, motion) if is_small(hybrid, motion.size) else 0.0
    while is_small(hybrid, wanted := max(motion.size, least)) and motion.size:
        hybrid = hybrid.of_size(wanted, min(hybrid.max_steps, MOST))
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


def least_size(hybrid: HybridSystem, motion: SegmentedMotion) -> float:
    """Return the least size that errors of steps can be relative to, in SI; infinite at rest but for rounding."""
    noise = acceleration_noise(motion.segments[0], motion.size)
    if noise and motion.size <= REST:
        return math.inf
    step = (motion.end - hybrid.time[0]) / motion.cost()["steps"]
    return min(PART * step * noise, MOST_ROUNDING) / hybrid.method.tolerance


def acceleration_noise(segment: MotionSegment, size: float) -> float:
    """Return the standard deviation of the rounding of the accelerations in a motion, in SI.

    The quantile ``MOST_OF_THEM`` of ``|difference of order 6| / sqrt(binomial(12, 6))`` of accelerations at states
    along a line as long as the motion is large. More, Wild, Estimating computational noise, SIAM J. Sci. Comput. 33
    (2011), section 3.

    Args:
        segment: Part of the motion.
        size: Largest coordinate or velocity.
    """
    solution = segment.solution
    if not solution.steps or not solution.manifold.nv:
        return 0.0
    step, nq = solution.steps[0], solution.manifold.nq
    interval = solution.intervals[step.interval]
    along = size * np.cos(np.arange(1.0, len(step.y) + 1.0))
    states = step.y + np.linspace(0.0, 1.0, STATES)[:, None] * along
    found = np.array([interval.acceleration(step.t, y[:nq], y[nq:]) for y in states])
    differences = np.abs(np.diff(found, ORDER, axis=0)) / math.sqrt(math.comb(2 * ORDER, ORDER))
    return float(np.quantile(differences, MOST_OF_THEM, axis=0).max())

"""Natural size of a unit in a run: what its masses, lengths and times make of it, by which rounding is judged."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.input.units import Unit

ZERO = 1e-14
"""Size of an output, relative to what the masses, lengths and times of the run make of its unit, that rounding
explains; outputs that are 0 are up to 4e-15 in the scenarios that come with pinarm."""


def natural_sizes(run: Trajectory) -> Callable[[Unit | None], float]:
    """Return the natural size of a unit as a function, from mass, length and time: of N, ``mass * length / time²``.

    The mass is that of all bodies, the length that of all links from end to end, or the longest way of a sliding joint
    where that is longer, and the time the shortest in which gravity, or the motion, changes anything by its own size.
    """
    model = run.mechanism.model
    mass = sum(inertia.mass for inertia in model.inertias) or 1.0
    levers = [np.linalg.norm(inertia.lever) for inertia in model.inertias]
    ways = [np.abs(run.q[:, joint.q]).max() for joint in run.mechanism.joints.values() if joint.unit.dimension[0]]
    links = float(sum(levers) + sum(np.linalg.norm(place.translation) for place in model.jointPlacements))
    length = max(links, *map(float, ways), 0.0) or 1.0
    reach = np.array([length if joint.unit.dimension[0] else 1.0 for joint in run.mechanism.joints.values()])
    index = [joint.v for joint in run.mechanism.joints.values()]
    rate = float((np.abs(run.v[:, index]) / reach).max(initial=0.0))
    change = float((np.abs(run.a[:, index]) / reach).max(initial=0.0))
    frequency = max(rate, change**0.5, (run.mechanism.gravity / length) ** 0.5) or 1.0

    def size(unit: Unit | None) -> float:
        if unit is None:
            return 1.0
        metres, kilograms, seconds, _ = (float(exponent) for exponent in unit.dimension)
        return float(length**metres * mass**kilograms * frequency**-seconds)

    return size

"""What errors of outputs are relative to: their largest value, or what the run makes of their unit where they are 0."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.input.units import Unit

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

ZERO = 1e-14
"""Size of an output, relative to what the masses, lengths and times of the run make of its unit, that rounding
explains; outputs that are 0 are up to 4e-15 in the scenarios that come with pinarm."""


def output_scales(result: Result) -> dict[str, float]:
    """Return what the errors of the outputs are relative to.

    That is the largest absolute value over the run; of an output that is 0 but for rounding, what the masses, lengths
    and times of the run make of its unit.
    """
    return {name: usual if size <= ZERO * usual else size for name, (size, usual) in _sizes(result).items()}


def rounded_to_zero(result: Result) -> dict[str, float]:
    """Return how large the outputs are that are 0 but for rounding, though not exactly, relative to their scales."""
    return {name: size / usual for name, (size, usual) in _sizes(result).items() if 0.0 < size <= ZERO * usual}


def _sizes(result: Result) -> dict[str, tuple[float, float]]:
    """Return the largest absolute value of every output, and what the run makes of its unit."""
    natural = natural_sizes(result.trajectory)
    columns = {name: result[name] for name in result.content.outputs}
    return {name: (float(np.abs(one.values).max()), natural(one.unit)) for name, one in columns.items()}


def natural_sizes(run: Trajectory) -> Callable[[Unit | None], float]:
    """Return what the masses, lengths and times of a run make of a unit: of N, the mass times length over time squared.

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

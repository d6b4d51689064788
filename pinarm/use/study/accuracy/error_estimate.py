"""The global error of a result: solved a second time, finer and with other last digits, and compared.

The tolerance of an integration bounds the error of one step. What the errors of all steps, and of rounding, have done
to an output at the end is seen where the problem is solved again in another way: with a finer setting, and for a
mechanism whose numbers differ in their last digits. The difference is the error of the coarser solution but for that of
the finer one; where a motion is chaotic, it grows in the difference as it does in the error. ``BOUND`` times the
difference bounds the error in 99 of 100 cases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.engine.checks.balance import LOST
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import NumericsError
from pinarm.input.units import Unit
from pinarm.records import replace
from pinarm.use.study.accuracy.common_rows import common_rows
from pinarm.use.study.accuracy.error_growth import e_folding
from pinarm.use.study.accuracy.integration_settings import comparison_settings, format_setting, step_limit, with_setting

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

BOUND = 2.0
"""Factor by which differences of solutions are multiplied, so that 99 of 100 true errors are below.

Measured by ``benchmarks/error_bound.py`` (``docs/accuracy.md``): the 99 % quantile of error over difference is 1.1 for
all methods together, 1.4 to 1.7 for collocation, whose windows hardly follow the tolerance, and 1.3 where only rounding
is left.
"""

ZERO = 1e-14
"""Size of an output, relative to what the masses, lengths and times of the run make of its unit, that rounding
explains; outputs that are 0 are up to 4e-15 in the scenarios that come with pinarm."""

UNSEEN = 1e-15
"""Relative error that no comparison in double precision can tell from none."""


def estimate_errors(scenario: Scenario, result: Result) -> Result:
    """Return a result with a bound of every output's error that holds in 99 of 100 cases, and what it rests on.

    Args:
        scenario: What was solved, at its own setting.
        result: Its result.

    Returns:
        The result with its errors: output -> bound of the error relative to the output's scale, infinite where there is
        no finer solution; with the setting of both in words, and where errors grow exponentially, how fast.
    """
    accuracy = scenario.content.accuracy
    if "evaluations" not in result.figures:
        other = _other(scenario, accuracy.setting_keys, accuracy.max_steps)
        return with_errors(result, other, "against other last digits")
    used, steps = format_setting(accuracy.setting_keys), step_limit(result, accuracy.max_steps)
    for setting in comparison_settings(accuracy):
        other = _other(scenario, setting, steps)
        if other and np.isfinite(max(output_differences(result, other).values())):
            return with_errors(result, other, f"{used}, against {format_setting(setting)} and other last digits")
    return with_errors(result, None, f"{used}; no other setting got to the end")


def _other(scenario: Scenario, setting: Mapping[str, Any], max_steps: int) -> Result | None:
    """Return the solution of another setting, with other last digits; ``None`` where that fails."""
    try:
        return with_setting(scenario, setting, max_steps, seed=1).solve()
    except NumericsError:
        return None


def with_errors(result: Result, other: Result | None, setting: str) -> Result:
    """Return a result with the bounds of its errors by the difference to another solution of the same.

    Args:
        result: What the errors are wanted of.
        other: A finer solution, or one at rounding; ``None`` where there is none, and errors are infinite.
        setting: Both settings, in words.
    """
    if other is None:
        return replace(result, errors=dict.fromkeys(result.content.outputs, np.inf), setting=setting)
    errors = {name: BOUND * difference for name, difference in output_differences(result, other).items()}
    zeros = [name for name, zero in _rounded_to_zero(result).items() if zero]
    setting += f"; 0 but for rounding: {', '.join(zeros)}" if zeros else ""
    time = e_folding(result.trajectory, other.trajectory)
    growth = {} if time is None else {"e-folding": time}
    return replace(result, errors=errors, setting=setting, figures={**result.figures, **growth})


def unaccounted_energy(result: Result) -> float:
    """Return the energy that nothing accounts for, relative to that exchanged; 0 where it is too little to be noted.

    No estimate of the error is worth more than that.
    """
    energy = result.figures.get("energy", 0.0)
    return energy if energy >= LOST else 0.0


def output_differences(result: Result, other: Result) -> dict[str, float]:
    """Return the largest difference of every output of two results, relative to its scale in the first."""
    first, second = common_rows(result.trajectory, other.trajectory)
    if not len(first):
        return dict.fromkeys(result.content.outputs, np.inf)
    found = {}
    for name, scale in output_scales(result).items():
        one, two = result[name].values[first], other[name].values[second]
        difference = float(np.abs(one - two).max())
        found[name] = max(difference / scale, UNSEEN) if np.isfinite(difference) else np.inf
    return found


def output_scales(result: Result) -> dict[str, float]:
    """Return what the errors of the outputs are relative to.

    That is the largest absolute value over the run; of an output that is 0 but for rounding, what the masses, lengths
    and times of the run make of its unit.
    """
    return {name: usual if size <= ZERO * usual else size for name, (size, usual) in _sizes(result).items()}


def _rounded_to_zero(result: Result) -> dict[str, bool]:
    """Return which outputs are 0 but for rounding, though not exactly."""
    return {name: 0.0 < size <= ZERO * usual for name, (size, usual) in _sizes(result).items()}


def _sizes(result: Result) -> dict[str, tuple[float, float]]:
    """Return the largest absolute value of every output, and what the run makes of its unit."""
    natural = _natural(result.trajectory)
    columns = {name: result[name] for name in result.content.outputs}
    return {name: (float(np.abs(one.values).max()), natural(one.unit)) for name, one in columns.items()}


def _natural(run: Trajectory) -> Callable[[Unit | None], float]:
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

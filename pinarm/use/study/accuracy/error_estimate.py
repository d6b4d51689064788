"""The global error of a result: solved a second time, finer and with other last digits, and compared.

The tolerance of an integration bounds the error of one step. What the errors of all steps, and of rounding, have done
to an output at the end is seen where the problem is solved again in another way: with a finer setting, and for a
mechanism whose numbers differ in their last digits. The difference is the error of the coarser solution but for that of
the finer one; where a motion is chaotic, it grows in the difference as it does in the error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Indices
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import NumericsError
from pinarm.input.units import Unit
from pinarm.use.study.accuracy.integration_settings import comparison_settings, format_setting, step_limit, with_setting

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

ZERO = 1e-12
"""Size of an output, relative to what the masses, lengths and times of the run make of its unit, that is 0."""

UNSEEN = 1e-15
"""Relative error that no comparison in double precision can tell from none."""


def estimate_errors(scenario: Scenario, result: Result) -> tuple[dict[str, float], str]:
    """Return the estimate of every output's error, and what it rests on.

    Args:
        scenario: What was solved, at its own setting.
        result: Its result.

    Returns:
        Output -> largest difference to a finer solution, relative to the output's scale; infinite where there is no
        finer solution. And the setting of both, in words.
    """
    accuracy = scenario.content.accuracy
    if "evaluations" not in result.figures:
        return _compared(scenario, result, accuracy.setting_keys, accuracy.max_steps), "against other last digits"
    used, steps = format_setting(accuracy.setting_keys), step_limit(result, accuracy.max_steps)
    for setting in comparison_settings(accuracy):
        errors = _compared(scenario, result, setting, steps)
        if np.isfinite(max(errors.values())):
            return errors, f"{used}, against {format_setting(setting)} and other last digits"
    return errors, f"{used}; no other setting got to the end"


def _compared(scenario: Scenario, result: Result, setting: Mapping[str, Any], max_steps: int) -> dict[str, float]:
    """Return the differences to the solution of another setting; infinite where that fails."""
    try:
        return output_differences(result, with_setting(scenario, setting, max_steps, seed=1).solve())
    except NumericsError:
        return dict.fromkeys(result.content.outputs, np.inf)


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
    natural = _natural(result.trajectory)
    found = {}
    for name in result.content.outputs:
        series = result[name]
        size, usual = float(np.abs(series.values).max()), natural(series.unit)
        found[name] = size if size > ZERO * usual else usual
    return found


def common_rows(one: Trajectory, two: Trajectory) -> tuple[Indices, Indices]:
    """Return the rows of two runs that belong together; none where that cannot be told.

    Events may stand at other instants in either. Where there are as many rows, an event's rows belong together, however
    far apart; else only the instants that stand in both as often.
    """
    if len(one) == len(two):
        return np.arange(len(one)), np.arange(len(two))
    if one.parameter != "t":
        return np.arange(0), np.arange(0)
    (t1, n1), (t2, n2) = (np.unique(run.grid.t, return_counts=True) for run in (one, two))
    shared, k1, k2 = np.intersect1d(t1, t2, return_indices=True)
    shared = shared[n1[k1] == n2[k2]]
    return np.flatnonzero(np.isin(one.grid.t, shared)), np.flatnonzero(np.isin(two.grid.t, shared))


def _natural(run: Trajectory) -> Callable[[Unit | None], float]:
    """Return what the masses, lengths and times of a run make of a unit: of N, the mass times length over time squared.

    The mass is that of all bodies, the length that of all links from end to end, and the time the shortest in which
    gravity, or the motion, changes anything by its own size.
    """
    model = run.mechanism.model
    mass = sum(inertia.mass for inertia in model.inertias) or 1.0
    levers = [np.linalg.norm(inertia.lever) for inertia in model.inertias]
    length = float(sum(levers) + sum(np.linalg.norm(place.translation) for place in model.jointPlacements)) or 1.0
    reach = np.array([length if joint.unit.dimension[0] else 1.0 for joint in run.mechanism.joints.values()])
    index = [joint.v for joint in run.mechanism.joints.values()]
    rate = float((np.abs(run.v[:, index]) / reach).max(initial=0.0))
    change = float((np.abs(run.a[:, index]) / reach).max(initial=0.0))
    frequency = max(rate, change**0.5, (run.mechanism.gravity / length) ** 0.5) or 1.0

    def size(unit: Unit | None) -> float:
        if unit is None:
            return 1.0
        metres, kilograms, seconds = (float(exponent) for exponent in unit.dimension)
        return float(length**metres * mass**kilograms * frequency**-seconds)

    return size

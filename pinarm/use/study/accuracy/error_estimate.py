"""The global error of a result: solved a second time, finer and with other last digits, and compared.

The tolerance of an integration bounds the error of one step. What the errors of all steps, and of rounding, have done
to an output at the end is seen where the problem is solved again in another way: with a finer setting, and for a
mechanism whose numbers differ in their last digits. The difference is the error of the coarser solution but for that of
the finer one; where a motion is chaotic, it grows in the difference as it does in the error. ``BOUND`` times the
difference bounds the error in 99 of 100 cases.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.engine.checks.balance import LOST
from pinarm.errors import NumericsError
from pinarm.records import replace
from pinarm.use.result.output_scales import output_scales, rounded_to_zero
from pinarm.use.study.accuracy.common_rows import between_rows, common_rows
from pinarm.use.study.accuracy.error_growth import e_folding, saturation
from pinarm.use.study.accuracy.integration_settings import (
    comparison_settings,
    finer_setting,
    format_setting,
    other_method,
    reference_settings,
    step_limit,
    takes_other_steps,
    with_setting,
)
from pinarm.use.study.accuracy.number_bounds import bounded_sections, number_bounds

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

BOUND = 2.0
"""Factor by which differences of solutions are multiplied, so that 99 of 100 true errors are below.

Measured by ``benchmarks/error_bound.py`` (``docs/accuracy.md``): the 99 % quantile of error over difference is 1.1 for
all methods together, and 1.5 where only rounding is left.
"""

LONGER, ROWS = 10.0, 401
"""Time of tight solutions that tell how fast errors grow, over that until coarse ones are far apart: from 1e-13 it
takes at most ten times as many e-folds as from 1e-2. Their rows."""

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
    setting: Mapping[str, Any]
    for setting in comparison_settings(accuracy):
        other = _other(scenario, setting, steps)
        if other and np.isfinite(max(output_differences(result, other).values())):
            other, setting = _with_other_steps(scenario, result, other, setting, steps)
            return with_errors(result, other, f"{used}, against {format_setting(setting)} and other last digits")
    return with_errors(result, None, f"{used}; no other setting got to the end")


def _with_other_steps(
    scenario: Scenario, result: Result, other: Result, setting: Mapping[str, Any], most: int
) -> tuple[Result, Mapping[str, Any]]:
    """Return a solution whose steps are others than those of a result, and its setting: as fine as need be, or can be.

    Where steps of no setting are others, one by another method, whose errors are.

    Args:
        scenario: What is solved.
        result: The result.
        other: A solution that it can be compared with.
        setting: The setting of that.
        most: Number of steps after which a solution is given up.
    """
    method = scenario.content.accuracy.method
    while not takes_other_steps(result, other) and setting["method"] == method:
        finer = finer_setting(setting, other) or other_method(method)
        found = _other(scenario, finer, most)
        if found is None or not np.isfinite(max(output_differences(result, found).values())):
            break
        other, setting = found, finer
    return other, setting


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
        unknown = replace(result, errors=dict.fromkeys(result.content.outputs, np.inf), setting=setting)
        return _with_number_bounds(unknown, other)
    errors = error_bounds(result, other)
    zeros = ", ".join(rounded_to_zero(result))
    setting += f"; 0 but for rounding: {zeros}" if zeros else ""
    rounding = max(_rounding(result), _rounding(other))
    setting += f"; rounding lets errors of steps add up to {rounding:.1e} of so small a motion" if rounding else ""
    time = _growth_time(result, other)
    growth = {} if time is None else {"e-folding": time}
    found = replace(result, errors=errors, setting=setting, figures={**result.figures, **growth})
    return _with_number_bounds(found, other)


def _with_number_bounds(result: Result, other: Result | None) -> Result:
    """Return a result with the bounds of its numbers, and its sections with theirs."""
    if not (result.content.numbers or result.numbered):
        return result
    bounds = number_bounds(result, other, BOUND)
    return replace(result, number_errors=bounds, known={**result.known, **bounded_sections(result, bounds)})


def _growth_time(result: Result, other: Result) -> float | None:
    """Return the time in which errors grow e-fold [s]; ``None`` where they do not grow exponentially.

    Where the solutions are far apart before that is seen, of two tight ones of as much of the motion as these need.
    """
    time, apart = e_folding(result.trajectory, other.trajectory), saturation(result.trajectory, other.trajectory)
    if time is not None or apart is None or "evaluations" not in result.figures:
        return time
    start, end = result.trajectory.grid.t[[0, -1]].tolist()
    span = {"start": f"{start!r} s", "end": f"{min(start + LONGER * apart, end)!r} s", "samples": ROWS}
    beginning = other.scenario.varied({"problem.time": span})
    most = result.content.accuracy.max_steps
    first, second = (_other(beginning, setting, most) for setting in reference_settings()[::2])
    return e_folding(first.trajectory, second.trajectory) if first and second else None


def error_bounds(result: Result, other: Result) -> dict[str, float]:
    """Return the bound of every output's error, relative to its scale, by another solution.

    ``BOUND`` times the difference, and where rounding has decided the steps of either, so that it is no finer, their
    own error: as much of what the output varies by as they may be wrong by of the motion. What is 0 but for rounding is
    wrong by all of it.
    """
    rounding, differences = max(_rounding(result), _rounding(other)), output_differences(result, other)
    zeros = rounded_to_zero(result)
    return {
        name: max(
            BOUND * differences[name] + rounding * float(np.ptp(result[name].values)) / scale, zeros.get(name, 0.0)
        )
        for name, scale in output_scales(result).items()
    }


def _rounding(result: Result) -> float:
    """Return the figure of ``SegmentedMotion.rounding``, 0 where steps are as accurate as the tolerance says."""
    return result.figures.get("rounding", 0.0)


def unaccounted_energy(result: Result) -> float:
    """Return the energy that nothing accounts for, relative to that exchanged; 0 where it is too little to be noted.

    No estimate of the error is worth more than that.
    """
    energy = result.figures.get("energy", 0.0)
    return energy if energy >= LOST else 0.0


def output_differences(result: Result, other: Result) -> dict[str, float]:
    """Return the largest difference of every output of two results, relative to its scale in the first.

    In rows, and between those of motions.
    """
    first, second = common_rows(result.trajectory, other.trajectory)
    if not len(first):
        return dict.fromkeys(result.content.outputs, np.inf)
    found = {}
    elsewhere = list(between_rows(result.lookup, other.lookup))
    for name, scale in output_scales(result).items():
        pairs = [(result[name].values[first], other[name].values[second])]
        pairs += [(one[name].values, two[name].values) for one, two in elsewhere]
        difference = float(np.max([np.abs(one - two).max() for one, two in pairs]))
        found[name] = max(difference / scale, UNSEEN) if np.isfinite(difference) else np.inf
    return found

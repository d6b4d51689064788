"""Errors of settings of the time integration against a reference whose own error is bounded, and what they cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import takewhile

import numpy as np

from pinarm.errors import IntegrationError, NumericsError
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario
from pinarm.use.study.accuracy.error_estimate import output_differences, reason_for_no_bound
from pinarm.use.study.accuracy.integration_settings import (
    format_setting,
    reference_settings,
    settings_by_method,
    step_limit,
    with_setting,
)
from pinarm.use.study.accuracy.timed_solutions import SolveTrials, TimedSolution, TimedTrial

WANTED = (1e-3, 1e-6, 1e-9)
"""Errors that a setting is recommended for."""

MARGIN = 3.0
"""Wanted error over that of a setting which is recommended: in 98 of 100 random chains and loops it errs by at most
3 times as much where initial velocities differ by 1 % (``benchmarks/error_bound.py``)."""

UNDECIDED = "an end before the instant at which they part, or other values: one event more or less is no small error"
"""What to try where two tight solutions take different courses."""

LONG = 0.05
"""Time for which short solutions are repeated [s]; the shortest of their times counts."""

MOST = 5000
"""Steps that every setting may take; more, where the reference needs many."""


@dataclass(frozen=True)
class TriedSetting:
    """A setting, its error and its price.

    Attributes:
        method: What is varied within: a curve of the plot.
        setting: The setting in words.
        errors: Output -> largest difference to the reference over the run, relative to the output's scale; infinite
            where the integration failed, or takes another course.
        evaluations: Number of accelerations computed; 0 where the integration failed.
        seconds: Wall time of the solution [s], the model being loaded.
    """

    method: str
    setting: str
    errors: dict[str, float]
    evaluations: int
    seconds: float

    @property
    def error(self) -> float:
        """Largest error of any output."""
        return max(self.errors.values())


@dataclass(frozen=True)
class Reference:
    """What errors are measured against.

    Attributes:
        result: The tightest of some solutions that share neither tolerances nor last digits.
        bound: Largest difference to the next: the larger of both errors, but for a factor near 1.
        words: Both settings.
    """

    result: Result
    bound: float
    words: str


def reference_solution(scenario: Scenario) -> Reference:
    """Return the reference of a scenario.

    Raises:
        IntegrationError: Fewer than two tight settings get to the end, or these contradict each other.
    """
    solved: list[tuple[str, Result]] = []
    for seed, setting in enumerate(reference_settings()):
        most = step_limit(solved[-1][1], scenario.content.accuracy.max_steps) if solved else None
        try:
            solved.append((format_setting(setting), with_setting(scenario, setting, most, seed=seed).solve()))
        except NumericsError:
            continue
    if len(solved) > 1:
        (two, other), (one, result) = solved[-2:]
        if why := reason_for_no_bound(result, other):
            raise IntegrationError(f"there is no reference to measure errors against: {why}", hint=UNDECIDED)
        return Reference(result, max(output_differences(result, other).values()), f"{one}, compared with {two}")
    raise IntegrationError("no two tight settings get to the end: there is no reference to measure errors against",
                           hint="a shorter time, away from singular positions")  # fmt: skip


def tried_settings(scenario: Scenario, against: Reference, solve: SolveTrials) -> list[TriedSetting]:
    """Return all settings that are tried, method by method, the coarsest first."""
    most = max(MOST, step_limit(against.result, scenario.content.accuracy.max_steps))
    by_method = settings_by_method(against.result).items()
    tried = [(method, setting) for method, settings in by_method for setting in settings]
    trials = [TimedTrial(partial(with_setting, setting=setting, max_steps=most), LONG) for _, setting in tried]
    return [
        _tried(solution, method, format_setting(setting), against)
        for (method, setting), solution in zip(tried, solve(trials), strict=True)
    ]


def _tried(solution: TimedSolution, method: str, words: str, against: Reference) -> TriedSetting:
    result = solution.result
    if result is None:
        errors = dict.fromkeys(against.result.content.outputs, np.inf)
        return TriedSetting(method, words, errors, 0, solution.seconds)
    errors = output_differences(against.result, result)
    return TriedSetting(method, words, errors, int(result.figures["evaluations"]), solution.seconds)


def recommended_setting(points: Sequence[TriedSetting], bound: float, wanted: float) -> TriedSetting | None:
    """Return the cheapest setting that is good enough, as all finer ones of its method are: none by luck.

    Good enough is an error that is below what is wanted by ``MARGIN``, whatever that of the reference is. Finer
    settings that failed do not count: they say so. Those that take another course do. Evaluations decide because they
    are the same on every machine.

    Args:
        points: Settings, those of a method the coarsest first.
        bound: Error of the reference.
        wanted: Error that is wanted.
    """
    good: list[TriedSetting] = []
    for method in dict.fromkeys(point.method for point in points):
        solved = [point for point in points if point.method == method and point.evaluations]
        good += takewhile(lambda point: MARGIN * point.error + bound <= wanted, reversed(solved))
    return min(good, key=lambda point: point.evaluations, default=None)

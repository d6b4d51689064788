"""Solutions of a trade-off, with the time that each takes: settings against a reference, variants against the model."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import takewhile
from operator import methodcaller

import numpy as np

from pinarm.errors import InputError, IntegrationError, NumericsError, PinarmError
from pinarm.use.accuracy.error_estimate import common_rows, different_course, output_differences, reason_for_no_bound
from pinarm.use.accuracy.integration_settings import (
    format_setting,
    reference_settings,
    settings_by_method,
    step_limit,
    with_setting,
)
from pinarm.use.result.number_accuracy import output_scales
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario, ScenarioSource
from pinarm.use.workers.worker import LostJob

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


Trial = tuple[Callable[[Scenario], Scenario], float]
"""What makes a scenario to be solved of another, importable by its name; time for which short ones are repeated [s]."""


@dataclass(frozen=True, eq=False)
class TimedSolution:
    """A solution.

    Attributes:
        result: The result; none where the numerics failed.
        seconds: Wall time [s], the model being loaded; of several the shortest.
        failure: Why there is no result.
    """

    result: Result | None
    seconds: float
    failure: NumericsError | None = None


SolveTrials = Callable[[Sequence[Trial]], Iterator[TimedSolution]]
"""Trials -> their solutions, in their order; raises where the input of one has a mistake."""


@contextmanager
def solving_trials(scenario: Scenario) -> Iterator[SolveTrials]:
    """Yield a function that solves trials, by the runners of a scenario; workers end with the block."""
    with scenario.runners.applying(_TrialSolver(scenario.source)) as apply:

        def solve(trials: Sequence[Trial]) -> Iterator[TimedSolution]:
            for answer in apply(trials):
                if isinstance(answer, LostJob):
                    raise NumericsError(f"a solution is missing: {answer.reason}")
                if isinstance(answer, PinarmError):
                    raise answer
                yield answer

        yield solve


@dataclass(frozen=True)
class _TrialSolver:
    """Solves trials in this process, or in another one, which reads the scenario from its source."""

    source: ScenarioSource

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario, with its mechanism loaded before the clock runs."""
        read = self.source.scenario()
        assert read.mechanism
        return read

    def __call__(self, trial: Trial) -> TimedSolution | PinarmError:
        """Return the solution of a trial, or the mistake in it."""
        change, least = trial
        try:
            return _timed(change(self.scenario), least)
        except PinarmError as error:
            return error


def _timed(scenario: Scenario, least: float) -> TimedSolution:
    assert scenario.mechanism  # loaded before the clock runs
    seconds: list[float] = []
    while not seconds or sum(seconds) < least:
        begin = time.perf_counter()
        try:
            result = scenario.run()
        except NumericsError as error:
            return TimedSolution(None, time.perf_counter() - begin, error)
        seconds.append(time.perf_counter() - begin)
    return TimedSolution(result, min(seconds))


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
    raise IntegrationError(
        "no two tight settings get to the end: there is no reference to measure errors against",
        hint="a shorter time, away from singular positions",
    )


def tried_settings(scenario: Scenario, against: Reference, solve: SolveTrials) -> list[TriedSetting]:
    """Return all settings that are tried, method by method, the coarsest first."""
    most = max(MOST, step_limit(against.result, scenario.content.accuracy.max_steps))
    by_method = settings_by_method(against.result).items()
    tried = [(method, setting) for method, settings in by_method for setting in settings]
    trials = [(partial(with_setting, setting=setting, max_steps=most), LONG) for _, setting in tried]
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


@dataclass(frozen=True, eq=False)
class Variant:
    """A model of the scenario, and how far its outputs are from those of the scenario's own.

    Attributes:
        name: As the scenario has it; ``exact`` for the scenario itself.
        result: Its result; none where it could not be solved.
        errors: Output -> largest difference over the run, in the output's unit.
        relative: The same, relative to the output's scale in the exact model.
        where: Output -> row parameter at which that stands.
        seconds: Wall time of the solution [s].
        failure: Why there is no result.
        course: How its events, contacts or end differ from those of the exact model; then only the rows are compared
            that both have.
    """

    name: str
    result: Result | None
    errors: dict[str, float] = field(default_factory=dict)
    relative: dict[str, float] = field(default_factory=dict)
    where: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    failure: str = ""
    course: str = ""


def solve_variants(scenario: Scenario, solve: SolveTrials) -> list[Variant]:
    """Return the exact model and all variants of a scenario.

    Raises:
        PinarmError: The scenario itself cannot be solved, or a variant has a mistake.
    """
    names = list(scenario.content.variants)
    changes = [methodcaller("varied", {}), *(methodcaller("variant", name) for name in names)]
    solutions = solve([(change, 0.0) for change in changes])
    first = next(solutions)
    if first.failure:
        raise first.failure
    assert first.result
    found = [Variant("exact", first.result, seconds=first.seconds)]
    for name in names:
        with scenario.document.locating("variants", name):
            found.append(_compared(_variant(name, next(solutions)), first.result))
    return found


def _variant(name: str, solution: TimedSolution) -> Variant:
    failure = solution.failure.message if solution.failure else ""
    return Variant(name, solution.result, seconds=solution.seconds, failure=failure)


def _compared(variant: Variant, exact: Result) -> Variant:
    """Return the variant with its differences to the exact model."""
    if variant.result is None:
        return variant
    one, two = common_rows(exact.trajectory, variant.result.trajectory)
    if not len(one):
        raise InputError(
            f"the rows of the variant '{variant.name}' are not those of the scenario",
            expected="the same time or range, and as many samples",
        )
    errors, relative, where = {}, {}, {}
    for name, scale in output_scales(exact).items():
        apart = np.abs(exact[name].values[one] - variant.result[name].values[two])
        row = int(apart.argmax())
        errors[name], relative[name] = float(apart[row]), float(apart[row]) / scale
        where[name] = float(exact.trajectory.grid.t[one[row]])
    course = different_course(exact, variant.result)
    return Variant(variant.name, variant.result, errors, relative, where, variant.seconds, course=course)

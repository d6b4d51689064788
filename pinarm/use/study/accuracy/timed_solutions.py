"""Solutions of a scenario and of variants of it, with the time that each takes, by whoever solves them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pinarm.errors import NumericsError, PinarmError
from pinarm.input.roots import file_root, given_root
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario, ScenarioSource
from pinarm.use.workers.runners import LostJob


@dataclass(frozen=True)
class TimedTrial:
    """A scenario to be solved.

    Attributes:
        changed: What makes it of the scenario that all trials are of; importable by its name.
        least: Time for which short solutions are repeated [s].
    """

    changed: Callable[[Scenario], Scenario]
    least: float = 0.0


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


SolveTrials = Callable[[Sequence[TimedTrial]], Iterator[TimedSolution]]
"""Trials -> their solutions, in their order; raises where the input of one has a mistake."""


@contextmanager
def solving_trials(scenario: Scenario) -> Iterator[SolveTrials]:
    """Yield what solves trials, by the runners of a scenario; workers end with the block."""
    with scenario.runners.applying(_TrialSolver(scenario.source, given_root())) as apply:

        def solve(trials: Sequence[TimedTrial]) -> Iterator[TimedSolution]:
            for answer in apply(trials):
                if isinstance(answer, LostJob):
                    raise NumericsError(f"a solution is missing: {answer.reason}")
                if isinstance(answer, PinarmError):
                    raise answer
                yield answer

        yield solve


@dataclass(frozen=True)
class _TrialSolver:
    """What workers do with trials.

    Attributes:
        source: What the scenario is read from.
        root: Folder that files may refer to; each file's own where it is ``None``.
    """

    source: ScenarioSource
    root: Path | None

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario, with its mechanism loaded before the clock runs."""
        read = self.source.scenario()
        assert read.mechanism
        return read

    def __call__(self, trial: TimedTrial) -> TimedSolution | PinarmError:
        """Return the solution of a trial, or the mistake in it."""
        with file_root(self.root):
            try:
                return _timed(trial.changed(self.scenario), trial.least)
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

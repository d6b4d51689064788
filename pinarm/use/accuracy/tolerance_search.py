"""The cheapest setting of the time integration whose global error is below a target."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from pinarm.engine.integration.methods import METHODS, MethodName
from pinarm.engine.integration.methods.explicit import LIMITED
from pinarm.errors import NumericsError
from pinarm.problems.forward import Forward
from pinarm.records import replace
from pinarm.use.accuracy.error_estimate import UNCOMPARED, estimate_errors
from pinarm.use.accuracy.integration_settings import COARSEST, Ladder, step_limit, with_setting

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario


MANY = 3000
"""Steps within which it shows whether an explicit method is limited by stability."""

TRIED: tuple[MethodName, ...] = tuple(name for name, entry in METHODS.items() if entry.setting == "tolerance")
"""Methods that are tried where the scenario names none, until one reaches the target; in the reverse order where a
motion is stiff."""


def reach_target(scenario: Scenario) -> Result:
    """Return the result of the cheapest setting whose error is at most the scenario's target, by its bound.

    Tolerances are tried by decades, steps by halves, of the method that the scenario names, or of several until one
    reaches the target; each with the bound of its error by ``estimate_errors``.
    Where none reaches the target, it is the result of the smallest error; ``setting`` says which it is.
    """
    if not isinstance(scenario.problem, Forward):
        return replace(estimate_errors(scenario, with_setting(scenario, {}).solve()), scenario=scenario)
    best, tried = None, 0
    for search in _searches(scenario):
        found = search.best()
        tried += len(search.runs)
        if best is None or _error(found) < _error(best):
            best = found
        if search.reached(found):
            break
    if best is None or isinstance(best, NumericsError):
        raise best or AssertionError
    notes = *best.outcome.notes, *scenario.method_notes(best.content.accuracy)
    best = replace(best, scenario=scenario, outcome=replace(best.outcome, notes=notes))
    verdict = "best" if best.missed else "cheapest"
    return replace(best, setting=f"{best.setting}, the {verdict} of {tried} settings tried")


def _searches(scenario: Scenario) -> Iterator[_Search]:
    """Yield a search by each method that may be tried, in order: of a motion that proves stiff the stiff one first."""
    methods: tuple[MethodName, ...] = TRIED
    if "method" in scenario.document.data["accuracy"]:
        methods = (scenario.content.accuracy.method,)
    elif _is_stiff(_Search.of(scenario, TRIED[0])):
        methods = TRIED[::-1]
    yield from (_Search.of(scenario, method) for method in methods)


def _is_stiff(first: _Search) -> bool:
    most = min(MANY, first.scenario.content.accuracy.max_steps)
    try:
        run: Result | None = with_setting(first.scenario, first.ladder.setting(first.guess), most).solve()
    except NumericsError as error:
        run = error.partial
    return run is not None and any(note.startswith(LIMITED) for note in run.outcome.notes)


def _error(run: Result | NumericsError) -> float:
    """Return the bound of the error of a run; infinite where there is none."""
    return np.inf if isinstance(run, NumericsError) else max(run.errors.values())


@dataclass(frozen=True, eq=False)
class _Search:
    """Solutions by the rungs of a ladder.

    Attributes:
        runs: Rung -> its result with the bounds of its errors, or why there is none.
        others: Setting -> solution with other last digits, with which others are compared; see ``estimate_errors``.
    """

    scenario: Scenario
    ladder: Ladder
    runs: dict[int, Result | NumericsError] = field(default_factory=dict)
    others: dict[str, Result | None] = field(default_factory=dict)

    @classmethod
    def of(cls, scenario: Scenario, method: MethodName) -> _Search:
        """Return the search by a method."""
        time = scenario.problem.time  # type: ignore[attr-defined]
        return cls(scenario, Ladder(method, time.end - time.start))

    @property
    def target(self) -> float:
        return float(self.scenario.content.accuracy.target or 0.0)

    @property
    def guess(self) -> int:
        """The rung that probably reaches the target."""
        guess = COARSEST if self.ladder.halving else int(np.ceil(-np.log10(self.target))) + 1
        return min(max(guess, COARSEST), self.ladder.last - 1)

    def best(self) -> Result | NumericsError:
        """Go up and down the ladder for the coarsest rung that reaches the target, or has the smallest error.

        Where a rung has nothing to be compared with, coarser ones are tried. Where it has no bound, as its solutions
        contradict each other, coarser ones may agree by chance: finer ones are tried. Where there is no solution with
        the steps of a rung, shorter ones may have one.
        """
        rung, last = self.guess, self.ladder.last - 1
        while rung > COARSEST and getattr(self.run(rung), "no_bound", "") == UNCOMPARED:
            rung -= 1
        while rung > COARSEST and self.reached(self.run(rung)) and self.reached(self.run(rung - 1)):
            rung -= 1
        while rung < last and not self.reached(run := self.run(rung)):
            if isinstance(run, NumericsError) and not self.ladder.halving:
                break
            rung += 1
        finest_first = sorted(self.runs.items(), key=lambda entry: -entry[0])
        solved = [run for _, run in finest_first if not isinstance(run, NumericsError)]
        good = [run for run in solved if self.reached(run)]
        return good[-1] if good else min(solved, key=_error, default=finest_first[-1][1])

    def reached(self, run: Result | NumericsError) -> bool:
        """Tell whether the error of a run is at most the target."""
        return _error(run) <= self.target

    def run(self, rung: int) -> Result | NumericsError:
        """Return the result of a rung with its errors, solved once, in not many more steps than the one before."""
        if rung not in self.runs:
            most = self.scenario.content.accuracy.max_steps
            solved = [run for run in self.runs.values() if not isinstance(run, NumericsError)]
            asked = with_setting(
                self.scenario, self.ladder.setting(rung), step_limit(solved[-1], most) if solved else most
            )
            try:
                self.runs[rung] = estimate_errors(asked, asked.solve(), self.others)
            except NumericsError as error:
                self.runs[rung] = error
        return self.runs[rung]

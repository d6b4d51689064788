"""The cheapest setting of the time integration whose global error is below a target."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from pinarm.engine.integration.methods import METHODS, MethodName
from pinarm.engine.integration.methods.explicit import LIMITED
from pinarm.errors import NumericsError
from pinarm.problems.forward import Forward
from pinarm.records import replace
from pinarm.use.accuracy.error_estimate import error_bounds, estimate_errors, with_errors
from pinarm.use.accuracy.integration_settings import (
    Ladder,
    format_setting,
    other_method,
    step_limit,
    takes_other_steps,
    with_setting,
)

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario


FIRST = 2
"""The coarsest rung."""

ANOTHER = 0
"""Rung number that denotes another method."""

MANY = 3000
"""Steps within which it shows whether an explicit method is limited by stability."""

TRIED: tuple[MethodName, ...] = tuple(name for name, entry in METHODS.items() if entry.setting == "tolerance")
"""Methods that are tried where the scenario names none, until one reaches the target; in the reverse order where a
motion is stiff."""


def reach_target(scenario: Scenario) -> Result:
    """Return the result of the cheapest setting whose error is at most the scenario's target, by its bound.

    Tolerances are tried by decades, steps by halves, of the method that the scenario names, or of several until one
    reaches the target. All solutions that serve as comparison are solved with other last digits, each with its own, and
    used for both of the settings that they are compared with.
    Where none reaches the target, it is the result of the smallest error; ``setting`` says which it is.
    """
    if not isinstance(scenario.problem, Forward):
        return replace(estimate_errors(scenario, with_setting(scenario, {}).solve()), scenario=scenario)
    target = float(scenario.content.accuracy.target or 0.0)
    span = scenario.problem.time.end - scenario.problem.time.start
    named = "method" in scenario.document.data["accuracy"]
    searches: list[_Search] = []
    for method in (scenario.content.accuracy.method,) if named else _ordered(scenario, span, target):
        searches.append(_Search(scenario, Ladder(method, span), target))
        searches[-1].search()
        if not searches[-1].missing:
            break
    while True:
        best = min(searches, key=lambda search: search.missing)
        result = best.result(sum(len(search.errors) for search in searches))
        if not result.missed or best.missing:
            return result
        best.note_miss(max(result.errors.values()))


def _ordered(scenario: Scenario, span: float, target: float) -> tuple[MethodName, ...]:
    """Return the methods in the order in which they are tried: of a motion that proves stiff the stiff one first."""
    first = _Search(scenario, Ladder(TRIED[0], span), target)
    most = min(MANY, scenario.content.accuracy.max_steps)
    try:
        run: Result | None = with_setting(scenario, first.ladder.setting(first.guess), most).solve()
    except NumericsError as error:
        run = error.partial
    is_stiff = run is not None and any(note.startswith(LIMITED) for note in run.outcome.notes)
    return TRIED[::-1] if is_stiff else TRIED


@dataclass(frozen=True, eq=False)
class _Search:
    """Solutions by the rungs of a ladder, each solved once.

    Attributes:
        runs: Rung -> solution with other last digits; none where it failed.
        errors: Rung -> bound of the error; see ``error_estimate.BOUND``.
    """

    scenario: Scenario
    ladder: Ladder
    target: float
    runs: dict[int, Result | None] = field(default_factory=dict)
    errors: dict[int, float] = field(default_factory=dict)

    @property
    def guess(self) -> int:
        """The rung that probably reaches the target."""
        guess = FIRST if self.ladder.halving else int(np.ceil(-np.log10(self.target))) + 1
        return min(max(guess, FIRST), self.ladder.last - 1)

    def search(self) -> None:
        """Go up and down the ladder for the coarsest rung that reaches the target.

        A rung whose finer solution takes more steps than are left tells nothing of those below it. Where a rung has no
        bound, as its solutions contradict each other, coarser ones may agree by chance: finer ones are tried.
        """
        last, rung = self.ladder.last - 1, self.guess
        while rung > FIRST and self.run(rung) and not self._compared(rung):
            rung -= 1
        if self.error(rung) <= self.target:
            while rung > FIRST and self.error(rung - 1) <= self.target:
                rung -= 1
        while (self._compared(rung) and self.error(rung) > self.target) or self._diverges(rung):
            if rung == last:
                break
            rung += 1

    def _compared(self, rung: int) -> bool:
        return self.run(rung) is not None and self.finer(rung) is not None

    def _diverges(self, rung: int) -> bool:
        """Return whether there is no solution with the steps of a rung: shorter ones may have one."""
        return self.ladder.halving and self.run(rung) is None

    def run(self, rung: int) -> Result | None:
        """Return the solution of a rung with other last digits, or that by another method."""
        if rung not in self.runs:
            solved = [run for run in self.runs.values() if run]
            most = self.scenario.content.accuracy.max_steps
            most = step_limit(solved[-1], most) if solved else most
            try:
                setting = other_method(self.ladder.method) if rung == ANOTHER else self.ladder.setting(rung)
                self.runs[rung] = with_setting(self.scenario, setting, most, seed=rung).solve()
            except NumericsError:
                self.runs[rung] = None
        return self.runs[rung]

    def finer(self, rung: int) -> Result | None:
        """Return the solution that one of a rung is compared with: whose steps are others, or else the method."""
        own, last = self.run(rung), self.ladder.last
        result = self.run(min(rung + self.ladder.finer, last))
        for other in (*range(rung + 2 * self.ladder.finer, last + 1, self.ladder.finer), ANOTHER):
            if own is None or result is None or takes_other_steps(own, result) or self.run(other) is None:
                break
            result = self.run(other)
        return result

    def error(self, rung: int) -> float:
        """Return the bound of the error at a rung; infinite where there is none, or a solution failed."""
        if rung not in self.errors:
            coarse, fine = self.run(rung), self.finer(rung)
            self.errors[rung] = max(error_bounds(coarse, fine).values()) if coarse else np.inf
        return self.errors[rung]

    @property
    def best_rung(self) -> int:
        """The coarsest rung that reaches the target, or that of the smallest error; the finest without any."""
        good = [rung for rung, error in self.errors.items() if error <= self.target]
        finest = max((rung for rung in self.errors if self._compared(rung)), default=FIRST)
        return min(good) if good else min(self.errors, key=lambda rung: (self.errors[rung], abs(rung - finest)))

    @property
    def missing(self) -> float:
        """0 where the target is reached, else the smallest error."""
        error = self.errors[self.best_rung]
        return 0.0 if error <= self.target else error

    def note_miss(self, error: float) -> None:
        """Note that the rung found misses the target after all, of the mechanism as it is; look beyond it."""
        rung = self.best_rung
        self.errors[rung] = error
        if rung < self.ladder.last - 1:
            self.error(rung + 1)

    def result(self, tried: int) -> Result:
        """Return the result of the rung found, of the mechanism as it is."""
        rung = self.best_rung
        chosen = self.ladder.setting(rung)
        result = with_errors(with_setting(self.scenario, chosen).solve(), self.finer(rung), format_setting(chosen))
        notes = *result.outcome.notes, *self.scenario.method_notes(result.content.accuracy)
        result = replace(result, scenario=self.scenario, outcome=replace(result.outcome, notes=notes))
        verdict = "best" if result.missed else "cheapest"
        return replace(result, setting=f"{result.setting}, the {verdict} of {tried} settings tried")

"""The cheapest setting of the time integration whose global error is below a target."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.engine.integration.methods import METHODS, MethodName
from pinarm.engine.integration.methods.explicit import LIMITED
from pinarm.errors import NumericsError
from pinarm.problems.forward import Forward
from pinarm.records import replace
from pinarm.use.accuracy.error_estimate import estimate_errors, ladder, step_limit, with_setting

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

TRIED: tuple[MethodName, ...] = tuple(name for name, entry in METHODS.items() if entry.setting == "tolerance")
"""Methods that are tried where the scenario names none, until one reaches the target; in the reverse order where a
motion is stiff."""

MANY = 3000
"""Steps within which it shows whether an explicit method is limited by stability."""


def reach_target(scenario: Scenario) -> Result:
    """Return the result of the cheapest setting whose error is at most the scenario's target, by its bound.

    Tolerances are tried by decades, steps by halves, of the method that the scenario names, or of several until one
    reaches the target; each with the bound of its error by ``estimate_errors``.
    Where none reaches the target, it is the result of the smallest error; ``setting`` says which it is.
    """
    if not isinstance(scenario.problem, Forward):
        return replace(estimate_errors(scenario, with_setting(scenario, {}).solve()), scenario=scenario)
    target = scenario.content.accuracy.target or 0.0
    runs: list[Result | NumericsError] = []
    others: dict[str, Result | None] = {}
    named = "method" in scenario.document.data["accuracy"]
    for method in (scenario.content.accuracy.method,) if named else TRIED[:: -1 if _is_stiff(scenario, target) else 1]:
        runs += _search(scenario, method, target, others)
        if any(_error(run) <= target for run in runs):
            break
    solved = [run for run in runs if not isinstance(run, NumericsError)]
    if not solved:
        raise runs[-1]  # type: ignore[misc]  # it is an error
    good = [run for run in solved if _error(run) <= target]
    best = good[-1] if good else min(reversed(solved), key=_error)
    notes = *best.outcome.notes, *scenario.method_notes(best.content.accuracy)
    best = replace(best, scenario=scenario, outcome=replace(best.outcome, notes=notes))
    verdict = "best" if best.missed else "cheapest"
    return replace(best, setting=f"{best.setting}, the {verdict} of {len(runs)} settings tried")


def _is_stiff(scenario: Scenario, target: float) -> bool:
    """Tell whether the first steps of the first method are limited by stability."""
    most = min(MANY, scenario.content.accuracy.max_steps)
    settings = ladder(TRIED[0], 1.0)
    try:
        run: Result | None = with_setting(scenario, settings[_guess(settings, target)], most).solve()
    except NumericsError as error:
        run = error.partial
    return run is not None and any(note.startswith(LIMITED) for note in run.outcome.notes)


def _guess(settings: list[dict[str, Any]], target: float) -> int:
    """Return the setting that probably reaches the target; the longest of steps."""
    guess = 0 if "step" in settings[0] else max(int(np.ceil(-np.log10(target))) - 1, 0)
    return min(guess, len(settings) - 1)


def _search(
    scenario: Scenario, method: MethodName, target: float, others: dict[str, Result | None]
) -> list[Result | NumericsError]:
    """Return results with their errors from a setting of a method on, or why there are none.

    From the setting that probably reaches the target it goes to coarser ones as long as they reach it, or to finer ones
    until one does. Where the method that chooses its steps has no solution, finer ones have none either.

    Args:
        scenario: The scenario.
        method: The method.
        target: The largest error wanted.
        others: Setting -> solution with other last digits, with which others are compared; see ``estimate_errors``.
    """
    time = scenario.problem.time  # type: ignore[attr-defined]
    settings, most = ladder(method, time.end - time.start), scenario.content.accuracy.max_steps
    halving, rung, way = "step" in settings[0], _guess(settings, target), 0
    runs: list[Result | NumericsError] = []
    while 0 <= rung < len(settings):
        solved = [run for run in runs if not isinstance(run, NumericsError)]
        steps = step_limit(solved[-1], most) if solved else most
        asked = with_setting(scenario, settings[rung], steps)
        try:
            runs.append(estimate_errors(asked, asked.solve(), others))
        except NumericsError as error:
            runs.append(error)
        reached = _error(runs[-1]) <= target
        way = way or (-1 if reached else 1)
        if reached == (way > 0) or (isinstance(runs[-1], NumericsError) and not halving):
            break
        rung += way
    return runs


def _error(run: Result | NumericsError) -> float:
    """Return the bound of the error of a run; infinite where there is none."""
    return np.inf if isinstance(run, NumericsError) else max(run.errors.values())

"""The cheapest setting of the time integration whose global error is below a target."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from pinarm.errors import NumericsError
from pinarm.use.result import Result
from pinarm.use.settings import patience, spoken, varied
from pinarm.use.worth import differences, estimated

if TYPE_CHECKING:
    from pinarm.use.scenario import Scenario

LOOSEST, TIGHTEST = 2, 13
"""Tolerances that are tried are ``10^-k`` with k in these bounds; one at the end is compared with a finer one yet."""

FINER = 2
"""A solution is compared with one whose tolerance is so many decades finer."""


def reach(scenario: Scenario) -> Result:
    """Return the result of the cheapest setting whose estimated error is at most the scenario's target.

    Tolerances are tried by decades. All solutions that serve as comparison are solved with other last digits, each with
    its own, and used for both of the settings that they are compared with.

    Args:
        scenario: With ``accuracy.target``.

    Returns:
        The result at the setting found; where none reaches the target, that of the smallest error. ``setting`` says
        which it is.

    Raises:
        PinarmError: See ``Scenario.run``.
    """
    target = float(scenario.content.accuracy.target or 0.0)
    if scenario.problem.kind != "forward":
        return _as_it_is(scenario)
    search = _Search(scenario)
    decade = min(max(int(np.ceil(-np.log10(target))) + 1, LOOSEST), TIGHTEST)
    if search.error(decade) <= target:
        while decade > LOOSEST and search.error(decade - 1) <= target:
            decade -= 1
    while decade < TIGHTEST and search.error(decade) > target:
        decade += 1
    if search.error(decade) > target:
        decade = min(search.errors, key=lambda k: (search.errors[k], k))
    return search.result(decade, target)


def _as_it_is(scenario: Scenario) -> Result:
    """Return the result of a problem that no setting changes."""
    result = varied(scenario, {}).solve()
    errors, setting = estimated(scenario, result)
    return replace(result, content=scenario.content, data=scenario.document.data, errors=errors, setting=setting)


@dataclass(frozen=True, eq=False)
class _Search:
    """Solutions by the decade of their tolerance, each solved once.

    Attributes:
        scenario: What is solved.
        runs: Decade -> solution with other last digits; none where it failed.
        errors: Decade -> estimated error.
    """

    scenario: Scenario
    runs: dict[int, Result | None] = field(default_factory=dict)
    errors: dict[int, float] = field(default_factory=dict)

    def run(self, decade: int) -> Result | None:
        """Return the solution of a decade with other last digits."""
        if decade not in self.runs:
            try:
                self.runs[decade] = varied(self.scenario, _setting(decade), self.patience(), seed=decade).solve()
            except NumericsError:
                self.runs[decade] = None
        return self.runs[decade]

    def patience(self) -> int:
        """Return how many steps a solution may take."""
        most, solved = self.scenario.content.accuracy.max_steps, [run for run in self.runs.values() if run]
        return patience(solved[-1], most) if solved else most

    def finer(self, decade: int) -> Result | None:
        """Return the solution that one of a decade is compared with."""
        return self.run(min(decade + FINER, TIGHTEST + 1))

    def error(self, decade: int) -> float:
        """Return the estimated error at a decade; infinite where a solution failed."""
        if decade not in self.errors:
            one, two = self.run(decade), self.finer(decade)
            self.errors[decade] = max(differences(one, two).values()) if one and two else np.inf
        return self.errors[decade]

    def result(self, decade: int, target: float) -> Result:
        """Return the result of a decade, of the mechanism as it is."""
        result, two = varied(self.scenario, _setting(decade)).solve(), self.finer(decade)
        errors = differences(result, two) if two else dict.fromkeys(result.content.outputs, np.inf)
        tried = f"of {len(self.errors)} settings tried" if len(self.errors) > 1 else "the only setting tried"
        found = "cheapest" if max(errors.values()) <= target else "best"
        setting = f"{spoken(_setting(decade))}, {found} {tried}"
        content, data = self.scenario.content, self.scenario.document.data
        return replace(result, content=content, data=data, errors=errors, setting=setting)


def _setting(decade: int) -> dict[str, float]:
    return {"tolerance": float(f"1e-{decade}")}

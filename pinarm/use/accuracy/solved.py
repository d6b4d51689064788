"""A scenario solved at the accuracy that it asks for, or with its accuracy estimated.

One solution is ``Scenario.solve``. What is put together here needs several: the search for the setting that reaches
``accuracy.target``, and the second solution that the global error is estimated from.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pinarm.engine.checks.balance import power_balance
from pinarm.engine.checks.figures import plain
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.constraints.nullspace import one_blas_thread
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario


def solved(scenario: Scenario) -> Result:
    """Return the result of a scenario; with ``accuracy.target``, at the cheapest setting whose error is below it.

    Raises:
        PinarmError: The input is impossible, or the numerics failed; then ``partial`` holds the result until there.
    """
    search = scenario.content.find
    if scenario.content.accuracy.target is None or (search and search.objective):  # every run of which reaches it
        return scenario.solve()
    from pinarm.use.accuracy.tolerance_search import reach_target

    return reach_target(scenario)


def verified(scenario: Scenario) -> Result:
    """Return the result of a scenario with a bound of its outputs' global errors, and all its rows checked.

    Raises:
        PinarmError: See ``solved``.
    """
    from pinarm.use.accuracy.error_estimate import estimate_errors

    result = solved(scenario)
    run, rows = result.trajectory, len(result)
    with one_blas_thread(scenario.mechanism.model.nv):
        checked = plain({**power_balance(run, rows), **residual_figures(run, result.outcome.motion, rows)})
    result = replace(result, figures={**result.figures, **checked})
    if result.errors:
        return result
    return estimate_errors(scenario.restated(result.data) if "find" in result.known else scenario, result)

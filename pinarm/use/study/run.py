"""One call to solve a scenario at the accuracy that it asks for, and one to check it without solving.

What a scenario needs beyond one solution is put together here: the search for the setting that reaches
``accuracy.target``, and the second solution that the global error is estimated from.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pinarm.engine.checks.balance import power_balance
from pinarm.engine.checks.residuals import table_figures
from pinarm.errors import InputError
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario, load


def run(scenario: Scenario | str | Path, overrides: list[str] | None = None) -> Result:
    """Solve a scenario; with ``accuracy.target``, at the cheapest setting whose error is below it.

    Args:
        scenario: The scenario, or its file.
        overrides: Assignments such as ``problem.time.end=3 s`` that replace values of it.

    Raises:
        PinarmError: The input has a mistake or is impossible, or the numerics failed; then ``partial`` holds the result
            until there.
    """
    scenario = load(scenario, overrides)
    if scenario.content.accuracy.target is None:
        return scenario.solve()
    from pinarm.use.study.accuracy.tolerance_search import reach

    return reach(scenario)


def verified(scenario: Scenario | str | Path) -> Result:
    """Solve a scenario, estimate the global error of its outputs, and check all its rows.

    Raises:
        PinarmError: See ``run``.
    """
    from pinarm.use.study.accuracy.error_estimate import estimated

    scenario = load(scenario)
    result = run(scenario)
    solved, rows = result.trajectory, len(result)
    figures = {**result.figures, **power_balance(solved, rows), **table_figures(solved, result.outcome.motion, rows)}
    if result.errors:
        return replace(result, figures=figures)
    errors, setting = estimated(scenario, result)
    return replace(result, figures=figures, errors=errors, setting=setting)


def validate(scenario: Scenario | str | Path) -> list[Scenario]:
    """Check everything that can be checked without solving, and return what was checked.

    Args:
        scenario: The scenario, its file, or a folder of them.

    Raises:
        PinarmError: One has a mistake; the message says where.
    """
    found = scenarios(scenario)
    for one in found:
        one.validate()
    return found


def scenarios(given: Scenario | str | Path) -> list[Scenario]:
    """Return a scenario, that of a file, or those of a folder.

    Raises:
        InputError: A file has a mistake, or the folder has none.
    """
    return [given] if isinstance(given, Scenario) else [load(file) for file in scenario_files(Path(given))]


def scenario_files(path: Path) -> list[Path]:
    """Return a scenario file, or those in a folder in the order of their names.

    Raises:
        InputError: The folder has none.
    """
    found = sorted(path.glob("*.yaml")) if path.is_dir() else [path]
    if not found:
        raise InputError(f"there are no scenarios in {path}", expected="files ending in .yaml")
    return found

"""One call to solve a scenario, and one to check it without solving."""

from __future__ import annotations

from pathlib import Path

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
    return load(scenario, overrides).run()


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

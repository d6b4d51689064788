"""One call to solve a scenario, and one to check it without solving."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from pinarm.errors import InputError
from pinarm.input.yaml.document import Document, Values
from pinarm.use.facade import Result
from pinarm.use.scenario.file_kind import is_mechanism
from pinarm.use.scenario.scenario import Given, Scenario, load

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pinarm.mechanics.control.function import ControlFunction


def run(
    scenario: Given, values: Values | None = None, *,
    control: Mapping[str | tuple[str, ...], ControlFunction] | None = None, period: float | None = None,
    delay: float = 0.0, forces: Mapping[str, tuple[str, ControlFunction]] | None = None, workers: int | None = None,
    executor: Executor | None = None,
) -> Result:  # fmt: skip
    """Solve a scenario; with ``accuracy.target``, at the cheapest setting whose error is below it.

    Args:
        scenario: The scenario, or its file.
        values: Other values than those of the file, such as ``{"problem.time.end": "3 s"}``; see ``pinarm.load``.
        control: Drives whose efforts are functions ``u(t, state)``; see ``Scenario.run``.
        period: Of sampled functions [s]; continuous where it is left out.
        delay: From a sample to the change of the effort [s].
        forces: Loads that are functions ``f(t, state)``, such as ``{"brake": ("knee", f)}``; see ``Scenario.run``.
        workers: Processes that solve the runs of ``find`` and ``sensitivity``; this process where it is left out.
        executor: Who solves them in place of processes of this machine; see ``Scenario.with_workers``.

    Returns:
        The result: ``result["C_B"]`` is a quantity with its unit, one value per row.

    Raises:
        PinarmError: The input has a mistake or is impossible, or the numerics failed; then ``partial`` holds the result
            until there.
    """
    return (
        load(scenario, values).with_workers(workers, executor).run(control, period=period, delay=delay, forces=forces)
    )


def validate(scenario: Given, values: Values | None = None) -> list[Scenario]:
    """Check everything that can be checked without solving, and return what was checked.

    Args:
        scenario: The scenario, its file, or a folder of them.
        values: Other values for each of them, such as ``{"problem.time.end": "3 s"}``; see ``pinarm.load``.

    Raises:
        PinarmError: One has a mistake; the message says where.
    """
    checked = scenarios(scenario, values)
    for each in checked:
        each.validate()
    return checked


def scenarios(given: Given, values: Values | None = None) -> list[Scenario]:
    """Return a scenario, that of a file, or those of a folder, with other values."""
    if isinstance(given, str | PathLike):
        return [load(file, values) for file in scenario_files(Path(given))]
    return [load(given, values)]


def scenario_files(*paths: Path) -> Iterator[Path]:
    """Yield scenario files, and those in folders in the order of their names; mechanism files there are passed over."""
    files = [file for path in paths for file in (sorted(path.glob("*.yaml")) if path.is_dir() else [path])]
    chosen = [file for file in files if file in paths or not is_mechanism_file(file)]
    if not chosen:
        places = ", ".join(map(str, paths))
        below = sorted({str(file.parent) for path in paths if path.is_dir() for file in path.glob("*/*.yaml")})
        raise InputError(
            f"there are no scenarios in {places}",
            expected="files ending in .yaml, with a 'problem:'",
            hint=f"the folders below: {' '.join(below[:12])}" if below else "",
        )
    yield from chosen


def input_files(path: Path) -> list[Path]:
    """Return a file, or the scenarios and mechanism files in a folder and the folders below it.

    Hidden folders are left alone. So are folders of results below it, whose files are those of a run as it was.
    """
    from pinarm.use.output import read_manifest

    if not path.is_dir():
        return [path]
    files = sorted(path.rglob("*.yaml"))
    visible = [file for file in files if not any(part.startswith(".") for part in file.relative_to(path).parts)]
    written = {folder for folder in {file.parent for file in visible} - {path} if read_manifest(folder) is not None}
    return [file for file in visible if file.parent not in written and is_input(file)]


def is_mechanism_file(file: Path) -> bool:
    """Tell whether a file is a mechanism file; of one that cannot be read, whoever loads it says what is wrong."""
    try:
        return is_mechanism(Document.read(file).data)
    except InputError:
        return False


def is_input(file: Path) -> bool:
    """Tell whether a file is a scenario or a mechanism file, or cannot be read: whoever loads it says why."""
    try:
        data = Document.read(file).data
    except InputError:
        return True
    return isinstance(data, dict) and bool(INPUT & data.keys())


INPUT = frozenset(("pinarm", "problem", "mechanism", "robot", "planar"))
"""Keys by which scenarios and mechanism files are known among other YAML."""

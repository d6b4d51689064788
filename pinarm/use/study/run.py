"""One call to solve a scenario, and one to check it without solving."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pinarm.errors import InputError
from pinarm.input.yaml.document import Document, Values
from pinarm.use.facade import Given, Result, Scenario, load
from pinarm.use.scenario.file_kind import is_mechanism

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


def scenario_files(*paths: Path) -> list[Path]:
    """Return files, and the scenarios of folders; see ``input_files``."""
    return [file for file in input_files(*paths) if file in paths or kind_of(file) == "scenario"]


def input_files(*paths: Path) -> list[Path]:
    """Return files, and the scenarios and mechanism files in folders and the folders below these.

    Hidden folders are left alone. So are folders of results below them, whose files are those of a run as it was.

    Raises:
        InputError: There are none.
    """
    files = [file for path in paths for file in (_files_in(path) if path.is_dir() else [path])]
    if not files:
        expected = "files ending in .yaml, with a 'problem:', a 'robot:' or 'planar:'"
        message = f"there are no scenarios and no mechanism files in {', '.join(map(str, paths))}"
        raise InputError(message, expected=expected)
    return files


def _files_in(folder: Path) -> list[Path]:
    from pinarm.use.output import read_manifest

    files = sorted(folder.rglob("*.yaml"))
    visible = [file for file in files if not any(part.startswith(".") for part in file.relative_to(folder).parts)]
    written = {home for home in {file.parent for file in visible} - {folder} if read_manifest(home) is not None}
    return [file for file in visible if file.parent not in written and kind_of(file)]


def kind_of(file: Path) -> Literal["scenario", "mechanism", ""]:
    """Return the kind of a file; empty for other YAML.

    One that cannot be read is a scenario: whoever loads it says why.
    """
    try:
        data = Document.read(file).data
    except InputError:
        return "scenario"
    if is_mechanism(data):
        return "mechanism"
    return "scenario" if isinstance(data, dict) and {"pinarm", "problem", "mechanism"} & data.keys() else ""

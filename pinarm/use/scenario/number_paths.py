"""Paths of numbers that a scenario varies, such as those of ``find``: checked in the scenario, with nothing solved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinarm.engine.mechanism_loading import mechanism_document
from pinarm.errors import NumericsError, PinarmError
from pinarm.input.roots import contained_file, root_of
from pinarm.input.units import read_quantity
from pinarm.input.yaml.document import joined

if TYPE_CHECKING:
    from pinarm.use.scenario.scenario import Scenario

NEAREST, MOST_PATHS = 3, 2000
"""Paths that a message names, and paths of a file that are compared with a wrong one at most."""


def check_paths(scenario: Scenario, values: Mapping[str, Sequence[str]], *at: str) -> None:
    """Check that paths lead to numbers of a scenario and its mechanism.

    Args:
        scenario: The scenario.
        values: Path -> values as a file would have them, at least one of which must fit there.
        at: Where the paths are keys in the scenario.

    Raises:
        PinarmError: A path leads nowhere, or no value fits; located at the path in the file, with the nearest paths.
    """
    for path, texts in values.items():
        failures = [error for text in texts if (error := _failure(scenario, path, text, *at))]
        if len(failures) < len(texts):
            continue
        error, known = failures[0], _number_paths(scenario)
        near = get_close_matches(path, known, n=NEAREST, cutoff=0.4) if path not in known else []
        error.message = f"{path}: {error.message}"
        error.hint = f"a number of the scenario or its mechanism, such as {', '.join(near)}" if near else error.hint
        raise error


def _failure(scenario: Scenario, path: str, text: str, *at: str) -> PinarmError | None:
    """Return why a scenario cannot be prepared with a value at a path; none where it can, or numerics decide."""
    try:
        document = scenario.document.assigned(path, text, scenario.document.locate((*at, path)))
        other = scenario.with_document(document)
        other.problem.prepare(other.mechanism, other.content.accuracy, other.place)
    except NumericsError:
        return None
    except PinarmError as error:
        return error
    return None


def _number_paths(scenario: Scenario) -> list[str]:
    """Return paths of numbers that a scenario and its mechanism file have."""
    data, wanted = scenario.document.data, scenario.content.mechanism
    paths = [steps for steps in _numbers(data, []) if steps[0] not in ("pinarm", "find", "expect")]
    if scenario.given is None and Path(wanted).suffix:
        file = contained_file((scenario.folder / wanted).absolute(), root_of(scenario.folder), {})
        paths += [["changes", *steps] for steps in _numbers(mechanism_document(file).data, []) if steps[0] != "pinarm"]
    return [joined(steps) for steps in paths[:MOST_PATHS]]


def _numbers(data: Any, steps: list[str]) -> Iterator[list[str]]:
    """Yield the steps to every number in maps, with a unit or without."""
    if isinstance(data, dict):
        for key, inner in data.items():
            yield from _numbers(inner, [*steps, str(key)])
    elif isinstance(data, int | float) or (isinstance(data, str) and _is_quantity(data)):
        yield steps


def _is_quantity(text: str) -> bool:
    """Tell whether a text is a number with a unit."""
    try:
        read_quantity(text)
    except PinarmError:
        return False
    return True

"""Keys of a scenario that belong elsewhere: in its problem, beside it, or in the mechanism file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pinarm.errors import InputError, Key
from pinarm.input.yaml.document import Document
from pinarm.problems import KINDS, problem_class
from pinarm.use.scenario.file_kind import map_in_mechanism_file
from pinarm.use.scenario.scenario_file import ScenarioFile


def refuse_misplaced_keys(document: Document) -> None:
    """Refuse keys that scenarios do not have and problems or mechanism files do.

    Raises:
        InputError: Says where the key belongs.
    """
    given: Mapping[str, Any] = document.data if isinstance(document.data, dict) else {}
    for key in [*given]:
        if key in ScenarioFile.__struct_encode_fields__:
            continue
        problem = given.get("problem")
        kind = problem.get("kind") if isinstance(problem, dict) else None
        if isinstance(kind, str) and kind in KINDS and key in _keys(kind):
            raise InputError(f"'{key}' is a key of the problem", expected=f"'{key}:' below 'problem:', indented",
                             ).at(document.locate((Key(key),)))  # fmt: skip
        _refuse_key_of_mechanism(document, key)


def refuse_misplaced_keys_of_problem(document: Document, kind: str) -> None:
    """Refuse keys that no problem has, and scenarios or mechanism files do; and drives that are maps, not names.

    Raises:
        InputError: Says where the key belongs.
    """
    given = document.data["problem"]
    others = set[str]()
    for key in [*given]:
        if key in _keys(kind):
            continue
        others = others or {name for other in KINDS for name in _keys(other)}
        if key in others:
            continue
        if key in ScenarioFile.__struct_encode_fields__:
            raise InputError(f"'{key}' is a key of the scenario", expected=f"'{key}:' beside 'problem:', not below it",
                             ).at(document.locate(("problem", Key(key))))  # fmt: skip
        _refuse_key_of_mechanism(document, key, "problem")
    drives = given.get("drives")
    for index, drive in enumerate(drives if isinstance(drives, list) else ()):
        if isinstance(drive, dict):
            name = drive.get("along", drive.get("joint"))
            error = InputError("a drive of a problem is the name of the coordinate that it acts along",
                               expected="such names; motors and gears stand under 'drives' of the mechanism file",
                               hint=f"drives: [{name}]" if isinstance(name, str) else "")  # fmt: skip
            raise error.at(document.locate(("problem", "drives", index)))


def _refuse_key_of_mechanism(document: Document, key: str, *at: str) -> None:
    """Refuse a key where mechanism files have it; see ``refuse_misplaced_keys``."""
    outer = map_in_mechanism_file(key)
    if outer is None:
        return
    file = document.data.get("mechanism")
    change = f"{{{key}: ...}}" if not outer else f"{{{outer.rstrip('.')}: {{{key}: ...}}}}"
    raise InputError(
        f"'{key}' is a key of mechanism files",
        expected=f"'{key}:' in {file if isinstance(file, str) and '.' in file else 'a mechanism file'}, or in "
        f"'changes:' of the scenario, beside 'problem:'",
        hint=f"changes: {change}",
    ).at(document.locate((*at, Key(key))))


def _keys(kind: str) -> tuple[str, ...]:
    """Return the keys of a kind of problem."""
    return (*problem_class(kind).__struct_encode_fields__, "kind")

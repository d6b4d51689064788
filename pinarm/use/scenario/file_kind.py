"""Files and keys that are no scenario's: mechanism files, models, folders, names of robots, and keys of other files."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from pinarm.errors import InputError, Key, Location, ModelError
from pinarm.input.roots import ENDINGS, robots
from pinarm.input.yaml.document import Document
from pinarm.mechanics.description import MechanismDescription
from pinarm.problems import KINDS, problem_class

MOST = 12
"""Number of files of a folder that a message lists."""

GIVEN = "mechanism.yaml"
"""Name in a scenario of a mechanism that was given as an object: the file that a result writes it to."""


def is_mechanism(data: Any) -> bool:
    """Tell whether the content of a file is that of a mechanism file."""
    return isinstance(data, dict) and bool({"robot", "planar"} & data.keys()) and not {"problem", "mechanism"} & {*data}


def refuse_folder(path: Path) -> None:
    """Refuse a folder; the message names the files in it that can be given."""
    if not path.is_dir():
        return
    files = sorted(file for file in path.iterdir() if file.name.endswith((".yaml", ".yml", *ENDINGS)))
    shown = [str(file) for file in files[:MOST]] + (["..."] if len(files) > MOST else [])
    none = "a scenario, a mechanism file or a model; there is none of them in it"
    hint = "for the saved result, the commands replay and report, or pinarm.restore in Python"
    raise InputError(
        "this is a folder" + (", and the name of a robot" if _is_robot(path) else ""),
        expected=f"one of the files in it: {', '.join(shown)}" if shown else none,
        hint=hint if (path / "summary.json").is_file() else "",
    ).at(Location(str(path)))


def _is_robot(path: Path) -> bool:
    try:
        return str(path) == path.name and path.suffix not in (".yaml", ".yml") and path.name in robots()
    except ModelError:  # the package is not installed
        return False


def refuse_model(path: Path) -> None:
    """Refuse a model file, and the name of a robot where there is no file of that name; say what to do with it.

    Whoever reads a model that does not exist says so.
    """
    robot = not path.exists() and _is_robot(path)
    if not robot and not (path.name.endswith(ENDINGS) and path.is_file()):
        return
    error = InputError(
        f"'{path}' is the name of a robot, not a scenario" if robot else "this is a model, not a scenario",
        expected="a scenario (.yaml): a question about a mechanism",
        hint=f"python -m pinarm new {path}, which writes a scenario for it; or python -m pinarm explain {path}",
    )
    raise error if robot else error.at(Location(str(path)))


def refuse_mechanism(path: Path, data: Any) -> None:
    """Refuse a mechanism file; say what to do with it."""
    if is_mechanism(data):
        raise InputError(
            "this is a mechanism file, not a scenario",
            expected=f"a scenario, with 'mechanism: {path.name}' and a 'problem:'",
            hint=f"python -m pinarm explain {path}; or python -m pinarm new four_bar, for a scenario to begin with",
        ).at(Location(str(path)))


def refuse_changes(data: Mapping[str, Any]) -> None:
    """Refuse changes of a mechanism that was given as an object: it is what it is."""
    for key in ("arguments", "gravity", "payloads", "changes"):
        if data.get(key):
            raise InputError(
                f"the mechanism is given as an object, which '{key}' does not change",
                expected="its file or its name, or the changes where the mechanism is made",
                hint="Mechanism.load(path, values={...})",
            )


def refuse_misplaced_keys(document: Document, keys: Collection[str], *at: str) -> None:
    """Refuse keys of a scenario, or of its problem, that belong elsewhere, and say where; and drives that are maps.

    Args:
        document: A scenario.
        keys: Those of scenarios.
        at: ``problem`` for the keys below it.
    """
    data: Mapping[str, Any] = document.data if isinstance(document.data, dict) else {}
    problem: Mapping[str, Any] = data["problem"] if isinstance(data.get("problem"), dict) else {}
    keys_of_kind = _keys(str(problem.get("kind")))
    own, others = (keys_of_kind, keys) if at else (keys, keys_of_kind)
    known = {key for kind in KINDS for key in _keys(kind)} if at else {*own}
    for key in (key for key in (problem if at else data) if key not in own):
        place, outer = document.locate((*at, Key(key))), _map_in_mechanism_file(key)
        if key in others and (place.line or outer is None):
            owner = "scenario" if at else "problem"
            expected = f"'{key}:' beside 'problem:', not below it" if at else f"'{key}:' below 'problem:', indented"
            raise InputError(f"'{key}' is a key of the {owner}", expected=expected).at(place)
        if key not in known and outer is not None:
            file = data.get("mechanism")
            home = file if isinstance(file, str) and "." in file else "a mechanism file"
            change = f"{{planar: {{{key}: ...}}}}" if outer else f"{{{key}: ...}}"
            path = place.source.removeprefix("--set ").partition("=")[0]  # where an option has the key
            raise InputError(
                f"'{key}' is a key of mechanism files",
                expected=f"'{key}:' in {home}, or in 'changes:' of the scenario, beside 'problem:'",
                hint=f"changes: {change}" if place.line else f"changes.{outer}{path}",
            ).at(place)
    drives = problem.get("drives")
    for index, drive in enumerate(drives if at and isinstance(drives, list) else ()):
        if isinstance(drive, dict):
            name = drive.get("along", drive.get("joint"))
            raise InputError(
                "a drive of a problem is the name of the coordinate that it acts along",
                expected="such names; motors and gears stand under 'drives' of the mechanism file",
                hint=f"drives: [{name}]" if isinstance(name, str) else "",
            ).at(document.locate(("problem", "drives", index)))


def _map_in_mechanism_file(key: str) -> str | None:
    """Return the path to the map of a mechanism file that has a key; ``None`` where none has."""
    if key in MechanismDescription.__struct_fields__:
        return ""
    from pinarm.mechanics.planar_drawing import PlanarDrawing

    return "planar." if key in PlanarDrawing.__struct_fields__ else None


def _keys(kind: str) -> tuple[str, ...]:
    return (*problem_class(kind).__struct_encode_fields__, "kind") if kind in KINDS else ()

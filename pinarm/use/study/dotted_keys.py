"""Paths of keys that a scenario or a mechanism file has or may have, for the completion of lines in shells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pinarm.engine.mechanism_loading import mechanism_document
from pinarm.input.yaml.document import Document, joined
from pinarm.input.yaml.schema import InputStruct, with_types
from pinarm.input.yaml.validation_messages import keys_at
from pinarm.mechanics.description import MechanismDescription
from pinarm.problems import problem_class
from pinarm.use.scenario.file_kind import is_mechanism
from pinarm.use.scenario.scenario_file import ScenarioFile

PARTS = ("problem", "changes", "arguments")
"""Keys of a scenario whose content is that of another kind of file, or of one of several kinds."""


class KeyPart(NamedTuple):
    """A part of a file.

    Attributes:
        at: Path of the part.
        struct: What it may hold; ``None`` where that is what it holds.
        data: What it holds.
    """

    at: tuple[str, ...]
    struct: type[InputStruct] | None
    data: Mapping[str, Any]


def dotted_keys(file: str | Path, prefix: str = "") -> list[str]:
    """Return the paths of keys one step further than a prefix: ``problem.time.end=``, or ``problem.time.`` of a map.

    Args:
        file: A scenario, or a mechanism file.
        prefix: Beginning of the path.

    Raises:
        InputError: The file cannot be read, or names a kind of problem that there is not.
    """
    parts = _parts(Path(file))
    while True:
        paths = [path for part in parts for path in _further(part, prefix)]
        if len(paths) != 1 or not paths[0].endswith(".") or paths[0] == prefix:
            return paths
        prefix = paths[0]  # the shell would put a blank behind it


def _parts(file: Path) -> list[KeyPart]:
    """Return the file, its problem, and what it may change of its mechanism file."""
    data = Document.read(file).data
    if not isinstance(data, dict):
        return []
    if is_mechanism(data):
        return [KeyPart((), MechanismDescription, data)]
    known, wanted = data.get("problem"), data.get("mechanism")
    problem = known if isinstance(known, dict) else {}
    mechanism: Mapping[str, Any] = {}
    if isinstance(wanted, str) and Path(wanted).suffix:
        given = mechanism_document(file.parent / wanted).data
        mechanism = given if isinstance(given, dict) else {}
    kind = problem_class(problem["kind"]) if "kind" in problem else None
    return [
        KeyPart((), ScenarioFile, data),
        KeyPart(PARTS[:1], kind, problem),
        KeyPart(PARTS[1:2], MechanismDescription, mechanism),
        KeyPart(PARTS[2:], None, mechanism.get("arguments") or {}),
    ]


def _further(part: KeyPart, prefix: str) -> Iterator[str]:
    """Yield the paths in a part that begin with a prefix and are one step longer."""
    if not part.at or prefix.startswith(f"{joined([*part.at])}."):
        yield from _below(part, part.struct and with_types(part.struct, part.struct.deferred), part.data, (), prefix)


def _below(
    part: KeyPart, struct: type[InputStruct] | None, data: Any, at: tuple[str | int, ...], prefix: str
) -> Iterator[str]:
    """Yield such paths below a place in a part, which holds some data."""
    for name in dict.fromkeys((*_children(data), *_known(part, struct, at))):
        path, inner, place = joined([*part.at, *map(str, at), str(name)]), _children(data).get(name), (*at, name)
        elsewhere = not part.at and name in PARTS
        if prefix.startswith(f"{path}.") and not elsewhere:
            yield from _below(part, struct, inner, place, prefix)
        elif path.startswith(prefix):
            below = elsewhere or _children(inner) or (inner is None and _known(part, struct, place))
            yield f"{path}{'.' if below else '='}"


def _known(part: KeyPart, struct: type[InputStruct] | None, at: tuple[str | int, ...]) -> list[str]:
    return keys_at(struct, part.data, at) if struct else []


def _children(data: Any) -> dict[Any, Any]:
    return dict(data if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else {})

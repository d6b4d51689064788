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


class KeyTree(NamedTuple):
    """Keys of a file and of the files that it names: those that are there, and those that may be.

    Attributes:
        data: That of the file, with what it may change of its mechanism file.
        structs: Key of a part -> what it may hold, ``None`` where that is what it holds; empty for the file itself.
    """

    data: dict[str, Any]
    structs: Mapping[str, type[InputStruct] | None]

    @classmethod
    def read(cls, file: Path) -> KeyTree:
        """Read a file; raise as ``dotted_keys`` does."""
        data = Document.read(file).data
        if not isinstance(data, dict) or is_mechanism(data):
            return cls(_children(data), {"": MechanismDescription})
        problem, wanted, mechanism = _children(data.get("problem")), data.get("mechanism"), dict[str, Any]()
        if isinstance(wanted, str) and Path(wanted).suffix:
            mechanism = _children(mechanism_document(file.parent / wanted).data)
        kind = problem_class(problem["kind"]) if "kind" in problem else None
        parts = {"problem": problem, "changes": mechanism, "arguments": _children(mechanism.get("arguments"))}
        structs = {"": ScenarioFile, "problem": kind, "changes": MechanismDescription, "arguments": None}
        return cls({**data, **parts}, structs)

    def known(self, at: tuple[str, ...]) -> list[str]:
        """Return the keys that may stand at a path."""
        part = at[0] if at and at[0] in self.structs else ""
        struct, data, rest = self.structs[part], self.data[part] if part else self.data, at[1:] if part else at
        return keys_at(with_types(struct, struct.deferred), data, rest) if struct else []

    def further(self, prefix: str, data: Any, at: tuple[Any, ...] = ()) -> Iterator[str]:
        """Yield the paths below a place, which holds some data, that begin with a prefix and are one step longer."""
        for name in dict.fromkeys((*_children(data), *self.known(at))):
            place, inner = (*at, name), _children(data).get(name)
            path = joined(place)
            if prefix.startswith(f"{path}."):
                yield from self.further(prefix, inner, place)
            elif path.startswith(prefix):
                part = not at and name in self.structs
                below = part or _children(inner) or (inner is None and self.known(place))
                yield f"{path}{'.' if below else '='}"


def dotted_keys(file: str | Path, prefix: str = "") -> list[str]:
    """Return the paths of keys one step further than a prefix: ``problem.time.end=``, or ``problem.time.`` of a map.

    Args:
        file: A scenario, or a mechanism file.
        prefix: Beginning of the path.

    Raises:
        InputError: The file cannot be read, or names a kind of problem that there is not.
    """
    tree = KeyTree.read(Path(file))
    while True:
        paths = [*tree.further(prefix, tree.data)]
        if len(paths) != 1 or not paths[0].endswith(".") or paths[0] == prefix:
            return paths
        prefix = paths[0]  # the shell would put a blank behind it


def _children(data: Any) -> dict[Any, Any]:
    return dict(data if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else {})

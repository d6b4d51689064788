"""JSON Schemas of the files, for editors."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Union

import msgspec

from pinarm.errors import InputError
from pinarm.input.yaml.schema import InputStruct, json_schema, with_types
from pinarm.mechanics.description import MechanismDescription
from pinarm.problems import KINDS, problem_class
from pinarm.use.scenario.scenario_file import ScenarioFile

EXAMPLES = Path(__file__).with_name("key_examples.json")
"""Definition -> key -> a value that a tested file gives it; ``docs/key_examples.py`` writes it."""


def schema(of: Literal["scenario", "mechanism"] = "scenario") -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of scenario files or of mechanism files, as plain data.

    Args:
        of: ``scenario`` or ``mechanism``.

    Raises:
        InputError: There are no files of that kind.
    """
    if of not in ("scenario", "mechanism"):
        raise InputError(f"there is no schema of '{of}'", expected="scenario or mechanism")
    file: type[InputStruct] = ScenarioFile if of == "scenario" else MechanismDescription
    kinds = [problem_class(kind) for kind in KINDS] if of == "scenario" else []
    structs = [with_types(struct, struct.deferred) for struct in (file, *kinds)]
    roots, definitions = msgspec.json.schema_components(
        [structs[0], Union[tuple(structs[1:])]] if kinds else structs,  # noqa: UP007
        schema_hook=json_schema,
        ref_template="#/$defs/{name}",
    )
    if kinds:
        definitions["ScenarioFile"]["properties"]["problem"] = roots[1]
    meanings, examples = _meanings(InputStruct), json.loads(EXAMPLES.read_text(encoding="utf-8"))
    for name, definition in definitions.items():
        if name in meanings:
            _explain(definition, *meanings[name], examples.get(name, {}))
    own = definitions.pop(file.__name__)
    return {**own, "$defs": definitions, "$schema": "https://json-schema.org/draft/2020-12/schema"}


_KEY = re.compile(r"([A-Za-z]\w*): (.*)")


def _meanings(base: type[Any]) -> dict[str, tuple[str, dict[str, str]]]:
    """Return of every struct below a base what it is, and what each of its keys means, out of their docstrings."""
    meanings: dict[str, tuple[str, dict[str, str]]] = {}
    for struct in base.__subclasses__():
        meanings |= _meanings(struct)
        text, _, attributes = inspect.cleandoc(struct.__doc__ or "").partition("\nAttributes:\n")
        inherited: dict[str, str] = {}
        for parent in reversed(struct.__mro__[1:]):
            inherited |= _keys(inspect.cleandoc(parent.__doc__ or "").partition("\nAttributes:\n")[2])
        own = {**inherited, **_keys(attributes)}
        names = {field.name: field.encode_name for field in msgspec.structs.fields(struct)}
        meanings[struct.__name__] = text.strip(), {names[key]: own[key] for key in own if key in names}
    return meanings


def _keys(attributes: str) -> dict[str, str]:
    """Return the meaning of each key of the section of a docstring, on one line."""
    meanings: dict[str, str] = {}
    last = ""
    for line in attributes.splitlines():
        if (matched := _KEY.fullmatch(line.strip())) and len(line) - len(line.lstrip()) == INDENT:
            last, meanings[matched[1]] = matched[1], matched[2]
        elif last and line.strip():
            meanings[last] += f" {line.strip()}"
        elif not line.strip():
            last = ""
    return meanings


INDENT = 4
"""Of the keys below ``Attributes:`` in a docstring."""


def _explain(definition: dict[str, Any], meaning: str, keys: Mapping[str, str], examples: Mapping[str, Any]) -> None:
    """Put the meanings of a struct and of its keys into its schema, which editors show where the mouse is."""
    definition["description"] = meaning
    for key, own in definition.get("properties", {}).items():
        unit = f" ({own['description']})" if "description" in own else ""
        text = keys.get(key) or (_first_sentence(meaning) if key in TAGS else "")
        shown = {"examples": [examples[key]]} if key in examples else {}
        definition["properties"][key] = {**own, "description": f"{text}{unit}".strip(), **shown}


TAGS = ("kind", "law")
"""Keys that say which structure it is: their text is what that is."""


def _first_sentence(text: str) -> str:
    return re.split(r"(?<=[.:])\s", " ".join(text.split()), maxsplit=1)[0].rstrip(":")


def has_example(key: Mapping[str, Any]) -> bool:
    """Tell whether the schema of a key shows what may stand there: an example, in its text or beside it, or all values.

    Args:
        key: Its JSON Schema.
    """
    listed = "enum" in key or key.get("type") == "boolean"
    return listed or bool(key.get("examples")) or "such as ``" in key["description"].lower()

"""Write the examples that editors show of keys: values of tested files. ``python docs/key_examples.py``."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pinarm.input.yaml.document import Document
from pinarm.use.scenario.file_kind import is_mechanism
from pinarm.use.scenario.json_schema import EXAMPLES, has_example, schema

ROOT = Path(__file__).parents[1]

SOURCES = ("docs/kind_examples", "scenarios", "models", "examples")
"""Folders with tested files, best first: the examples of kinds are the shortest."""

SHORT = 60
"""Characters of an example that is read at a glance."""

Given = dict[tuple[str, str], dict[str, int]]
"""Definition of the JSON Schemas and key of it -> values, as JSON -> index in ``SOURCES`` of the first that has it."""


def given() -> Given:
    """Return the values that keys have in the tested files."""
    schemas = {of: schema(of) for of in ("mechanism", "scenario")}
    values: Given = {}
    for k, folder in enumerate(SOURCES):
        for file in sorted((ROOT / folder).rglob("*.yaml")):
            data = Document.read(file).data
            of = "mechanism" if is_mechanism(data) else "scenario"
            if of == "mechanism" or "problem" in data:
                for place, value in _of_struct(data, schemas[of]["title"], schemas[of], schemas[of]["$defs"]):
                    values.setdefault(place, {}).setdefault(json.dumps(value, ensure_ascii=False), k)
    return values


Values = Iterator[tuple[tuple[str, str], Any]]


def _of_struct(data: Mapping[str, Any], name: str, definition: Mapping[str, Any], parts: Mapping[str, Any]) -> Values:
    """Yield the keys of a structure that data give, and those of the structures in it, with their values."""
    for key, value in data.items():
        if key in definition["properties"]:
            yield (name, key), value
            yield from _of_value(value, definition["properties"][key], parts)


def _of_value(value: Any, allowed: Mapping[str, Any], parts: Mapping[str, Any]) -> Values:
    if name := _structure(value, allowed, parts):
        yield from _of_struct(value, name, parts[name], parts)
        return
    for form in _forms(allowed):
        if isinstance(value, dict) and isinstance(form.get("additionalProperties"), dict):
            for inner in value.values():
                yield from _of_value(inner, form["additionalProperties"], parts)
        if isinstance(value, list) and form.get("type") == "array":
            for inner, kind in zip(value, form.get("prefixItems", [form["items"]] * len(value)), strict=False):
                yield from _of_value(inner, kind or {}, parts)


def _structure(value: Any, allowed: Mapping[str, Any], parts: Mapping[str, Any]) -> str:
    """Return the name of the definition that a value is of; empty where it is of none."""
    if not isinstance(value, dict):
        return ""
    names = [form["$ref"].rpartition("/")[2] for form in _forms(allowed) if "$ref" in form]
    return next((name for name in names if _fits(value, parts[name])), "")


def _forms(allowed: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield the schemas of the forms that a value may have."""
    for form in allowed.get("anyOf", ()):
        yield from _forms(form)
    if "anyOf" not in allowed:
        yield allowed


def _fits(value: Mapping[str, Any], definition: Mapping[str, Any]) -> bool:
    properties = definition.get("properties", {})
    tags = {tag: properties[tag]["enum"] for tag in ("kind", "law") if "enum" in properties.get(tag, {})}
    return (
        set(definition.get("required", ())) <= value.keys() <= properties.keys()
        and all(value.get(tag, allowed[0]) in allowed for tag, allowed in tags.items())
    )  # fmt: skip


def best(values: Mapping[str, int], default: object) -> Any:
    """Return the value to show: short, of the first source, and one that says something."""

    def rank(text: str) -> tuple[bool, bool, int, int]:
        only_zeros = bool(re.search(r"\d", text)) and not re.search(r"[1-9]", text)
        return only_zeros or json.loads(text) == default, len(text) > SHORT, values[text], len(text)

    return json.loads(min(values, key=rank))


def chosen() -> dict[str, dict[str, Any]]:
    """Return an example for every key that a tested file has and whose text gives none: definition -> key -> value."""
    values, examples = given(), {}
    for of in ("mechanism", "scenario"):
        root = schema(of)
        for name, definition in sorted({root["title"]: root, **root["$defs"]}.items()):
            for key, own in definition.get("properties", {}).items():
                if (name, key) in values and not has_example({**own, "examples": []}):
                    examples.setdefault(name, {})[key] = best(values[name, key], own.get("default"))
    return examples


if __name__ == "__main__":
    rows = [f' "{name}": {json.dumps(keys, ensure_ascii=False)}' for name, keys in sorted(chosen().items())]
    EXAMPLES.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")
    print(f"written to {EXAMPLES}")

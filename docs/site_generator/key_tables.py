"""Tables of the keys of a definition of the JSON Schemas: meaning, what may stand there, default."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from site_generator.families import definitions, families

HEAD = ("| key | meaning | value | default |", "| --- | --- | --- | --- |")

_UNIT = re.compile(r"\s*\(?(?P<text>a quantity in [^()]+|a number with its unit)\)?$")


def key_tables(name: str) -> list[str]:
    """Return the lines of the table of a definition, and of those of the structures that its keys contain.

    Args:
        name: Of the definition.
    """
    lines: list[str] = []
    pending, seen = [name], {name}
    while pending:
        current = pending.pop(0)
        if current != name:
            lines += ["", f"### Keys of `{_title(current)}` {{#{current.lower()}}}", "", _prose(current)]
        lines += ["", *HEAD, *_rows(definitions()[current])]
        inner = [part for part in _parts(definitions()[current]["properties"]) if part not in seen]
        seen.update(inner)
        pending += dict.fromkeys(inner)
    return lines


def prose(text: str) -> str:
    """Return a text of a docstring as Markdown."""
    return text.replace("``", "`").replace("*", r"\*") if "`" not in text else _outside_code(text.replace("``", "`"))


def _outside_code(text: str) -> str:
    parts = text.split("`")
    return "`".join(part if k % 2 else part.replace("*", r"\*") for k, part in enumerate(parts))


def _prose(name: str) -> str:
    return prose(definitions()[name].get("description", ""))


def _title(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()


def _rows(definition: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each key, but for the one that names the kind."""
    for key, schema in definition["properties"].items():
        if key not in ("kind", "law"):
            meaning, value = prose(_UNIT.sub("", schema.get("description", ""))), _value(schema)
            default = "required" if key in definition["required"] else _default(schema.get("default"))
            cells = (text.replace("|", r"\|").replace("\n", " ") for text in (f"`{key}`", meaning, value, default))
            yield f"| {' | '.join(cells)} |"


def _default(value: object) -> str:
    if value in (None, "", [], {}):
        return ""
    written = json.dumps(value, ensure_ascii=False).replace('"', "")
    written = re.sub(r"\.0(?!\d)", "", written)
    return f"`{written}`"


def _value(schema: Mapping[str, Any]) -> str:
    """Return what may stand for a key, in words."""
    if unit := _UNIT.search(schema.get("description", "")):
        return unit["text"].removeprefix("a ")
    if family := _family(schema):
        return family
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(_value(part) for part in schema["anyOf"] if part != {"type": "null"}))
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{_title(name)}]({_place(name)})"
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    return _container(schema)


def _container(schema: Mapping[str, Any]) -> str:
    if "prefixItems" in schema:
        parts = [_value(part) for part in schema["prefixItems"]]
        return f"list of {len(parts)}: {parts[0]}" if len(set(parts)) == 1 else f"list: {', '.join(parts)}"
    if schema.get("type") == "array":
        return f"list of: {_value(schema['items'])}" if schema.get("items") else "list"
    if schema.get("type") == "object":
        inner = schema.get("additionalProperties")
        return f"name → {_value(inner)}" if isinstance(inner, dict) and inner else "name → value"
    return {"string": "text", "integer": "whole number", "number": "number", "boolean": "`true` or `false`"}.get(
        schema.get("type", ""), "any"
    )


def _family(schema: Mapping[str, Any]) -> str:
    """Return a link to the family most of whose members, and no others, may stand for a key; empty for none."""
    names = {part["$ref"].rpartition("/")[2] for part in schema.get("anyOf", ()) if "$ref" in part}
    for family in families():
        if names <= set(family.members.values()) and len(names) > len(family.members) / 2:
            return f"[{family.one}](../{family.name}/index.md)"
    return ""


def _place(name: str) -> str:
    """Return where a definition is explained: on a page of its own where it is a member of a family."""
    for family in families():
        for member, definition in family.members.items():
            if definition == name:
                return f"../{family.name}/{member}.md"
    return f"#{name.lower()}"


def _parts(schema: Any) -> list[str]:
    """Return the definitions that a schema contains and that are no members of a family."""
    members = {name for family in families() for name in family.members.values()}
    names = re.findall(r'"#/\$defs/(\w+)"', json.dumps(schema))
    return [name for name in dict.fromkeys(names) if name not in members]

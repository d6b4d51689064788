"""Validation errors in the terms of input files, with the exact location and a suggestion."""

from __future__ import annotations

import re
from collections.abc import Iterator
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

import msgspec

from pinarm.errors import InputError, PinarmError, choices
from pinarm.input.units import leading_number
from pinarm.input.yaml.schema import InputStruct, convert

Keys = tuple[str | int, ...]
_STEP = r"\.(?P<key>[^.\[\]]+)|\[(?P<index>\d+)\]|\[(?P<any>\.\.\.)\]"
_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "object": "a map of keys",
    "array": "a list",
}


def failing_path(error: msgspec.ValidationError, data: Any, struct: type[InputStruct]) -> Keys:
    """Return the keys and indices of the value that fails.

    msgspec names fields and indices, but not the keys of maps: those are found by validating the map key by key.
    """
    _, placed, text = str(error).rpartition(" - at `$")
    path: list[str | int] = []
    if not placed:  # it is about the whole, and its message may look like a path
        return ()
    for step in re.finditer(_STEP, text.rstrip("`")):
        if step["any"]:
            path.append(_failing_key(data, path, struct))
        else:
            path.append(int(step["index"]) if step["index"] else step["key"])
    return tuple(path)


def _failing_key(data: Any, path: list[str | int], struct: type[InputStruct]) -> str:
    """Return the first key of a map whose value fails."""
    node = _at(data, path)
    maps = [kind for kind in _kinds(struct, data, tuple(path)) if get_origin(kind) is dict]
    for key, value in node.items():
        try:
            for kind in maps:
                msgspec.convert({key: value}, kind, dec_hook=convert)
        except msgspec.ValidationError:
            return str(key)
    return str(next(iter(node)))


def explain(
    error: msgspec.ValidationError, data: Any, path: Keys, struct: type[InputStruct], written: str = ""
) -> PinarmError:
    """Return the error to raise for the value at a path, as it is ``written`` in a file."""
    cause, (message, _, _) = error.__cause__, str(error).partition(" - at `$")
    if isinstance(cause, PinarmError):
        mistake = type(cause)(cause.message, expected=cause.expected, hint=cause.hint, location=cause.location)
        mistake.path = cause.path
        return mistake
    if match := re.fullmatch(r"Object contains unknown field `(.*)`", message, re.DOTALL):
        expected, hint = choices(match[1], keys_at(struct, data, path), most=40)
        if leading_number(match[1]):  # a comma in {mass: 0,6 kg} ends the value
            hint = f"decimals with a point, such as 0.{match[1]}"
        return InputError(f"unknown key '{match[1]}'", expected=expected, hint=hint)
    if match := re.fullmatch(r"Object missing required field `(.*)`", message):
        if match[1] not in _tags(struct, data, path):
            return InputError(f"the key '{match[1]}' is missing")
        expected, _ = choices("", _values(struct, data, (*path, match[1])), most=40)
        return InputError(f"the key '{match[1]}' is missing: it says which kind this is", expected=expected)
    if match := re.fullmatch(r"Invalid (?:enum )?value (.*)", message, re.DOTALL):
        names = _values(struct, data, path)
        expected, hint = choices(match[1].strip("'"), names, most=40)
        key = next((step for step in reversed(path) if isinstance(step, str)), "value")
        return InputError(f"unknown {key} {match[1]}", expected=expected, hint=hint)
    wanted, _, found_kind = message.removeprefix("Expected ").partition(", got ")
    shown = _at(data, list(path))
    expected, what = _in_words(wanted), _in_words(found_kind) or repr(shown)[:40]
    if found_kind == "`null`":
        what = "nothing" if path else "an empty file"
    quoted = f"'{written or shown}'" if expected == "text" and isinstance(shown, int | float) else ""
    return InputError(f"this is {what}", expected=expected, hint=quoted)


def _in_words(kinds: str) -> str:
    """Replace msgspec's type names in an error by words for authors of files."""
    return re.sub(
        r"`([^`]*)`", lambda m: " or ".join(_WORDS.get(k, k) for k in m[1].split(" | ") if k != "null"), kinds
    )


def unknown_key(error: msgspec.ValidationError) -> tuple[str, ...]:
    """Return the unknown key of an error as a path of one step; empty where the error is about a value."""
    match = re.match(r"Object contains unknown field `(.*?)`( - at|$)", str(error), re.DOTALL)
    return (match[1],) if match else ()


def _kinds(annotation: Any, data: Any, path: Keys) -> Iterator[Any]:
    if hasattr(annotation, "__metadata__"):
        annotation = annotation.__origin__
    if get_origin(annotation) in (Union, UnionType):
        members = get_args(annotation)
        fitting = [member for member in members if not _is_other(member, data)]
        for member in fitting if any(hasattr(member, "__struct_config__") for member in fitting) else members:
            yield from _kinds(member, data, path)
        return
    if not path:
        yield annotation
        return
    first, rest = path[0], path[1:]
    inner = _at(data, [first])
    if isinstance(annotation, type) and issubclass(annotation, InputStruct):
        for field in msgspec.structs.fields(annotation):
            if field.encode_name == first:
                yield from _kinds(field.type, inner, rest)
    elif get_args(annotation):
        yield from _kinds(get_args(annotation)[-1], inner, rest)


def _is_other(member: Any, data: Any) -> bool:
    """Return whether the tag in the data excludes a member of a union; a wrong tag excludes all structs in it."""
    if not (isinstance(member, type) and issubclass(member, InputStruct) and isinstance(data, dict)):
        return False
    config = member.__struct_config__
    return config.tag_field in data and data[config.tag_field] != config.tag


def _structs(struct: type[InputStruct], data: Any, path: Keys) -> list[type[InputStruct]]:
    return [kind for kind in _kinds(struct, data, path) if isinstance(kind, type) and issubclass(kind, InputStruct)]


def _tags(struct: type[InputStruct], data: Any, path: Keys) -> list[str]:
    tags = (kind.__struct_config__.tag_field for kind in _structs(struct, data, path))
    return [tag for tag in tags if tag]


def keys_at(struct: type[InputStruct], data: Any, path: Keys) -> list[str]:
    """Return the keys that may stand at a path of data which are to be a struct; none where any may, or no map."""
    kinds = _structs(struct, data, path)
    names = [field.encode_name for kind in kinds for field in msgspec.structs.fields(kind)]
    return [*names, *_tags(struct, data, path)]


def _values(struct: type[InputStruct], data: Any, path: Keys) -> list[str]:
    """Return the values allowed at a path: tags of a union, or literals."""
    kinds = [kind for kind in _kinds(struct, data, path) if get_origin(kind) is Literal]
    unoffered = {name for kind in _structs(struct, data, path[:-1]) for name in kind.unoffered}
    names = [str(literal) for kind in kinds for literal in get_args(kind) if literal not in unoffered]
    tagged = (kind.__struct_config__ for kind in _structs(struct, data, path[:-1]))
    return [*names, *(str(kind.tag) for kind in tagged if path and kind.tag_field == path[-1])]


def _has(data: Any, key: str | int) -> bool:
    if isinstance(data, list):
        return isinstance(key, int) and key < len(data)
    return isinstance(data, dict) and key in data


def _at(data: Any, path: list[str | int]) -> Any:
    for key in path:
        data = data[key] if _has(data, key) else None
    return data

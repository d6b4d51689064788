"""YAML text to plain data, with the location of every key and value.

Loading builds numbers, text, booleans, lists and maps only. Tags, anchors and aliases are refused, and depth and digits
are bounded: an untrusted file can neither run code nor occupy the reader for long.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from pinarm.errors import InputError, Location, PinarmError

MAX_DEPTH = 50
NESTED, LEVELS = "maps and lists are nested too deeply", f"at most {MAX_DEPTH} levels"
TAGGED = "anchors, aliases and tags are not read", "the value itself, without '&', '*' and '!' before it"
MAX_VALUES = 50_000
"""Largest number of values; they are read in half a second."""
MAX_DIGITS = 400
"""Python refuses to convert integers beyond 4300 digits; no float needs more than this."""

_WORDS: dict[str, Any] = {
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys(("null", "Null", "NULL", "~", "")),
}
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INTEGER = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_SPECIAL = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")

_UNTAGGED = tuple(f"tag:yaml.org,2002:{kind}" for kind in ("str", "seq", "map"))

Path_ = tuple[str | int, ...]

Places = Mapping[Path_, tuple[Location, Location]]
"""Path of keys and indices -> location of the value, which of a list or map in a map is its key's, and of the key."""


class Builder:
    """Builds plain data from the nodes of a YAML text.

    Args:
        tagged: For tables of other programs, which may have tags, anchors and aliases, and keys that stand twice, of
            which the last counts: returns the value of a scalar with a tag, from the tag and the text; ``None`` for a
            tag that is unknown.

    Attributes:
        places: Path of keys and indices -> locations of the value and of its key; see ``Places``.
    """

    def __init__(self, text: str, source: str, tagged: Callable[[str, str], Any] | None = None) -> None:
        self.text, self.source, self.tagged = text, source, tagged
        self.lines = text.splitlines()
        self.places: dict[Path_, tuple[Location, Location]] = {}
        self.count = 0

    def build(self) -> Any:
        import yaml

        fast = getattr(yaml, "CLoader", yaml.Loader)  # 20 times as fast as that in Python
        untyped: Any = type("Untyped", (fast,), {"yaml_implicit_resolvers": {}})
        try:
            root = yaml.compose(self.text, untyped)
        except yaml.MarkedYAMLError as error:
            place, problem = self._location(error.problem_mark or error.context_mark), error.problem or error.context
            if "nesting depth" in str(problem):  # libyaml has a bound of its own
                raise InputError(NESTED, expected=LEVELS).at(place) from None
            hint = _yaml_hint(str(problem), place.text[place.column - 1 : place.column])
            raise InputError(f"this is not YAML: {problem}", hint=hint).at(place) from None
        except (yaml.YAMLError, ValueError, RecursionError, AttributeError) as error:
            raise InputError(f"this is not YAML: {str(error).splitlines()[0]}").at(Location(self.source)) from None
        return None if root is None else self._built(root, (), 1)

    def _built(self, node: Any, path: Path_, depth: int) -> Any:
        """Return the value of a node, and note its place."""
        self.count += 1
        if self.count > MAX_VALUES:
            raise self._refuse(node, "the file holds too many values", f"at most {MAX_VALUES}; tables go in CSV files")
        text, width = self._text(node), _width(node)
        place = self._location(node.start_mark, width)
        key_place = self.places[path][1] if path in self.places else place
        self.places[path] = place if width and node.id == "scalar" else key_place, key_place
        if node.tag not in _UNTAGGED:
            value = self.tagged(node.tag, text) if self.tagged and node.id == "scalar" else None
            if value is None:
                raise self._refuse(node, *TAGGED)
            return value
        if node.id == "scalar":
            return text if node.style else self._value(text, node)
        if depth > MAX_DEPTH:
            raise self._refuse(node, NESTED, LEVELS)
        if node.id == "sequence":
            return [self._built(item, (*path, index), depth + 1) for index, item in enumerate(node.value)]
        built: dict[str, Any] = {}
        for key_node, item in node.value:
            if key_node.id != "scalar":
                raise self._refuse(key_node, "a list or map cannot be a key", "a plain word as key")
            key = self._text(key_node)
            at = (*path, key)
            if key in built and self.tagged is None:
                message = f"the key '{key}' stands twice (first in line {self.places[at][1].line})"
                raise self._refuse(key_node, message, "remove one")
            self.places[at] = (self._location(key_node.start_mark, len(key)),) * 2
            built[key] = self._built(item, at, depth + 1)
        return built

    def _text(self, node: Any) -> str:
        """Return the text of a scalar, nothing of others; refuse tags and anchors, and with these all aliases."""
        begin = node.start_mark.index
        if self.tagged is None and self.text[begin : begin + 1] in ("!", "&"):
            raise self._refuse(node, *TAGGED)
        text = node.value if node.id == "scalar" else ""
        if any("\ud800" <= c <= "\udfff" for c in text):
            raise self._refuse(node, "this contains half of a surrogate pair", "Unicode characters")
        return text

    def _value(self, text: str, node: Any) -> Any:
        """Resolve a plain scalar by the YAML 1.2 core schema."""
        if text in _WORDS:
            return _WORDS[text]
        digits, prefixed = _NUMBER.fullmatch(text), _INTEGER.fullmatch(text)
        if (digits or prefixed) and len(text) > MAX_DIGITS:
            raise self._refuse(node, "this number has too many digits", f"at most {MAX_DIGITS}")
        if digits:
            return float(text) if set(text) & set(".eE") else int(text)
        if prefixed:
            return int(text, 0)
        if _SPECIAL.fullmatch(text):
            return float(text.replace(".", "").lower())
        return text

    def _location(self, mark: Any, width: int = 1) -> Location:
        if mark is None:
            return Location(self.source)
        text = self.lines[mark.line] if mark.line < len(self.lines) else ""
        return Location(self.source, mark.line + 1, mark.column + 1, text, max(width, 1))

    def _refuse(self, node: Any, message: str, expected: str) -> PinarmError:
        return InputError(message, expected=expected).at(self._location(node.start_mark))


def _width(node: Any) -> int:
    """Return the width of a scalar on one line, of several lines the length of its value; 1 of a list or map."""
    begin, end = node.start_mark, node.end_mark
    return 1 if node.id != "scalar" else end.column - begin.column if end.line == begin.line else len(node.value)


def _yaml_hint(problem: str, character: str) -> str:
    if "tab" in problem or character == "\t":
        return "indent with spaces"
    if "mapping values are not allowed" in problem:
        return "a space after the colon, the right indentation, or quotes around text that holds a colon"
    return ""

"""YAML text to plain data, without recursion, with the location of every key and value.

Loading builds numbers, text, booleans, lists and maps only. Tags, anchors and aliases are refused, and depth and digits
are bounded: an untrusted file can neither run code nor occupy the reader for long.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from pinarm.errors import InputError, Location, PinarmError

MAX_DEPTH = 50
NESTED, LEVELS = "maps and lists are nested too deeply", f"at most {MAX_DEPTH} levels"
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

Path_ = tuple[str | int, ...]


class Builder:
    """Builds plain data from YAML events.

    Args:
        tagged: For tables of other programs, which may have tags, anchors and aliases, and keys that stand twice, of
            which the last counts: returns the value of a scalar with a tag, from the tag and the text; ``None`` for a
            tag that is unknown.

    Attributes:
        places: Path of keys and indices -> location of the value; that of a list or map in a map is its key's.
    """

    def __init__(self, text: str, source: str, tagged: Callable[[str, str], Any] | None = None) -> None:
        self.text, self.source, self.tagged = text, source, tagged
        self.lines = text.splitlines()
        self.places: dict[Path_, Location] = {}
        self.keys: dict[Path_, Location] = {}
        self.stack: list[tuple[Any, Path_, str | None, list[str]]] = []
        self.root: Any = None
        self.documents = self.count = 0
        self.anchors: dict[str, Any] = {}

    def build(self) -> Any:
        import yaml

        try:
            for event in yaml.parse(self.text, getattr(yaml, "CLoader", yaml.Loader)):  # C's is 20 times as fast
                self._take(event)
        except yaml.MarkedYAMLError as error:
            place, problem = self._location(error.problem_mark or error.context_mark), error.problem or error.context
            if "nesting depth" in str(problem):  # libyaml looks ahead, and has a bound of its own
                raise InputError(NESTED, expected=LEVELS).at(place) from None
            hint = _yaml_hint(str(problem), place.text[place.column - 1 : place.column])
            raise InputError(f"this is not YAML: {problem}", hint=hint).at(place) from None
        except (yaml.YAMLError, ValueError, RecursionError, AttributeError) as error:
            if isinstance(error, PinarmError):
                raise
            raise InputError(f"this is not YAML: {str(error).splitlines()[0]}").at(Location(self.source)) from None
        return self.root

    def _take(self, event: Any) -> None:
        name = type(event).__name__
        if name == "DocumentStartEvent":
            self.documents += 1
            if self.documents > 1 or event.version or event.tags:
                raise self._refuse(event, "this begins another document, or is a directive", "one document")
        if name == "AliasEvent" and self.tagged is not None and event.anchor in self.anchors:
            self._put(self.anchors[event.anchor], event)
            return
        if name == "AliasEvent" or (getattr(event, "anchor", None) and self.tagged is None):
            raise self._refuse(event, "anchors and aliases are not read", "write the value out")
        if name in ("ScalarEvent", "MappingStartEvent", "SequenceStartEvent") and event.tag:
            known = self.tagged is not None and name == "ScalarEvent"
            if self.tagged is not None and known and (value := self.tagged(event.tag, event.value)) is not None:
                self._put(value, event)
                return
            raise self._refuse(event, "tags are not read", "remove the word that begins with '!'")
        if name == "MappingStartEvent":
            self._open({}, event)
        elif name == "SequenceStartEvent":
            self._open([], event)
        elif name in ("MappingEndEvent", "SequenceEndEvent"):
            container, _, anchor, _ = self.stack.pop()
            if anchor:
                self.anchors[anchor] = container
        elif name == "ScalarEvent":
            self._scalar(event)

    def _open(self, container: Any, event: Any) -> None:
        if len(self.stack) >= MAX_DEPTH:
            raise self._refuse(event, NESTED, LEVELS)
        path = self._put(container, event)
        self.stack.append((container, path, event.anchor, []))

    def _scalar(self, event: Any) -> None:
        if any("\ud800" <= c <= "\udfff" for c in event.value):
            raise self._refuse(event, "this contains half of a surrogate pair", "Unicode characters")
        container, path, _, pending = self.stack[-1] if self.stack else (None, (), None, [])
        if isinstance(container, dict) and not pending:
            if event.value in container and self.tagged is None:
                first = self.keys[(*path, event.value)].line
                raise self._refuse(event, f"the key '{event.value}' stands twice (first in line {first})", "remove one")
            pending.append(event.value)
            self.keys[(*path, event.value)] = self._location(event.start_mark, len(event.value))
        else:
            self._put(value := self._value(event), event)
            if event.anchor:
                self.anchors[event.anchor] = value

    def _put(self, value: Any, event: Any) -> Path_:
        """Add a value to the open container and return its path."""
        self.count += _size(value, MAX_VALUES)
        if self.count > MAX_VALUES:
            raise self._refuse(event, "the file holds too many values", f"at most {MAX_VALUES}; tables go in CSV files")
        if not self.stack:
            self.root = value
            self.places[()] = self._location(event.start_mark)
            return ()
        container, path, _, pending = self.stack[-1]
        if isinstance(container, list):
            container.append(value)
            here = (*path, len(container) - 1)
            self.places[here] = self._location(event.start_mark, _width(event))
            return here
        if not pending:
            raise self._refuse(event, "a list or map cannot be a key", "a plain word as key")
        here = (*path, pending.pop())
        container[here[-1]] = value
        plain = not isinstance(value, dict | list) and _width(event)
        self.places[here] = self._location(event.start_mark, _width(event)) if plain else self.keys[here]
        return here

    def _value(self, event: Any) -> Any:
        """Resolve a scalar by the YAML 1.2 core schema."""
        text: str = event.value
        if not event.implicit[0]:
            return text
        if text in _WORDS:
            return _WORDS[text]
        digits, prefixed = _NUMBER.fullmatch(text), _INTEGER.fullmatch(text)
        if (digits or prefixed) and len(text) > MAX_DIGITS:
            raise self._refuse(event, "this number has too many digits", f"at most {MAX_DIGITS}")
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

    def _refuse(self, event: Any, message: str, expected: str) -> PinarmError:
        return InputError(message, expected=expected).at(self._location(event.start_mark))


def _size(value: Any, most: int) -> int:
    """Return the number of values in a value, itself included; if above ``most``, any number above it."""
    waiting, count = [value], 0
    while waiting and count <= most:
        value, count = waiting.pop(), count + 1
        if isinstance(value, list | dict):
            waiting += value.values() if isinstance(value, dict) else value
    return count


def _width(event: Any) -> int:
    """Return the width of an event on one line, 0 without a value; of several lines, the length of its value."""
    begin, end = event.start_mark, event.end_mark
    return int(end.column - begin.column if end.line == begin.line else len(str(getattr(event, "value", ""))))


def _yaml_hint(problem: str, character: str) -> str:
    if "tab" in problem or character == "\t":
        return "indent with spaces"
    if "mapping values are not allowed" in problem:
        return "a space after the colon, the right indentation, or quotes around text that holds a colon"
    return ""

"""YAML documents whose every value knows its line, and validation whose every error says where.

Loading builds numbers, text, booleans, lists and maps only. Tags, anchors and aliases are refused, and size, depth and
digits are bounded, so that a file from a stranger can neither run anything nor keep the reader busy.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from pinarm.errors import InputError, Location, PinarmError
from pinarm.input.mistakes import explain, failing_path, unknown_key
from pinarm.input.roots import similar_file
from pinarm.input.schema import Model, convert, reading_from

MAX_BYTES = 1_000_000
"""Longer tables belong in CSV files; a reader in Python needs about a minute per ten megabytes."""
MAX_DEPTH = 50
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
ModelT = TypeVar("ModelT", bound=Model)


@dataclass(frozen=True)
class Document:
    """A YAML file as plain data, with the place of every key and value.

    Attributes:
        source: File name as the user gave it, for messages.
        path: The file; ``None`` for text.
        data: Its content: maps, lists, text, numbers, booleans, ``None``.
        places: Path of keys and indices -> location.
    """

    source: str
    path: Path | None
    data: Any
    places: Mapping[Path_, Location] = field(repr=False)

    @classmethod
    def read(cls, path: Path, *, source: str | None = None) -> Document:
        """Read a file.

        Raises:
            InputError: The file is missing, too large, not UTF-8, or not YAML of the kind described above.
        """
        name = source or str(path)
        try:
            with open(path, "rb") as stream:
                raw = stream.read(MAX_BYTES + 1)
        except (OSError, ValueError) as error:
            raise _unreadable(path, error).at(Location(name)) from None
        if len(raw) > MAX_BYTES:
            raise InputError("the file is too large", expected=f"at most {MAX_BYTES} bytes").at(Location(name))
        try:
            return cls.parse(raw.decode("utf-8-sig"), source=name, path=path)
        except UnicodeDecodeError as error:
            raise InputError(f"the file is not UTF-8 text ({error.reason})").at(Location(name)) from None

    @classmethod
    def parse(cls, text: str, *, source: str = "<text>", path: Path | None = None) -> Document:
        """Read YAML text; see ``read``."""
        data, places = _Builder(text, source).build()
        return cls(source, path, data, places)

    def locate(self, path: Path_) -> Location:
        """Return the place of a path, or of its nearest ancestor that has one."""
        for length in range(len(path), -1, -1):
            if path[:length] in self.places:
                return self.places[path[:length]]
        return Location(self.source)

    @contextmanager
    def locating(self, *path: str | int) -> Iterator[None]:
        """Give errors that come out of the block the place of ``path``, unless they have a more exact one."""
        try:
            yield
        except PinarmError as error:
            raise error.at(self.locate(path)) from error.__cause__

    def override(self, assignment: str) -> Document:
        """Return the document with one value replaced, as ``--set problem.time.end='3 s'`` asks.

        Raises:
            InputError: The text is no assignment, or its path does not lead into the document.
        """
        name, equals, text = assignment.partition("=")
        option = Location(f"--set {assignment}")
        if not equals or not name.strip():
            raise InputError("this is no assignment", expected="path.to.key=value").at(option)
        value, _ = _Builder(text, option.source).build()
        data, node = (copied := _copy(self.data)), None
        path: Path_ = ()
        *parents, last = name.strip().split(".")
        for key in parents:
            node = _step(data, key, option, create=True)
            data, path = data[node], (*path, node)
        node = _step(data, last, option, create=True)
        data[node] = value
        path = (*path, node)
        places = {at: place for at, place in self.places.items() if at[: len(path)] != path} | {path: option}
        return replace(self, data=copied, places=places)

    def validate(self, model: type[ModelT], *at: str | int) -> ModelT:
        """Validate the document, or the part of it at a path, as an input model.

        Raises:
            InputError: The first mistake, located, with what was expected.
        """
        data = self.data
        for key in at:
            data = data[key]
        with reading_from(self.path.parent if self.path else Path()):
            try:
                return msgspec.convert(data, model, dec_hook=convert)
            except msgspec.ValidationError as error:
                path = failing_path(error, data, model)
                place = self.locate((*at, *path, *unknown_key(error)))
                raise explain(error, data, path, model).at(place) from None


def _unreadable(path: Path, error: OSError | ValueError) -> InputError:
    if isinstance(error, FileNotFoundError):
        return InputError(f"there is no file {path}", hint=similar_file(path))
    return InputError(f"the file cannot be read ({getattr(error, 'strerror', None) or error})")


def _copy(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _copy(value) for key, value in data.items()}
    return [_copy(value) for value in data] if isinstance(data, list) else data


def _step(data: Any, key: str, option: Location, *, create: bool) -> str | int:
    """Return the key or index by which to step into ``data``; with ``create`` a missing key becomes an empty map."""
    if isinstance(data, list):
        if re.fullmatch(r"-?[0-9]{1,9}", key) and -len(data) <= int(key) < len(data):
            return int(key) % len(data)
        raise InputError(f"'{key}' is no index of this list", expected=f"0 to {len(data) - 1}").at(option)
    if not isinstance(data, dict):
        raise InputError(f"there is nothing below '{key}': a plain value stands there").at(option)
    if create:
        data.setdefault(key, {})
    return key


class _Builder:
    """Builds plain data from YAML events, without recursion."""

    def __init__(self, text: str, source: str) -> None:
        from ruamel.yaml import YAML

        self.text, self.source = text, source
        self.lines = text.splitlines()
        self.yaml = YAML(typ="safe", pure=True)
        self.places: dict[Path_, Location] = {}
        self.stack: list[tuple[Any, Path_, list[str]]] = []
        self.root: Any = None
        self.documents = 0

    def build(self) -> tuple[Any, dict[Path_, Location]]:
        from ruamel.yaml.error import MarkedYAMLError, YAMLError

        try:
            for event in self.yaml.parse(self.text):
                self._take(event)
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            problem = f"this is not YAML: {error.problem or error.context}"
            raise InputError(problem, hint=_yaml_hint(str(error.problem))).at(self._location(mark)) from None
        except (YAMLError, ValueError, RecursionError, AttributeError) as error:
            if isinstance(error, PinarmError):
                raise
            raise InputError(f"this is not YAML: {str(error).splitlines()[0]}").at(Location(self.source)) from None
        return self.root, self.places

    def _take(self, event: Any) -> None:
        name = type(event).__name__
        if name == "DocumentStartEvent":
            self.documents += 1
            if self.documents > 1 or event.version or event.tags:
                raise self._refuse(event, "this begins another document, or is a directive", "one document")
        if name == "AliasEvent" or getattr(event, "anchor", None):
            raise self._refuse(event, "anchors and aliases are not read", "write the value out")
        if name in ("ScalarEvent", "MappingStartEvent", "SequenceStartEvent") and getattr(event, "tag", None):
            raise self._refuse(event, "tags are not read", "remove the word that begins with '!'")
        if name == "MappingStartEvent":
            self._open({}, event)
        elif name == "SequenceStartEvent":
            self._open([], event)
        elif name in ("MappingEndEvent", "SequenceEndEvent"):
            self.stack.pop()
        elif name == "ScalarEvent":
            self._scalar(event)

    def _open(self, container: Any, event: Any) -> None:
        if len(self.stack) >= MAX_DEPTH:
            raise self._refuse(event, "the file is nested too deeply", f"at most {MAX_DEPTH} levels")
        path = self._put(container, event)
        self.stack.append((container, path, []))

    def _scalar(self, event: Any) -> None:
        if any("\ud800" <= c <= "\udfff" for c in event.value):
            raise self._refuse(event, "this holds half of a surrogate pair", "characters of Unicode")
        container, path, pending = self.stack[-1] if self.stack else (None, (), [])
        if isinstance(container, dict) and not pending:
            if event.value in container:
                first = self.places[(*path, event.value)].line
                raise self._refuse(event, f"the key '{event.value}' stands twice (first in line {first})", "remove one")
            pending.append(event.value)
            self.places[(*path, event.value)] = self._location(event.start_mark, len(event.value))
        else:
            self._put(self._value(event), event)

    def _put(self, value: Any, event: Any) -> Path_:
        """Add a value to the open container and return its path."""
        if not self.stack:
            self.root = value
            self.places[()] = self._location(event.start_mark)
            return ()
        container, path, pending = self.stack[-1]
        if isinstance(container, list):
            container.append(value)
            here = (*path, len(container) - 1)
            self.places[here] = self._location(event.start_mark, len(str(getattr(event, "value", " "))))
            return here
        if not pending:
            raise self._refuse(event, "a list or map cannot be a key", "a plain word as key")
        key = pending.pop()
        container[key] = value
        return (*path, key)

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


def _yaml_hint(problem: str) -> str:
    if "tab" in problem or "\\t" in problem:
        return "indent with spaces"
    if "mapping values are not allowed" in problem:
        return "a space after the colon, the right indentation, or quotes around text that holds a colon"
    return ""

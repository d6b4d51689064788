"""YAML documents with the location of every value, validation with located errors, and values that replace others.

Reading builds numbers, text, booleans, lists and maps only. Tags, anchors and aliases are refused, and depth and digits
are bounded: an untrusted file can neither run code nor occupy the reader for long.

Paths of keys such as ``problem.time.end`` are steps joined by dots, indices of lists included (``expect.0.rtol``), in
quotes where a key has a dot of its own: ``problem.motion."tcp.y".value`` leads below the key ``tcp.y``. Without quotes
a dot belongs to a key where the data have that key, and none that ends at the dot.

``{"problem.time.end": "3 s", "arguments.m_A": 0.2}`` and ``["problem.time.end=3 s", "arguments.m_A=0.2"]`` are the same
values. A value is what the file would have there; a list or a map replaces the whole that stood there. A bare number is
in SI. It is allowed where the file has an SI unit at that place (0.2 for a value in kg), or none. Where the file has
another unit (mm, deg, rpm) it is refused, since 200 might be meant in either.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from itertools import combinations
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from pinarm.errors import InputError, Key, Location, PinarmError, UnitError, within
from pinarm.input.roots import similar_file
from pinarm.input.units import read_quantity, unit
from pinarm.input.yaml.schema import InputStruct, Measured, convert, reading_from, with_types
from pinarm.input.yaml.validation_messages import explain, failing_path, unknown_key
from pinarm.records import ValueRecord, replace

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


MAX_BYTES = 1_000_000
"""Largest size of a file; a reader in Python needs about a minute for ten megabytes. Longer tables go in CSV files."""

_STEP = re.compile(r"""(?P<quote>["'])(?P<quoted>.*?)(?P=quote)(?=\.|$)|(?P<plain>[^."'][^.]*)(?=\.|$)""", re.DOTALL)

QUOTED = """keys that have dots in quotes, such as --set 'problem.motion."tcp.y".value=3 mm'"""
"""Hint for paths that lead elsewhere."""

SHOWN_KEYS, SHOWN_LETTERS = 5, 40
"""Keys that a message lists, and characters that it shows of a path."""

Values = Mapping[str, object] | Sequence[str]
"""Path -> value, or texts such as ``problem.time.end=3 s``."""

SHOWN = 120
"""Characters of a value that a message repeats."""

StructT = TypeVar("StructT", bound=InputStruct)
T = TypeVar("T")


class Document(ValueRecord, frozen=True):
    """A YAML file as plain data, with the location of every key and value; that of a list or map is its key's.

    Attributes:
        source: File name as the user gave it, for messages.
        path: The file; ``None`` for text.
        data: Content: maps, lists, text, numbers, booleans, ``None``.
        places: Path of keys and indices -> locations of the value and of its key.
    """

    source: str
    path: Path | None
    data: Any
    places: Places

    @classmethod
    def read(cls, path: Path, *, source: str | None = None) -> Document:
        name = source or str(path)
        try:
            if path.exists() and not path.is_file():  # a pipe would keep the reader waiting
                raise OSError(0, "it is not a regular file")
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
        data, places = _built(text, source)
        return cls(source, path, _copy(data), places)

    @classmethod
    def of_data(cls, data: Any, source: str) -> Document:
        """Return data built in Python as if they had been read; the location of a value is its path."""
        try:
            plain = plain_data(data)
        except InputError as error:
            raise error.at(_named(source, error.path)) from None
        return cls(source, None, plain, {path: (_named(source, path),) * 2 for path in _paths(plain)})

    def locate(self, path: Path_) -> Location:
        """Return the location of the value at a path, or of its nearest ancestor; a final ``Key`` asks for the key."""
        for length in range(len(path), -1, -1):
            if path[:length] in self.places:
                return self.places[path[:length]][length == len(path) > 0 and isinstance(path[-1], Key)]
        return Location(self.source)

    def written(self, path: Path_) -> str:
        """Return the text of the plain value at a path as written in the file; empty for data built in Python."""
        place = self.locate(path)
        return place.text[place.column - 1 : place.column - 1 + place.width] if place.line else ""

    @contextmanager
    def locating(self, *path: str | int) -> Iterator[None]:
        """Locate errors raised in the block at ``path``, unless they have a more exact location."""
        try:
            yield
        except PinarmError as error:
            raise error.at(self.locate((*path, *error.path))) from error.__cause__

    def with_each(self, key: str, values: Iterable[T], call: Callable[[T], object]) -> None:
        for index, value in enumerate(values):
            with self.locating(key, index):
                call(value)

    def assigned(self, name: str, value: Any, option: Location) -> Document:
        """Return the document with the value at a path (see ``steps_of``) replaced; missing keys are created."""
        holder = data = _copy(self.data)
        path = tuple(steps_of(name, data, option))
        for key in path[:-1]:
            if isinstance(holder, dict) and holder.get(key) is None:
                holder[key] = {}
            holder = holder[key]
        holder[path[-1]] = value
        made = {path[:k]: (option, option) for k in range(1, len(path))}
        kept = {at: place for at, place in self.places.items() if at[: len(path)] != path}
        return replace(self, data=data, places={**made, **kept, path: (option, option)})

    def part(self, key: str) -> Document:
        """Return the content below a key as a document."""
        places = {path[1:]: place for path, place in self.places.items() if path[:1] == (key,)}
        return replace(self, data=self.data[key], places=places)

    def merged(self, changes: Document) -> Document:
        """Return the document with values replaced by those of another document at the same paths."""
        data = _merged(self.data, changes.data, Location(changes.source))
        return replace(self, data=data, places={**self.places, **changes.places})

    def validate(self, struct: type[StructT], *at: str | int) -> StructT:
        """Validate the document, or its part at a path, as an input struct."""
        data = self.data
        for key in at:
            data = data[key]
        struct = with_types(struct, data) if isinstance(data, dict) else struct
        with reading_from(self.path.parent if self.path else Path()):
            try:
                return msgspec.convert(data, struct, dec_hook=convert)
            except msgspec.ValidationError as error:
                path = failing_path(error, data, struct)
                mistake = explain(error, data, path, struct, self.written((*at, *path)))
                place = self.locate((*at, *path, *map(Key, unknown_key(error)), *mistake.path))
                raise mistake.at(place) from None


@lru_cache(maxsize=32)
def _built(text: str, source: str) -> tuple[Any, Places]:
    """Read YAML text; cached, since reading can take longer than the run."""
    builder = Builder(text, source)
    return builder.build(), builder.places


def _unreadable(path: Path, error: OSError | ValueError) -> InputError:
    if isinstance(error, FileNotFoundError):
        return InputError(f"there is no file {path}", hint=similar_file(path))
    return InputError(f"the file cannot be read ({getattr(error, 'strerror', None) or error})")


def _copy(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _copy(value) for key, value in data.items()}
    return [_copy(value) for value in data] if isinstance(data, list) else data


def _paths(data: Any, at: Path_ = ()) -> Iterator[Path_]:
    yield at
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from _paths(value, (*at, key))


def _named(source: str, path: Path_) -> Location:
    return Location(f"{source}: {'.'.join(map(str, path))}" if path else source)


def plain_data(data: Any, depth: int = 0) -> Any:
    """Return data as a file would give them: of numpy's types and tuples, Python's numbers and lists."""
    if depth > MAX_DEPTH:
        raise InputError(NESTED, expected=LEVELS)
    if isinstance(data, np.ndarray | np.generic):
        return data.tolist()
    if isinstance(data, list | tuple):
        return [plain_data(value, depth + 1) for value in data]
    if isinstance(data, str | int | float | None):
        return data
    if isinstance(data, Path):
        return str(data)
    if not isinstance(data, Mapping):
        raise InputError(
            f"a value of type {type(data).__name__} is nothing that a file can hold",
            expected="text with a unit such as '30 deg', a number, a list, or a map",
        )
    plain = {}
    for key, value in data.items():
        with within(str(key)):
            plain[str(key)] = plain_data(value, depth + 1)
    return plain


def _merged(data: Any, changes: Any, place: Location) -> Any:
    if not isinstance(changes, dict) or not isinstance(data, dict | list):
        return changes
    merged: Any = data.copy()
    for key, value in changes.items():
        step: Any = _index(data, key, place) if isinstance(data, list) else key
        merged[step] = _merged(data.get(step) if isinstance(data, dict) else data[step], value, place)
    return merged


def steps_of(path: str, data: Any, place: Location) -> list[str | int]:
    """Return the keys and indices by which a path leads through data; keys that are not there stay as written."""
    parts, steps = _parts(path, place), list[str | int]()
    if len(parts) > MAX_DEPTH:
        raise InputError(f"the path '{path[:SHOWN_LETTERS]}...' has {len(parts)} steps", expected=LEVELS).at(place)
    while parts:
        if not isinstance(data, dict | list):
            message = f"'{parts[0][0]}' cannot be reached: the path leads through a plain value"
            raise InputError(message).at(place)
        count = 1 if isinstance(data, list) else _length(parts, data, steps, place)
        step: Any = ".".join(text for text, _ in parts[:count])
        if isinstance(data, list):
            step = _index(data, step, place)
        inner = data[step] if isinstance(data, list) else data.get(step)
        data, parts = {} if inner is None else inner, parts[count:]
        steps.append(step)
    return steps


def _index(data: list[Any], step: str, place: Location) -> int:
    if re.fullmatch(r"-?[0-9]{1,9}", step) and -len(data) <= int(step) < len(data):
        return int(step) % len(data)
    raise InputError(f"'{step}' is not an index of this list", expected=f"0 to {len(data) - 1}").at(place)


def argument_of(path: str) -> str:
    """Return the argument that a path such as ``arguments.m_A`` leads to; empty where it leads elsewhere."""
    first, *rest = (text for text, _ in _parts(path, Location(path)))
    return ".".join(rest) if first == "arguments" else ""


def joined(steps: Iterable[str | int]) -> str:
    """Return the path of steps, in quotes where they have dots."""
    return ".".join(f'"{step}"' if "." in str(step) else str(step) for step in steps)


def _parts(path: str, place: Location) -> list[tuple[str, bool]]:
    parts, end = list[tuple[str, bool]](), 0
    while match := _STEP.match(path, end):
        quoted = match["quote"] is not None
        parts.append((match["quoted"] if quoted else match["plain"], quoted))
        end = match.end() + 1
    if end != len(path) + 1:
        raise InputError(f"'{path[end:] or path}' is no path of keys", expected="path.to.key", hint=QUOTED).at(place)
    return parts


def _length(parts: list[tuple[str, bool]], data: dict[str, Any], before: list[str | int], place: Location) -> int:
    """Return the number of parts of a path that are its next key in a map."""
    (first, quoted), *rest = parts
    if quoted or first in data:
        return 1
    for count in range(2, len(parts) + 1):
        if ".".join(text for text, _ in parts[:count]) in data and not any(quoted for _, quoted in parts[:count]):
            return count
    if rest and (dotted := [str(key) for key in data if str(key).startswith(f"{first}.")]):
        raise InputError(
            f"there is no key '{first}' here, but keys that begin with it and a dot",
            expected=", ".join(joined([*before, key]) for key in dotted[:SHOWN_KEYS]),
            hint=QUOTED,
        ).at(place)
    return 1


def varied(document: Document, values: Values, declared: Callable[[str], str] = lambda path: "") -> Document:
    """Return a file with other values; ``declared`` knows the unit at a path where the file itself has none."""
    for path, value, place in _assignments(values):
        document = document.assigned(path, _with_unit(document, path, value, place, declared), place)
    return document


def require_apart(data: Any, values: Values, others: Iterable[str]) -> None:
    """Refuse values that lead to, or below, what other paths replace, and two of these paths that are the same."""
    replaced = [(other, steps_of(other, data, Location(other))) for other in others]
    for (first, start), (second, end) in combinations(replaced, 2):
        if start == end:
            raise InputError(f"'{first}' and '{second}' are one path, and varied twice", expected="each path once")
    for path, _, place in _assignments(values):
        steps = steps_of(path, data, place)
        for other, above in replaced:
            if steps[: len(above)] == above:
                raise InputError(
                    f"'{other}' is varied, and what is set there would have no effect",
                    expected="a path that is set or varied, not both",
                ).at(place)


def written_unit(data: Any, path: str) -> str:
    """Return the unit of the value at a path of plain data; empty where there is none."""
    value = value_at(data, path)
    try:
        measured = read_quantity(value)[1] if isinstance(value, str) else None
    except InputError:  # no quantity
        return ""
    return measured.text if measured else ""


def require_unit(value: Measured, known: str, path: str) -> None:
    """Refuse a number without a unit where the number at the path that it is meant for has one."""
    if value and value.unit is None and known not in ("", "1"):
        raise UnitError(
            f"'{value:g}' has no unit, and the number at '{path}' is in {known}",
            expected="a number with its unit",
            hint=f"{value:g} {known}",
        )


def value_at(data: Any, path: str) -> Any:
    """Return the value at a path of plain data; ``None`` where there is none."""
    try:
        for step in steps_of(path, data, Location(path)):
            data = data[step]
    except (InputError, KeyError):
        return None
    return data


def _assignments(values: Values) -> Iterator[tuple[str, Any, Location]]:
    if isinstance(values, Mapping):
        for path, value in values.items():
            place = Location(f"{path}={value}"[:SHOWN])
            if not isinstance(path, str) or not path.strip():
                raise InputError(f"the key {path!r} is no path", expected="text such as 'problem.time.end'").at(place)
            try:
                yield path.strip(), plain_data(value), place
            except InputError as error:
                raise error.at(place) from None
        return
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise InputError(
            f"other values are given as {str(values)[:SHOWN]!r}",
            expected="{'problem.time.end': '3 s'}, or ['problem.time.end=3 s']",
        )
    for text in values:
        name, equals, value = str(text).partition("=")
        option = Location(f"--set {text}")
        if not equals or not name.strip():
            raise InputError("this is not an assignment", expected="path.to.key=value").at(option)
        yield name.strip(), Document.parse(value, source=option.source).data, option


def _with_unit(document: Document, path: str, value: Any, place: Location, declared: Callable[[str], str]) -> Any:
    """Return a bare number with the SI unit in which the file has the value that it replaces; others as they are."""
    if isinstance(value, bool) or not isinstance(value, int | float) or value == 0:
        return value
    written = written_unit(document.data, path)
    text = written or declared(path)
    if not text or text == "1" != written:
        return value
    if unit(text).factor != 1.0:
        raise UnitError(
            f"{value!r} has no unit, and the value that it replaces is in {text}",
            expected="a number with its unit",
            hint=f"'{value!r} {text}'",
        ).at(place)
    return f"{value!r} {text}"

"""YAML documents with the location of every value, and validation with located errors."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from pinarm.errors import InputError, Key, Location, PinarmError, within
from pinarm.input.roots import similar_file
from pinarm.input.yaml.deferred import with_types
from pinarm.input.yaml.key_path import steps_of
from pinarm.input.yaml.parser import LEVELS, MAX_DEPTH, NESTED, Builder, Path_
from pinarm.input.yaml.schema import InputStruct, convert, reading_from
from pinarm.input.yaml.validation_messages import explain, failing_path, unknown_key
from pinarm.records import ValueRecord, replace

MAX_BYTES = 1_000_000
"""Largest size of a file; a reader in Python needs about a minute for ten megabytes. Longer tables go in CSV files."""


StructT = TypeVar("StructT", bound=InputStruct)
T = TypeVar("T")


class Document(ValueRecord, frozen=True):
    """A YAML file as plain data, with the location of every key and value; that of a list or map is its key's.

    Attributes:
        source: File name as the user gave it, for messages.
        path: The file; ``None`` for text.
        data: Content: maps, lists, text, numbers, booleans, ``None``.
        places: Path of keys and indices -> location of the value.
        keys: Path of keys and indices -> location of the key.
    """

    source: str
    path: Path | None
    data: Any
    places: Mapping[Path_, Location]
    keys: Mapping[Path_, Location]

    @classmethod
    def read(cls, path: Path, *, source: str | None = None) -> Document:
        """Read a file.

        Raises:
            InputError: The file is missing, too large, not UTF-8, or not the accepted subset of YAML.
        """
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
        """Read YAML text; see ``read``."""
        data, places, keys = _built(text, source)
        return cls(source, path, _copy(data), places, keys)

    @classmethod
    def of_data(cls, data: Any, source: str) -> Document:
        """Return data built in Python as if they had been read: maps, lists, text, numbers, arrays, ``None``.

        The location of a value is its path.

        Raises:
            InputError: Something else is among them.
        """
        try:
            plain = plain_data(data)
        except InputError as error:
            raise error.at(_named(source, error.path)) from None
        places = {path: _named(source, path) for path in _paths(plain)}
        return cls(source, None, plain, places, {path: place for path, place in places.items() if path})

    def locate(self, path: Path_) -> Location:
        """Return the location of the value at a path, or of its nearest ancestor; a final ``Key`` asks for the key."""
        if path and isinstance(path[-1], Key) and path in self.keys:
            return self.keys[path]
        for length in range(len(path), -1, -1):
            if path[:length] in self.places:
                return self.places[path[:length]]
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
        """Call a function with each of the values of a list, and locate its errors at them as ``locating`` does."""
        for index, value in enumerate(values):
            try:
                call(value)
            except PinarmError as error:
                raise error.at(self.locate((key, index, *error.path))) from error.__cause__

    def assigned(self, name: str, value: Any, option: Location) -> Document:
        """Return the document with the value at a path such as ``problem.time.end`` replaced.

        Args:
            name: The path, see ``key_path``; missing keys are created.
            value: Plain data.
            option: Location of the value, for messages.

        Raises:
            InputError: The path is not in the document.
        """
        holder = data = _copy(self.data)
        path: Path_ = ()
        *parents, last = steps_of(name, data, option)
        for key in parents:
            path = (*path, step_into(holder, key, option, create=True))
            holder = holder[path[-1]]
        path = (*path, step_into(holder, last, option, create=True))
        holder[path[-1]] = value
        made = {path[:k]: option for k in range(1, len(path))}
        places, keys = (
            made | {at: place for at, place in locations.items() if at[: len(path)] != path} | {path: option}
            for locations in (self.places, self.keys)
        )
        return replace(self, data=data, places=places, keys=keys)

    def part(self, key: str) -> Document:
        """Return the content below a key as a document."""
        places, keys = (
            {path[1:]: place for path, place in locations.items() if path[:1] == (key,)}
            for locations in (self.places, self.keys)
        )
        return replace(self, data=self.data[key], places=places, keys=keys)

    def merged(self, changes: Document) -> Document:
        """Return the document with values replaced by those of another document at the same paths.

        Raises:
            InputError: An index of a list does not exist.
        """
        data = _merged(self.data, changes.data, Location(changes.source))
        places, keys = {**self.places, **changes.places}, {**self.keys, **changes.keys}
        return replace(self, data=data, places=places, keys=keys)

    def validate(self, struct: type[StructT], *at: str | int) -> StructT:
        """Validate the document, or its part at a path, as an input struct.

        Raises:
            InputError: The first error, located, with what was expected.
        """
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
def _built(text: str, source: str) -> tuple[Any, Mapping[Path_, Location], Mapping[Path_, Location]]:
    """Read YAML text; cached, since reading can take longer than the run."""
    builder = Builder(text, source)
    return builder.build(), builder.places, builder.keys


def _unreadable(path: Path, error: OSError | ValueError) -> InputError:
    if isinstance(error, FileNotFoundError):
        return InputError(f"there is no file {path}", hint=similar_file(path))
    return InputError(f"the file cannot be read ({getattr(error, 'strerror', None) or error})")


def _copy(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _copy(value) for key, value in data.items()}
    return [_copy(value) for value in data] if isinstance(data, list) else data


def _paths(data: Any, at: Path_ = ()) -> Iterator[Path_]:
    """Yield the paths of data and of everything in them."""
    yield at
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from _paths(value, (*at, key))


def _named(source: str, path: Path_) -> Location:
    return Location(f"{source}: {'.'.join(map(str, path))}" if path else source)


def plain_data(data: Any, depth: int = 0) -> Any:
    """Return data as a file would give them: of numpy's types and tuples, Python's numbers and lists.

    Raises:
        InputError: They hold what no file can hold, or, as lists that hold themselves, too many levels.
    """
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
        raise InputError(f"a value of type {type(data).__name__} is nothing that a file can hold",
                         expected="text with a unit such as '30 deg', a number, a list, or a map")  # fmt: skip
    plain = {}
    for key, value in data.items():
        with within(str(key)):
            plain[str(key)] = plain_data(value, depth + 1)
    return plain


def _merged(data: Any, changes: Any, place: Location) -> Any:
    if not isinstance(changes, dict) or not isinstance(data, dict | list):
        return changes
    merged = data.copy()
    for key, value in changes.items():
        step: Any = step_into(data, key, place, create=False)
        inner = data.get(step) if isinstance(data, dict) else data[step]
        merged[step] = _merged(inner, value, place)
    return merged


def step_into(data: Any, key: str, option: Location, *, create: bool) -> str | int:
    """Return the key or index by which to step into ``data``; with ``create`` a missing key becomes an empty map."""
    if isinstance(data, list):
        if re.fullmatch(r"-?[0-9]{1,9}", key) and -len(data) <= int(key) < len(data):
            return int(key) % len(data)
        raise InputError(f"'{key}' is not an index of this list", expected=f"0 to {len(data) - 1}").at(option)
    if not isinstance(data, dict):
        raise InputError(f"'{key}' cannot be reached: the path leads through a plain value").at(option)
    if create:
        data.setdefault(key, {})
    return key

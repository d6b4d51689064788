"""Values that replace those of a file: a mapping in Python, ``key=value`` in the shell.

``{"problem.time.end": "3 s", "arguments.m_A": 0.2}`` and ``["problem.time.end=3 s", "arguments.m_A=0.2"]`` are the
same. Keys are paths, their steps joined by dots, indices of lists included (``expect.0.rtol``); steps that have dots
stand in quotes (``problem.motion."tcp.y".value``), which may be left out where the file has that key. A value is what
the file would have there: text with a unit, a number, a word, a list or a map, which replaces the whole that stood
there.

A bare number is in SI. It is allowed where the file has an SI unit at that place (0.2 for a value in kg), or none.
Where the file has another unit (mm, deg, rpm) it is refused, since 200 might be meant in either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

from pinarm.errors import InputError, Location, UnitError
from pinarm.input.units import read_quantity, unit
from pinarm.input.yaml.document import Document, plain_data, step_into
from pinarm.input.yaml.key_path import steps_of
from pinarm.input.yaml.schema import Measured

Values = Mapping[str, object] | Sequence[str]
"""Path -> value, or texts such as ``problem.time.end=3 s``."""

SHOWN = 120
"""Characters of a value that a message repeats."""


def varied(document: Document, values: Values, declared: Callable[[str], str] = lambda path: "") -> Document:
    """Return a file with other values; ``declared`` knows the unit at a path where the file itself has none.

    Raises:
        InputError: A path does not lead into the file, or a value is no plain data.
        UnitError: A number has no unit, and the value that it replaces is not in SI.
    """
    for path, value, place in _assignments(values):
        document = document.assigned(path, _with_unit(document, path, value, place, declared), place)
    return document


def require_apart(data: Any, values: Values, others: Iterable[str]) -> None:
    """Refuse values that lead to, or below, what other paths replace, and two of these paths that are the same."""
    replaced = [(other, steps_of(other, data, Location(other))) for other in others]
    for (first, one), (second, two) in combinations(replaced, 2):
        if one == two:
            raise InputError(f"'{first}' and '{second}' are one path, and varied twice", expected="each path once")
    for path, _, place in _assignments(values):
        steps = steps_of(path, data, place)
        for other, above in replaced:
            if steps[: len(above)] == above:
                raise InputError(f"'{other}' is varied, and what is set there would have no effect",
                                 expected="a path that is set or varied, not both").at(place)  # fmt: skip


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
        raise UnitError(f"'{value:g}' has no unit, and the number at '{path}' is in {known}",
                        expected="a number with its unit", hint=f"{value:g} {known}")  # fmt: skip


def value_at(data: Any, path: str) -> Any:
    """Return the value at a path of plain data; ``None`` where there is none."""
    try:
        for key in steps_of(path, data, Location(path)):
            data = data[step_into(data, key, Location(path), create=False)]
    except (InputError, KeyError):
        return None
    return data


def _assignments(values: Values) -> Iterator[tuple[str, Any, Location]]:
    """Yield path, value and the place of each, for messages."""
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
        raise InputError(f"other values are given as {str(values)[:SHOWN]!r}",
                         expected="{'problem.time.end': '3 s'}, or ['problem.time.end=3 s']")  # fmt: skip
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
        raise UnitError(f"{value!r} has no unit, and the value that it replaces is in {text}",
                        expected="a number with its unit", hint=f"'{value!r} {text}'").at(place)  # fmt: skip
    return f"{value!r} {text}"

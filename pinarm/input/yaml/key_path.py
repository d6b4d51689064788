"""Paths of keys such as ``problem.time.end``: steps joined by dots, in quotes where a key has a dot of its own.

``problem.motion."tcp.y".value`` leads below the key ``tcp.y``. Without quotes a dot belongs to a key where the data
have that key, and none that ends at the dot.
"""

from __future__ import annotations

import re
from typing import Any

from pinarm.errors import InputError, Location
from pinarm.input.yaml.parser import LEVELS, MAX_DEPTH

_STEP = re.compile(r"""(?P<quote>["'])(?P<quoted>.*?)(?P=quote)(?=\.|$)|(?P<plain>[^."'][^.]*)(?=\.|$)""", re.DOTALL)

QUOTED = """keys that have dots in quotes, such as --set 'problem.motion."tcp.y".value=3 mm'"""
"""Hint for paths that lead elsewhere."""

SHOWN, SHOWN_LETTERS = 5, 40
"""Keys that a message lists, and characters that it shows of a path."""


def steps_of(path: str, data: Any, place: Location) -> list[str]:
    """Return the keys and indices, as texts, by which a path leads through data.

    Args:
        path: The path.
        data: What it leads into; a step that does not exist stays as it is written.
        place: Of the path, for messages.

    Raises:
        InputError: A step is empty, there are too many, or the path ends in the middle of keys that have dots.
    """
    parts, steps = _parts(path, place), list[str]()
    if len(parts) > MAX_DEPTH:
        raise InputError(f"the path '{path[:SHOWN_LETTERS]}...' has {len(parts)} steps", expected=LEVELS).at(place)
    while parts:
        step, parts = _next(parts, data, steps, place)
        steps.append(step)
        data = _inner(data, step)
    return steps


def argument_of(path: str) -> str:
    """Return the argument that a path such as ``arguments.m_A`` leads to; empty where it leads elsewhere."""
    first, *rest = (text for text, _ in _parts(path, Location(path)))
    return ".".join(rest) if first == "arguments" else ""


def joined(steps: list[str]) -> str:
    """Return the path of steps, in quotes where they have dots."""
    return ".".join(f'"{step}"' if "." in step else step for step in steps)


def _parts(path: str, place: Location) -> list[tuple[str, bool]]:
    """Return the parts between the dots of a path, and whether each is in quotes."""
    parts, end = list[tuple[str, bool]](), 0
    while match := _STEP.match(path, end):
        quoted = match["quote"] is not None
        parts.append((match["quoted"] if quoted else match["plain"], quoted))
        end = match.end() + 1
    if end != len(path) + 1:
        raise InputError(f"'{path[end:] or path}' is no path of keys", expected="path.to.key", hint=QUOTED).at(place)
    return parts


def _next(
    parts: list[tuple[str, bool]], data: Any, before: list[str], place: Location
) -> tuple[str, list[tuple[str, bool]]]:
    """Return the first step of a path through data, and the parts behind it."""
    (first, quoted), *rest = parts
    if quoted or not isinstance(data, dict) or first in data:
        return first, rest
    for count in range(2, len(parts) + 1):
        joint = ".".join(text for text, _ in parts[:count])
        if joint in data and not any(quoted for _, quoted in parts[:count]):
            return joint, parts[count:]
    if rest and (dotted := [str(key) for key in data if str(key).startswith(f"{first}.")]):
        raise InputError(
            f"there is no key '{first}' here, but keys that begin with it and a dot",
            expected=", ".join(joined([*before, key]) for key in dotted[:SHOWN]),
            hint=QUOTED,
        ).at(place)
    return first, rest


def _inner(data: Any, step: str) -> Any:
    """Return the value at a step; ``None`` where there is none."""
    if isinstance(data, list):
        return data[int(step)] if re.fullmatch(r"-?[0-9]{1,9}", step) and -len(data) <= int(step) < len(data) else None
    return data.get(step) if isinstance(data, dict) else None

"""At which joints a scenario asks for forces: these are solved for, whatever holds them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

from pinarm.engine.mechanism import Mechanism
from pinarm.input.formulas.expressions import Expression

WORD = re.compile(r"[^\W\d][\w.]*")
JOINT, DRIVE, POINT = re.compile(r"\b(?:joint|coordinate)\."), re.compile(r"\bdrive\."), re.compile(r"\.")

MOTION = re.compile(r"(?:position|velocity|acceleration)\b")
"""What is asked of a joint and is no force."""


def requested_joints(texts: Iterable[str], symbols: Mapping[str, Expression], mechanism: Mechanism) -> set[str]:
    """Return the names of the joints whose effort, power or reaction is requested, or the torque of whose drive.

    Args:
        texts: Quantities, symbols and formulas.
        symbols: Those of the scenario, beside those of the mechanism.
        mechanism: The mechanism.
    """
    left, seen = list(texts), set[str]()
    while left:
        text = left.pop()
        if text in seen:
            continue
        seen.add(text)
        for word in WORD.findall(text):
            left += [known[word].text for known in (symbols, mechanism.symbols) if word in known]
    joints = {
        name for text in seen for name, rest in _asked(text, JOINT)
        if name in mechanism.joints and not MOTION.match(rest)
    }  # fmt: skip
    drives = {name for text in seen for name, _ in _asked(text, DRIVE)}
    return joints | {drive.coordinate for name, drive in mechanism.drives.items() if name in drives}


def _asked(text: str, family: re.Pattern[str]) -> Iterator[tuple[str, str]]:
    """Yield what may be a name behind the word of a family, with what follows behind a point: names may hold points."""
    for word in family.finditer(text):
        for point in POINT.finditer(text, word.end()):
            yield text[word.end() : point.start()], text[point.end() :]

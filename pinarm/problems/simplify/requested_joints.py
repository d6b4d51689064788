"""At which joints a scenario asks for forces: these are solved for, whatever holds them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from pinarm.engine.mechanism import Mechanism
from pinarm.input.formulas.expressions import Expression

WORD = re.compile(r"[^\W\d][\w.]*")


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
        name for name in mechanism.joints
        if any(re.search(rf"\b(joint|coordinate)\.{re.escape(name)}\.(?!{MOTION})", text) for text in seen)
    }  # fmt: skip
    return joints | {
        drive.coordinate for name, drive in mechanism.drives.items() if any(f"drive.{name}." in text for text in seen)
    }


MOTION = r"(position|velocity|acceleration)\b"
"""What is asked of a joint and is no force."""

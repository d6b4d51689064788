"""Files of results: written whole or not at all, and the same bytes for the same content."""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np


def write(path: Path, text: str) -> None:
    """Write through a file beside it, so that an interruption leaves the old file whole."""
    write_parts(path, [text.encode()])


def write_parts(path: Path, parts: Iterable[bytes]) -> None:
    """Write pieces one after the other; see ``write``."""
    draft = path.with_name(f".{path.name}.part")
    with open(draft, "wb") as stream:
        stream.writelines(parts)
    draft.replace(path)


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """Write an npz file whose bytes depend on the arrays only; any name will do."""
    draft = path.with_name(f".{path.name}.part")
    with zipfile.ZipFile(draft, "w") as archive:
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, array, allow_pickle=False)
    draft.replace(path)


_WORDS = frozenset(["true", "false", "null", "yes", "no", "on", "off", "y", "n"])
"""What some readers of YAML take for something else than text, in any case."""


def yaml_text(data: Any) -> str:
    """Return plain data as YAML, its keys in the order they have.

    By hand, since libraries take longer for it than a short scenario takes to be solved.
    """
    return "\n".join(_lines(data)) + "\n"


def _lines(data: Any) -> list[str]:
    """Return the lines of a value at the margin: of a map or a list one for each of what is in it, or more."""
    if not data or not isinstance(data, dict | list):
        return [_scalar(data)]
    if isinstance(data, list):
        return [f"{'  ' if k else '- '}{line}" for value in data for k, line in enumerate(_lines(value))]
    written = []
    for key, value in data.items():
        inner, name = _lines(value), _scalar(str(key))
        if value and isinstance(value, dict | list):
            margin = "  " if isinstance(value, dict) else ""
            written += [f"{name}:", *(margin + line for line in inner)]
        else:
            written.append(f"{name}: {inner[0]}")
    return written


def _scalar(value: Any) -> str:
    """Return text as it stands where every reader takes it for text, otherwise in quotes; and other values."""
    if isinstance(value, str):
        plain = re.fullmatch(r"[\w./-](?:[\w .,*/+()^=-]*[\w.)])?", value) and not re.match(r"-(\s|$)|[.-]*$", value)
        number = re.fullmatch(r"[-+]?\.?[0-9][\w.+-]*|[-+]?\.(inf|nan)", value, re.IGNORECASE)
        return value if plain and not number and value.lower() not in _WORDS else f'"{_escaped(value)}"'
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0.0 else "-.inf"
    return json.dumps(value)


def _escaped(text: str) -> str:
    named = {"\\": "\\\\", '"': '\\"'}
    return "".join(
        named.get(c) or (c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode()) for c in text
    )


def cell(text: str) -> str:
    """Return a cell of a CSV file; text that a spreadsheet would take for a formula gets an apostrophe before it."""
    safe = f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text
    return '"' + safe.replace('"', '""') + '"' if any(mark in safe for mark in ',"\n\r') else safe


def json_text(value: object) -> str:
    """Return plain data as JSON; numbers that are not finite become null, which JSON has a word for."""
    return json.dumps(_finite(value), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)

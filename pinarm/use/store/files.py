"""Contents of files of results: the same bytes for the same content."""

from __future__ import annotations

import io
import json
import math
import re
import zipfile
from collections.abc import Callable, Iterable, Mapping
from csv import reader, writer
from functools import cache
from pathlib import Path
from typing import IO, Any

import numpy as np

from pinarm.use.output import no_text
from pinarm.use.result.presentation import CsvForm


def write(path: Path, text: str) -> None:
    """Write a new file; what appears whole is the folder that it is written in (``whole_folder``)."""
    write_parts(path, [text.encode()])


def write_parts(path: Path, parts: Iterable[bytes]) -> None:
    """Write a new file of pieces one after the other."""
    with open(path, "xb") as stream:
        stream.writelines(parts)


def write_arrays(target: Path | IO[bytes], arrays: dict[str, Any]) -> None:
    """Write a new npz file, or one into a stream, whose bytes depend on the arrays only; any name will do."""
    with zipfile.ZipFile(target, "x") as archive:
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, array, allow_pickle=False)


def yaml_text(data: Any) -> str:
    """Return plain data as YAML, its keys in the order they have; every reader takes its texts for text.

    Raises:
        InputError: A text is none in Unicode, such as the name of a folder that is not UTF-8.
    """
    import yaml

    try:
        return str(yaml.dump(data, Dumper=_dumper(), sort_keys=False, allow_unicode=True, width=WIDTH))
    except UnicodeEncodeError as error:
        raise no_text(error) from None


@cache
def _dumper() -> Any:
    import yaml

    class Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
        """PyYAML knows YAML 1.1; this puts what later versions and other readers take for a number in quotes too."""

        ignore_aliases = staticmethod(lambda data: True)

    Dumper.add_implicit_resolver("!else", re.compile(SOMETHING_ELSE, re.IGNORECASE), None)
    return Dumper


WIDTH = 10**9
"""Lines are not folded."""

SOMETHING_ELSE = r"([-+]?\.?[0-9][\w.+-]*|y|n)$"
"""Text that some reader of YAML takes for a number or a truth value."""


def cell(text: str) -> str:
    """Return a cell of a CSV file; text that a spreadsheet would take for a formula gets an apostrophe before it."""
    safe = f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text
    return '"' + safe.replace('"', '""') + '"' if any(mark in safe for mark in ',"\n\r') else safe


def with_semicolons(part: bytes) -> bytes:
    """Return whole lines of CSV with semicolons between the cells and decimal commas; texts stay as they are."""
    text, lines = io.StringIO(newline=""), reader(io.StringIO(part.decode(), newline=""))
    writer(text, delimiter=";", lineterminator="\n").writerows(map(_with_commas, lines))
    return text.getvalue().encode()


def _with_commas(cells: list[str]) -> list[str]:
    return [cell.replace(".", ",") if NUMBER.fullmatch(cell) else cell for cell in cells]


NUMBER = re.compile(r"[-+]?\d+\.\d*(e[-+]?\d+)?")
"""A number with a decimal point in a cell."""

CSV_FORMS: Mapping[CsvForm, Callable[[bytes], bytes]] = {"commas": bytes, "semicolons": with_semicolons}
"""Key ``csv`` of a scenario -> what is done to files that have commas."""


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

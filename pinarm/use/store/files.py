"""Contents of files of results: the same bytes for the same content."""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.use.output import no_text
from pinarm.use.result.presentation import CsvForm


def write(path: Path, content: str | Iterable[bytes]) -> None:
    """Write a new file, of a text or piece by piece; what appears whole is its folder (``whole_folder``)."""
    with open(path, "xb") as stream:
        stream.writelines([content.encode()] if isinstance(content, str) else content)


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


MARKS: Mapping[CsvForm, tuple[str, str]] = {"commas": (",", "."), "semicolons": (";", ",")}
"""Key ``csv`` of a scenario -> what stands between cells, and the decimal mark."""


def csv_lines(
    headings: Sequence[str], blocks: Iterable[Array | Iterable[Sequence[str | float]]], form: CsvForm = "commas"
) -> Iterator[bytes]:
    """Yield a table as CSV, piece by piece: headings, then every number with as many digits as it needs.

    Read again the numbers are the same to the last bit. Text that a spreadsheet would take for a formula gets an
    apostrophe before it.

    Args:
        headings: Names of the columns, with units.
        blocks: Rows of texts and numbers, in arrays where all are numbers.
        form: How cells are separated.
    """
    between, mark = MARKS[form]

    def cell(x: str | float) -> str:
        if not isinstance(x, str):
            return repr(x).replace(".", mark)
        safe = f"'{x}" if x.startswith(("=", "+", "-", "@", "\t", "\r")) else x
        return '"' + safe.replace('"', '""') + '"' if any(sign in safe for sign in f'{between}"\n\r') else safe

    for block in chain([[headings]], blocks):
        if isinstance(block, np.ndarray) and np.isfinite(block).all():  # eight times as fast as Python's own
            lines = msgspec.json.encode(block.tolist())[2:-2].replace(b"],[", b"\n") + b"\n"
            yield lines if form == "commas" else lines.replace(b",", b";").replace(b".", b",")
        else:
            rows = block.tolist() if isinstance(block, np.ndarray) else block
            yield "".join(between.join(map(cell, row)) + "\n" for row in rows).encode()


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

"""The folder that a command writes to: what came of another scenario file is replaced only where the user names it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from pinarm.errors import InputError, printable
from pinarm.records import ValueRecord
from pinarm.use.output.manifest import PARTIAL, read_manifest

RESULTS = Path("results")
"""Where folders stand that the user does not name."""


class Destination(ValueRecord, frozen=True):
    """A folder to write to.

    Attributes:
        folder: The folder.
        remark: Why it is not the usual one, or whose files are replaced there; empty for neither.
    """

    folder: Path
    remark: str = ""

    def __str__(self) -> str:
        return printable(f"written to {self.folder}{self.remark and ', '}{self.remark}")


def destination(given: Path | None, scenario: Path, name: str, ending: str = "") -> Destination:
    """Return the folder for what comes of a scenario file.

    It is the one that the user names; else ``results/NAME``, or where that holds what came of another file the first of
    ``results/PARENT-NAME``, ``results/GRANDPARENT-PARENT-NAME`` ... that does not.

    Args:
        given: The folder that the user names.
        scenario: The scenario file.
        name: Name of the scenario.
        ending: Of the folder's name: ``-sweep``.

    Raises:
        InputError: All these folders hold what came of other files.
    """
    own = os.path.realpath(scenario)
    if given is not None:
        other = _other(given, own)
        return Destination(given, f"in place of {other}" if other else "")
    usual = RESULTS / f"{name}{ending}"
    other = _other(usual, own)
    if not other:
        return Destination(usual)
    said = f"{usual} holds {other}"
    for longer in _longer(Path(own), name):
        if not _other(folder := RESULTS / f"{longer}{ending}", own):
            return Destination(folder, f"as {said}")
    raise InputError(said, expected="a folder of its own", hint="another folder: -o DIR")


def _longer(scenario: Path, name: str) -> Iterator[str]:
    """Yield the name with that of the folder of the file before it, then of the one above that too ..."""
    above = scenario.parents[1:] if scenario.parent.name == name else scenario.parents
    for parent in above:
        if parent.name:
            name = f"{parent.name}-{name}"
            yield name


def _other(folder: Path, own: str) -> str:
    """Return in words what a folder holds that did not come of this file; empty for nothing."""
    for home in (folder, folder / PARTIAL):
        manifest = read_manifest(home)
        if manifest is not None:
            source = _path(home, manifest.source)
            known = f"the {manifest.kind} of {os.path.relpath(source)}" if source else f"a {manifest.kind} of no file"
            return "" if source == own else known
    return ""


def _path(home: Path, source: str) -> str:
    """Return the file that a manifest names, with no links on the way; empty where it names none."""
    try:
        return os.path.realpath(home / source) if source else ""
    except (OSError, ValueError):  # it has been changed by hand
        return ""

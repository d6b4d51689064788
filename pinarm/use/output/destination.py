"""The folder that a command writes to: what came of another scenario file is replaced only where the user names it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pinarm.errors import InputError, printable
from pinarm.records import ValueRecord
from pinarm.use.output.folder import claim_folder, release_folder, source_from
from pinarm.use.output.manifest import PARTIAL, read_manifest

RESULTS = Path("results")
"""Where folders stand that the user does not name."""


ENDINGS = {"result": "", "sweep": "-sweep", "trade-off": "-tradeoff"}
"""What is written -> how the names of its folders end."""


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


@contextmanager
def destination(given: Path | None, scenario: Path, name: str, kind: str = "result") -> Iterator[Destination]:
    """Yield the folder for what comes of a scenario file, which no other file takes meanwhile.

    It is the one that the user names; else ``results/NAME``, or where that holds what came of another file the first of
    ``results/PARENT-NAME``, ``results/GRANDPARENT-PARENT-NAME`` ... that does not. A new folder is made at once, with a
    manifest that says whose it is, and removed where nothing has been written to it in the block.

    Args:
        given: The folder that the user names.
        scenario: The scenario file.
        name: Name of the scenario.
        kind: What is written: a key of ``ENDINGS``.

    Raises:
        InputError: All these folders hold what came of other files, or none can be made, or the name of the scenario
            file is no text.
    """
    own = os.path.realpath(scenario)
    if given is not None:
        source_from(given, scenario)  # what cannot be written down is told before the work
        other = _other(given, own)
        yield Destination(given, f"in place of {other}" if other else "")
        return
    found = _free(own, name, kind)
    try:
        yield found
    finally:
        release_folder(found.folder)


def _free(own: str, name: str, kind: str) -> Destination:
    """Return the first folder that no other file has taken, made where there was none; see ``destination``.

    Raises:
        InputError: All are taken.
    """
    said = ""
    for longer in (name, *_longer(Path(own), name)):
        folder = RESULTS / f"{longer}{ENDINGS[kind]}"
        claimed = claim_folder(folder, kind, Path(own))
        other = "" if claimed else _other(folder, own)
        if not other:
            return Destination(folder, said and f"as {said}")
        said = said or f"{folder} holds {other}"
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

"""What a sweep has finished, in a file that is only ever added to, so that an interrupted sweep goes on.

A line of JSON is a set of files with the digests of their contents, or a case: the digest of everything else that
determines its numbers, the set of files that it refers to, and its row. A case is known where both are as they were. A
last line that was cut short is passed over.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pinarm.errors import InputError
from pinarm.use.study.sweep.axes import Value
from pinarm.use.study.sweep.cases import Row, Task

JOURNAL = "journal.jsonl"
"""Its name in the folder of a sweep."""

SYNC = 1.0
"""Seconds after which lines are forced to the disk: what a power failure may cost."""


def digest(data: object) -> str:
    """Return a digest of plain data."""
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()[:32]


def task_digest(task: Task) -> str:
    """Return a digest of all that determines the numbers of a sweep, but for its files and the values of its cases.

    The code of this program is part of it.
    """
    import pinocchio

    import pinarm

    relevant = {key: value for key, value in task.document.data.items() if key not in ("expect", "title")}
    package = Path(pinarm.__file__).parent
    code = [hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(package.rglob("*.py"))]
    wanted = [(entry.quantity, entry.at, entry.of) for entry in task.wanted]
    versions = [pinocchio.__version__, np.__version__]
    return digest([relevant, str(task.folder.resolve()), wanted, code, versions])


class Sources:
    """The files that cases refer to, held to be the same for as long as a sweep runs."""

    def __init__(self) -> None:
        self.stamps: dict[str, tuple[int, int] | None] = {}
        self.sets: dict[tuple[str, ...], str] = {}

    def check(self, files: tuple[str, ...]) -> None:
        """Raise where a file has changed since a case first referred to it.

        Raises:
            InputError: One has.
        """
        for file in files:
            stamp = _stamp(file)
            if self.stamps.setdefault(file, stamp) != stamp:
                hint = "the same command again: it solves anew what the old file was used for"
                raise InputError(f"the file {file} has changed while the sweep ran", hint=hint)

    def content(self, files: tuple[str, ...]) -> dict[str, str]:
        """Return the digests of what is in files; empty for one that does not exist."""
        return {file: hashlib.sha256(Path(file).read_bytes()).hexdigest() if _stamp(file) else "" for file in files}


def _stamp(file: str) -> tuple[int, int] | None:
    try:
        state = os.stat(file)
    except OSError:
        return None
    return state.st_mtime_ns, state.st_size


class Journal:
    """An open journal.

    Args:
        path: The file, which need not exist.
        task: The digest of the sweep's task.

    Raises:
        InputError: It cannot be written, or another sweep is writing it.
    """

    def __init__(self, path: Path, task: str) -> None:
        self.task, self.synced, self.sets = task, time.monotonic(), dict[tuple[str, ...], str]()
        try:
            self.file = open(path, "a+b", buffering=0)  # noqa: SIM115  (closed by close)
        except OSError as error:
            raise InputError(f"the journal {path} cannot be written ({error.strerror})") from None
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.file.close()
            raise InputError(f"another sweep is writing to {path.parent}", expected="a folder of its own") from None
        except OSError:
            pass  # there are file systems without locks
        self.offsets = self._read()

    def _read(self) -> dict[str, int]:
        """Return where the cases stand that are known and whose files are as they were."""
        sources, sets, offsets, position = Sources(), dict[str, bool](), dict[str, int](), 0
        self.file.seek(0)
        with open(self.file.fileno(), "rb", closefd=False) as lines:
            for line in lines:
                entry = _entry(line)
                if "files" in entry:
                    sets[entry["set"]] = sources.content(tuple(entry["files"])) == entry["files"]
                elif sets.get(entry.get("set", "")):
                    offsets[entry["case"]] = position
                position += len(line)
        if position and not line.endswith(b"\n"):
            self.file.write(b"\n")
        return offsets

    def key(self, values: Mapping[str, Value]) -> str:
        """Return the digest of a case."""
        return digest([self.task, dict(values)])

    def row(self, key: str) -> Row | None:
        """Return the row of a case that is known."""
        if key not in self.offsets:
            return None
        with open(self.file.fileno(), "rb", closefd=False) as lines:
            lines.seek(self.offsets[key])
            entry = _entry(lines.readline())
        return Row(tuple(np.nan if number is None else number for number in entry["numbers"]), entry["error"])

    def add(self, key: str, row: Row, sources: Sources) -> None:
        """Write down a case that is finished."""
        if row.files not in self.sets:
            content = sources.content(row.files)
            self.sets[row.files] = digest(content)
            self._write({"set": self.sets[row.files], "files": content})
        numbers = [number if np.isfinite(number) else None for number in row.numbers]
        self._write({"case": key, "set": self.sets[row.files], "numbers": numbers, "error": row.error})
        if time.monotonic() - self.synced > SYNC:
            os.fsync(self.file.fileno())
            self.synced = time.monotonic()

    def _write(self, entry: dict[str, Any]) -> None:
        self.file.write(json.dumps(entry).encode() + b"\n")

    def close(self) -> None:
        """Force what was written to the disk."""
        os.fsync(self.file.fileno())
        self.file.close()


def _entry(line: bytes) -> dict[str, Any]:
    """Return what a line says; nothing where it was cut short."""
    try:
        entry = json.loads(line)
    except ValueError:
        return {}
    return entry if isinstance(entry, dict) else {}

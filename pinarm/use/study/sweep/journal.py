"""Journal of a sweep: the rows of solved cases, in a file that is only added to, so that an interrupted sweep goes on.

The first line says what the file is. Each further line of JSON is a set of files with the digests of their contents, or
a case: the digest of everything else that determines its numbers, the set of files that it refers to, and its row. A
case is known where both are as they were. A line that was cut short, changed, or is no such entry is passed over, and
its case solved again.
"""

from __future__ import annotations

import fcntl
import hashlib
import io
import json
import os
import pickle
import secrets
import stat
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote_to_bytes

import msgspec
import numpy as np

from pinarm.errors import InputError, PinarmError
from pinarm.input.roots import Stamp, stamp_of
from pinarm.input.yaml.schema import plain
from pinarm.mechanics.control.function import FunctionControl
from pinarm.problems.forward import Forward
from pinarm.records import replace
from pinarm.use.cases.case import Row, Task, Value
from pinarm.use.workers.worker import file_digest, versions

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.scenario.scenario import ScenarioSource

JOURNAL = "journal.jsonl"
"""Its name in the folder of a sweep."""

HEAD = b'{"journal": "pinarm sweep", "format": 1}\n'
"""Its first line."""

MOST_LINE = 10_000_000
"""Bytes of a line: a hundred times those of a row of a thousand numbers."""

PLAIN = json.JSONEncoder(sort_keys=True, default=str)
"""Writes plain data in one way only."""

SYNC = 1.0
"""Seconds after which lines are forced to the disk: what a power failure may cost."""


def digest(data: object) -> str:
    """Return a digest of plain data."""
    return hashlib.sha256(PLAIN.encode(data).encode()).hexdigest()[:32]


def task_digest(task: Task) -> str:
    """Return a digest of all that determines the numbers of a sweep, but for its files and the values of its cases.

    The code of this program is part of it, a mechanism that was given in Python, and where loops may be closed from the
    anchors of the task, these too.
    """
    relevant = {key: value for key, value in task.source.document.data.items() if key not in ("expect", "title")}
    anchors = [dict(anchor) for anchor in task.anchors] if _depends_on_anchors(task) else []
    wanted = [repr(entry) for entry in task.wanted]
    given = identity(task.source)
    return digest([relevant, str(task.source.folder.resolve()), given, wanted, anchors, versions()])


def _depends_on_anchors(task: Task) -> bool:
    """Tell whether the last digits of a case may depend on the anchors: see ``Task``."""
    try:
        scenario = task.source.scenario()
        return bool(scenario.mechanism.closure.size) and not isinstance(scenario.problem, Forward)
    except PinarmError:  # cases change what is wrong with it
        return True


class Sources:
    """The files that cases refer to, held to be the same for as long as a sweep runs."""

    def __init__(self) -> None:
        self.stamps: dict[str, Stamp | None] = {}
        self.checked: tuple[str, ...] = ()

    def check(self, files: tuple[str, ...]) -> None:
        """Raise where a file has changed since a case first referred to it.

        What a worker answers at once was solved before any of it is looked at: its cases share one tuple of files,
        which is looked at once.

        Raises:
            InputError: One has.
        """
        if files is self.checked:
            return
        self.checked = files
        for file in files:
            stamp = _stamp(file)
            if self.stamps.setdefault(file, stamp) != stamp:
                hint = "the same command again: it solves anew what the old file was used for"
                raise InputError(f"the file {file} has changed while the sweep ran", hint=hint)

    def content(self, files: tuple[str, ...]) -> dict[str, str]:
        """Return the digests of what is in files; empty for what is no file that a case could refer to."""
        return {file: file_digest(file) for file in files}


def _stamp(file: str) -> Stamp | None:
    try:
        return stamp_of(os.stat(file))
    except (OSError, ValueError):
        return None


class JournalEntry(msgspec.Struct, frozen=True, omit_defaults=True):
    """A line.

    Attributes:
        set: Digest of a set of files.
        files: Its files, with the digests of their contents; of a line that is a case, nothing.
        case: Digest of a case.
        numbers: Its row; null in the file for numbers that are not finite.
        error: Why it failed.
        seal: Digest of the other fields, so that a line that was changed is known.
    """

    set: str
    files: dict[str, str] | None = None
    case: str = ""
    numbers: tuple[float | None, ...] = ()
    error: str = ""
    seal: str = ""

    @property
    def proper_seal(self) -> str:
        """The seal of what it says."""
        return _seal(msgspec.json.encode(replace(self, seal="")))


class _Positions:
    """Where cases stand in a journal; of a case that stands twice, the last one.

    Args:
        places: Short digest of a case -> position, as often as one stands there.
    """

    def __init__(self, places: Iterable[tuple[int, int]]) -> None:
        both = np.fromiter(places, np.dtype((np.uint64, 2)))
        order = np.argsort(both[:, 0], kind="stable")
        self._digests, self._positions = both[order].T

    def __len__(self) -> int:
        return len(self._digests)

    def of(self, key: str) -> int | None:
        """Return the position of a case, or of another one of the same short digest."""
        if not len(self):
            return None
        place = int(np.searchsorted(self._digests, np.uint64(_short(key)), side="right")) - 1
        return int(self._positions[place]) if place >= 0 and self._digests[place] == _short(key) else None


def _short(key: str) -> int:
    return int.from_bytes(hashlib.blake2b(key.encode(), digest_size=8).digest(), "big")


class Journal:
    """An open journal.

    Args:
        path: The file, which need not exist.
        task: The digest of the sweep's task.
        width: How many numbers the row of a case has.

    Raises:
        InputError: It cannot be written, is no journal, or another sweep is writing it.
    """

    def __init__(self, path: Path, task: str, width: int) -> None:
        self.path, self.task, self.width = path, task, width
        self.synced, self.sets = time.monotonic(), dict[tuple[str, ...], str]()
        try:
            flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
            self.file = open(os.open(path, flags, 0o666), "a+b", buffering=0)  # noqa: SIM115  (closed by close)
        except (OSError, ValueError) as error:
            said = "it is a symbolic link" if path.is_symlink() else getattr(error, "strerror", None) or str(error)
            raise InputError(f"the journal {path} cannot be written ({said})") from None
        try:
            self._lock()
            self.positions = _Positions(self._read())
        except BaseException:
            self.file.close()
            raise

    def _lock(self) -> None:
        if not stat.S_ISREG(os.fstat(self.file.fileno()).st_mode):
            raise InputError(f"the journal {self.path} is no regular file", hint="another folder: -o DIR")
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"another sweep is writing to {self.path.parent}", expected="a folder of its own"
            ) from None
        except OSError:
            pass  # there are file systems without locks

    def _begin(self) -> None:
        """Write the first line, or raise where a file of somebody else has another."""
        self.file.seek(0)
        first = self.file.read(len(HEAD)) or b""
        if first != HEAD and HEAD.startswith(first):  # new, or cut short
            self.file.truncate(0)
            self._append(HEAD)
        elif first != HEAD:
            raise InputError(f"{self.path} is no journal of a sweep", hint="another folder: -o DIR, or move it away")

    def _read(self) -> Iterator[tuple[int, int]]:
        """Yield where the cases stand that are known and whose files are as they were."""
        sources, sets, position = Sources(), dict[str, bool](), len(HEAD)
        self._begin()
        line = HEAD
        with open(self.file.fileno(), "rb", closefd=False) as lines:
            lines.seek(position)
            while line := lines.readline(MOST_LINE):
                entry = _entry(line)
                if entry and entry.files is not None:
                    names = tuple(os.fsdecode(unquote_to_bytes(name)) for name in entry.files)
                    sets[entry.set] = _quoted(sources.content(names)) == entry.files
                elif entry and sets.get(entry.set) and len(entry.numbers) == (0 if entry.error else self.width):
                    yield _short(entry.case), position
                position += len(line)
        self.file.seek(-1, os.SEEK_END)
        if self.file.read(1) != b"\n":
            self._append(b"\n")

    def key(self, values: Mapping[str, Value]) -> str:
        """Return the digest of a case."""
        return digest([self.task, dict(values)])

    def row(self, key: str) -> Row | None:
        """Return the row of a case that is known."""
        position = self.positions.of(key)
        if position is None:
            return None
        with open(self.file.fileno(), "rb", closefd=False) as lines:
            lines.seek(position)
            entry = _entry(lines.readline(MOST_LINE))
        if entry is None or entry.case != key:
            return None
        return Row(tuple(np.nan if number is None else number for number in entry.numbers), entry.error)

    def add(self, cases: Iterable[tuple[str, Row]], sources: Sources) -> None:
        """Write down cases that are finished, by their digests.

        Raises:
            InputError: There is no room for them.
        """
        lines = list[bytes]()
        for key, row in cases:
            if row.files not in self.sets:
                content = _quoted(sources.content(row.files))
                self.sets[row.files] = digest(content)
                lines.append(_line(JournalEntry(self.sets[row.files], content)))
            numbers = tuple(map(float, row.numbers))
            lines.append(_line(JournalEntry(self.sets[row.files], case=key, numbers=numbers, error=row.error)))
        self._append(b"".join(lines))
        if time.monotonic() - self.synced > SYNC:
            os.fsync(self.file.fileno())
            self.synced = time.monotonic()

    def _append(self, line: bytes) -> None:
        try:
            while line:
                line = line[self.file.write(line) :]
        except OSError as error:
            hint = "the same command again, when there is room: it goes on from there"
            raise InputError(f"the journal {self.path} cannot be written ({error.strerror})", hint=hint) from None

    def close(self) -> None:
        """Force what was written to the disk."""
        with suppress(OSError):
            os.fsync(self.file.fileno())
        self.file.close()


def _quoted(content: Mapping[str, str]) -> dict[str, str]:
    """Return digests by names that JSON can hold, which the system's need not be."""
    return {quote(os.fsencode(name), safe="/: "): found for name, found in content.items()}


def _seal(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]


def _line(entry: JournalEntry) -> bytes:
    """Return a line of an entry that has no seal yet; the seal is its last field."""
    content = msgspec.json.encode(entry)
    return b'%s,"seal":"%s"}\n' % (content[:-1], _seal(content).encode())


def _entry(line: bytes) -> JournalEntry | None:
    """Return what a line says; nothing where it was cut short or changed."""
    try:
        entry = msgspec.json.decode(line, type=JournalEntry)
        return entry if entry.seal == entry.proper_seal else None
    except (ValueError, RecursionError):
        return None


def identity(source: ScenarioSource) -> list[object]:
    """Return plain data that differ where the mechanism that a scenario was given in Python does.

    Functions in Python, whose code nothing tells, are never the same again.
    """
    acting = [*source.functions, *(source.given.control if source.given else ())]
    functions = [secrets.token_hex() for control in acting if isinstance(control, FunctionControl)]
    return [source.seed, functions or (_of_mechanism(source.given) if source.given else [])]


def _of_mechanism(mechanism: Mechanism) -> list[str]:
    """Return digests of what the file of a mechanism says, and of what was made of that, numbers of tables included."""
    described = msgspec.to_builtins(mechanism.description, enc_hook=plain)
    _, (_, fields) = mechanism.__reduce__()
    bytes_io = io.BytesIO()
    _Pickler(bytes_io, protocol=5).dump([fields[name] for name in fields if name not in ("description", "locate")])
    return [digest(described), hashlib.sha256(bytes_io.getvalue()).hexdigest()]


class _Pickler(pickle.Pickler):
    """Writes sets in the same order in every process."""

    def persistent_id(self, thing: Any) -> Any:
        return sorted(map(repr, thing)) if isinstance(thing, set | frozenset) else None

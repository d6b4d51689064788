"""Solution of the cases of a sweep: rows in the journal are taken from it, the other cases go to workers.

The journal is a file that is only added to, so that an interrupted sweep goes on. Its first line says what the file is.
Each further line of JSON is a set of files with the digests of their contents, or a case: the digest of everything else
that determines its numbers, the set of files that it refers to, and its row. A case is known where both are as they
were. A line that was cut short, or is no such entry, is passed over, and its case solved again.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import secrets
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote, unquote

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.roots import Stamp, stamp_of
from pinarm.input.units import DIMENSIONLESS
from pinarm.records import replace
from pinarm.use.cases.case import WORTH, Case, Row, Task
from pinarm.use.cases.solving import CaseSolver, row_of
from pinarm.use.output import check_replaceable, locks, reason
from pinarm.use.study.sweep.axes import Cases
from pinarm.use.workers.runners import Runners
from pinarm.use.workers.worker import LostJob, file_digest, versions

JOURNAL = "journal.jsonl"
"""Its name in the folder of a sweep."""

HEAD = b'{"journal": "pinarm sweep", "format": 1}\n'
"""Its first line."""

PLAIN = json.JSONEncoder(sort_keys=True, default=str)
"""Writes plain data in one way only."""


def digest(data: object) -> str:
    """Return a digest of plain data."""
    return hashlib.sha256(PLAIN.encode(data).encode()).hexdigest()[:32]


def task_digest(task: Task) -> str:
    """Return a digest of all that determines the numbers of a sweep, but for its files and the values of its cases.

    The code of this program is part of it. A mechanism or functions given in Python are never the same again.
    """
    source = task.source
    relevant = {key: value for key, value in source.document.data.items() if key not in ("expect", "title")}
    python = secrets.token_hex() if source.given or source.functions or source.function_forces else ""
    wanted, folder = [repr(entry) for entry in task.wanted], str(source.folder.resolve())
    return digest([relevant, folder, source.seed, python, wanted, versions()])


class JournalEntry(msgspec.Struct, frozen=True, omit_defaults=True):
    """A line.

    Attributes:
        set: Digest of a set of files.
        files: Its files, with the digests of their contents; nothing in the line of a case.
        case: Digest of a case.
        numbers: Its row; null in the file for numbers that are not finite.
        error: Why it failed.
    """

    set: str
    files: dict[str, str] | None = None
    case: str = ""
    numbers: tuple[float | None, ...] = ()
    error: str = ""


class Journal:
    """An open journal.

    Args:
        path: The file, which need not exist.
        task: The digest of the sweep's task.
        width: Length of the row of a case.
    """

    def __init__(self, path: Path, task: str, width: int) -> None:
        self.path, self.task, self.width = path, task, width
        self.sets = dict[tuple[str, ...], str]()
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise InputError(f"the journal {path} is no regular file", hint="another folder: -o DIR")
        try:
            self.file = open(path, "a+b", buffering=0)  # noqa: SIM115  (closed by close)
        except (OSError, ValueError) as error:
            raise self._unwritable(error) from None
        try:
            if not locks(self.file.fileno(), fcntl.LOCK_EX):
                raise InputError(f"another sweep is writing to {path.parent}", expected="a folder of its own")
            self._begin()
        except BaseException:
            self.file.close()
            raise

    def _begin(self) -> None:
        """Write the first line, or raise where a file of somebody else has another; end a line that was cut short."""
        self.file.seek(0)
        first = self.file.read(len(HEAD)) or b""
        if first != HEAD and HEAD.startswith(first):  # new, or cut short
            self.file.truncate(0)
            self._append(HEAD)
        elif first != HEAD:
            raise InputError(f"{self.path} is no journal of a sweep", hint="another folder: -o DIR, or move it away")
        self.file.seek(-1, os.SEEK_END)
        if self.file.read(1) != b"\n":
            self._append(b"\n")

    def rows(self) -> Iterator[tuple[str, Row]]:
        """Yield the cases that are known and whose files are as they were, by their digests."""
        sets = dict[str, bool]()
        with open(self.path, "rb") as lines:
            for entry in map(_entry, lines):
                if entry and entry.files is not None:
                    names = [unquote(name, errors="surrogateescape") for name in entry.files]
                    sets[entry.set] = _contents(names) == entry.files
                elif entry and sets.get(entry.set) and len(entry.numbers) == (0 if entry.error else self.width):
                    yield entry.case, Row(tuple(np.nan if x is None else x for x in entry.numbers), entry.error)

    def key(self, values: Case) -> str:
        """Return the digest of a case."""
        return digest([self.task, dict(values)])

    def add(self, cases: Iterable[tuple[str, Row]]) -> None:
        """Write down cases that are finished, by their digests."""
        lines = list[bytes]()
        for key, row in cases:
            if row.files not in self.sets:
                contents = _contents(row.files)
                self.sets[row.files] = digest(contents)
                lines.append(msgspec.json.encode(JournalEntry(self.sets[row.files], contents)))
            numbers = tuple(map(float, row.numbers))
            entry = JournalEntry(self.sets[row.files], case=key, numbers=numbers, error=row.error)
            lines.append(msgspec.json.encode(entry))
        self._append(b"".join(line + b"\n" for line in lines))

    def _append(self, line: bytes) -> None:
        try:
            while line:
                line = line[self.file.write(line) :]
        except OSError as error:
            raise self._unwritable(error) from None

    def _unwritable(self, error: Exception) -> InputError:
        hint = "the same command again, when there is room: it goes on from there"
        return InputError(f"the journal {self.path} cannot be written ({getattr(error, 'strerror', error)})", hint=hint)

    def close(self) -> None:
        """Close the file, which others may write then."""
        self.file.close()


def _contents(files: Iterable[str]) -> dict[str, str]:
    """Return the digests of the contents of files, by names that JSON can hold, which the system's need not be."""
    return {quote(name, safe="/: ", errors="surrogateescape"): file_digest(name) for name in files}


def _entry(line: bytes) -> JournalEntry | None:
    """Return the entry in a line; nothing where it was cut short or is none."""
    try:
        return msgspec.json.decode(line, type=JournalEntry)
    except (ValueError, RecursionError):
        return None


UNSOLVED = "not solved"

Progress = Callable[[int, int, int], None]
"""Called with how many cases are done, how many of them failed, and how many there are."""


@dataclass(eq=False)
class Solving:
    """The cases of a sweep while they are solved.

    Attributes:
        task: What is the same in all of them.
        cases: Their values.
        results: The columns of what is taken from them, still empty.
        errors: Case -> why it failed.
        stamps: Files that cases refer to, as they were at first.
        numbers: Rows of cases, NaN where there is none, shape (cases, columns).
        solved: Which cases are done, shape (cases,).
    """

    task: Task
    cases: Cases
    results: Sequence[Series]
    progress: Progress = lambda done, failed, total: None
    errors: dict[int, str] = field(default_factory=dict)
    stamps: dict[str, Stamp | None] = field(default_factory=dict)
    done: int = 0

    def __post_init__(self) -> None:
        self.named = [*self.results, *(Series(name, DIMENSIONLESS, np.zeros(0)) for name in WORTH)]
        self.solved = np.zeros(len(self.cases), bool)
        self.numbers: Array = np.full((len(self.cases), len(self.named)), np.nan)

    def run(self, runners: Runners, folder: Path | None = None) -> None:
        """Solve all cases; keep the journal in a folder, if there is one."""
        if folder is None:
            self._solve(runners, None)
            return
        check_replaceable(folder, "sweep", beside=(JOURNAL,))
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"the sweep cannot be written to {folder}: {reason(error)}") from None
        with closing(Journal(folder / JOURNAL, task_digest(self.task), len(self.named))) as journal:
            keys = dict[str, int]()
            for key, row in journal.rows():
                keys = keys or {journal.key(self.cases.values(case)): case for case in range(len(self.cases))}
                if (case := keys.get(key)) is not None and not self.solved[case]:
                    self.take(case, row)
            self._solve(runners, journal)

    def _solve(self, runners: Runners, journal: Journal | None) -> None:
        left = np.flatnonzero(~self.solved).tolist()
        with runners.answering(CaseSolver(self.task)) as answering:
            for jobs, answers in answering(map(self.cases.values, left)):
                self._take({left[number]: values for number, values in jobs}, answers, journal)

    def _take(self, cases: dict[int, Case], answers: Collection[Row | LostJob], journal: Journal | None) -> None:
        rows = [row_of(answer) for answer in answers]
        for files in {row.files for row in rows}:
            self.check(files)
        if journal:
            journal.add((journal.key(x), row) for x, row in zip(cases.values(), rows, strict=True) if row.final)
        for case, row in zip(cases, rows, strict=True):
            self.take(case, row)

    def check(self, files: Iterable[str]) -> None:
        """Raise where a file has changed since a case first referred to it."""
        for file in files:
            try:
                stamp = stamp_of(os.stat(file))
            except (OSError, ValueError):
                stamp = None
            if self.stamps.setdefault(file, stamp) != stamp:
                hint = "the same command again: it solves anew what the old file was used for"
                raise InputError(f"the file {file} has changed while the sweep ran", hint=hint)

    def take(self, case: int, row: Row) -> None:
        """Take the row of a case."""
        if row.error:
            self.errors[case] = row.error
        if row.numbers:
            self.numbers[case] = row.numbers
        self.solved[case] = True
        self.done += 1
        self.progress(self.done, len(self.errors), len(self.cases))

    def columns(self) -> list[Series]:
        """Return the columns with their numbers; measures that no case has are left out."""
        filled = [replace(series, values=self.numbers[:, k]) for k, series in enumerate(self.named)]
        return [series for series in filled if series.name not in WORTH or not np.isnan(series.values).all()]

    def failures(self) -> dict[int, str]:
        """Return why cases failed, in order, those that were not solved included."""
        unsolved = {int(case): UNSOLVED for case in np.flatnonzero(~self.solved)}
        return dict(sorted((self.errors | unsolved).items()))

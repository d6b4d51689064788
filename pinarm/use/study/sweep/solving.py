"""Solution of the cases of a sweep: rows in the journal are taken from it, the other cases go to workers."""

from __future__ import annotations

import mmap
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS
from pinarm.records import replace
from pinarm.use.cases.case import WORTH, Row, Task
from pinarm.use.cases.case_table import CaseTable, RowTable
from pinarm.use.cases.solving import CaseSolver
from pinarm.use.output.folder import check_replaceable, reason, signals_waiting
from pinarm.use.output.manifest import DRAFT
from pinarm.use.study.sweep.axes import Cases
from pinarm.use.study.sweep.journal import JOURNAL, Journal, Sources, task_digest
from pinarm.use.study.sweep.parquet import Parts
from pinarm.use.workers.runners import Runners
from pinarm.use.workers.worker import LostJob

UNSOLVED = "not solved"

BLOCK = 1 << 17
"""Numbers of a table that are written to the disk at once."""

Progress = Callable[[int, int, int], None]
"""Called with how many cases are done, how many of them failed, and how many there are."""


@dataclass(eq=False)
class Solving:
    """The cases of a sweep while they are solved.

    Attributes:
        task: What is the same in all of them.
        cases: Their values.
        results: The columns of what is taken from them, still empty.
        progress: Called after every case.
        streams: Whether parts of the table are written as Parquet as soon as their cases are done.
        sources: The files that cases refer to.
        errors: Case -> why it failed.
        numbers: Their rows, NaN where there is none, shape (cases, columns).
        solved: Which cases are done, shape (cases,).
        counted: Numbers of cases that were done, and that had failed, of which ``progress`` is still to be told.
    """

    task: Task
    cases: Cases
    results: Sequence[Series]
    progress: Progress = lambda done, failed, total: None
    streams: bool = False
    sources: Sources = field(default_factory=Sources)
    errors: dict[int, str] = field(default_factory=dict)
    done: int = 0

    def __post_init__(self) -> None:
        self.named = [*self.results, *(Series(name, DIMENSIONLESS, np.zeros(0)) for name in WORTH)]
        self.solved = np.zeros(len(self.cases), bool)
        self.numbers: Array = np.full((len(self.cases), len(self.named)), np.nan)
        self.parts: Parts | None = None
        self.counted: list[tuple[int, int]] = []

    def run(self, runners: Runners, folder: Path | None = None) -> None:
        """Solve all cases.

        Args:
            runners: Who solves them.
            folder: Where to keep the journal; ``None`` for none.

        Raises:
            InputError: The folder cannot be written, or a file changes on the way.
        """
        if folder is None:
            self._solve(runners, None)
            return
        check_replaceable(folder, "sweep", beside=(JOURNAL,))
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"the sweep cannot be written to {folder}: {reason(error)}") from None
        with closing(Journal(folder / JOURNAL, task_digest(self.task), len(self.named))) as journal:
            self.numbers = table_on_disk(len(self.cases), len(self.named), folder)
            if self.streams:
                self.parts = Parts(folder, self.cases, self._filled(), self.errors)
            self._solve(runners, journal)

    def _solve(self, runners: Runners, journal: Journal | None) -> None:
        with runners.answering(CaseSolver(self.task), self._written) as answering:
            for some, answers in answering(self._unknown(journal)):
                cases = np.array([case for _, case in some])
                with signals_waiting():  # so that what is in the journal is counted
                    if isinstance(answers, RowTable):
                        self._take_solved(cases, answers, journal)
                    else:
                        for case, answer in zip(cases.tolist(), answers, strict=True):
                            self._take_alone(case, answer, journal)
                self._tell()

    def _written(self, cases: list[int]) -> CaseTable:
        """Return cases as workers get them."""
        return self.cases.some(np.array(cases))

    def _unknown(self, journal: Journal | None) -> Iterator[int]:
        """Yield the cases that the journal does not know, and take the others from it."""
        for case in range(len(self.cases)):
            known = journal.row(journal.key(self.cases.values(case))) if journal and journal.positions else None
            if known is None:
                yield case
            else:
                self.take(case, known)
                self._tell()

    def _tell(self) -> None:
        """Tell of the cases that have been counted; it may take long, and signals do not wait for it."""
        total, counted = len(self.cases), self.counted
        self.counted = []
        for done, failed in counted:
            self.progress(done, failed, total)

    def _take_solved(self, cases: Indices, rows: RowTable, journal: Journal | None) -> None:
        """Take cases that were solved as one array."""
        self.sources.check(rows.files)
        if journal:
            journal.add(zip(map(journal.key, self.cases.some(cases)), rows, strict=True), self.sources)
        self.numbers[cases] = rows.numbers
        self._note(cases)

    def _take_alone(self, case: int, row: Row | LostJob, journal: Journal | None) -> None:
        """Take a case that was solved by itself, or was lost."""
        if isinstance(row, LostJob):
            row = Row((), row.reason, final=False)
        self.sources.check(row.files)
        if journal and row.final:
            journal.add([(journal.key(self.cases.values(case)), row)], self.sources)
        self.take(case, row)

    def take(self, case: int, row: Row) -> None:
        """Take the row of a case."""
        if row.error:
            self.errors[case] = row.error
        if row.numbers:
            self.numbers[case] = row.numbers
        self._note(np.array([case]))

    def _note(self, cases: Indices) -> None:
        """Note that cases are done."""
        self.solved[cases] = True
        for case in cases.tolist():
            self.done += 1
            if self.parts:
                self.parts.note(case)
            self.counted.append((self.done, len(self.errors)))

    def columns(self) -> list[Series]:
        """Return the columns with their numbers; measures that no case has are left out."""
        return [series for series in self._filled() if series.name not in WORTH or not np.isnan(series.values).all()]

    def _filled(self) -> list[Series]:
        return [replace(series, values=self.numbers[:, k]) for k, series in enumerate(self.named)]

    def failures(self) -> dict[int, str]:
        """Return why cases failed, in order, those that were not solved included."""
        unsolved = {int(case): UNSOLVED for case in np.flatnonzero(~self.solved)}
        return dict(sorted((self.errors | unsolved).items()))


def table_on_disk(rows: int, columns: int, folder: Path) -> Array:
    """Return a table that can be written, all NaN at first, shape (rows, columns), one column after the other.

    The system keeps as much of it in memory as there is room for. Its file has no name and goes with the table, however
    the process ends; its bytes are taken from the disk at once, as a full one could not be told later.

    Raises:
        InputError: There is no room for it, or its folder cannot be written.
    """
    block, left = np.full(BLOCK, np.nan), rows * columns
    try:
        with TemporaryFile(dir=folder, prefix=DRAFT) as file:
            for begin in range(0, left, BLOCK):
                file.write(block[: left - begin].tobytes())
            file.flush()
            mapped = mmap.mmap(file.fileno(), 8 * left)
    except OSError as error:
        raise InputError(f"a table of {rows} cases cannot be written in {folder}: {error.strerror}") from None
    return np.frombuffer(mapped).reshape(columns, rows).T

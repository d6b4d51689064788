"""Solution of the cases of a sweep: rows in the journal are taken from it, the other cases go to workers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS
from pinarm.records import replace
from pinarm.use.cases.case import WORTH, Row, Task
from pinarm.use.cases.case_table import CaseTable
from pinarm.use.cases.solving import CaseSolver
from pinarm.use.output import check_replaceable, reason
from pinarm.use.study.sweep.axes import Cases
from pinarm.use.study.sweep.journal import JOURNAL, Journal, Sources, task_digest
from pinarm.use.workers.runners import Runners
from pinarm.use.workers.worker import LostJob

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
        progress: Called after every case.
        sources: The files that cases refer to.
        errors: Case -> why it failed.
        done: Number of cases that are solved.
        numbers: Their rows, NaN where there is none, shape (cases, columns).
        solved: Which cases are done, shape (cases,).
    """

    task: Task
    cases: Cases
    results: Sequence[Series]
    progress: Progress = lambda done, failed, total: None
    sources: Sources = field(default_factory=Sources)
    errors: dict[int, str] = field(default_factory=dict)
    done: int = 0

    def __post_init__(self) -> None:
        self.named = [*self.results, *(Series(name, DIMENSIONLESS, np.zeros(0)) for name in WORTH)]
        self.solved = np.zeros(len(self.cases), bool)
        self.numbers: Array = np.full((len(self.cases), len(self.named)), np.nan)

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
            self._solve(runners, journal)

    def _solve(self, runners: Runners, journal: Journal | None) -> None:
        with runners.answering(CaseSolver(self.task), self._written) as answering:
            for jobs, answers in answering(self._unknown(journal)):
                self._take([case for _, case in jobs], answers, journal)

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

    def _take(self, cases: list[int], answers: Collection[Row | LostJob], journal: Journal | None) -> None:
        """Take the answers of cases, and write them to the journal."""
        rows = [Row((), row.reason, final=False) if isinstance(row, LostJob) else row for row in answers]
        for row in rows:
            self.sources.check(row.files)
        if journal:
            keys = map(journal.key, self._written(cases))
            journal.add((key, row) for key, row in zip(keys, rows, strict=True) if row.final)
        for case, row in zip(cases, rows, strict=True):
            self.take(case, row)

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

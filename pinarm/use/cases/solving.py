"""Cases given to whoever solves them: rows in the order of the cases, the same whoever it is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from pinarm.use.cases.case import Case, Row, Task
from pinarm.use.cases.together import CaseSolver
from pinarm.use.workers.runners import LostJob, Runners

SolveCases = Callable[[Iterable[Case]], Iterator[Row]]
"""Cases -> their rows, in their order, each solved when it is asked for or before."""


@contextmanager
def solving(task: Task, runners: Runners) -> Iterator[SolveCases]:
    """Yield what solves cases, as often as it is asked; workers end with the block.

    Args:
        task: What is the same in all cases.
        runners: Who solves them.
    """
    with runners.applying(CaseSolver(task)) as apply:

        def solve(cases: Iterable[Case]) -> Iterator[Row]:
            answers = apply(cases)
            return (Row((), each.reason, final=False) if isinstance(each, LostJob) else each for each in answers)

        yield solve

"""Who answers the jobs of a study: this process, processes of this machine, or the workers of an executor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeVar

from pinarm.errors import InputError
from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pinarm.use.workers.chunk_order import LostJob

TOGETHER = 1000
"""Jobs that a function which solves several at once is given at once in this process."""

JobT = TypeVar("JobT")
AnswerT = TypeVar("AnswerT")

Apply = Callable[[Iterable[JobT]], "Iterator[AnswerT | LostJob]"]
"""Jobs -> their answers, in their order; the answers are the same whoever gives them."""


MOST = 10_000
"""Most workers: each is a process with 60 MB of memory, here or on a cluster."""


def check_number(workers: int | None) -> None:
    """Raise where a number of workers is none.

    Raises:
        InputError: It is below 1, or above ``MOST``.
    """
    if workers is not None and not 1 <= workers <= MOST:
        said = f"{workers} workers solve nothing" if workers < 1 else f"{workers} workers are too many"
        raise InputError(said, expected="at least 1" if workers < 1 else f"at most {MOST}")


class Runners(ValueRecord, frozen=True):
    """Who answers jobs; nobody works before ``applying``, nor after it.

    Attributes:
        number: Of processes, or of the workers of the executor; ``None`` without an executor is this process.
        executor: Any of ``concurrent.futures``, which stays the caller's.
    """

    number: int | None = None
    executor: Executor | None = None

    def __post_init__(self) -> None:
        check_number(self.number)

    @contextmanager
    def applying(self, function: Callable[[JobT], AnswerT]) -> Iterator[Apply[JobT, AnswerT]]:
        """Yield what applies a function to jobs, as often as it is asked; workers end with the block.

        Args:
            function: Importable by its name, as is all that it holds; it may be ``Together``.

        Raises:
            InputError: A worker has other versions.
            NumericsError: Workers die one after the other, or there are none any more.
        """
        if self.number is None and self.executor is None:
            yield partial(_applied_here, function)
            return
        from pinarm.use.workers.choice import chosen_workers
        from pinarm.use.workers.distribute import Dispatch

        with closing(Dispatch(function, chosen_workers(self.number, self.executor))) as spread:
            yield spread.in_order


HERE = Runners()
"""This process."""


def _applied_here(function: Callable[[JobT], AnswerT], jobs: Iterable[JobT]) -> Iterator[Any]:
    """Yield the answers of jobs, which are solved when they are asked for, or with one before them."""
    from pinarm.use.workers.chunk_order import in_order
    from pinarm.use.workers.worker import Together

    if not isinstance(function, Together):
        yield from map(function, jobs)
        return
    left = iter(jobs)
    while some := list(islice(left, TOGETHER)):
        yield from in_order(function.together(some, lambda: False))

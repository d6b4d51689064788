"""Choice of who solves the jobs of a study: this process, processes of this machine, or an executor."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeVar

from pinarm.errors import InputError
from pinarm.records import ValueRecord
from pinarm.use.workers.worker import AnsweredPart, LostJob, answered_parts

if TYPE_CHECKING:
    from concurrent.futures import Executor


TOGETHER = 1000
"""Jobs that a function which solves several at once is given at once in this process."""

MOST = 10_000
"""Most workers: each is a process with 60 MB of memory, here or on a cluster."""

JobT = TypeVar("JobT")
AnswerT = TypeVar("AnswerT")

Apply = Callable[[Iterable[JobT]], Iterator[AnswerT | LostJob]]
"""Jobs -> their answers, in their order; the answers are the same whoever gives them."""

Answering = Callable[[Iterable[JobT]], Iterator[tuple[list[tuple[int, JobT]], Collection[AnswerT | LostJob]]]]
"""Jobs -> numbered jobs and their answers, as many as come together, in the order in which answers come."""


def check_number(workers: int | None) -> None:
    """Raise where a number of workers is none."""
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
    def answering(self, function: Callable[[JobT], AnswerT]) -> Iterator[Answering[JobT, AnswerT]]:
        """Yield a function from jobs to numbered answers, for any number of calls; workers end with the block.

        The function is importable by its name, as is all that it holds; see ``answered_parts``.
        """
        if self.number is None and self.executor is None:
            yield partial(_answers_here, function)
            return
        from pinarm.use.workers.dispatch import Dispatch, chosen_workers

        with closing(Dispatch(function, chosen_workers(self.number, self.executor))) as dispatch:
            yield dispatch.answers

    @contextmanager
    def applying(self, function: Callable[[JobT], AnswerT]) -> Iterator[Apply[JobT, AnswerT]]:
        """Yield a function from jobs to their answers, in the order of the jobs; see ``answering``."""
        with self.answering(function) as answers:

            def apply(jobs: Iterable[JobT]) -> Iterator[AnswerT | LostJob]:
                return in_order(([number for number, _ in some], told) for some, told in answers(jobs))

            yield apply


HERE = Runners()
"""This process."""


def _answers_here(
    function: Callable[[JobT], AnswerT], jobs: Iterable[JobT]
) -> Iterator[tuple[list[tuple[int, JobT]], Collection[Any]]]:
    """Yield the answers of jobs, which are solved when they are asked for, or with one before them."""
    left, size = enumerate(jobs), TOGETHER if hasattr(function, "together") else 1
    while some := list(islice(left, size)):
        for places, answers in answered_parts(function, [job for _, job in some]):
            yield [some[place] for place in places], answers


def in_order(parts: Iterable[AnsweredPart]) -> Iterator[Any]:
    """Yield answers in the order of their jobs, each as soon as all before it are there."""
    early, wanted = dict[int, Any](), 0
    for places, answers in parts:
        early |= zip(places, answers, strict=True)
        while wanted in early:
            yield early.pop(wanted)
            wanted += 1

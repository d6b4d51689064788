"""What a worker does: compare versions, keep the function and its files, and answer jobs until its time is up."""

from __future__ import annotations

import pickle
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol, runtime_checkable

from pinarm.errors import fault
from pinarm.input.roots import noting_files
from pinarm.use.workers.chunk_order import AnsweredPart, Answers, ChunkOrder, FilesLacking, LostJob, answered, unpacked
from pinarm.use.workers.travelling_files import Mirror, SharedFiles
from pinarm.use.workers.versions import versions

KEPT = 2
"""Sessions that a thread keeps its function and files of."""


def work(wanted: dict[str, str], order: bytes) -> bytes | dict[str, str]:
    """Return what a worker answers to an order, packed; its versions where they are not those that are wanted.

    Whatever runs it, a process, a thread or a machine elsewhere, needs to know nothing of earlier orders.

    Args:
        wanted: Versions of the process that gives the order, which is unpacked by the same only.
        order: An ``ChunkOrder``, pickled.
    """
    if wanted != versions():
        return versions()
    given: ChunkOrder = pickle.loads(order)
    session = _session(given)
    return answered(session.answer(given), session.files.prefix)


Late = Callable[[], bool]
"""Tells whether nothing is to be begun any more once there are answers."""


@runtime_checkable
class Together(Protocol):
    """A function of jobs that solves several of them at once."""

    def together(self, jobs: Any, late: Late) -> Iterator[AnsweredPart]:
        """Yield places of jobs and their answers, none of which raises; not of all jobs where it gets late."""


class _Session:
    """A function and its files, on a worker.

    Args:
        order: The first order of it.
    """

    def __init__(self, order: ChunkOrder) -> None:
        self.files: Mirror | SharedFiles = SharedFiles() if order.files is None else Mirror()
        self._packed = order.function
        self.function = unpacked(self._packed, self.files.prefix)

    def answer(self, order: ChunkOrder) -> Answers | FilesLacking:
        """Answer the jobs of an order until the time is up, or a file is wanted."""
        lacking = self.files.update(order.files or {}, order.contents)
        if lacking.digests:
            return lacking
        begin, parts = time.perf_counter(), list[AnsweredPart]()
        jobs = unpacked(order.jobs, self.files.prefix)

        def late() -> bool:
            return bool(parts) and time.perf_counter() - begin > order.budget

        together = self.function.together if isinstance(self.function, Together) else self._one_by_one
        coming = together(jobs, late)
        while True:
            with noting_files() as files:
                part = next(coming, None)
            if part is None:
                break
            lacking = self.files.unknown(files)
            if lacking.paths:
                self.function = unpacked(self._packed, self.files.prefix)  # without what it has learnt of its lack
                if not parts:
                    return lacking
                break
            parts.append(part)
        return Answers(parts, time.perf_counter() - begin)

    def _one_by_one(self, jobs: Iterable[Any], late: Late) -> Iterator[AnsweredPart]:
        for place, job in enumerate(jobs):
            if late():
                return
            yield [place], [self._answer_of(job)]

    def _answer_of(self, job: Any) -> Any:
        try:
            return self.function(job)
        except Exception as error:  # a fault of the program costs one job
            return LostJob(f"the program failed: {fault(error)}")


_kept = threading.local()
"""The sessions of a thread: what is built for a scenario serves one thread at a time."""


def _session(order: ChunkOrder) -> _Session:
    sessions: OrderedDict[str, _Session] = _kept.__dict__.setdefault("sessions", OrderedDict())
    if order.session not in sessions:
        sessions[order.session] = _Session(order)
        while len(sessions) > KEPT:
            sessions.popitem(last=False)
    sessions.move_to_end(order.session)
    return sessions[order.session]

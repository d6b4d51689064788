"""Jobs given to workers in chunks: each job is answered once, whatever happens to the workers.

A chunk takes a worker about ``CHUNK_TIME``, as measured of the chunks before. Jobs of a chunk with which a worker died
are tried again one by one, with nothing else under way: only a job that kills its worker alone is lost.
"""

from __future__ import annotations

import os
import pickle
import queue
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from functools import partial
from itertools import islice
from typing import Any, Generic, NamedTuple, TypeVar

from pinarm.errors import InputError, NumericsError
from pinarm.input.roots import given_access
from pinarm.use.workers.executors import WorkerDeath, Workers
from pinarm.use.workers.worker import Answers, LostJob, differences, file_digest, versions, work

CHUNK_TIME, TIME_PER_WORKER = 0.5, 0.005
"""Time of a chunk [s]: at least, and for each worker there is, so that answers come 200 times a second at most."""

GROWTH = 8
"""Largest size of a chunk relative to that of one that has been answered."""

HOPELESS = 10
"""Deaths of workers in a row, with no answer in between, after which the work is given up."""

PATIENCE = 5.0
"""Time without an answer after which workers are looked for [s]."""

JobT = TypeVar("JobT")
AnswerT = TypeVar("AnswerT")

NumberedJob = tuple[int, JobT]


class Chunk(NamedTuple):
    """Numbered jobs for one worker; ``alone`` after a death, where nothing else is to be under way."""

    jobs: list[NumberedJob[Any]]
    alone: bool = False


class Dispatch(Generic[JobT, AnswerT]):
    """Chunks of jobs under way.

    Args:
        function: Answers a job; importable by its name, as is all that it holds; see ``worker.answered_parts``.
        workers: Who calls it.
        written: Returns jobs as a worker gets them: a list of them, or what stands for it.
    """

    def __init__(
        self,
        function: Callable[[JobT], AnswerT],
        workers: Workers,
        written: Callable[[list[JobT]], Any] = list,
    ) -> None:
        self.workers, self.written = workers, written
        self.call = partial(work, versions(), os.urandom(16).hex(), pickle.dumps(function), given_access())
        self.jobs: Iterator[NumberedJob[JobT]] = iter(())
        self.size, self.deaths = 1, 0
        self.retries, self.given = deque[Chunk](), dict[Any, Chunk]()
        self.over, self.files = queue.SimpleQueue[Any](), dict[str, str]()

    def answers(self, jobs: Iterable[JobT]) -> Iterator[tuple[list[NumberedJob[JobT]], Collection[AnswerT | LostJob]]]:
        """Yield numbered jobs and their answers, as many as come together, in the order in which answers come.

        Args:
            jobs: Taken as they are needed. Those of a call before are all answered.

        Raises:
            InputError: A worker has other versions, or other files.
            NumericsError: Workers die one after the other, or there are none any more.
        """
        self.jobs = enumerate(jobs)
        self._hand_out()
        while self.given:
            yield from self._coming()
            self._hand_out()

    def close(self) -> None:
        """End the workers."""
        self.workers.close()

    def _hand_out(self) -> None:
        """Give workers as many chunks as they may have."""
        while len(self.given) < self._room() and (chunk := self._next()):
            future = self.workers.submit(*self._packed(chunk))
            self.given[future] = chunk
            future.add_done_callback(self.over.put)

    def _room(self) -> int:
        alone = bool(self.retries) or any(chunk.alone for chunk in self.given.values())
        return 1 if alone else self.workers.room()

    def _next(self) -> Chunk | None:
        if self.retries:
            return self.retries.popleft()
        jobs = [*islice(self.jobs, self.size)]
        return Chunk(jobs) if jobs else None

    def _packed(self, chunk: Chunk) -> tuple[Any, ...]:
        jobs = pickle.dumps(self.written([job for _, job in chunk.jobs]))
        return self.call.func, *self.call.args, jobs

    def _coming(self) -> Iterator[tuple[list[NumberedJob[JobT]], Collection[AnswerT | LostJob]]]:
        """Wait for a chunk, and yield its jobs with their answers."""
        try:
            future = self.over.get(timeout=PATIENCE)
        except queue.Empty:
            self.workers.require()
            return
        chunk = self.given.pop(future)
        try:
            answers = self.workers.result(future)
        except WorkerDeath as death:
            yield from self._lost(chunk, death)
            return
        self._check(answers)
        self.deaths, budget = 0, max(CHUNK_TIME, TIME_PER_WORKER * self.workers.count())
        fitting = int(budget * len(chunk.jobs) / max(answers.seconds, 1e-9))
        self.size = max(1, min(fitting, GROWTH * len(chunk.jobs)))
        self._hand_out()  # so that no worker waits until the answers are written down
        for places, some in answers.parts:
            yield [chunk.jobs[place] for place in places], some

    def _check(self, answers: Answers | dict[str, str]) -> None:
        """Raise where a worker has other versions, or sees other files.

        Raises:
            InputError: It has.
        """
        if isinstance(answers, dict):
            said = f"a worker has other programs: {differences(versions(), answers)}"
            expected = "the same versions everywhere, as the numbers depend on them"
            hint = f"pip install 'pinarm=={versions()['pinarm']}' and the rest there"
            raise InputError(said, expected=expected, hint=hint)
        for file, digest in answers.files.items():
            if self.files.setdefault(file, file_digest(file)) != digest:
                said = f"the file {file} is not the same for a worker as here, or has changed meanwhile"
                raise InputError(said, expected="files that all workers see", hint="a folder that all machines share")

    def _lost(self, chunk: Chunk, death: WorkerDeath) -> Iterator[tuple[list[NumberedJob[JobT]], list[LostJob]]]:
        """Try the jobs of a chunk with which a worker died one by one; give up a job that did so alone."""
        self.deaths += 1
        if self.deaths >= HOPELESS:
            raise NumericsError(f"{HOPELESS} workers died one after the other, the last by {death}")
        if chunk.alone:
            yield chunk.jobs, [LostJob(f"its process died by {death}")]
        else:
            self.retries += [Chunk([job], alone=True) for job in chunk.jobs]

"""Jobs spread over workers in chunks: each is answered once, whatever happens to the workers.

A chunk takes a worker about ``LEAST_TIME``, as measured of the jobs before; what a worker has not begun by then it
gives back, so that answers go on coming whatever a job takes. A chunk with which a worker dies is halved, so that only
a job that kills whoever works on it is lost.
"""

from __future__ import annotations

import math
import os
import pickle
import queue
import sys
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from concurrent.futures import Future
from contextlib import closing
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Any, Generic, Protocol, TypeVar

from pinarm.errors import InputError, NumericsError
from pinarm.records import replace
from pinarm.use.workers.chunk_order import Answers, ChunkOrder, FilesLacking, LostJob, in_order, packed, read_answer
from pinarm.use.workers.travelling_files import Parcel
from pinarm.use.workers.versions import differences, versions
from pinarm.use.workers.worker import work

LEAST_TIME, TIME_PER_WORKER = 0.2, 0.005
"""Time of a chunk [s]: at least, and for each worker there is, so that answers come 200 times a second at most."""

GROWTH = 8
"""Size of a chunk relative to the largest before, at most: one that is too large is given back, but had to travel."""

PAYS = 0.8
"""Time of a job in a chunk, relative to that in one of half the size, below which a larger chunk is tried."""

DEATHS = 3
"""Deaths of workers with one and the same job after which it is given up."""

HOPELESS = 10
"""Deaths in a row, with no answer in between, after which the work is given up."""

AHEAD = 100
"""Jobs that are looked at to see whether they are few."""

PATIENCE = 5.0
"""Time without an answer after which workers are looked for [s]."""

JobT = TypeVar("JobT")
AnswerT = TypeVar("AnswerT")

AnsweredJobs = tuple[list[tuple[int, JobT]], Collection[AnswerT | LostJob]]
"""Jobs, each with its number, and their answers."""


@dataclass(frozen=True)
class WorkerDeath:
    """The end of a worker that was not asked to end, with the chunk that it was at; ``reason`` says how it ended."""

    reason: str


@dataclass(frozen=True)
class NotBegun:
    """A chunk that waited for a worker which died with another one."""


Outcome = bytes | dict[str, str] | WorkerDeath | NotBegun
"""What comes of a chunk: what ``work`` returns, or why it returned nothing."""


class Workers(Protocol):
    """Whoever runs chunks."""

    @property
    def files(self) -> Parcel | None:
        """A parcel for the files that jobs refer to; ``None`` where workers see the files."""

    def count(self) -> int:
        """Return how many workers there are now."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Let a worker call a function."""

    def outcome(self, future: Future[Any]) -> Outcome:
        """Return what came of a call that is over.

        Raises:
            PinarmError: There are no workers any more.
        """

    def require(self) -> None:
        """Raise where there have been no workers for long.

        Raises:
            PinarmError: There have not.
        """

    def close(self) -> None:
        """End what has not ended yet."""


@dataclass(frozen=True)
class Chunk(Generic[JobT]):
    """Jobs for one worker.

    Attributes:
        jobs: The jobs, each with its number.
        deaths: How many workers have died with it, or with a chunk that it is a part of.
        contents: Digests of the files that are sent with it.
    """

    jobs: tuple[tuple[int, JobT], ...]
    deaths: int = 0
    contents: frozenset[str] = frozenset()

    @property
    def is_suspect(self) -> bool:
        """Whether it is one job that is given up with the next death."""
        return len(self.jobs) == 1 and self.deaths >= DEATHS - 1


@dataclass(eq=False)
class Pace:
    """How many jobs fill a chunk: as many as fit in its time, and as many as it pays to solve at once.

    Attributes:
        size: How many.
        largest: Jobs of the largest chunk so far.
        seconds: Time of a job of late [s].
        paying: Jobs of the largest chunk that took less time for each than half as many did, by ``PAYS``.
        least: Least time of a job in such a chunk [s].
    """

    size: int = 1
    largest: int = 1
    seconds: float = 0.0
    paying: int = 1
    least: float = math.inf

    def note(self, jobs: int, seconds: float, budget: float) -> None:
        """Note how long a chunk took; the next is at most ``GROWTH`` times as large as the largest before."""
        each = seconds / jobs
        self.seconds = min(each, 0.5 * (self.seconds + each)) if self.seconds else each  # the first ones load more
        if jobs >= 2 * self.paying and each < PAYS * self.least:
            self.paying, self.least = jobs, each
        elif jobs <= self.paying:
            self.least = min(self.least, each)
        self.largest = max(self.largest, jobs)
        fitting = min(GROWTH * self.largest, int(budget / max(self.seconds, 1e-9)))
        self.size = max(fitting, 2 * self.paying)


@dataclass(eq=False)
class Dispatch(Generic[JobT, AnswerT]):
    """The chunks that workers have of a function's jobs, and the jobs that are left.

    Attributes:
        function: Importable by its name, as is all that it holds.
        workers: Who does it.
        written: Returns jobs as a worker gets them: a list of them, or what stands for it.
    """

    function: Callable[[JobT], AnswerT]
    workers: Workers
    written: Callable[[list[JobT]], Any] = list
    jobs: Iterator[tuple[int, JobT]] = field(default_factory=lambda: iter(()))
    share: int = sys.maxsize
    pace: Pace = field(default_factory=Pace)
    returned: deque[Chunk[JobT]] = field(default_factory=deque)
    given: dict[Future[Any], Chunk[JobT]] = field(default_factory=dict)
    over: queue.SimpleQueue[Future[Any]] = field(default_factory=queue.SimpleQueue)
    deaths: int = 0
    orders: int = 0

    def __post_init__(self) -> None:
        self.session, self.parcel = os.urandom(16).hex(), self.workers.files
        self.packed = packed(self.function)

    def answers(self, jobs: Iterable[JobT]) -> Generator[AnsweredJobs[JobT, AnswerT], None, None]:
        """Yield numbered jobs and their answers, as many as come together, in the order in which answers come.

        Args:
            jobs: Taken as they are needed, and a few ahead; of few every worker gets a share. Those of a call before
                are all answered.

        Raises:
            InputError: A worker has other versions.
            NumericsError: Workers die one after the other, or there are none any more.
        """
        left = enumerate(jobs)
        seen = [*islice(left, AHEAD)]
        self.jobs = chain(seen, left)
        self.share = -(-len(seen) // self.workers.count()) if len(seen) < AHEAD else sys.maxsize
        self.hand_out()
        while self.given:
            yield from self._coming()
            self.hand_out()

    def in_order(self, jobs: Iterable[JobT]) -> Iterator[AnswerT | LostJob]:
        """Yield the answers in the order of their jobs; see ``answers``."""
        return in_order(([number for number, _ in some], answers) for some, answers in self.answers(jobs))

    def close(self) -> None:
        """End the workers."""
        self.workers.close()

    @property
    def budget(self) -> float:
        """Time after which a worker begins no other job of a chunk [s]."""
        return max(LEAST_TIME, TIME_PER_WORKER * self.workers.count())

    def hand_out(self) -> None:
        """Give every worker a chunk, and the next, so that none waits."""
        while len(self.given) < self._room() and (chunk := self._next()):
            self.orders += 1
            future = self.workers.submit(work, versions(), pickle.dumps(self._order(chunk)))
            self.given[future] = chunk
            future.add_done_callback(self.over.put)

    def _room(self) -> int:
        """Return how many chunks workers may have; beside a suspect none, as executors blame all that a worker had."""
        first = [*islice(self.returned, 1)]
        alone = [*self.given.values()] if len(self.given) == 1 else []
        return 1 if any(chunk.is_suspect for chunk in first + alone) else 2 * self.workers.count()

    def _next(self) -> Chunk[JobT] | None:
        if self.returned:
            return self.returned.popleft()
        jobs = tuple(islice(self.jobs, min(self.pace.size, self.share)))
        return Chunk(jobs) if jobs else None

    def _order(self, chunk: Chunk[JobT]) -> ChunkOrder:
        jobs = packed(self.written([job for _, job in chunk.jobs]))
        order = ChunkOrder(self.session, self.orders, self.packed, jobs, self.budget)
        if self.parcel is None:
            return order
        contents = {digest: self.parcel.contents[digest] for digest in chunk.contents}
        return replace(order, files=dict(self.parcel.entries), contents=contents)

    def _coming(self) -> Iterator[AnsweredJobs[JobT, AnswerT]]:
        """Wait for a chunk, and yield its jobs with their answers."""
        try:
            future = self.over.get(timeout=PATIENCE)
        except queue.Empty:
            self.workers.require()
            return
        chunk, outcome = self.given.pop(future), self.workers.outcome(future)
        if isinstance(outcome, NotBegun):
            self.returned.append(chunk)
        elif isinstance(outcome, WorkerDeath):
            yield from self._bury(chunk, outcome)
        elif isinstance(outcome, dict):
            said = f"a worker has other programs: {differences(versions(), outcome)}"
            raise InputError(said, expected="the same versions everywhere, as the numbers depend on them",
                             hint=f"pip install 'pinarm=={versions()['pinarm']}' and the rest there")  # fmt: skip
        else:
            yield from self._take(chunk, read_answer(outcome))

    def _take(self, chunk: Chunk[JobT], answer: Answers | FilesLacking) -> Iterator[AnsweredJobs[JobT, AnswerT]]:
        self.deaths = 0
        if isinstance(answer, FilesLacking):
            assert self.parcel is not None
            self.parcel.add(answer.paths)
            self.returned.appendleft(replace(chunk, contents=chunk.contents | answer.digests))
            return
        left = dict(enumerate(chunk.jobs))
        parts = [([left.pop(place) for place in places], answers) for places, answers in answer.parts]
        self.pace.note(len(chunk.jobs) - len(left), answer.seconds, self.budget)
        yield from parts
        if left:
            self.returned.append(Chunk((*left.values(),)))

    def _bury(self, chunk: Chunk[JobT], death: WorkerDeath) -> Iterator[AnsweredJobs[JobT, AnswerT]]:
        """Halve a chunk with which a worker died, down to single jobs; give up one with which several did."""
        self.deaths += 1
        if self.deaths >= HOPELESS:
            raise NumericsError(f"{HOPELESS} workers died one after the other, the last by {death.reason}")
        half, deaths = len(chunk.jobs) // 2, chunk.deaths + 1
        if half:
            self.returned += [Chunk(chunk.jobs[:half], deaths), Chunk(chunk.jobs[half:], deaths)]
        elif deaths < DEATHS:
            self.returned.append(replace(chunk, deaths=deaths))
        else:
            yield [chunk.jobs[0]], [LostJob(f"its process died by {death.reason}")]


def distribute(
    function: Callable[[JobT], AnswerT], jobs: Iterator[JobT], workers: Workers
) -> Generator[tuple[JobT, AnswerT | LostJob], None, None]:
    """Apply a function to jobs; yield each job with its answer, in the order in which they come.

    Args:
        function: Importable by its name, as is all that it holds.
        jobs: Taken as they are needed.
        workers: Who does it; they end with the work.

    Raises:
        InputError: A worker has other versions.
        NumericsError: Workers die one after the other, or there are none any more.
    """
    with closing(Dispatch(function, workers)) as spread:
        for some, answers in spread.answers(jobs):
            yield from ((job, answer) for (_, job), answer in zip(some, answers, strict=True))

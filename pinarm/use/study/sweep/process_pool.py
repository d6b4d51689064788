"""Work spread over processes, of which any may die: it takes with it the one job that it was at.

Every worker is a fresh interpreter at the end of a pipe. It starts in half a second where a fork takes hundredths; but
a fork copies locks whose threads it does not copy, and the other ways of ``multiprocessing`` run the user's script
again in every worker. A worker has one job in hand and the next in its pipe, so that it need not wait for the parent.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from multiprocessing.connection import Connection, Pipe, wait
from typing import IO, Any, Generic, TypeVar

from pinarm.errors import NumericsError

IN_HAND = 2
"""Jobs that a worker has been given."""

HOPELESS = 10
"""Deaths in a row, with no answer in between, after which no more workers are started."""

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""The cores are taken already: by the workers."""

JobT = TypeVar("JobT")
AnswerT = TypeVar("AnswerT")


@dataclass(frozen=True)
class WorkerDeath:
    """The end of a worker that was not asked to end; ``how`` says by which signal, or with which exit code."""

    how: str


@dataclass(eq=False)
class _Worker(Generic[JobT]):
    """A process, the pipe to it, and the jobs that it has been given, the one in hand first."""

    process: subprocess.Popen[bytes]
    pipe: Connection[Any, Any]
    jobs: deque[JobT] = field(default_factory=deque)

    @classmethod
    def start(cls, function: Callable[[JobT], object], log: IO[bytes]) -> _Worker[JobT]:
        ours, theirs = Pipe()
        path = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-P", "-c", f"from {__name__} import work; work()", str(theirs.fileno())],
                pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                env={**os.environ, **ONE_THREAD, "PYTHONPATH": path},
                process_group=0,  # Ctrl-C is for the parent, who then ends its workers
            )  # fmt: skip
        ours.send(function)
        return cls(process, ours)

    def give(self, job: JobT) -> None:
        self.jobs.append(job)
        with suppress(OSError):  # it has died, as its pipe is going to say
            self.pipe.send(job)

    def end(self) -> WorkerDeath:
        """End the process, if it has not ended by itself, and say how it did."""
        self.pipe.close()
        try:
            code = self.process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        names = {int(number): number.name for number in signal.Signals}
        return WorkerDeath(names.get(-code, f"signal {-code}") if code < 0 else f"exit code {code}")


@dataclass(eq=False)
class _Team(Generic[JobT]):
    """The workers, and the jobs that are left."""

    function: Callable[[JobT], Any]
    jobs: Iterator[JobT]
    size: int
    log: IO[bytes]
    workers: list[_Worker[JobT]] = field(default_factory=list)
    orphans: deque[JobT] = field(default_factory=deque)
    deaths: int = 0

    def hand_out(self) -> None:
        """Give every worker a job, then the next, and start workers as long as there are jobs for them."""
        for depth in range(IN_HAND):
            for worker in self.workers:
                if len(worker.jobs) == depth:
                    for job in self._next():
                        worker.give(job)
            while len(self.workers) < self.size and (first := self._next()):
                self.workers.append(_Worker.start(self.function, self.log))
                self.workers[-1].give(*first)

    def _next(self) -> list[JobT]:
        """Return the next job, or nothing."""
        return [self.orphans.popleft()] if self.orphans else list(islice(self.jobs, 1))

    def answers(self) -> Iterator[tuple[JobT, Any]]:
        """Wait for workers and yield what they answer; a dead one leaves the jobs that it had not begun."""
        by_pipe = {worker.pipe: worker for worker in self.workers if worker.jobs}
        for pipe in wait(list(by_pipe)):
            worker = by_pipe[pipe]  # type: ignore[index]
            try:
                answer = worker.pipe.recv()
                self.deaths = 0
            except (EOFError, OSError):
                answer = self._bury(worker)
            yield worker.jobs.popleft(), answer
            if isinstance(answer, WorkerDeath):
                self.orphans += worker.jobs

    def _bury(self, worker: _Worker[JobT]) -> WorkerDeath:
        self.workers.remove(worker)
        death = worker.end()
        self.deaths += 1
        if self.deaths >= HOPELESS:
            self.log.seek(0)
            last = self.log.read().decode(errors="replace").strip().splitlines()[-1:]
            raise NumericsError(
                f"{HOPELESS} processes died one after the other, the last by {death.how}: {''.join(last)}"
            )
        return death


def distribute(
    function: Callable[[JobT], AnswerT], jobs: Iterator[JobT], workers: int
) -> Generator[tuple[JobT, AnswerT | WorkerDeath], None, None]:
    """Apply a function to jobs in processes; yield each job with its answer, in the order in which they come.

    Args:
        function: Importable by its name, and so all that it holds.
        jobs: Taken as they are needed.
        workers: How many processes.

    Raises:
        NumericsError: The processes die one after the other.
    """
    with tempfile.TemporaryFile() as log:
        team = _Team(function, jobs, workers, log)
        try:
            team.hand_out()
            while any(worker.jobs for worker in team.workers):
                yield from team.answers()
                team.hand_out()
        finally:
            for worker in team.workers:
                worker.process.terminate()
                worker.end()


def work() -> None:
    """Be a worker: take a function from the pipe, then jobs, and answer them until the pipe is closed."""
    pipe: Connection[Any, Any] = Connection(int(sys.argv[1]))
    with suppress(EOFError):
        function = pipe.recv()
        while True:
            job = pipe.recv()
            answer = function(job)
            try:
                pipe.send(answer)
            except OSError:  # the parent is gone
                return

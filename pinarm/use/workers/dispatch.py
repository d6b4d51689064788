"""Jobs given to workers in chunks: to processes of this machine (loky), or to an executor, such as a Dask cluster's.

A chunk takes a worker about ``CHUNK_TIME``, as measured of the chunks before. Jobs of a chunk with which a worker died
are tried again one by one, with nothing else under way: only a job that kills its worker alone is lost.
"""

from __future__ import annotations

import asyncio
import logging
import os
import pickle
import queue
import re
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from itertools import islice
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

from pinarm.errors import InputError, NumericsError
from pinarm.input.roots import given_access
from pinarm.use.workers.worker import Answers, LostJob, Versions, file_digest, versions, work

CHUNK_TIME = 0.5
"""Time that a chunk takes a worker [s]."""

GROWTH = 8
"""Largest size of a chunk relative to that of one that has been answered."""

HOPELESS = 10
"""Deaths of workers in a row, with no answer in between, after which the work is given up."""

RECOUNT = 1.0
"""Time after which the workers of a cluster are counted again [s]: clusters grow and shrink."""

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""The cores are taken already: by the workers."""

SAFE = {"PYTHONSAFEPATH": "1", "PYTHONWARNINGS": "ignore:resource_tracker"}
"""Nothing is imported from the user's folder, and semaphores that ``loky`` removes after a signal are not listed."""

WATCH = 0.5
"""Time between two looks of a worker at whether its parent lives [s]."""

TIMEOUT = 10.0
"""Time in which a scheduler has to answer [s]."""

JobT = TypeVar("JobT")
AnswerT = TypeVar("AnswerT")

NumberedJob = tuple[int, JobT]


class WorkerDeath(Exception):
    """A worker ended that was not asked to; the message says how."""


class Chunk(NamedTuple):
    """Numbered jobs for one worker; ``alone`` after a death, where nothing else is to be under way."""

    jobs: list[NumberedJob[Any]]
    alone: bool = False


class Dispatch(Generic[JobT, AnswerT]):
    """Chunks of jobs under way.

    Args:
        function: Answers a job; importable by its name, as is all that it holds; see ``runners.answered_parts``.
        workers: Who calls it.
    """

    def __init__(self, function: Callable[[JobT], AnswerT], workers: Workers) -> None:
        self.workers = workers
        self.call = partial(work, versions(), os.urandom(16).hex(), pickle.dumps(function), given_access())
        self.jobs: Iterator[NumberedJob[JobT]] = iter(())
        self.size, self.deaths = 1, 0
        self.retries, self.given = deque[Chunk](), dict[Any, Chunk]()
        self.over, self.files = queue.SimpleQueue[Any](), dict[str, str]()

    def answers(self, jobs: Iterable[JobT]) -> Iterator[tuple[list[NumberedJob[JobT]], Collection[AnswerT | LostJob]]]:
        """Yield numbered jobs and their answers, as many as come together, in the order in which answers come."""
        self.jobs = enumerate(jobs)
        self._hand_out()
        while self.given:
            yield from self._coming()
            self._hand_out()

    def close(self) -> None:
        self.workers.close()

    def _hand_out(self) -> None:
        """Give workers as many chunks as they may have."""
        while len(self.given) < self._room() and (chunk := self._next()):
            jobs = pickle.dumps([job for _, job in chunk.jobs])
            future = self.workers.submit(self.call.func, *self.call.args, jobs)
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

    def _coming(self) -> Iterator[tuple[list[NumberedJob[JobT]], Collection[AnswerT | LostJob]]]:
        """Wait for a chunk, and yield its jobs with their answers."""
        future = self.over.get()
        chunk = self.given.pop(future)
        try:
            answers = self.workers.result(future)
        except WorkerDeath as death:
            yield from self._lost(chunk, death)
            return
        self._check(answers)
        fitting = int(CHUNK_TIME * len(chunk.jobs) / max(answers.seconds, 1e-9))
        self.size, self.deaths = max(1, min(fitting, GROWTH * len(chunk.jobs))), 0
        self._hand_out()  # so that no worker waits until the answers are written down
        for places, some in answers.parts:
            yield [chunk.jobs[place] for place in places], some

    def _check(self, answers: Answers | Versions) -> None:
        """Raise where a worker has other versions, or sees other files."""
        if not isinstance(answers, Answers):
            here = versions()
            names = [name for name in {**here, **answers} if here.get(name) != answers.get(name)]
            pairs = (f"{k} is {here.get(k, 'absent')} here and {answers.get(k, 'absent')} there" for k in names)
            said, expected = f"a worker has other programs: {', '.join(pairs)}", "the same versions everywhere"
            raise InputError(said, expected=expected, hint=f"pip install 'pinarm=={here['pinarm']}' and the rest there")
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


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def chosen_workers(number: int | None, executor: Executor | None) -> Workers:
    """Return the workers of an executor, or where there is none processes of this machine, which start when needed."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        expected, hint = "one of concurrent.futures, or none", "workers: for the number of processes"
        raise InputError(f"{executor!r} is no executor", expected=expected, hint=hint)
    return LocalProcesses(number or cores()) if executor is None else ExecutorWorkers(executor, number)


class LocalProcesses:
    """Worker processes of ``loky`` on this machine, each in an executor of its own, so that a death is its own.

    ``loky`` starts fresh interpreters, which neither copy locks of threads as forks do nor run the user's script again
    as the standard library's do, and it says how a process ended.
    """

    def __init__(self, number: int) -> None:
        self._number, self._idle, self._busy = number, list[Any](), dict[Any, Any]()

    def room(self) -> int:
        return self._number

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Let an idle process call a function; it is started where there is none."""
        with _starting():
            try:
                executor = self._idle.pop()
                future = executor.submit(function, *arguments)
            except (IndexError, BrokenExecutor):
                executor = _started()
                future = executor.submit(function, *arguments)
        self._busy[future] = executor
        return future

    def result(self, future: Any) -> Any:
        """Return the result of a call that is over."""
        try:
            answer = future.result()
        except BrokenExecutor as error:
            self._busy.pop(future).shutdown(wait=False)
            ended = re.search(r"\{(?:(SIG\w+)\(|EXIT\()(-?\d+)\)", str(error))  # {SIGKILL(-9)} or {EXIT(7)}
            cause = "an unknown cause" if ended is None else ended[1] or f"exit code {ended[2]}"
            raise WorkerDeath(cause) from None
        self._idle.append(self._busy.pop(future))
        return answer

    def close(self) -> None:
        for executor in (*self._idle, *self._busy.values()):
            executor.shutdown(kill_workers=True)


def _started() -> Any:
    from loky import ProcessPoolExecutor

    path = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
    quiet = {"PYTHONFAULTHANDLER": ""}  # how a worker died is told by its exit code
    environment = {**ONE_THREAD, "PYTHONSAFEPATH": "1", **quiet, "PYTHONPATH": path}
    return ProcessPoolExecutor(1, env=environment, initializer=_end_with, initargs=(os.getpid(),))


@contextmanager
def _starting() -> Iterator[None]:
    """Let processes that start in the block leave Ctrl-C to this one, and import nothing from the user's folder.

    Those that remove what ``loky`` leaves behind start first: to start them lets Ctrl-C through again, and a worker
    that is interrupted in the middle of an answer leaves this process waiting for the rest of it.
    """
    from multiprocessing import resource_tracker as inherited

    from loky.backend import resource_tracker as own

    added = {name: value for name, value in SAFE.items() if name not in os.environ}
    os.environ.update(added)
    try:
        for tracker in (own, inherited):
            tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    finally:
        for name in added:
            del os.environ[name]


def _end_with(parent: int) -> None:
    """End this process when its parent has ended, however that did."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class ExecutorWorkers:
    """The workers of an executor that the user has, which is not shut down with the work.

    Args:
        executor: The executor. Calls of Dask's go to its client, as the executor itself leaves a call without an end
            whose worker dies between its end and the fetching of its answer (distributed 2026.8).
        number: How many workers it has; where it is left out, as many as it says: a Dask executor by the threads of its
            cluster, those of the standard library by ``max_workers``; else one for each core here.
    """

    def __init__(self, executor: Executor, number: int | None = None) -> None:
        self._number, self._pending = number, set[Any]()
        self._client: Any = getattr(executor, "_client", None)  # Dask's executor has no public way to it
        options = {**getattr(executor, "_kwargs", {}), "pure": False}
        self._call = executor.submit if self._client is None else partial(self._client.submit, **options)
        self._count, self._counted = int(getattr(executor, "_max_workers", 0)) or cores(), -RECOUNT

    def room(self) -> int:
        """Return two for each worker, so that none waits for the next chunk to travel; one while there are none."""
        if self._client is not None and time.monotonic() - self._counted > RECOUNT:
            with suppress(Exception):  # the connection is lost, as the chunks are going to say
                self._count = sum(self._client.nthreads().values())
            self._counted = time.monotonic()
        return 2 * max(self._number or self._count, 1)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Let a worker call a function."""
        try:
            future = self._call(function, *arguments)
        except Exception as error:
            raise _no_workers(error) from None
        self._pending.add(future)
        return future

    def result(self, future: Any) -> Any:
        """Return the result of a call that is over."""
        self._pending.discard(future)
        try:
            return future.result()
        except (CancelledError, BrokenExecutor) as error:
            raise _no_workers(error) from None
        except Exception as error:
            raise WorkerDeath(_said(error)) from None

    def close(self) -> None:
        for future in self._pending:
            future.cancel()


def _no_workers(error: BaseException) -> NumericsError:
    hint = "the same command or call again: with a folder of the sweep it goes on from there"
    return NumericsError(f"the workers are lost ({_said(error)})", hint=hint)


def _said(error: BaseException) -> str:
    """Return the name of an error, and the first line of its message."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__


Workers: TypeAlias = LocalProcesses | ExecutorWorkers
"""Whoever answers chunks."""


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Yield the executor of a cluster; nothing listens here.

    Args:
        address: That of its scheduler, such as ``tcp://10.0.0.1:8786``; of ``tls://...`` the certificates are those of
            Dask's own configuration, ``distributed.comm.tls``.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError("Dask is not installed", hint="pip install 'pinarm[cluster]'") from None
    quiet = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    for name in (*quiet, "tornado.application"):  # that the connection is lost is told by the work under way
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        with asyncio.Runner() as runner:  # whose ``run`` would make of an interrupt a cancellation, which may be lost
            runner.get_loop().run_until_complete(_answered(distributed, address))
        client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False, name="pinarm")
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise InputError(
            f"no scheduler of Dask answers at {address}: {_said(error)}",
            expected="tcp://HOST:PORT, or tls://HOST:PORT with distributed.comm.tls configured: ca-file, client.key "
            "and client.cert",
            hint="dask scheduler",
        ) from None
    try:
        yield client.get_executor()
    finally:
        with suppress(Exception):
            client.close(timeout=1.0)


async def _answered(distributed: Any, address: str) -> None:
    """Wait for an answer of a scheduler: a client that finds none takes long to give up, or hangs."""
    given = distributed.Security().get_connection_args("client")
    async with distributed.rpc(address, timeout=TIMEOUT, connection_args=given) as scheduler:
        await asyncio.wait_for(scheduler.identity(), TIMEOUT)

"""Calls by processes of this machine (loky), by the workers of an executor of the user, or by a Dask cluster."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from typing import Any, TypeAlias

from pinarm.errors import InputError, NumericsError

ABSENCE = 300.0
"""Time without any worker after which the work ends [s]."""

RECOUNT = 1.0
"""Time after which the workers of an executor are counted again [s]: clusters grow and shrink."""

MOST_TEXT = 300
"""Characters that are repeated of what another program says."""

AGAIN = "the same command or call again: with a folder of the sweep it goes on from there, on the cluster or without it"

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""The cores are taken already: by the workers."""

SAFE = {"PYTHONSAFEPATH": "1", "PYTHONWARNINGS": "ignore:resource_tracker"}
"""Nothing is imported from the user's folder, and semaphores that ``loky`` removes after a signal are not listed."""

WATCH = 0.5
"""Time between two looks of a worker at whether its parent lives [s]."""


class WorkerDeath(Exception):
    """A worker ended that was not asked to; the message says how."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def chosen_workers(number: int | None, executor: Executor | None) -> Workers:
    """Return the workers of an executor, or where there is none processes of this machine, which start when needed.

    Args:
        number: How many; ``None`` for as many as the executor has, or as there are cores here.
        executor: Any of ``concurrent.futures``, which stays the caller's.

    Raises:
        InputError: The executor is none.
    """
    if executor is not None and not callable(getattr(executor, "submit", None)):
        expected, hint = "one of concurrent.futures, or none", "workers: for the number of processes"
        raise InputError(f"{executor!r} is no executor", expected=expected, hint=hint)
    return LocalProcesses(number or cores()) if executor is None else ExecutorWorkers(executor, number)


class LocalProcesses:
    """Worker processes of ``loky`` on this machine, each in an executor of its own, so that a death is its own.

    ``loky`` starts fresh interpreters, which neither copy locks of threads as forks do nor run the user's script again
    as the standard library's do, and it says how a process ended.

    Args:
        number: How many.
    """

    def __init__(self, number: int) -> None:
        self._number, self._idle, self._busy = number, list[Any](), dict[Any, Any]()

    def count(self) -> int:
        """Return the number of processes, started or not."""
        return self._number

    room = count

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
        """Return the result of a call that is over.

        Raises:
            WorkerDeath: Its process died.
        """
        try:
            answer = future.result()
        except BrokenExecutor as error:
            self._busy.pop(future).shutdown(wait=False)
            raise WorkerDeath(how_it_ended(str(error))) from None
        self._idle.append(self._busy.pop(future))
        return answer

    def require(self) -> None:
        """Do nothing: processes that die say so."""

    def close(self) -> None:
        """Kill the processes."""
        for executor in (*self._idle, *self._busy.values()):
            executor.shutdown(kill_workers=True)


def _started() -> Any:
    """Return an executor of one process to be."""
    from loky import ProcessPoolExecutor

    path = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
    quiet = {"PYTHONFAULTHANDLER": ""}  # how a worker died is told by its exit code
    environment = {**ONE_THREAD, "PYTHONSAFEPATH": "1", **quiet, "PYTHONPATH": path}
    return ProcessPoolExecutor(1, env=environment, initializer=_end_with, initargs=(os.getpid(),))


def how_it_ended(said: str) -> str:
    """Return signal or exit code of an ended process from the text of ``loky``: ``{SIGKILL(-9)}`` or ``{EXIT(7)}``."""
    ended = re.search(r"\{(\w+)\((-?\d+)\)", said)
    if ended is None:
        return "an unknown cause"
    return ended[1] if ended[1].startswith("SIG") else f"exit code {ended[2]}"


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
        self._executor, self._number, self._pending = executor, number, set[Any]()
        self._client: Any = getattr(executor, "_client", None)  # Dask's executor has no public way to it
        options = {**getattr(executor, "_kwargs", {}), "pure": False}
        self._call = executor.submit if self._client is None else partial(self._client.submit, **options)
        self._counted, self._count, self._seen = -RECOUNT, 1, time.monotonic()

    def count(self) -> int:
        """Return the current number of workers, 1 where there are none yet."""
        now = time.monotonic()
        if self._number is None and now - self._counted > RECOUNT:
            present = self._present()
            self._counted, self._count = now, max(present, 1)
            self._seen = now if present else self._seen
        return self._number or self._count

    def room(self) -> int:
        """Return two for each worker, so that none waits for the next chunk to travel."""
        return 2 * self.count()

    def _present(self) -> int:
        if self._client is None:
            return int(getattr(self._executor, "_max_workers", 0)) or cores()
        try:
            return int(sum(self._client.nthreads().values()))
        except Exception:  # the connection is lost, as the chunks are going to say
            return 0

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Let a worker call a function."""
        try:
            future = self._call(function, *arguments)
        except Exception as error:
            raise _no_workers(error) from None
        self._pending.add(future)
        return future

    def result(self, future: Any) -> Any:
        """Return the result of a call that is over.

        Raises:
            WorkerDeath: Its worker died.
            InputError: pinarm is not installed on a worker.
            NumericsError: The executor is broken, or its scheduler is gone.
        """
        self._pending.discard(future)
        try:
            return future.result()
        except (CancelledError, BrokenExecutor) as error:
            raise _no_workers(error) from None
        except Exception as error:
            _require_modules(error)
            raise WorkerDeath(_said(error)[:MOST_TEXT]) from None

    def require(self) -> None:
        """Raise where there have been no workers for long.

        Raises:
            NumericsError: There have not.
        """
        self.count()
        if time.monotonic() - self._seen > ABSENCE and not self._present():
            raise NumericsError(f"there have been no workers for {ABSENCE:g} s", hint=AGAIN)

    def close(self) -> None:
        """Call off what has not been begun."""
        for future in self._pending:
            future.cancel()


def _require_modules(error: BaseException) -> None:
    """Raise where an error arose because a worker, or a scheduler, cannot import what it is to run.

    Raises:
        InputError: It did.
    """
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, ModuleNotFoundError):
            hint = "install pinarm on all workers and where the scheduler runs, in the version that is here"
            raise InputError(f"the workers, or their scheduler, cannot run pinarm: {cause}", hint=hint) from None
        cause = cause.__cause__


def _no_workers(error: BaseException) -> NumericsError:
    return NumericsError(f"the workers are lost ({_said(error)})"[:MOST_TEXT], hint=AGAIN)


def _said(error: BaseException) -> str:
    """Return the name of an error, and the first line of its message."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


Workers: TypeAlias = LocalProcesses | ExecutorWorkers
"""Whoever answers chunks."""


TIMEOUT = 10.0
"""Time in which a scheduler has to answer [s]."""


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Yield the executor of a cluster; nothing listens here.

    Args:
        address: That of its scheduler, such as ``tcp://10.0.0.1:8786``; of ``tls://...`` the certificates are those of
            Dask's own configuration, ``distributed.comm.tls``.

    Raises:
        InputError: Dask is not installed, or no scheduler answers.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError("Dask is not installed", hint="pip install 'pinarm[cluster]'") from None
    _quieten()
    if address.startswith("tls://") and not distributed.Security().get_connection_args("client").get("ssl_context"):
        raise InputError(
            f"{address} wants certificates, and none are configured",
            expected="distributed.comm.tls in Dask's configuration: ca-file, client.key and client.cert",
            hint="DASK_DISTRIBUTED__COMM__TLS__CA_FILE and the like",
        ) from None
    try:
        with asyncio.Runner() as runner:  # whose ``run`` would make of an interrupt a cancellation, which may be lost
            # a client that has not found a scheduler takes 20 s to give up
            runner.get_loop().run_until_complete(_identity(distributed, address))
        client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False, name="pinarm")
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        said = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(
            f"no scheduler of Dask answers at {address}: {said}",
            expected="tcp://HOST:PORT, or tls://HOST:PORT with distributed.comm.tls configured",
            hint="dask scheduler",
        ) from None
    try:
        yield client.get_executor()
    finally:
        with suppress(Exception):
            client.close(timeout=1.0)


async def _identity(distributed: Any, address: str) -> None:
    """Ask what listens at an address who it is.

    Raises:
        OSError: It is no scheduler, or does not answer in time.
        ValueError: It is no address.
    """
    given = distributed.Security().get_connection_args("client")
    async with distributed.rpc(address, timeout=TIMEOUT, connection_args=given) as scheduler:
        try:
            identity = await asyncio.wait_for(scheduler.identity(), TIMEOUT)
        except TimeoutError:
            raise OSError(f"no answer in {TIMEOUT:.0f} s") from None
    if identity.get("type") != "Scheduler":
        raise OSError(f"it is a {identity.get('type')}")


def _quieten() -> None:
    """Let Dask print no messages, nor its event loop: that the connection is lost is told by the work under way."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    for name in (*names, "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)

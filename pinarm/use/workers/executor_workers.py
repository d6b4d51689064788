"""The workers of an executor that the user has: a Dask cluster, or any other of ``concurrent.futures``."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from functools import partial
from typing import Any

from pinarm.engine.dynamics.parallel import cores
from pinarm.errors import InputError, NumericsError
from pinarm.use.workers.dask_calls import submit
from pinarm.use.workers.distribute import Outcome, WorkerDeath
from pinarm.use.workers.travelling_files import Parcel

RECOUNT = 1.0
"""Time after which workers are counted again [s]: clusters grow and shrink."""

ABSENCE = 300.0
"""Time without any worker after which the work is given up [s]."""

MOST_TEXT = 300
"""Characters that are repeated of what another program says."""

AGAIN = "the same command or call again: with a folder of the sweep it goes on from there, on the cluster or without it"


class ExecutorWorkers:
    """The workers of an executor, which is not shut down with the work; files travel to them, but not to threads.

    Args:
        executor: The executor.
        number: How many workers it has; where it is left out, as many as it says: a Dask executor by the threads of its
            cluster, those of the standard library by ``max_workers``; else one for each core here.
    """

    def __init__(self, executor: Executor, number: int | None = None) -> None:
        self.files = None if isinstance(executor, ThreadPoolExecutor) else Parcel()  # threads see the files
        self._executor, self._number = executor, number
        self._counted, self._count, self._seen = -RECOUNT, 1, time.monotonic()
        self._pending = set[Future[Any]]()
        self._client: Any = getattr(executor, "_client", None)  # of Dask's executor, which has no public way to it
        self._submit: Callable[..., Future[Any]] = (
            executor.submit if self._client is None else partial(submit, self._client, getattr(executor, "_kwargs", {}))
        )

    def count(self) -> int:
        """Return how many workers there are now, 1 where there are none yet."""
        if self._number is not None:
            return self._number
        now = time.monotonic()
        if now - self._counted > RECOUNT:
            found = self._present()
            self._counted, self._count = now, max(found, 1)
            self._seen = now if found else self._seen
        return self._count

    def _present(self) -> int:
        try:
            if self._client is not None:
                return int(sum(self._client.nthreads().values()))
        except Exception:  # the connection is lost, as the chunks are going to say
            return 0
        return int(getattr(self._executor, "_max_workers", 0)) or cores()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Let a worker call a function."""
        try:
            future = self._submit(function, *arguments)
        except Exception as error:
            raise _lost(error) from None
        self._pending.add(future)
        return future

    def outcome(self, future: Future[Any]) -> Outcome:
        """Return what a worker has answered, or how it died.

        Raises:
            InputError: pinarm is not installed on a worker.
            NumericsError: The executor is broken, or its scheduler is gone.
        """
        self._pending.discard(future)
        try:
            found: Outcome = future.result()
            return found
        except (CancelledError, BrokenExecutor) as error:
            raise _lost(error) from None
        except Exception as error:
            _require_modules(error)
            return WorkerDeath(f"{type(error).__name__}{_first_line(error)}"[:MOST_TEXT])

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


def _lost(error: BaseException) -> NumericsError:
    return NumericsError(f"the workers are lost ({type(error).__name__}{_first_line(error)})"[:MOST_TEXT], hint=AGAIN)


def _first_line(error: BaseException) -> str:
    """Return the first line of what an error says, behind a colon; nothing where it says nothing."""
    lines = str(error).strip().splitlines()
    return f": {lines[0]}" if lines else ""

"""Worker processes on this machine, of ``loky``: each in an executor of its own, so that a death stays its own.

``loky`` starts fresh interpreters, which neither copy locks of threads as forks do nor run the user's script again as
the standard library's do, and it says how a process ended.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from pinarm.use.workers.distribute import NotBegun, Outcome, WorkerDeath

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""The cores are taken already: by the workers."""

SAFE_PATH = {"PYTHONSAFEPATH": "1"}
"""No module is imported from the folder in which the user is, which may hold files of strangers."""

UNTRACKED = {"PYTHONWARNINGS": "ignore:resource_tracker"}
"""No list of the semaphores that ``loky`` removes when a signal has ended this process."""

WATCH = 0.5
"""Time between two looks of a worker at whether its parent lives [s]."""


@dataclass(eq=False)
class _Process:
    """An executor with one process, and the calls that it has, the one in hand first."""

    executor: Any
    calls: list[Future[Any]] = field(default_factory=list)
    waiting: set[Future[Any]] = field(default_factory=set)

    @classmethod
    def start(cls) -> _Process:
        from loky import ProcessPoolExecutor

        path = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
        quiet = {"PYTHONFAULTHANDLER": ""}  # how a worker died is told by its exit code
        environment = {**ONE_THREAD, **SAFE_PATH, **quiet, "PYTHONPATH": path}
        with _starting():
            return cls(ProcessPoolExecutor(1, env=environment, initializer=_end_with, initargs=(os.getpid(),)))

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        with _starting():
            future: Future[Any] = self.executor.submit(function, *arguments)
        self.calls.append(future)
        return future

    def died_with(self, future: Future[Any]) -> bool:
        """Tell whether a call of the process that died was in hand then: the first of those that were not answered."""
        if future in self.waiting:
            return False
        unanswered = [call for call in self.calls if not call.done() or call.exception()]
        self.waiting.update(unanswered[1:])
        return future is unanswered[0]


class LocalProcesses:
    """Worker processes on this machine.

    Args:
        number: How many.
    """

    files = None

    def __init__(self, number: int) -> None:
        self._seats: list[_Process | None] = [None] * number
        self._of = dict[Future[Any], _Process]()

    def count(self) -> int:
        """Return how many workers there are, or are to be."""
        return len(self._seats)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Let the process call a function that has the fewest calls to do; it is started where it is the first."""
        seat = min(range(len(self._seats)), key=lambda k: len(process.calls) if (process := self._seats[k]) else 0)
        process = self._seats[seat] or _Process.start()
        try:
            future = process.submit(function, *arguments)
        except BrokenExecutor:  # it has died, as its calls are going to say
            process = _Process.start()
            future = process.submit(function, *arguments)
        self._seats[seat] = self._of[future] = process
        return future

    def outcome(self, future: Future[Any]) -> Outcome:
        """Return what a process has answered, or how it died."""
        process = self._of.pop(future)
        error = future.exception()
        if error is None:
            process.calls.remove(future)
            found: Outcome = future.result()
            return found
        if not isinstance(error, BrokenExecutor):
            raise error
        in_hand = process.died_with(future)
        process.calls.remove(future)
        if process in self._seats:
            self._seats[self._seats.index(process)] = None
            process.executor.shutdown(wait=False)
        return WorkerDeath(_how(str(error))) if in_hand else NotBegun()

    def require(self) -> None:
        """Do nothing: processes that die say so."""

    def close(self) -> None:
        """Kill the processes."""
        for process in filter(None, self._seats):
            process.executor.shutdown(kill_workers=True)


def _how(said: str) -> str:
    """Return how a process ended by what ``loky`` says: ``{SIGKILL(-9)}``, ``{EXIT(7)}`` or the like."""
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

    added = {name: value for name, value in (SAFE_PATH | UNTRACKED).items() if name not in os.environ}
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

"""One engine in a process of its own: it may crash or hang without taking the race with it."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from benchmarks.race.engines import Run, Setting, Unable, prepare
from benchmarks.race.problems import Motion, Problem
from benchmarks.race.references import reference

FAR = 0.1
"""Error [rad] beyond which a motion is another one, and difference of equal angles on another branch."""

SHORT = 1.0
"""Runs that take less time [s] are timed three times, and the best counts."""


PATIENCE = 5.0
"""Time that a process has to end [s]."""

ENVIRONMENT = {"pinocchio": {"OMP_WAIT_POLICY": "passive", "GOMP_SPINCOUNT": "20000"}}
"""What a user learns to set: threads that wait busily cost the parallel calls of Pinocchio milliseconds each, and those
that sleep at once must be woken for each; pinarm sets the same."""


class Worker:
    """The process of an engine, and the line to it.

    Attributes:
        engine: Its module.
    """

    def __init__(self, engine: str) -> None:
        self.engine = engine
        self._process: Any = None
        self._line: Connection | None = None

    def ask(self, order: tuple[Any, ...], patience: float) -> Any:
        """Return the engine's answer.

        Raises:
            EOFError: It died.
            TimeoutError: It took longer than ``patience`` [s], and was ended.
        """
        if self._process is None:
            self._start()
        assert self._line
        try:
            self._line.send(order)
            if self._line.poll(patience):
                return self._line.recv()
        except (EOFError, OSError):
            self.end()
            raise EOFError("its process died") from None
        self.end()
        raise TimeoutError(f"no answer within {patience:g} s")

    def _start(self) -> None:
        context = get_context("spawn")
        self._line, far = context.Pipe()
        self._process = context.Process(target=_serve, args=(self.engine, far))
        own = {name: x for name, x in ENVIRONMENT.get(self.engine, {}).items() if name not in os.environ}
        os.environ.update(own)
        self._process.start()
        for name in own:
            del os.environ[name]
        far.close()

    def close(self) -> None:
        """Let the process end, and end it where it does not."""
        if self._process is not None and self._line:
            self._line.close()
            self._process.join(PATIENCE)
        self.end()

    def end(self) -> None:
        """End the process and those it started."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                leader = os.getpgid(self._process.pid) == self._process.pid
                os.killpg(self._process.pid, signal.SIGKILL) if leader else self._process.kill()
            self._process.join()
        self._process, self._line = None, None


def _serve(engine: str, line: Connection) -> None:
    """Answer orders until the line is closed, then end this process and those it started, which would keep it."""
    os.setsid()
    with tempfile.TemporaryDirectory() as folder, open(os.devnull, "w") as nothing:
        os.chdir(folder)  # some engines write logs beside them
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nothing.fileno(), stream.fileno())
        with suppress(EOFError):
            _answer(engine, line)
        os.chdir(os.sep)
    os.killpg(0, signal.SIGKILL)


def _answer(engine: str, line: Connection) -> None:
    """Answer orders: ``("prepare", problem)``, ``("make", index)``, ``("try", index)``, ``("time", index)``."""
    settings: list[Setting] = []
    made: dict[int, Run] = {}
    while True:
        kind, argument = line.recv()
        if kind == "prepare":
            problem, answer = argument, reference(argument)[0]
            made.clear()
            try:
                settings = prepare(engine, problem)
                line.send([(setting.method, setting.value) for setting in settings])
            except Unable as reason:
                line.send(str(reason))
        elif kind == "make":
            made[argument] = _made(settings[argument])
            line.send(None)
        elif kind == "try":
            line.send(_tried(made.pop(argument), problem, answer))
        else:
            line.send(_warm(made[argument]))


def _made(setting: Setting) -> Run:
    """Return the run of a setting; one that fails as the making did, where that failed."""
    try:
        return setting.make()
    except Exception as error:
        return partial(_fail, error)


def _fail(error: Exception) -> np.ndarray:
    raise error


def _timed(run: Run) -> tuple[float, np.ndarray]:
    begin = time.perf_counter()
    answer = run()
    return time.perf_counter() - begin, answer


def _warm(run: Run) -> float:
    """Return the time of a short run right after another: other engines have had the processor's caches before."""
    seconds = _timed(run)[0]
    return _timed(run)[0] if seconds < SHORT else seconds


def _tried(run: Run, problem: Problem, answer: np.ndarray) -> dict[str, Any]:
    """Return the time of a run, its error, and whether it is on another branch, or why it failed."""
    try:
        seconds, found = _timed(run)
        if seconds < SHORT:
            seconds = min(seconds, _timed(run)[0], _timed(run)[0])
    except Exception as error:
        return {"failed": f"{type(error).__name__}: {error}"[:200]}
    if not np.isfinite(found).all():
        return {"failed": "numbers that are not finite"}
    error = float(np.abs(found[: len(answer)] - answer).max())
    alike = found[:, list(problem.alike)] if isinstance(problem, Motion) and problem.alike else np.zeros((1, 1))
    apart = np.abs(alike[:, 1:] - alike[:, :1]).max(initial=0.0)
    return {"seconds": seconds, "error": error, "branch": bool(apart > FAR)}

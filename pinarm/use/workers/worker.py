"""Answers of a worker to a chunk of jobs; the function that answers is kept from chunk to chunk."""

from __future__ import annotations

import pickle
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

from pinarm.errors import fault
from pinarm.input.roots import Access, example_robot_data, file_root, noting_files
from pinarm.records import ValueRecord
from pinarm.use.workers.versions import Versions, file_digest, versions

KEPT = 2
"""Functions that a thread keeps: what is built for a scenario serves one thread at a time."""

AnsweredPart = tuple[Iterable[int], Collection[Any]]
"""Places of jobs in a chunk, and their answers."""


class LostJob(ValueRecord, frozen=True):
    """A job that has no answer, and why: its worker died, or the program failed."""

    reason: str


@runtime_checkable
class Together(Protocol):
    """A function of a job that solves several of them at once."""

    def together(self, jobs: Any) -> Iterator[AnsweredPart]:
        """Yield places of jobs and their answers, none of which raises."""


class Answers(NamedTuple):
    """Answers of a worker to a chunk.

    Attributes:
        parts: Of all jobs of the chunk.
        seconds: Time that they took [s].
        files: Files that they refer to for the first time in this thread, with the digests of their contents.
    """

    parts: list[AnsweredPart]
    seconds: float
    files: dict[str, str]


class _Session(NamedTuple):
    function: Callable[[Any], Any]
    files: set[Path]


def work(wanted: Versions, session: str, function: bytes, access: Access, jobs: bytes) -> Answers | Versions:
    """Return the answers to a chunk of jobs, or the versions of this process where they are not those wanted.

    Args:
        wanted: Versions of the process that gives the jobs; nothing is unpacked where they differ.
        session: Name of the function.
        function: The function, pickled.
        access: Folder and packages that files may refer to.
        jobs: The jobs, pickled.
    """
    if wanted != versions():
        return versions()
    kept, begin = _session(session, function), time.perf_counter()
    with file_root(*access), noting_files() as files:
        parts = [*answered_parts(kept.function, pickle.loads(jobs))]
    seconds, robots = time.perf_counter() - begin, example_robot_data()
    own = {file for file in files - kept.files if not file.is_relative_to(robots)}
    kept.files.update(own)
    return Answers(parts, seconds, {str(file): file_digest(str(file)) for file in own})


def answered_parts(function: Callable[[Any], Any], jobs: Any) -> Iterator[AnsweredPart]:
    """Yield places of jobs and their answers; a fault of the program costs one job."""
    if isinstance(function, Together):
        yield from function.together(jobs)
        return
    for place, job in enumerate(jobs):
        try:
            answer = function(job)
        except Exception as error:
            answer = LostJob(f"the program failed: {fault(error)}")
        yield [place], [answer]


_kept = threading.local()


def _session(name: str, function: bytes) -> _Session:
    sessions: dict[str, _Session] = _kept.__dict__.setdefault("sessions", {})
    if name not in sessions:
        while len(sessions) >= KEPT:
            del sessions[next(iter(sessions))]
        sessions[name] = _Session(pickle.loads(function), set())
    return sessions[name]


def in_order(parts: Iterable[AnsweredPart]) -> Iterator[Any]:
    """Yield answers in the order of their jobs, each as soon as all before it are there."""
    early, wanted = dict[int, Any](), 0
    for places, answers in parts:
        early |= zip(places, answers, strict=True)
        while wanted in early:
            yield early.pop(wanted)
            wanted += 1

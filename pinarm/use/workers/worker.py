"""Answers of a worker to a chunk of jobs, and the versions and files on which they depend."""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import stat
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from pinarm.errors import fault
from pinarm.input.roots import Access, example_robot_data, file_root, noting_files
from pinarm.records import ValueRecord

EXAMPLES = "example_files"
"""Folder of the package that a wheel has, and a checkout has elsewhere."""

MOST_BYTES, BLOCK = 2_000_000_000, 1 << 20
"""Size of a file whose content is read, and of the parts in which it is read [bytes]."""

Versions = Mapping[str, str]
"""Program -> its version."""


AnsweredPart = tuple[Iterable[int], Collection[Any]]
"""Places of jobs in a chunk, and their answers."""


class LostJob(ValueRecord, frozen=True):
    """A job that has no answer, and why: its worker died, or the program failed."""

    reason: str


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
    name: str
    function: Callable[[Any], Any]
    files: set[Path]


_kept = threading.local()
"""The session of a thread: what is built for a scenario serves one thread at a time."""


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
    kept: _Session | None = getattr(_kept, "session", None)
    if kept is None or kept.name != session:
        kept = _kept.session = _Session(session, pickle.loads(function), set())
    begin = time.perf_counter()
    with file_root(*access), noting_files() as files:
        parts = [*answered_parts(kept.function, pickle.loads(jobs))]
    seconds, robots = time.perf_counter() - begin, example_robot_data()
    new = {file for file in files - kept.files if not file.is_relative_to(robots)}
    kept.files.update(new)
    return Answers(parts, seconds, {str(file): file_digest(str(file)) for file in new})


def answered_parts(function: Callable[[Any], Any], jobs: list[Any]) -> Iterator[AnsweredPart]:
    """Yield places of jobs and their answers; a fault of the program costs one job.

    A function with a method ``together`` solves several jobs at once, and yields the same, without errors.
    """
    if hasattr(function, "together"):
        yield from function.together(jobs)
        return
    for place, job in enumerate(jobs):
        try:
            answer = function(job)
        except Exception as error:
            answer = LostJob(f"the program failed: {fault(error)}")
        yield [place], [answer]


@cache
def versions() -> dict[str, str]:
    """Return the versions of the programs that this process computes with."""
    import numpy
    import pinocchio
    import scipy

    from pinarm.engine.kernel.library import absence

    return {
        "python": platform.python_version(),
        "pinarm": import_module("pinarm").__version__,
        "the code of pinarm": code_digest(),
        "the compiled kernel of pinarm": "not used" if absence() else "used",
        "pinocchio": pinocchio.__version__,
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
    }


@cache
def code_digest() -> str:
    """Return a digest of the package's files of Python and C, which tells states of the code of one version apart."""
    package, content = Path(__file__).parents[2], hashlib.sha256()
    code = {path for ending in ("py", "c", "h") for path in package.rglob(f"*.{ending}")}
    for path in sorted(code - {*package.joinpath(EXAMPLES).rglob("*")}):
        content.update(f"{path.relative_to(package)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return content.hexdigest()[:12]


def file_digest(file: str) -> str:
    """Return the digest of a regular file of ordinary size; empty for a device, a pipe, or what cannot be read."""
    try:
        with open(os.open(file, os.O_RDONLY | os.O_NONBLOCK), "rb", buffering=0) as stream:
            state = os.fstat(stream.fileno())
            if not stat.S_ISREG(state.st_mode) or state.st_size > MOST_BYTES:
                return ""
            content = hashlib.sha256()
            for _ in range(0, state.st_size, BLOCK):  # and no more: files of /proc have no end
                content.update(stream.read(BLOCK) or b"")
            return content.hexdigest()
    except (OSError, ValueError):
        return ""

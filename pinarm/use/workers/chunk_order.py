"""What goes to a worker and what comes back, as bytes.

Paths on the way to a worker are led below the folder in which it has copies of the files; names of that folder in texts
on the way back are removed. So a worker on another machine finds its files, and says the same words as this one.
"""

from __future__ import annotations

import io
import os
import pickle
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any, Literal

FileEntry = tuple[Literal["file", "folder", "link", "absent"], str]
"""What stands at a path, and the SHA-256 digest of its content, or where the link leads."""


@dataclass(frozen=True)
class ChunkOrder:
    """A chunk of jobs for a worker.

    Attributes:
        session: Name of the work that the chunk is part of; the same for all of its chunks.
        number: Of the order in the work: Dask takes calls with the same arguments for one call.
        function: The function of a job, packed.
        jobs: The jobs, packed.
        budget: Time after which the worker begins no other job of the chunk [s].
        files: Absolute path -> what stands there; ``None`` where workers see the files themselves.
        contents: Digest -> content, of files that a worker was without.
    """

    session: str
    number: int
    function: bytes = field(repr=False)
    jobs: bytes = field(repr=False)
    budget: float
    files: Mapping[str, FileEntry] | None = field(default=None, repr=False)
    contents: Mapping[str, bytes] = field(default_factory=dict, repr=False)


AnsweredPart = tuple[Iterable[int], Collection[Any]]
"""Places of jobs in a chunk, and their answers."""


@dataclass(frozen=True)
class Answers:
    """The answers of jobs of a chunk, part by part, which took so long [s] together."""

    parts: Sequence[AnsweredPart] = field(repr=False)
    seconds: float


@dataclass(frozen=True)
class FilesLacking:
    """What a worker is without: files by the digests of their contents, and paths of which it was not told anything."""

    digests: frozenset[str] = frozenset()
    paths: frozenset[str] = frozenset()


@dataclass(frozen=True)
class LostJob:
    """A job that has no answer, and why: its worker died, or the program failed."""

    reason: str


def in_order(parts: Iterable[AnsweredPart]) -> Iterator[Any]:
    """Yield answers in the order of their jobs, each as soon as all before it are there."""
    early, wanted = dict[int, Any](), 0
    for places, answers in parts:
        early |= zip(places, answers, strict=True)
        while wanted in early:
            yield early.pop(wanted)
            wanted += 1


def packed(data: object) -> bytes:
    """Return data for a worker; its absolute paths are led below the folder of the worker's files there."""
    stream = io.BytesIO()
    _PathPickler(stream, pickle.HIGHEST_PROTOCOL).dump(data)
    return stream.getvalue()


def unpacked(content: bytes, prefix: str) -> Any:
    """Return what was packed for a worker that has its files below a folder; empty where it sees the files."""
    return _PathUnpickler(io.BytesIO(content), prefix).load()


def answered(data: object, prefix: str) -> bytes:
    """Return what a worker answers; the folder of its files is removed from all texts."""
    stream = io.BytesIO()
    (_TextPickler(stream, prefix) if prefix else pickle.Pickler(stream, pickle.HIGHEST_PROTOCOL)).dump(data)
    return stream.getvalue()


def read_answer(content: bytes) -> Any:
    """Return what a worker answered."""
    return _TextUnpickler(io.BytesIO(content)).load()


class _PathPickler(pickle.Pickler):
    """Writes absolute paths by their names."""

    def persistent_id(self, given: Any) -> str | None:
        return str(given) if isinstance(given, PurePath) and given.is_absolute() else None


class _PathUnpickler(pickle.Unpickler):
    """Reads absolute paths as those below a folder."""

    def __init__(self, stream: io.BytesIO, prefix: str) -> None:
        super().__init__(stream)
        self.prefix = prefix

    def persistent_load(self, name: Any) -> Path:
        return Path(f"{self.prefix}{name}")


class _TextPickler(pickle.Pickler):
    """Writes texts, and paths, without the name of a folder that stands before others in them."""

    def __init__(self, stream: io.BytesIO, prefix: str) -> None:
        super().__init__(stream, pickle.HIGHEST_PROTOCOL)
        self.prefix = prefix

    def persistent_id(self, given: Any) -> tuple[str, str] | None:
        if isinstance(given, PurePath) and self.prefix in str(given):
            return "path", str(given).replace(self.prefix, "") or os.sep
        if type(given) is str and self.prefix in given:
            return "text", given.replace(self.prefix, "")
        return None


class _TextUnpickler(pickle.Unpickler):
    """Reads what ``_TextPickler`` has written."""

    def persistent_load(self, shortened: Any) -> str | Path:
        kind, text = shortened
        return Path(text) if kind == "path" else str(text)

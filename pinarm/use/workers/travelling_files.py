"""Files that travel with jobs: what is known of them here, and their copies on a worker, checked by digest."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from shutil import rmtree
from weakref import finalize

from pinarm.errors import InputError
from pinarm.input.roots import MARKERS
from pinarm.use.workers.chunk_order import FileEntry, FilesLacking

MOST_BYTES = 500_000_000
"""Of all files of a work."""

EMPTY = hashlib.sha256().hexdigest()
"""Digest of a file without content."""


@dataclass(frozen=True, eq=False)
class Parcel:
    """The files that jobs refer to, as they stand here.

    Attributes:
        entries: Absolute path -> what stands there. Links are followed once, and files that mark a root are empty.
        contents: Digest -> content.
    """

    entries: dict[str, FileEntry] = field(default_factory=dict)
    contents: dict[str, bytes] = field(default_factory=lambda: {EMPTY: b""}, repr=False)

    def add(self, paths: Iterable[str | Path]) -> None:
        """Take in paths, whatever stands there.

        Raises:
            InputError: The files are too large to travel, or cannot be read.
        """
        for path in map(os.path.abspath, paths):
            real = os.path.realpath(path)
            if real != path:
                self.entries[path] = ("folder", "") if os.path.isdir(real) else ("link", real)
            if real not in self.entries:
                self.entries[real] = self._entry(real)
                self._mark_roots(real)

    def _entry(self, path: str) -> FileEntry:
        if os.path.isdir(path):
            return "folder", ""
        if not os.path.isfile(path):
            return "absent", ""
        try:
            size = os.path.getsize(path) + sum(map(len, self.contents.values()))
            if size > MOST_BYTES:
                raise InputError(f"the files that cases refer to have {size} bytes with {path}: too many to travel",
                                 expected=f"at most {MOST_BYTES}", hint="smaller meshes or tables")  # fmt: skip
            content = Path(path).read_bytes()
        except OSError as error:
            raise InputError(f"the file {path} cannot be read: {error.strerror}") from None
        digest = hashlib.sha256(content).hexdigest()
        self.contents[digest] = content
        return "file", digest

    def _mark_roots(self, path: str) -> None:
        """Note the files that mark the folders above a path as roots; only that they are there matters."""
        for folder in Path(path).parents:
            for marker in map(str, (folder / name for name in MARKERS)):
                if marker not in self.entries and os.path.isfile(marker):
                    self.entries[marker] = ("file", EMPTY)


class Mirror:
    """Copies of files on a worker, below a temporary folder that goes with this object.

    Attributes:
        prefix: The folder: the copy of ``/a/b`` is ``prefix + "/a/b"``.
    """

    def __init__(self) -> None:
        self.prefix = os.path.realpath(tempfile.mkdtemp(prefix="pinarm-files-"))
        finalize(self, rmtree, self.prefix, ignore_errors=True)
        self._known = dict[str, FileEntry]()

    def update(self, entries: Mapping[str, FileEntry], contents: Mapping[str, bytes]) -> FilesLacking:
        """Make what stands at paths that are new, and return which contents are wanted for others.

        Raises:
            InputError: A path is none that a parcel has, or a content is not that of its digest.
        """
        lacking = set[str]()
        for path, (kind, value) in entries.items():
            if path in self._known:
                continue
            if kind == "file" and value != EMPTY and value not in contents:
                lacking.add(value)
                continue
            self._make(path, kind, value, contents.get(value, b""))
            self._known[path] = kind, value
        return FilesLacking(digests=frozenset(lacking))

    def unknown(self, files: Iterable[Path]) -> FilesLacking:
        """Return the paths among files that have been referred to of which nothing is known here."""
        below = self.prefix + os.sep
        names = {str(file)[len(self.prefix) :] for file in files if str(file).startswith(below)}
        return FilesLacking(paths=frozenset(names - self._known.keys()))

    def _make(self, path: str, kind: str, value: str, content: bytes) -> None:
        copy = self._copy(path)
        if kind == "folder":
            copy.mkdir(parents=True, exist_ok=True)
        elif kind == "link":
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.symlink_to(self._copy(value))
        elif kind == "file":
            if hashlib.sha256(content).hexdigest() != value:
                raise InputError(f"the file {path} came to a worker with another content than it was sent with")
            copy.parent.mkdir(parents=True, exist_ok=True)
            with open(copy, "xb") as stream:
                stream.write(content)

    def _copy(self, path: str) -> Path:
        """Return where the copy of a path stands, with no link on the way to it."""
        copy = Path(f"{self.prefix}{path}")
        plain = os.path.isabs(path) and os.path.normpath(path) == path
        if not plain or os.path.realpath(copy.parent) != str(copy.parent):
            raise InputError(f"{path!r} is no path of a file that can travel", expected="an absolute path without '..'")
        return copy


class SharedFiles:
    """The files themselves, of a worker that sees the same ones."""

    prefix = ""

    def update(self, entries: Mapping[str, FileEntry], contents: Mapping[str, bytes]) -> FilesLacking:
        """Return that nothing is wanted."""
        return FilesLacking()

    def unknown(self, files: Iterable[Path]) -> FilesLacking:
        """Return that all is known."""
        return FilesLacking()

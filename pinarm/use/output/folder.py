"""Folders and files of results: they appear whole or not at all, and nothing else is replaced or removed.

A folder that was written here has a ``manifest.json`` with the SHA-256 digest of every file in it. Only these files are
ever replaced or removed; whatever else stands in the folder is an error that names it. New content is written to a
draft beside its place and renamed. Symbolic links are neither written through nor removed.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import shutil
import signal
import threading
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from pinarm.errors import InputError, printable
from pinarm.records import ValueRecord, replace
from pinarm.use.output.manifest import (
    DRAFT,
    MANIFEST,
    PARTIAL,
    Manifest,
    digest,
    file_names,
    no_text,
    own_files,
    read_manifest,
    write_manifest,
)

PATIENCE = 60.0
"""Seconds to wait for another process that replaces the files of a folder, which takes it milliseconds."""

YOUNG = 60.0
"""Seconds before a draft that is not locked counts as left behind: it may be about to be locked, or renamed."""

LEFT_BEHIND = re.compile(re.escape(DRAFT) + r"[0-9a-f]{8}[.]part([.]d)?")
"""Names of drafts."""


@contextmanager
def whole_folder(
    folder: Path, kind: str, *, source: Path | None = None, beside: Collection[str] = ()
) -> Iterator[Path]:
    """Yield an empty draft folder; at the end of the block its files replace those of an older one.

    An exception in the block leaves the folder as it was.

    Args:
        folder: The folder, which need not exist.
        kind: What is written, as in ``Manifest``.
        source: The scenario file that it came of.
        beside: Files in the folder that are left as they are.

    Raises:
        InputError: The folder cannot be written, or holds something else.
    """
    try:
        check_replaceable(folder, kind, beside=beside)
        with _draft(folder) as draft:
            yield draft
            _publish(draft, folder, Manifest(kind, {}, source=source_from(folder, source) if source else ""), beside)
    except OSError as error:
        raise InputError(f"the {kind} cannot be written to {folder}: {reason(error)}") from None


def reason(error: OSError) -> str:
    """Return why the system refuses to write, in words.

    It says "File exists" where a folder is to be made in place of a file, or of a link that leads nowhere.
    """
    if isinstance(error, FileExistsError):
        return f"{error.filename} is no folder, or a symbolic link that leads to none"
    return error.strerror or str(error)


def check_replaceable(folder: Path, kind: str, *, beside: Collection[str] = ()) -> None:
    """Raise where a folder holds anything but what was written here.

    Raises:
        InputError: It does, or it cannot be read; the message names the files.
    """
    try:
        if folder.is_symlink() or folder.exists():
            own_files(folder, kind, beside)
    except OSError as error:
        raise InputError(f"the {kind} cannot be written to {folder}: {reason(error)}") from None


def write_file(path: Path, parts: Iterable[bytes], *, home: Path | None = None) -> None:
    """Write a file that appears whole or not at all; in a folder with a manifest, which then lists it.

    Args:
        path: The file.
        parts: Its content.
        home: The folder that may have a manifest, where it is not the one that the file is in but one above it.

    Raises:
        InputError: It cannot be written, or something stands there that is no file, or none of the manifest's.
    """
    home = home or path.parent
    draft = home / f"{DRAFT}{os.urandom(4).hex()}.part"
    try:
        home.mkdir(parents=True, exist_ok=True)
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise InputError(f"{path} is not a regular file", hint="another name: -o FILE")
        try:
            with open(draft, "xb") as stream:
                _lock(stream.fileno(), fcntl.LOCK_SH)  # others see that it is being written
                stream.writelines(parts)
            _add(draft, home, path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {reason(error)}") from None


def write_new_file(path: Path, content: bytes) -> bool:
    """Write a file that appears whole where nothing is, not even a link; return whether nothing was there.

    Raises:
        OSError: It cannot be written; nothing is left then.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if os.path.lexists(path):
        return False
    draft = path.with_name(f"{DRAFT}{os.urandom(4).hex()}.part")
    try:
        draft.write_bytes(content)
        draft.rename(path)
    finally:
        draft.unlink(missing_ok=True)
    return True


def claim_folder(folder: Path, kind: str, source: Path) -> bool:
    """Make a folder where nothing stands, whose manifest says what is about to come of which file; tell whether it was.

    Nobody else can do so at the same time: of several processes one makes the folder.

    Args:
        folder: The folder.
        kind: What is to be written, as in ``Manifest``.
        source: The scenario file that it comes of.

    Raises:
        InputError: It cannot be made.
    """
    if os.path.lexists(folder):
        return False
    try:
        with _draft(folder) as draft:
            with _locked(draft, fcntl.LOCK_SH) as home:
                write_manifest(home, Manifest(kind, {}, source=source_from(folder, source)))
            draft.rename(folder)
    except OSError as error:
        if error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):  # another process was faster
            return False
        raise InputError(f"the {kind} cannot be written to {folder}: {reason(error)}") from None
    return True


def release_folder(folder: Path) -> None:
    """Remove a folder made by ``claim_folder`` that nothing has been written to; other ones stay."""
    with suppress(OSError):
        with _locked(folder, fcntl.LOCK_EX) as home:
            manifest = read_manifest(folder)
            if manifest is None or manifest.files or manifest.arriving:
                return
            os.unlink(MANIFEST, dir_fd=home)
        folder.rmdir()


@contextmanager
def complete_folder(folder: Path) -> Iterator[None]:
    """Let the block read a folder while nobody replaces its files.

    Raises:
        InputError: The folder has no manifest, or its writer was killed while it replaced files.
    """
    with _locked(folder, fcntl.LOCK_SH):
        manifest = read_manifest(folder)
        if manifest is None or manifest.arriving or not manifest.files:
            problem = _left_behind(manifest)
            raise InputError(f"{folder} is not a complete result: its writer {problem}", hint="the same run again")
        yield


def _left_behind(manifest: Manifest | None) -> str:
    """Return in words what became of the writer of a folder that is not complete."""
    if manifest is None:
        return "did not leave a manifest.json"
    return "was killed while it replaced files" if manifest.arriving else "has not come to its end"


@contextmanager
def _draft(folder: Path) -> Iterator[Path]:
    """Yield an empty folder: inside of one that exists, which may be all that this user can write; else beside it.

    It goes at the end of the block, unless it was renamed. Until then it is locked: others see that it is in use.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    for place in (folder.parent, folder):
        _clear(place)
    home = folder if folder.exists() else folder.parent
    draft = home / f"{DRAFT}{os.urandom(4).hex()}.part"
    draft.mkdir()
    try:
        with _locked(draft, fcntl.LOCK_SH):
            yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _clear(home: Path) -> None:
    """Remove drafts that killed processes have left in a folder: not locked, and there for a while."""
    for draft in home.glob(f"{DRAFT}*.part*"):
        with suppress(OSError):
            if not LEFT_BEHIND.fullmatch(draft.name) or time.time() - draft.lstat().st_mtime < YOUNG:
                continue
            descriptor = os.open(draft, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # raises without locks, too
                remove = shutil.rmtree if draft.is_dir() else os.unlink
                remove(draft)
            finally:
                os.close(descriptor)


def source_from(folder: Path, source: Path) -> str:
    """Return the path of a file from a folder, which need not exist, with no links on the way.

    Raises:
        InputError: It is no text that a manifest can hold.
    """
    path = os.path.relpath(os.path.realpath(source), os.path.realpath(folder))
    try:
        path.encode()
    except UnicodeEncodeError as error:
        raise no_text(error) from None
    return path


def _publish(draft: Path, folder: Path, empty: Manifest, beside: Collection[str]) -> None:
    """Put a draft in its place: by renaming it where there is none yet, else file by file under a lock."""
    new = {name: str(digest(draft / name)) for name in file_names(draft)}
    if not os.path.lexists(folder):
        with _locked(draft, fcntl.LOCK_SH) as home:
            write_manifest(home, replace(empty, files=new))
        try:
            draft.rename(folder)
            return
        except OSError as error:  # another process was faster
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        (draft / MANIFEST).unlink()
    with _locked(folder, fcntl.LOCK_EX) as home:
        own = own_files(folder, empty.kind, beside)
        _exchange(draft, home, replace(empty, files=own, arriving=new), set(own) - set(new))


def _add(draft: Path, folder: Path, path: Path) -> None:
    """Put a draft of one file in its place in a folder or below it."""
    name = path.relative_to(folder).as_posix()
    if (folder / MANIFEST).is_symlink() or not (folder / MANIFEST).is_file():
        draft.replace(path)
        return
    with _locked(folder, fcntl.LOCK_EX) as home:
        known = read_manifest(folder)
        if known is None or known.arriving:
            raise InputError(f"{folder} is not a complete result", hint="another name: -o FILE")
        if os.path.lexists(path) and digest(path) != known.files.get(name, ""):
            raise InputError(f"{path} was not written by pinarm, or was changed since", hint="another name: -o FILE")
        box = folder / f"{draft.name}.d"
        (box / name).parent.mkdir(parents=True)
        try:
            new = {name: str(digest(draft))}
            draft.rename(box / name)
            _exchange(box, home, replace(known, arriving=new), set())
        finally:
            shutil.rmtree(box, ignore_errors=True)


def _exchange(draft: Path, home: int, both: Manifest, stale: set[str]) -> None:
    """Move the files of a draft to a folder and remove what is stale.

    The manifest on the way knows the old files and the new: one whose writer is killed here is known for what it is.

    Args:
        draft: Where the new files are.
        home: Descriptor of the folder.
        both: The manifest on the way.
        stale: Files of the folder that are not replaced.
    """
    with signals_waiting():
        write_manifest(home, both)
        for name in both.arriving:
            with _parent(home, name) as (at, last):
                os.rename(draft / name, last, dst_dir_fd=at)
        for name in sorted(stale, reverse=True):
            with _parent(home, name) as (at, last), suppress(FileNotFoundError):
                os.unlink(last, dir_fd=at)
        for inner in sorted({str(Path(name).parent) for name in stale} - {"."}, reverse=True):
            with suppress(OSError):  # it holds other files
                os.rmdir(inner, dir_fd=home)
        left = {name: known for name, known in both.files.items() if name not in stale}
        write_manifest(home, replace(both, files=left | both.arriving, arriving={}))


@contextmanager
def _parent(home: int, name: str) -> Iterator[tuple[int, str]]:
    """Yield the descriptor of the folder that a path below ``home`` ends in, made where missing, and the last name.

    Raises:
        OSError: A folder on the way is a symbolic link.
    """
    *folders, last = Path(name).parts
    at = os.dup(home)
    try:
        for inner in folders:
            with suppress(FileExistsError):
                os.mkdir(inner, dir_fd=at)
            below = os.open(inner, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=at)
            os.close(at)
            at = below
        yield at, last
    finally:
        os.close(at)


@contextmanager
def _locked(folder: Path, how: int) -> Iterator[int]:
    """Yield the descriptor of a folder that nobody else replaces files in meanwhile.

    Raises:
        OSError: Another process keeps it locked.
    """
    if folder.is_symlink():  # which the system calls no directory
        raise OSError(errno.ELOOP, f"{folder} is a symbolic link")
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    deadline = time.monotonic() + PATIENCE
    try:
        while not _lock(descriptor, how):
            if time.monotonic() > deadline:
                raise OSError(errno.EAGAIN, f"another process has locked it for {PATIENCE:g} s")
            time.sleep(0.02)
        yield descriptor
    finally:
        os.close(descriptor)


def _lock(descriptor: int, how: int) -> bool:
    """Tell whether the lock is ours now."""
    try:
        fcntl.flock(descriptor, how | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # there are file systems without locks
    return True


@contextmanager
def signals_waiting() -> Iterator[None]:
    """Let signals that end the process wait for the end of a short block, such as a few renames."""
    arrived: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        arrived.append(number)

    main = threading.current_thread() is threading.main_thread()
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if main}
    changed = {number: handler for number, handler in before.items() if handler not in (None, signal.SIG_IGN)}
    for number in changed:
        signal.signal(number, note)
    try:
        yield
    finally:
        for number, handler in changed.items():
            signal.signal(number, handler)
        for one in arrived:
            signal.raise_signal(one)


RESULTS = Path("results")
"""Where folders stand that the user does not name."""


ENDINGS = {"result": "", "sweep": "-sweep", "trade-off": "-tradeoff"}
"""What is written -> how the names of its folders end."""


class Destination(ValueRecord, frozen=True):
    """A folder to write to.

    Attributes:
        folder: The folder.
        remark: Why it is not the usual one, or whose files are replaced there; empty for neither.
    """

    folder: Path
    remark: str = ""

    def __str__(self) -> str:
        return printable(f"written to {self.folder}{self.remark and ', '}{self.remark}")


@contextmanager
def destination(given: Path | None, scenario: Path, name: str, kind: str = "result") -> Iterator[Destination]:
    """Yield the folder for what comes of a scenario file, which no other file takes meanwhile.

    It is the one that the user names; else ``results/NAME``, or where that holds what came of another file the first of
    ``results/PARENT-NAME``, ``results/GRANDPARENT-PARENT-NAME`` ... that does not. A new folder is made at once, with a
    manifest that says whose it is, and removed where nothing has been written to it in the block.

    Args:
        given: The folder that the user names.
        scenario: The scenario file.
        name: Name of the scenario.
        kind: What is written: a key of ``ENDINGS``.

    Raises:
        InputError: All these folders hold what came of other files, or none can be made, or the name of the scenario
            file is no text.
    """
    own = os.path.realpath(scenario)
    if given is not None:
        source_from(given, scenario)  # what cannot be written down is told before the work
        other = _other(given, own)
        yield Destination(given, f"in place of {other}" if other else "")
        return
    free = _free(own, name, kind)
    try:
        yield free
    finally:
        release_folder(free.folder)


def _free(own: str, name: str, kind: str) -> Destination:
    """Return the first folder that no other file has taken, made where there was none; see ``destination``.

    Raises:
        InputError: All are taken.
    """
    said = ""
    for longer in (name, *_longer(Path(own), name)):
        folder = RESULTS / f"{longer}{ENDINGS[kind]}"
        claimed = claim_folder(folder, kind, Path(own))
        other = "" if claimed else _other(folder, own)
        if not other:
            return Destination(folder, said and f"as {said}")
        said = said or f"{folder} holds {other}"
    raise InputError(said, expected="a folder of its own", hint="another folder: -o DIR")


def _longer(scenario: Path, name: str) -> Iterator[str]:
    """Yield the name with that of the folder of the file before it, then of the one above that too ..."""
    above = scenario.parents[1:] if scenario.parent.name == name else scenario.parents
    for parent in above:
        if parent.name:
            name = f"{parent.name}-{name}"
            yield name


def _other(folder: Path, own: str) -> str:
    """Return in words what a folder holds that did not come of this file; empty for nothing."""
    for home in (folder, folder / PARTIAL):
        manifest = read_manifest(home)
        if manifest is not None:
            source = _path(home, manifest.source)
            known = f"the {manifest.kind} of {os.path.relpath(source)}" if source else f"a {manifest.kind} of no file"
            return "" if source == own else known
    return ""


def _path(home: Path, source: str) -> str:
    """Return the file that a manifest names, with no links on the way; empty where it names none."""
    try:
        return os.path.realpath(home / source) if source else ""
    except (OSError, ValueError):  # it has been changed by hand
        return ""

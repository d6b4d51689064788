"""Folders and files of results: they appear whole or not at all, and nothing else is replaced or removed.

A folder that was written here has a ``manifest.json`` with the SHA-256 digest of every file in it. Only these files are
ever replaced or removed; whatever else is in the folder is an error that names it. New content is written to a draft
beside its place and renamed. Symbolic links are neither written through nor removed.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import shutil
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from pinarm.errors import InputError, printable
from pinarm.records import ValueRecord, replace

MANIFEST = "manifest.json"
PARTIAL = "partial"
"""A folder in that of a result: the rows until a run failed. It has its own manifest."""

DRAFT = ".pinarm-"
"""Beginning of the names of drafts."""

NAMED = 5
"""Files that a message names."""

PATIENCE = 60.0
"""Seconds to wait for another process that replaces the files of a folder, which takes it milliseconds."""


class Manifest(msgspec.Struct, frozen=True, omit_defaults=True):
    """Files that were written to a folder.

    Attributes:
        kind: Content of the folder: ``result``, ``sweep``, ``batch`` or ``trade-off``.
        files: Path in the folder -> SHA-256 digest of its content.
        arriving: The same of files that are being put there; empty where the folder is complete.
        source: Path from the folder of the scenario file that it came of; empty where there is none.
    """

    kind: str
    files: dict[str, str]
    arriving: dict[str, str] = {}
    source: str = ""


@contextmanager
def whole_folder(
    folder: Path, kind: str, *, source: Path | None = None, beside: Collection[str] = ()
) -> Iterator[Path]:
    """Yield an empty draft folder; at the end of the block its files replace those of an older one.

    An exception in the block leaves the folder as it was.

    Args:
        folder: The folder, which need not exist.
        kind: Content of the folder, as in ``Manifest``.
        source: The scenario file that it came of.
        beside: Files in the folder that are left as they are.

    Raises:
        InputError: The folder cannot be written, or holds something else.
    """
    with _writing(kind, folder):
        check_replaceable(folder, kind, beside=beside)
        with _draft(folder) as draft:
            yield draft
            _publish(draft, folder, Manifest(kind, {}, source=source_from(folder, source) if source else ""), beside)


def check_replaceable(folder: Path, kind: str, *, beside: Collection[str] = ()) -> None:
    """Raise where a folder holds anything but files that were written here.

    Raises:
        InputError: It does, or it cannot be read; the message names the files.
    """
    with _writing(kind, folder):
        if os.path.lexists(folder):
            _own_files(folder, kind, beside)


@contextmanager
def _writing(kind: str, place: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"the {kind} cannot be written to {place}: {reason(error)}") from None


def reason(error: OSError) -> str:
    """Return why the system refuses to write, in words.

    It says "File exists" where a folder is to be made in place of a file, or of a link that leads nowhere.
    """
    if isinstance(error, FileExistsError):
        return f"{error.filename} is no folder, or a symbolic link that leads to none"
    return error.strerror or str(error)


def write_file(path: Path, parts: Iterable[bytes]) -> None:
    """Write a file that appears whole or not at all; the manifest of its folder, if there is one, lists it then.

    Raises:
        InputError: It cannot be written, or something is there that is no file, or none of the manifest's.
    """
    draft = path.with_name(_draft_name())
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise InputError(f"{path} is not a regular file", hint="another name: -o FILE")
        try:
            with open(draft, "xb") as stream:
                stream.writelines(parts)
            _add(draft, path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {reason(error)}") from None


def _add(draft: Path, path: Path) -> None:
    folder = path.parent
    if not _is_file(folder / MANIFEST):
        draft.replace(path)
        return
    with _locked(folder, fcntl.LOCK_EX):
        known = read_manifest(folder)
        if known is None or known.arriving:
            raise InputError(f"{folder} is not a complete result", hint="another name: -o FILE")
        if os.path.lexists(path) and _digest(path) != known.files.get(path.name, ""):
            raise InputError(f"{path} was not written by pinarm, or was changed since", hint="another name: -o FILE")
        arriving = {path.name: str(_digest(draft))}
        _write_manifest(folder, replace(known, arriving=arriving))
        draft.replace(path)
        _write_manifest(folder, replace(known, files=known.files | arriving))


def write_new_file(path: Path, content: bytes) -> bool:
    """Write a file where nothing is, not even a link; return whether nothing was there.

    Raises:
        OSError: It cannot be written; nothing is left then.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        stream = open(path, "xb")  # noqa: SIM115
    except FileExistsError:
        return False
    try:
        with stream:
            stream.write(content)
    except OSError:
        path.unlink()
        raise
    return True


@contextmanager
def complete_folder(folder: Path) -> Iterator[None]:
    """Let the block read a folder while nobody replaces its files.

    Raises:
        InputError: The folder has no manifest, or its writer was killed while it replaced files.
    """
    with _locked(folder, fcntl.LOCK_SH):
        manifest = read_manifest(folder)
        if manifest is None or manifest.arriving or not manifest.files:
            problem = "has not come to its end" if manifest else "did not leave a manifest.json"
            problem = "was killed while it replaced files" if manifest and manifest.arriving else problem
            raise InputError(f"{folder} is not a complete result: its writer {problem}", hint="the same run again")
        yield


def _draft_name() -> str:
    return f"{DRAFT}{os.urandom(4).hex()}.part"


@contextmanager
def _draft(folder: Path) -> Iterator[Path]:
    """Yield an empty folder: inside of one that exists, which may be all that this user can write; else beside it.

    It goes at the end of the block, unless it was renamed.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    home = folder if folder.exists() else folder.parent
    draft = home / _draft_name()
    draft.mkdir()
    try:
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _publish(draft: Path, folder: Path, empty: Manifest, beside: Collection[str]) -> None:
    """Put a draft in its place: by renaming it where there is none yet, else file by file under a lock."""
    new = {name: str(_digest(draft / name)) for name in _file_names(draft)}
    if not os.path.lexists(folder):
        _write_manifest(draft, replace(empty, files=new))
        with suppress(OSError):  # another process was faster
            draft.rename(folder)
            return
        (draft / MANIFEST).unlink()
    with _locked(folder, fcntl.LOCK_EX):
        old = _own_files(folder, empty.kind, beside)
        _write_manifest(folder, replace(empty, files=old, arriving=new))  # a folder whose writer is killed now is known
        for name in new:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            os.rename(draft / name, folder / name)
        for name in set(old) - set(new):
            (folder / name).unlink(missing_ok=True)
        for inner in sorted({str(Path(name).parent) for name in old} - {"."}, reverse=True):
            with suppress(OSError):  # it holds other files
                (folder / inner).rmdir()
        _write_manifest(folder, replace(empty, files=new))


@contextmanager
def _locked(folder: Path, how: int) -> Iterator[None]:
    """Hold the lock of a folder: nobody else replaces files in it meanwhile."""
    if folder.is_symlink():  # which the system calls no directory
        raise OSError(errno.ELOOP, f"{folder} is a symbolic link")
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    deadline = time.monotonic() + PATIENCE
    try:
        while not locks(descriptor, how):
            if time.monotonic() > deadline:
                raise OSError(errno.EAGAIN, f"another process has locked it for {PATIENCE:g} s")
            time.sleep(0.02)
        yield
    finally:
        os.close(descriptor)


def locks(descriptor: int, how: int) -> bool:
    """Lock an open file or folder, without waiting; return whether the lock is ours now."""
    try:
        fcntl.flock(descriptor, how | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # there are file systems without locks
    return True


def no_text(error: UnicodeEncodeError) -> InputError:
    """Return the error of a name that is no Unicode, such as that of a file whose name is not UTF-8."""
    name = str(error.object).encode(errors="surrogateescape").decode(errors="replace")
    hint = "another name for it, or results in a folder below: -o DIR"
    return InputError(f"the name {name} is no text that a file of results can hold", hint=hint)


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


def _own_files(folder: Path, kind: str, beside: Collection[str]) -> dict[str, str]:
    """Return the digests of the files of a folder that were written here, without its manifest."""
    if folder.is_symlink():
        raise InputError(f"{folder} is a symbolic link", hint=f"the folder itself: -o {os.path.realpath(folder)}")
    manifest = read_manifest(folder)
    if manifest and manifest.kind != kind:
        raise InputError(f"{folder} holds a {manifest.kind}, no {kind}", hint="another folder: -o DIR")
    known = _listed(manifest, "") | _listed(read_manifest(folder / PARTIAL), f"{PARTIAL}/")
    passed = {*beside, *([MANIFEST] if manifest else ()), *([f"{PARTIAL}/{MANIFEST}"] if known else ())}
    own, foreign = dict[str, str](), list[str]()
    for name in _file_names(folder):
        if name not in passed:
            digest = _digest(folder / name)
            if digest is not None and (name, digest) in known:
                own[name] = digest
            else:
                foreign.append(name)
        if len(foreign) > NAMED:  # of a folder that holds anything else, such as the user's home
            break
    if foreign:
        shown = ", ".join(foreign[:NAMED]) + (", ..." if len(foreign) > NAMED else "")
        raise InputError(
            f"{folder} holds files that pinarm did not write, or that were changed since: {shown}",
            expected="a new folder, or one that holds nothing but an earlier result",
            hint="another folder: -o DIR, or move these files away",
        )
    inner = folder / PARTIAL / MANIFEST
    return own | ({f"{PARTIAL}/{MANIFEST}": str(_digest(inner))} if _is_file(inner) else {})


def _listed(manifest: Manifest | None, inner: str) -> set[tuple[str, str]]:
    parts = (manifest.files, manifest.arriving) if manifest else ()
    return {(f"{inner}{name}", digest) for part in parts for name, digest in part.items()}


def _file_names(folder: Path) -> Iterator[str]:
    """Yield the paths in a folder of everything that is no folder, drafts left out; links are not followed."""
    for home, folders, files in os.walk(folder, onerror=_raise):
        folders[:] = sorted(name for name in folders if not name.startswith(DRAFT))
        links = [name for name in folders if os.path.islink(os.path.join(home, name))]
        for name in sorted([*files, *links]):
            if not name.startswith(DRAFT):
                yield os.path.relpath(os.path.join(home, name), folder)


def _raise(error: OSError) -> None:
    raise error


def _is_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _digest(path: Path) -> str | None:
    if not _is_file(path):
        return None
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def read_manifest(folder: Path) -> Manifest | None:
    """Return the manifest of a folder; nothing where it has none that can be read."""
    if folder.is_symlink() or not _is_file(folder / MANIFEST):
        return None
    try:
        return msgspec.json.decode((folder / MANIFEST).read_bytes(), type=Manifest)
    except (OSError, msgspec.DecodeError, RecursionError, ValueError):
        return None


def _write_manifest(folder: Path, manifest: Manifest) -> None:
    files, arriving = (dict(sorted(part.items())) for part in (manifest.files, manifest.arriving))
    data = replace(manifest, files=files, arriving=arriving)
    draft = folder / _draft_name()
    draft.write_bytes(msgspec.json.format(msgspec.json.encode(data), indent=1) + b"\n")
    draft.replace(folder / MANIFEST)


RESULTS = Path("results")
"""Folder of the folders that the user does not name."""

ENDINGS = {"result": "", "sweep": "-sweep", "trade-off": "-tradeoff"}
"""Kind of content -> how the names of its folders end."""


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
    """Yield the folder for the results of a scenario file, which no other file takes meanwhile.

    It is the one that the user names; else ``results/NAME``, or where that holds results of another file the first of
    ``results/PARENT-NAME``, ``results/GRANDPARENT-PARENT-NAME`` ... that does not. A new folder is made at once, with a
    manifest that says whose it is, and removed where nothing has been written to it in the block.

    Args:
        given: The folder that the user names.
        scenario: The scenario file.
        name: Name of the scenario.
        kind: Content of the folder: a key of ``ENDINGS``.

    Raises:
        InputError: All these folders hold results of other files, or none can be made, or the name of the scenario
            file is no text.
    """
    source = os.path.realpath(scenario)
    if given is not None:
        source_from(given, scenario)  # a name that cannot be written down is told before the work
        other = _other(given, source)
        yield Destination(given, f"in place of {other}" if other else "")
        return
    free = _free(source, name, kind)
    try:
        yield free
    finally:
        manifest = read_manifest(free.folder)
        if manifest and not manifest.files and not manifest.arriving:
            with suppress(OSError):
                (free.folder / MANIFEST).unlink()
                free.folder.rmdir()


def _free(source: str, name: str, kind: str) -> Destination:
    """Return the first folder that no other file has taken, made where there was none; see ``destination``."""
    above = [parent.name for parent in Path(source).parents if parent.name]
    taken, names = "", [name, *above[above[:1] == [name] :]]
    for count in range(1, len(names) + 1):
        folder = RESULTS / f"{'-'.join(reversed(names[:count]))}{ENDINGS[kind]}"
        other = "" if _claimed(folder, kind, source) else _other(folder, source)
        if not other:
            return Destination(folder, taken and f"as {taken}")
        taken = taken or f"{folder} holds {other}"
    raise InputError(taken, expected="a folder of its own", hint="another folder: -o DIR")


def _claimed(folder: Path, kind: str, source: str) -> bool:
    """Make a folder, with a manifest that says whose it is, where nothing is; of several processes one succeeds."""
    if os.path.lexists(folder):
        return False
    with _writing(kind, folder), _draft(folder) as draft:
        _write_manifest(draft, Manifest(kind, {}, source=source_from(folder, Path(source))))
        try:
            draft.rename(folder)
        except OSError as error:
            if error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):  # another process was faster
                return False
            raise
    return True


def _other(folder: Path, source: str) -> str:
    """Return in words whose results of another file a folder holds; empty for none."""
    for home in (folder, folder / PARTIAL):
        if manifest := read_manifest(home):
            known = os.path.realpath(home / manifest.source.replace("\0", "")) if manifest.source else ""
            of = f"the {manifest.kind} of {os.path.relpath(known)}" if known else f"a {manifest.kind} of no file"
            return "" if known == source else of
    return ""

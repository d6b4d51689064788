"""What pinarm wrote in a folder: a list of its files with the digests of their contents, in the folder itself."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

import msgspec

from pinarm.errors import InputError

MANIFEST = "manifest.json"
PARTIAL = "partial"
"""A folder in that of a result: what there was when a run failed. It has its own manifest."""

DRAFT = ".pinarm-"
"""How names of drafts begin; one that a killed process left behind is passed over, and removed by a later one."""

MOST_BYTES = 500_000_000
"""Of a manifest: twice that of a million files."""

NAMED = 5
"""Files that a message names."""


class Manifest(msgspec.Struct, frozen=True):
    """What is known of a folder.

    Attributes:
        kind: What it holds: ``result``, ``sweep``, ``batch`` or ``trade-off``.
        files: Path in the folder -> SHA-256 digest of its content.
        arriving: The same of files that are being put there; empty where the folder is complete.
        source: Path from the folder of the scenario file that it came of; empty where there is none.
    """

    kind: str
    files: dict[str, str]
    arriving: dict[str, str] = {}
    source: str = ""


def no_text(error: UnicodeEncodeError) -> InputError:
    """Return the error of a name that is no Unicode, such as that of a file whose name is not UTF-8."""
    name = str(error.object).encode(errors="surrogateescape").decode(errors="replace")
    hint = "another name for it, or results in a folder below: -o DIR"
    return InputError(f"the name {name} is no text that a file of results can hold", hint=hint)


def own_files(folder: Path, kind: str, beside: Collection[str]) -> dict[str, str]:
    """Return the digests of the files of a folder that were written here, without its manifest.

    Raises:
        InputError: It holds something else.
        OSError: It cannot be read.
    """
    if folder.is_symlink():
        raise InputError(f"{folder} is a symbolic link", hint=f"the folder itself: -o {os.path.realpath(folder)}")
    manifest = read_manifest(folder)
    if manifest and manifest.kind != kind:
        raise InputError(f"{folder} holds a {manifest.kind}, no {kind}", hint="another folder: -o DIR")
    known = _with_partial(folder, manifest or Manifest(kind, {}))
    passed = {MANIFEST, *beside} if manifest else beside
    own, foreign = dict[str, str](), list[str]()
    for name in file_names(folder):
        if name in passed:
            continue
        found = digest(folder / name)
        if found is not None and found in (known.files.get(name), known.arriving.get(name)):
            own[name] = found
        else:
            foreign.append(name)
        if len(foreign) > NAMED:
            break
    if foreign:
        raise _foreign(folder, foreign)
    return own


def _with_partial(folder: Path, manifest: Manifest) -> Manifest:
    """Return a manifest with the files of the partial result in the folder, which its own manifest lists."""
    partial = read_manifest(folder / PARTIAL) if not (folder / PARTIAL).is_symlink() else None
    if partial is None:
        return manifest
    files, arriving = (
        {f"{PARTIAL}/{name}": x for name, x in part.items()} for part in (partial.files, partial.arriving)
    )
    own = {f"{PARTIAL}/{MANIFEST}": str(digest(folder / PARTIAL / MANIFEST))}
    return Manifest(manifest.kind, manifest.files | files | own, manifest.arriving | arriving)


def _foreign(folder: Path, names: list[str]) -> InputError:
    shown = ", ".join(names[:NAMED]) + (", ..." if len(names) > NAMED else "")
    return InputError(
        f"{folder} holds files that pinarm did not write, or that were changed since: {shown}",
        expected="a new folder, or one that holds nothing but an earlier result",
        hint="another folder: -o DIR, or move these files away",
    )


def file_names(folder: Path) -> Iterator[str]:
    """Yield the paths in a folder of everything that is no folder, drafts left out; links are not followed."""
    for home, folders, files in os.walk(folder, onerror=_raise):
        folders[:] = sorted(name for name in folders if not name.startswith(DRAFT))
        links = [name for name in folders if os.path.islink(os.path.join(home, name))]
        for name in sorted([*files, *links]):
            if not name.startswith(DRAFT):
                yield os.path.relpath(os.path.join(home, name), folder)


def _raise(error: OSError) -> None:
    raise error


def digest(path: Path) -> str | None:
    """Return the digest of a regular file; nothing for a link or anything else."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    with open(descriptor, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest() if _is_file(descriptor) else None


def _is_file(descriptor: int) -> bool:
    return stat.S_ISREG(os.fstat(descriptor).st_mode)


def read_manifest(folder: Path) -> Manifest | None:
    """Return the manifest of a folder; nothing where it has none that can be read."""
    try:
        descriptor = os.open(folder / MANIFEST, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    with open(descriptor, "rb") as stream:
        if not _is_file(descriptor) or os.fstat(descriptor).st_size > MOST_BYTES:
            return None
        try:
            return msgspec.json.decode(stream.read(), type=Manifest)
        except (msgspec.DecodeError, RecursionError, ValueError):
            return None


def write_manifest(home: int, manifest: Manifest) -> None:
    """Write the manifest of a folder, given by its descriptor, in place of an older one.

    By its path it could by now be another folder, where someone puts a link in its place.
    """
    raw = msgspec.json.format(msgspec.json.encode(_sorted(manifest)), indent=1) + b"\n"
    draft = f"{DRAFT}{os.urandom(4).hex()}.part"
    try:
        with open(draft, "xb", opener=partial(os.open, mode=0o666, dir_fd=home)) as stream:
            stream.write(raw)
        os.rename(draft, MANIFEST, src_dir_fd=home, dst_dir_fd=home)
    finally:
        with suppress(FileNotFoundError):
            os.unlink(draft, dir_fd=home)


def _sorted(manifest: Manifest) -> dict[str, str | Mapping[str, str]]:
    """Return a manifest as plain data, without what is empty."""
    data: dict[str, str | Mapping[str, str]] = {"kind": manifest.kind, "files": dict(sorted(manifest.files.items()))}
    data |= {"arriving": dict(sorted(manifest.arriving.items()))} if manifest.arriving else {}
    return data | ({"source": manifest.source} if manifest.source else {})

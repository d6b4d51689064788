"""Folders of results: whole or not at all, whatever ends the writer; nothing else is touched."""

import os
import resource
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pinarm.errors import InputError
from pinarm.use.output import check_replaceable, complete_folder, whole_folder, write_file, write_new_file


def contents(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.json")
    return {str(path.relative_to(folder)): path.read_text() for path in files}


def put(folder: Path, files: dict[str, str], kind: str = "result") -> None:
    with whole_folder(folder, kind) as draft:
        for name, text in files.items():
            (draft / name).parent.mkdir(exist_ok=True)
            (draft / name).write_text(text)


OLD = {"summary.json": "old", "trajectory.csv": "old", "plots/C_B.png": "old", "timing.json": "old"}
NEW = {"summary.json": "new", "trajectory.csv": "new", "plots/F.png": "new"}


@pytest.fixture
def out(tmp_path: Path) -> Path:
    put(tmp_path / "out", OLD)
    return tmp_path / "out"


def test_an_older_folder_is_replaced_as_a_whole(out: Path) -> None:
    assert contents(out) == OLD
    put(out, NEW)
    assert contents(out) == NEW
    with pytest.raises(InputError, match="holds a result, no sweep"):
        put(out, OLD, "sweep")
    assert contents(out) == NEW
    put(out, {"summary.json": "alone"})
    assert sorted(path.name for path in out.iterdir()) == ["manifest.json", "summary.json"]
    assert [path.name for path in out.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("name", ["plots/mine.png", "partial/thesis", "summary.json"])
def test_a_file_of_somebody_else_is_named_and_kept(out: Path, name: str) -> None:
    (out / name).parent.mkdir(exist_ok=True)
    (out / name).write_text("mine")
    before = contents(out)
    with pytest.raises(InputError, match=f"did not write, or that were changed since: {name}"):
        put(out, NEW)
    assert contents(out) == before


@pytest.mark.parametrize("manifest", ["{}", "[" * 100_000, '{"kind": 3, "files": {}}'])
def test_a_folder_with_no_manifest_or_none_of_ours_is_kept(tmp_path: Path, manifest: str) -> None:
    (tmp_path / "summary.json").write_text("mine")
    (tmp_path / "manifest.json").write_text(manifest)
    with pytest.raises(InputError, match="did not write"):
        put(tmp_path, NEW)
    (tmp_path / "manifest.json").unlink()
    with pytest.raises(InputError, match="did not write"):
        put(tmp_path, NEW)
    assert contents(tmp_path) == {"summary.json": "mine"}


def test_a_manifest_cannot_name_files_elsewhere(out: Path) -> None:
    """Its digest is right; but only what stands in the folder is looked at."""
    (out.parent / "mine").write_text("old")
    manifest = (out / "manifest.json").read_text()
    (out / "manifest.json").write_text(manifest.replace('"timing.json"', '"../mine"'))
    (out / "timing.json").unlink()
    put(out, NEW)
    assert (out.parent / "mine").read_text() == "old"


def links(out: Path, place: str) -> Path:
    """Put a link to a folder or a file of somebody else in place of what was written; return what it leads to."""
    target = out.parent / "else"
    if place == "out":
        out.rename(target)
    elif place == "plots":
        (out / "plots").rename(target)
    else:
        target.write_text("old")
        (out / place).unlink()
    (out if place == "out" else out / place).symlink_to(target)
    return target


@pytest.mark.parametrize("place", ["out", "plots", "summary.json", "manifest.json"])
def test_nothing_is_written_or_removed_through_links(out: Path, place: str) -> None:
    target = links(out, place)
    before = contents(target) if target.is_dir() else target.read_text()
    with pytest.raises(InputError, match=r"symbolic link|did not write"):
        put(out, NEW)
    assert before == (contents(target) if target.is_dir() else target.read_text())


@contextmanager
def ending_at_rename(monkeypatch: pytest.MonkeyPatch, number: int, end: Callable[[], None]) -> Iterator[None]:
    real, calls = os.rename, []

    def rename(*arguments: object, **more: object) -> None:
        calls.append(arguments)
        if len(calls) == number:
            end()
        real(*arguments, **more)  # type: ignore[arg-type]

    with monkeypatch.context() as during:
        during.setattr(os, "rename", rename)
        yield
    assert len(calls) >= number


class Killed(BaseException):
    """The end of the process, of which nothing can be said any more."""


def kill() -> None:
    raise Killed


@pytest.mark.parametrize("number", [1, 3])
def test_a_killed_writer_leaves_a_folder_that_is_known_for_what_it_is(
    out: Path, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ending_at_rename(monkeypatch, number, kill), pytest.raises(Killed):
        put(out, NEW)
    (out / ".pinarm-0123abcd.part").mkdir()  # its draft, which nobody removes
    with pytest.raises(InputError, match="killed while it replaced"), complete_folder(out):
        pass
    put(out, {**NEW, "trajectory.csv": "third"})
    assert contents(out) == {**NEW, "trajectory.csv": "third"}
    assert (out / ".pinarm-0123abcd.part").exists()
    with complete_folder(out):
        pass


def test_a_full_disk_leaves_the_older_folder_or_none(out: Path) -> None:
    """A bound on the size of files stands for the disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for folder in (out, out.parent / "new"):
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        try:
            with pytest.raises(InputError, match=r"cannot be written to .*: File too large"):
                put(folder, {"summary.json": "new", "trajectory.csv": "x" * 2000})
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert contents(out) == OLD
    assert [path.name for path in out.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("exists", [True, False])
def test_of_several_writers_one_is_the_last(out: Path, exists: bool) -> None:
    names = [f"{n:02d}" for n in range(12)]
    for turn in range(3):
        folder = out if exists else out.parent / f"new{turn}"
        start = threading.Barrier(4)

        def write(text: str, folder: Path = folder, start: threading.Barrier = start) -> None:
            with whole_folder(folder, "result") as draft:
                for name in names[: int(text)]:
                    (draft / name).write_text(text)
                start.wait()

        writers = [threading.Thread(target=write, args=(text,)) for text in ("3", "6", "9", "12")]
        for writer in writers:
            writer.start()
        for writer in writers:
            writer.join()
        [text] = set(contents(folder).values())
        assert contents(folder) == dict.fromkeys(names[: int(text)], text)


class TestFile:
    def test_is_listed_in_the_manifest_of_its_folder(self, out: Path) -> None:
        write_file(out / "replay.html", [b"a", b"b"])
        write_file(out / "replay.html", [b"c"])
        assert (out / "replay.html").read_text() == "c"
        check_replaceable(out, "result")
        put(out, NEW)
        assert contents(out) == NEW
        (out / "replay.html").write_text("mine")
        with pytest.raises(InputError, match="was not written by pinarm"):
            write_file(out / "replay.html", [b"new"])
        assert (out / "replay.html").read_text() == "mine"

    def test_replaces_a_file_elsewhere_but_no_link(self, tmp_path: Path) -> None:
        (tmp_path / "there").write_text("mine")
        (tmp_path / "link").symlink_to("there")
        with pytest.raises(InputError, match="is not a regular file"):
            write_file(tmp_path / "link", [b"new"])
        assert (tmp_path / "there").read_text() == "mine"
        write_file(tmp_path / "there", [b"new"])
        assert contents(tmp_path) == {"there": "new", "link": "new"}


def test_a_new_file_is_written_where_nothing_is(tmp_path: Path) -> None:
    assert write_new_file(tmp_path / "a" / "first", b"content")
    (tmp_path / "a" / "link").symlink_to(tmp_path / "nowhere")
    assert not write_new_file(tmp_path / "a" / "first", b"other")
    assert not write_new_file(tmp_path / "a" / "link", b"other")
    assert (tmp_path / "a" / "first").read_bytes() == b"content"
    assert sorted(os.listdir(tmp_path / "a")) == ["first", "link"]

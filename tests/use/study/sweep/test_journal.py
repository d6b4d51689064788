"""A journal is a file like any other: whatever it holds, a sweep believes what it wrote itself, and ends with words."""

import os
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from pinarm.errors import InputError
from pinarm.use.cases.case import Row
from pinarm.use.study.sweep.solving import HEAD, Journal, JournalEntry, digest


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "file").write_text("content")
    journal = Journal(tmp_path / "journal.jsonl", "task", 2)
    for case in range(3):
        journal.add([(f"case {case}", Row((float(case), float("nan")), "", (str(tmp_path / "file"),)))])
    journal.add([("failed", Row((), "why", (str(tmp_path / "file"),)))])
    journal.close()
    return tmp_path / "journal.jsonl"


def line_of(entry: JournalEntry) -> bytes:
    return msgspec.json.encode(entry) + b"\n"


def known(path: Path) -> Iterator[str]:
    journal = Journal(path, "task", 2)
    for key, row in journal.rows():
        yield key
        assert row.error == ("why" if key == "failed" else "")
        assert row.numbers[:1] == ((float(key[-1]),) if key != "failed" else ())
    journal.close()


def test_what_was_written_is_read_again(path: Path) -> None:
    assert [*known(path)] == ["case 0", "case 1", "case 2", "failed"]
    (path.parent / "file").write_text("changed")
    assert not [*known(path)]


@pytest.mark.parametrize(("line", "left"), [
    (1, []), (2, ["case 1", "case 2", "failed"]), (5, ["case 0", "case 1", "case 2"]),
])  # fmt: skip
@pytest.mark.parametrize("change", [
    lambda line: b"", lambda line: line[:-9], lambda line: b"\xff\xfe\n",
    lambda line: b"[" * 100_000 + b"\n",
])  # fmt: skip
def test_a_line_that_was_changed_is_passed_over(path: Path, line: int, left: list[str], change) -> None:  # type: ignore[no-untyped-def]
    lines = path.read_bytes().splitlines(keepends=True)
    changed = change(lines[line])
    lines[line] = changed if changed.endswith(b"\n") or not changed else changed + b"\n"
    if lines[line] == path.read_bytes().splitlines(keepends=True)[line]:
        return
    path.write_bytes(b"".join(lines))
    assert [*known(path)] == left


def test_devices_and_pipes_that_it_names_are_not_read(path: Path) -> None:
    os.mkfifo(path.parent / "pipe")
    names = ["/dev/zero", str(path.parent / "pipe"), "/proc/kmsg", "/proc/self/mem", "a\0b", str(path.parent)]
    with open(path, "ab") as stream:
        for name in names:
            files = {name: digest(name)}
            stream.write(line_of(JournalEntry(digest(files), files)))
            stream.write(line_of(JournalEntry(digest(files), case="case 0", numbers=(9.0, 9.0))))
    assert [*known(path)] == ["case 0", "case 1", "case 2", "failed"]


@pytest.mark.parametrize("content", [b"mine\n", b"[" * 100_000, HEAD[:-2] + b"x\n"])
def test_a_file_that_is_no_journal_is_left_as_it_is(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "journal.jsonl").write_bytes(content)
    with pytest.raises(InputError, match="is no journal of a sweep"):
        Journal(tmp_path / "journal.jsonl", "task", 2)
    assert (tmp_path / "journal.jsonl").read_bytes() == content

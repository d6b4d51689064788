"""What goes to a worker: its paths are led below a folder there, and that folder is in no text that comes back."""

import pickle
from pathlib import Path, PurePosixPath

from pinarm.errors import InputError
from pinarm.use.study.workers.chunk_order import answered, packed, read_answer, unpacked


def test_absolute_paths_are_led_below_a_folder_and_relative_ones_are_names() -> None:
    given = {"folder": Path("/a/b"), "name": Path("b/c.yaml"), "text": "/a/b", "pure": PurePosixPath("/a")}
    assert unpacked(packed(given), "/tmp/x") == {**given, "folder": Path("/tmp/x/a/b"), "pure": Path("/tmp/x/a")}
    assert unpacked(packed(given), "") == {**given, "pure": Path("/a")}


def test_the_folder_is_removed_from_texts_and_paths_that_come_back() -> None:
    error = InputError("/tmp/x/a/b.yaml:3: a mistake", hint="see /tmp/x/a and /tmp/x/c")
    rows = [("/tmp/x/a/b", 1.5, Path("/tmp/x/a"), Path("/tmp/x")), error]
    found, same = read_answer(answered(rows, "/tmp/x"))
    assert found == ("/a/b", 1.5, Path("/a"), Path("/"))
    assert (same.message, same.hint) == ("/a/b.yaml:3: a mistake", "see /a and /c")


def test_what_a_worker_that_sees_the_files_says_stays_as_it_is() -> None:
    rows = ["/tmp/x/a", Path("/tmp/x"), float("inf")]
    assert read_answer(answered(rows, "")) == rows
    assert pickle.loads(answered(rows, "")) == rows

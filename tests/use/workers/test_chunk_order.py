"""What goes to a worker: its paths are led below a folder there, and that folder is in no text that comes back."""

import pickle
from pathlib import Path, PurePosixPath

from pinarm.errors import InputError
from pinarm.use.workers.chunk_order import answered, packed, read_answer, unpacked


def test_absolute_paths_are_led_below_a_folder_and_relative_ones_are_names() -> None:
    given = {"folder": Path("/a/b"), "name": Path("b/c.yaml"), "text": "/a/b", "pure": PurePosixPath("/a")}
    assert unpacked(packed(given), "/home/x") == {**given, "folder": Path("/home/x/a/b"), "pure": Path("/home/x/a")}
    assert unpacked(packed(given), "") == {**given, "pure": Path("/a")}


def test_the_folder_is_removed_from_texts_and_paths_that_come_back() -> None:
    error = InputError("/home/x/a/b.yaml:3: a mistake", hint="see /home/x/a and /home/x/c")
    rows = [("/home/x/a/b", 1.5, Path("/home/x/a"), Path("/home/x")), error]
    found, same = read_answer(answered(rows, "/home/x"))
    assert found == ("/a/b", 1.5, Path("/a"), Path("/"))
    assert (same.message, same.hint) == ("/a/b.yaml:3: a mistake", "see /a and /c")


def test_what_a_worker_that_sees_the_files_says_stays_as_it_is() -> None:
    rows = ["/home/x/a", Path("/home/x"), float("inf")]
    assert read_answer(answered(rows, "")) == rows
    assert pickle.loads(answered(rows, "")) == rows

"""CSV rows: a quote that is not closed drops nothing in silence."""

from pathlib import Path

import pytest

from pinarm.errors import InputError
from pinarm.input.csv_tables import rows, split_heading, table


def written(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_bytes(text.encode())
    return path


def test_rows_come_with_the_numbers_of_their_lines(tmp_path: Path) -> None:
    path = written(tmp_path, '\ufefft [s],x [m],note\r\n0,1,"a, ""b"""\n\n2,3,5" pipe\n')
    found = [(1, ["t [s]", "x [m]", "note"]), (2, ["0", "1", 'a, "b"']), (4, ["2", "3", '5" pipe'])]
    assert list(rows(path, "table.csv")) == found


@pytest.mark.parametrize(
    ("text", "line"),
    [('0,1,"a\n1,2,b\n2,3,c\n', 2), ('0,1,a\n1,2,"b\n2,3,c"\n3,4,d\n', 3), ('0,1,"a\n1,2,"b"\n2,3,c\n', 2)],
)
def test_a_quote_that_is_not_closed_in_its_line_is_an_error_there(tmp_path: Path, text: str, line: int) -> None:
    path = written(tmp_path, f"t [s],x [m],note\n{text}")
    with pytest.raises(InputError, match=rf"table\.csv:{line}:1: (a quote is not closed|this is not CSV)"):
        list(rows(path, "table.csv"))


def test_what_keeps_a_reader_waiting_is_refused(tmp_path: Path) -> None:
    import os

    os.mkfifo(tmp_path / "pipe.csv")
    for path, says in ((tmp_path / "pipe.csv", "not a regular file"), (Path("/dev/zero"), "not a regular file"),
                       (tmp_path, "not a regular file"), (tmp_path / "none.csv", "there is no file")):  # fmt: skip
        with pytest.raises(InputError, match=says):
            list(rows(path, str(path)))


@pytest.mark.parametrize(
    ("cell", "heading"),
    [(" theta [deg] ", ("theta", "deg")), ("[s]", ("", "s")), ("word", ("word", None)), ("a [b] c", None),
     ("a ] [b]", None), ("a [b", None), ("a [[b]]", None), (" " * 10**6 + "]", None)],
)  # fmt: skip
def test_headings(cell: str, heading: tuple[str, str | None] | None) -> None:
    assert split_heading(cell) == heading


def test_a_comment_above_a_table_is_called_one_and_lines_of_blanks_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"t\.csv:1:1: the first line is a comment"):
        table(written(tmp_path, "# measured, in May\na [m],b [m]\n1,2\n"), "t.csv")
    heads, below = table(written(tmp_path, "# a [m],b [m]\n1,2\n  \n"), "t.csv")
    assert (heads, [*below]) == (["# a [m]", "b [m]"], [(2, ["1", "2"])])

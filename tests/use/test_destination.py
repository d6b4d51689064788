"""Where commands write to: files of one name in different folders keep their results apart."""

import os
from pathlib import Path

import pytest

from pinarm.errors import InputError
from pinarm.use.output import Destination, complete_folder, destination, whole_folder


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def told(given: Path | None, scenario: Path, name: str, kind: str = "result") -> Destination:
    with destination(given, scenario, name, kind) as found:
        return found


def put(folder: Path, source: Path | None, kind: str = "result") -> None:
    with whole_folder(folder, kind, source=source) as draft:
        (draft / "summary.json").write_text("{}")


def test_files_of_one_name_have_folders_of_their_own() -> None:
    for scenario, folder in [("a/x.yaml", "results/x"), ("b/x.yaml", "results/b-x"), ("c/b/x.yaml", "results/c-b-x")]:
        found = told(None, Path(scenario), "x")
        assert found.folder == Path(folder)
        put(found.folder, Path(scenario))
        assert told(None, Path(scenario), "x").folder == Path(folder)  # its own is replaced
    assert str(found) == "written to results/c-b-x, as results/x holds the result of a/x.yaml"
    put(Path("results/arm"), Path("first/arm/scenario.yaml"))
    assert told(None, Path("second/arm/scenario.yaml"), "arm").folder == Path("results/second-arm")
    put(Path("results/y/partial"), Path("a/y.yaml"))  # which a failed run left
    assert told(None, Path("b/y.yaml"), "y").folder == Path("results/b-y")
    assert told(None, Path("a/y.yaml"), "y").folder == Path("results/y")


def test_a_folder_that_the_user_names_is_replaced_and_whose_it_was_is_said() -> None:
    put(Path("out"), Path("a/x.yaml"))
    assert str(told(Path("out"), Path("a/x.yaml"), "x")) == "written to out"
    assert str(told(Path("out"), Path("b/x.yaml"), "x")) == ("written to out, in place of the result of a/x.yaml")
    put(Path("old/results/x"), Path("old/x.yaml"))
    Path("old").rename("new")
    assert told(Path("new/results/x"), Path("new/x.yaml"), "x").remark == ""


@pytest.mark.parametrize("kind", ["result", "sweep"])
def test_what_came_of_no_file_or_of_another_kind_of_command_is_kept(kind: str) -> None:
    put(Path("results/x-sweep"), None if kind == "result" else Path("x-sweep.yaml"), kind)
    found = told(None, Path("a/x.yaml"), "x", "sweep")
    assert found.folder == Path("results/a-x-sweep")
    assert found.remark == (f"as results/x-sweep holds a {kind} of no file" if kind == "result" else
                            f"as results/x-sweep holds the {kind} of x-sweep.yaml")  # fmt: skip


def test_a_folder_that_nothing_was_written_to_is_removed_and_is_no_result_before() -> None:
    with destination(None, Path("a/x.yaml"), "x") as found:
        with pytest.raises(InputError, match="has not come to its end"), complete_folder(found.folder):
            pass
        assert told(None, Path("b/x.yaml"), "x").folder == Path("results/b-x")
    assert not list(Path("results").iterdir())


@pytest.mark.parametrize("given", [None, Path("out")])
def test_the_name_of_a_file_that_is_no_text_is_told_before_the_work(
    given: Path | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ended in a traceback when the result was written; a folder of such a name around both is none of it."""
    monkeypatch.chdir(tmp_path)
    named = Path(os.fsdecode(b"s\xff.yaml"))
    with pytest.raises(InputError, match="is no text that a file of results can hold"), destination(given, named, "s"):
        pass
    inner = tmp_path / os.fsdecode(b"f\xff")
    inner.mkdir()
    monkeypatch.chdir(inner)
    with destination(given, inner / "s.yaml", "s") as target:
        assert target.folder == (given or Path("results/s"))

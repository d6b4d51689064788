"""Where commands write to: files of one name in different folders keep their results apart."""

from pathlib import Path

import pytest

from pinarm.errors import InputError
from pinarm.use.output.destination import destination
from pinarm.use.output.folder import whole_folder


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(folder: Path, source: Path | None, kind: str = "result") -> None:
    with whole_folder(folder, kind, source=source) as draft:
        (draft / "summary.json").write_text("{}")


def test_files_of_one_name_have_folders_of_their_own() -> None:
    for scenario, folder in [("a/x.yaml", "results/x"), ("b/x.yaml", "results/b-x"), ("c/b/x.yaml", "results/c-b-x")]:
        found = destination(None, Path(scenario), "x")
        assert found.folder == Path(folder)
        put(found.folder, Path(scenario))
        assert destination(None, Path(scenario), "x").folder == Path(folder)  # its own is replaced
    assert str(found) == "written to results/c-b-x, as results/x holds the result of a/x.yaml"


def test_a_folder_that_the_user_names_is_replaced_and_whose_it_was_is_said() -> None:
    put(Path("out"), Path("a/x.yaml"))
    assert str(destination(Path("out"), Path("a/x.yaml"), "x")) == "written to out"
    assert str(destination(Path("out"), Path("b/x.yaml"), "x")) == (
        "written to out, in place of the result of a/x.yaml"
    )


def test_results_of_scenario_yaml_are_named_after_its_folder_and_then_after_that_above() -> None:
    put(Path("results/arm"), Path("first/arm/scenario.yaml"))
    assert destination(None, Path("second/arm/scenario.yaml"), "arm").folder == Path("results/second-arm")


@pytest.mark.parametrize("kind", ["result", "sweep"])
def test_what_came_of_no_file_or_of_another_kind_of_command_is_kept(kind: str) -> None:
    put(Path("results/x-sweep"), None if kind == "result" else Path("x-sweep.yaml"), kind)
    found = destination(None, Path("a/x.yaml"), "x", "-sweep")
    assert found.folder == Path("results/a-x-sweep")
    assert found.remark == (f"as results/x-sweep holds a {kind} of no file" if kind == "result" else
                            f"as results/x-sweep holds the {kind} of x-sweep.yaml")  # fmt: skip


def test_the_part_that_a_failed_run_left_is_kept_too() -> None:
    put(Path("results/x/partial"), Path("a/x.yaml"))
    assert destination(None, Path("b/x.yaml"), "x").folder == Path("results/b-x")
    assert destination(None, Path("a/x.yaml"), "x").folder == Path("results/x")


def test_a_folder_that_was_moved_with_its_scenario_is_still_its_own(here: Path) -> None:
    put(Path("old/results/x"), Path("old/x.yaml"))
    Path("old").rename("new")
    assert destination(Path("new/results/x"), Path("new/x.yaml"), "x").remark == ""


def test_where_all_names_are_taken_the_user_names_one(here: Path) -> None:
    put(Path("results/x"), Path("other.yaml"))
    names = [parent.name for parent in (here / "b").resolve().parents if parent.name]
    for count in range(len(names) + 1):
        put(Path("results") / "-".join([*reversed(names[:count]), "b", "x"]), Path("other.yaml"))
    with pytest.raises(InputError, match=r"results/x holds the result of other\.yaml.*\n.*\n.*-o DIR"):
        destination(None, Path("b/x.yaml"), "x")

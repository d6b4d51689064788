"""Versions of the programs that compute."""

from importlib.metadata import version
from pathlib import Path

import pytest

import pinarm
from pinarm.use.workers.versions import code_digest, differences, versions


def test_they_are_those_that_are_installed() -> None:
    found = versions()
    assert {name: found[name] for name in ("numpy", "scipy", "pinarm")} == {
        "numpy": version("numpy"), "scipy": version("scipy"), "pinarm": pinarm.__version__,
    }  # fmt: skip
    assert found["pinocchio"] == version("pin")


def test_differences_name_both() -> None:
    here = {"numpy": "2.4.6", "python": "3.11.7"}
    assert differences(here, here) == ""
    there = {"numpy": "2.3.1", "scipy": "1.0"}
    assert differences(here, there) == (
        "numpy is 2.4.6 here and 2.3.1 there, python is 3.11.7 here and absent there, "
        "scipy is absent here and 1.0 there"
    )


@pytest.mark.parametrize("name", ["a.py", "inner/b.c"])
def test_a_change_of_the_code_changes_its_digest(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "__init__.py").touch()
    monkeypatch.setattr(pinarm, "__file__", str(tmp_path / "__init__.py"))
    before = code_digest.__wrapped__()
    (tmp_path / "example_files").mkdir()
    (tmp_path / "example_files" / "first.py").write_text("# which only a wheel has\n")
    assert code_digest.__wrapped__() == before
    (tmp_path / name).write_text("# new\n")
    assert code_digest.__wrapped__() != before

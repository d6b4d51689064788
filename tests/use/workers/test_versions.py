"""Versions of the programs that compute."""

from pathlib import Path

import pytest

from pinarm.use.workers import worker
from pinarm.use.workers.worker import code_digest, differences


def test_differences_name_both() -> None:
    here = {"numpy": "2.4.6", "python": "3.11.7"}
    assert differences(here, here) == ""
    there = {"numpy": "2.3.1", "scipy": "1.0"}
    assert differences(here, there) == (
        "numpy is 2.4.6 here and 2.3.1 there, python is 3.11.7 here and absent there, "
        "scipy is absent here and 1.0 there"
    )


def test_a_change_of_the_code_changes_its_digest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "__init__.py").touch()
    monkeypatch.setattr(worker, "__file__", str(tmp_path / "use" / "workers" / "worker.py"))
    before = code_digest.__wrapped__()
    (tmp_path / "example_files").mkdir()
    (tmp_path / "example_files" / "first.py").write_text("# which only a wheel has\n")
    assert code_digest.__wrapped__() == before
    for name in ("a.py", "inner/b.c"):
        (tmp_path / name).write_text("# new\n")
        assert code_digest.__wrapped__() != before
        before = code_digest.__wrapped__()

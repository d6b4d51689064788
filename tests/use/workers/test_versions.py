"""Versions of the programs that compute."""

from pathlib import Path

import pytest

from pinarm.use.workers import worker
from pinarm.use.workers.worker import code_digest


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

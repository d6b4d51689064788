"""The test of an installation covers every kind of problem, and fails where an answer is wrong."""

import json
from pathlib import Path

import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.problems import KINDS
from pinarm.use.start.new import example_files
from pinarm.use.study.answers import selftest as module


@pytest.mark.house
def test_the_examples_of_every_kind_are_of_that_kind() -> None:
    for kind, entry in KINDS.items():
        examples = [pinarm.load(example_files() / "scenarios" / f"{name}.yaml") for name in entry.examples]
        assert [example.problem.kind for example in examples] == [kind] * len(examples) != []


def test_an_installation_that_is_well_passes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["selftest"]) == 0
    said = capsys.readouterr().out
    assert said.endswith("\npassed\n")
    assert said.count("passed, ") == sum(len(entry.examples) for entry in KINDS.values())
    assert all(f"\n{name} " in f"\n{said}" for name in ("pinarm", "python", "pinocchio", "numpy", "scipy", "platform"))


def test_a_wrong_answer_and_a_broken_library_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = (example_files() / "scenarios" / "gen411_arm_static.yaml").read_text()
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "models").symlink_to(example_files() / "models")
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "scenarios" / "one.yaml").write_text(scenario.replace("../models", str(example_files() / "models")))
    (tmp_path / "scenarios" / "other.yaml").write_text("nothing")
    monkeypatch.setattr(module, "example_files", lambda: tmp_path)
    kinds = {kind: KINDS[kind]._replace(examples=(name,)) for kind, name in (("statics", "one"), ("state", "other"))}
    monkeypatch.setattr(module, "KINDS", kinds)
    gravity = ["--root", str(example_files())]
    assert main(["selftest", "--json", *gravity]) == 1
    found = json.loads(capsys.readouterr().out)
    assert not found["passed"]
    assert "InputError" in found["checks"][1]["problem"]
    monkeypatch.setattr(module, "KINDS", {"statics": kinds["statics"]})
    assert main(["selftest", *gravity]) == 0
    light = (tmp_path / "scenarios" / "one.yaml").read_text() + "\ngravity: none\n"
    (tmp_path / "scenarios" / "one.yaml").write_text(light)
    assert main(["selftest", *gravity]) == 1
    assert "FAILED: not as in the answer key: C_B = 0" in capsys.readouterr().out

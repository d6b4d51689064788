"""Models, scenarios and examples are copied whole, and nothing that the user wrote is lost."""

from pathlib import Path

import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.start import new as module

ROOT = Path(pinarm.__file__).parents[1]


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is taken for the one with pinarm's own files."""
    for name in ("models/arm/arm.urdf", "models/arm/results/old.csv", "scenarios/arm.yaml", "scenarios/.hidden/x.yaml",
                 "examples/01.py", "examples/__pycache__/01.pyc"):  # fmt: skip
        file = tmp_path / "shipped" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(name, encoding="utf-8")
    monkeypatch.setattr(module, "example_files", lambda: tmp_path / "shipped")
    return tmp_path / "shipped"


def test_all_is_copied_as_it_is_and_a_scenario_runs_whatever_folder_that_is_in(tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").touch()
    copied = pinarm.examples(tmp_path / "deep" / "mine")
    assert copied == tmp_path / "deep" / "mine"
    for pattern in ("models/*/*.*", "scenarios/*.yaml", "examples/*.*"):
        originals = sorted(ROOT.glob(pattern))
        assert originals
        for original in originals:
            assert (copied / original.relative_to(ROOT)).read_bytes() == original.read_bytes()
    torque = pinarm.run(copied / "scenarios" / "gen411_arm_static.yaml")["C_B"].values
    assert torque.max() == pytest.approx(1.4715, abs=1e-12)  # g l2 (m_A + m_BA / 2)


def test_what_runs_have_left_is_not_copied(tmp_path: Path, shipped: Path) -> None:
    copied = pinarm.examples(tmp_path / "mine")
    files = {path.relative_to(copied).as_posix() for path in copied.rglob("*") if path.is_file()}
    assert files == {".pinarm-root", "models/arm/arm.urdf", "scenarios/arm.yaml", "examples/01.py"}


def test_a_file_that_exists_is_left_as_it_is(tmp_path: Path, shipped: Path) -> None:
    mine = tmp_path / "mine" / "scenarios" / "arm.yaml"
    mine.parent.mkdir(parents=True)
    mine.write_text("changed by its owner", encoding="utf-8")
    pinarm.examples(tmp_path / "mine")
    assert mine.read_text(encoding="utf-8") == "changed by its owner"
    assert (tmp_path / "mine" / "examples" / "01.py").is_file()


def test_a_folder_that_cannot_be_written_is_an_input_error(tmp_path: Path, shipped: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"examples cannot be written to .*file") as caught:
        pinarm.examples(tmp_path / "file")
    assert "-o DIR" in str(caught.value)

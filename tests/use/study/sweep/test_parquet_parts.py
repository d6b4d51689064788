"""The table as Parquet, in parts."""

import sys
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm import PinarmError
from pinarm.cli.commands import BAD_INPUT
from pinarm.cli.main import main
from pinarm.errors import Interrupted
from pinarm.use.study.sweep import parquet


@pytest.fixture
def sweep(held: pinarm.Scenario) -> pinarm.Sweep:
    over = {"arguments.m": "-1:1:5 kg", "problem.over.pivot.to": "60, 90"}
    return pinarm.sweep(held, over, results=["M @ end"], workers=1)


def test_the_parts_together_are_the_table(sweep: pinarm.Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(parquet, "PART", 4)
    for _ in range(2):  # the second replaces the first
        sweep.save(tmp_path / "out", plots=False, parquet=True)
    parts = sorted(path.name for path in (tmp_path / "out" / "cases.parquet").iterdir())
    assert parts == ["part-000000.parquet", "part-000001.parquet", "part-000002.parquet"]
    table = parquet.read_table(tmp_path / "out" / "cases.parquet").to_pydict()
    assert table["case"] == list(range(10))
    np.testing.assert_array_equal(table["M @ end [N*m]"], sweep["M @ end"].values)
    assert table["problem.over.pivot.to [deg]"] == [60.0, 90.0] * 5
    assert table["error"] == [sweep.errors.get(case, "") for case in range(10)]
    assert sweep.errors
    sweep.save(tmp_path / "out", plots=False)
    assert not (tmp_path / "out" / "cases.parquet").exists(), "it is no older table's"


def parts(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "cases.parquet").glob("*"))}


@pytest.mark.slow
def test_parts_appear_while_cases_are_solved_and_have_the_bytes_of_those_at_the_end(
    held: pinarm.Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Interrupted after 9 of 10 cases and gone on with, in another order of answers."""
    pytest.importorskip("pyarrow")
    monkeypatch.setattr(parquet, "PART", 4)
    out, begun, over = tmp_path / "out", list[int](), {"arguments.m": "-1:1:10 kg"}

    def interrupt(done: int, failed: int, total: int) -> None:
        begun.append(len(parts(out / "partial")))
        if done == 9:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted):
        pinarm.sweep(held, over, workers=1, folder=out, parquet=True, progress=interrupt)
    assert begun == [0, 0, 0, 1, 1, 1, 1, 2, 2]
    first = parts(out / "partial")
    pinarm.sweep(held, over, workers=2, folder=out, parquet=True)
    streamed = parts(out / "partial")
    assert first == {name: streamed[name] for name in first}
    pinarm.sweep(held, over, workers=1, folder=out).save(out, plots=False, parquet=True)
    assert parts(out) == streamed
    assert not (out / "partial").exists()


def test_without_pyarrow_it_is_said_before_the_work(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr(parquet, "find_spec", lambda name: None)
    out = tmp_path / "out"
    assert main(["sweep", str(path), "--over", "arguments.m=1, 2 kg", "--parquet", "-o", str(out)]) == BAD_INPUT
    assert "pip install 'pinarm[parquet]'" in capsys.readouterr().err
    assert not out.exists()
    with pytest.raises(PinarmError, match="written by pyarrow"):
        parquet.require_parquet()

"""The table as Parquet."""

import sys
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm import PinarmError
from pinarm.cli.commands import BAD_INPUT
from pinarm.cli.main import main
from pinarm.use.study.sweep import table


@pytest.fixture
def sweep(held: pinarm.Scenario) -> pinarm.Sweep:
    over = {"arguments.m": "-1:1:5 kg", "problem.over.pivot.to": "60, 90"}
    return pinarm.sweep(held, over, results=["M @ end"], workers=1)


def test_the_file_is_the_table(sweep: pinarm.Sweep, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    sweep.save(tmp_path / "out", plots=False, parquet=True)
    read = parquet.read_table(tmp_path / "out" / "cases.parquet").to_pydict()
    assert read["case"] == list(range(10))
    np.testing.assert_array_equal(read["M @ end [N*m]"], sweep["M @ end"].values)
    assert read["problem.over.pivot.to [deg]"] == [60.0, 90.0] * 5
    assert read["error"] == [sweep.errors.get(case, "") for case in range(10)]
    assert sweep.errors


def test_without_pyarrow_it_is_said_before_the_work(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr(table, "find_spec", lambda name: None)
    out = tmp_path / "out"
    assert main(["sweep", str(path), "--over", "arguments.m=1, 2 kg", "--parquet", "-o", str(out)]) == BAD_INPUT
    assert "pip install 'pinarm[parquet]'" in capsys.readouterr().err
    assert not out.exists()
    with pytest.raises(PinarmError, match="written by pyarrow"):
        table.require_parquet()

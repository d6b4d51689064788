"""The files of a sweep say what came out, with units, and can be read back to the last digit."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.input.yaml.document import Document

OVER = {"arguments.m": "-1, 0.1, 0.3 kg", "symbols.s": "alpha, 2*alpha"}


def test_table_statistics_and_definition_are_read_back(held: pinarm.Scenario, tmp_path: Path) -> None:
    sweep = pinarm.sweep(held, OVER, results=["M @ end", "min(0, 1)*s"])
    sweep.save(tmp_path / "out", plots=False)
    with open(tmp_path / "out" / "cases.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["M @ end [N*m]"] for row in rows] == ["", "", *(repr(x) for x in sweep["M @ end"].values[2:].tolist())]
    assert [row["symbols.s"] for row in rows] == ["alpha", "2*alpha"] * 3
    assert [bool(row["error"]) for row in rows] == [True, True, False, False, False, False]
    with np.load(tmp_path / "out" / "cases.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["M @ end"], sweep["M @ end"].values)
        assert dict(arrays["units"].tolist())["arguments.m"] == "kg"
        assert arrays["error"].tolist() == [sweep.errors.get(case, "") for case in range(6)]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    found = summary["results"]["M @ end"]
    assert (summary["cases"], summary["failed"], found["cases"], found["unit"]) == (6, 2, 4, "N*m")
    wanted = {"min": 1, "at_min": 2, "max": 3, "at_max": 4, "mean": 2, "deviation": np.sqrt(4 / 3), "median": 2,
              "5 %": 1, "95 %": 3}  # fmt: skip
    assert {key: found[key] for key in wanted} == pytest.approx(wanted, rel=1e-12)
    assert summary["accuracy"]["equilibrium"] < 1e-13
    asked = Document.read(tmp_path / "out" / "sweep.yaml").data
    assert (asked["over"], asked["units"], asked["base"]["mechanism"]) == (OVER, {"arguments.m": "kg"}, "pendulum.yaml")
    assert asked["results"] == ["M @ end", "min min(0, 1)*s", "max min(0, 1)*s"]
    assert (tmp_path / "out" / asked["scenario"]).resolve() == tmp_path / "held.yaml"

"""A result as files: the same bytes each time, every digit, nothing that a reader could be tricked by."""

import csv as csv_reader
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.use.store.save import LawTables, csv


def text_of(columns: list[Series]) -> str:
    return b"".join(csv(columns)).decode()


def contents(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


def test_the_same_input_gives_the_same_bytes(scenario: Callable[..., Any], folder: Path) -> None:
    one = contents(scenario("forward").run().save(folder / "one"))
    other = contents(scenario("forward").run().save(folder / "two"))
    assert set(one) >= {"scenario.yaml", "model.urdf", "summary.json", "trajectory.csv", "trajectory.npz"}
    assert any(name.startswith("plots/") for name in one)
    assert one == other


@pytest.mark.parametrize("kind", ["inverse", "forward"])
def test_the_resolved_scenario_gives_the_same_numbers(scenario: Callable[..., Any], folder: Path, kind: str) -> None:
    first = scenario(kind, "title: Größe 力 \U0001f600\n").run().save(folder / "results" / "one", plots=False)
    again = pinarm.load(first / "scenario.yaml").run().save(folder / "results" / "deeper" / "two", plots=False)
    third = pinarm.load(again / "scenario.yaml").run().save(folder / "three", plots=False)
    for name in ("trajectory.csv", "trajectory.npz", "model.urdf"):
        assert (first / name).read_bytes() == (again / name).read_bytes() == (third / name).read_bytes()
    assert pinarm.load(third / "scenario.yaml").content.title == "Größe 力 \U0001f600"


ROD = """\
<robot name="rod" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="m" default="1"/>
  <xacro:arg name="l0" default="0.5"/><xacro:arg name="tilt" default="0"/>
  <link name="base"/><link name="rod"><inertial><origin xyz="$(arg l0) 0 0"/><mass value="$(arg m)"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pin" type="continuous"><parent link="base"/><child link="rod"/>
  <origin rpy="0 $(arg tilt) 0"/><axis xyz="0 1 0"/></joint></robot>
"""


@pytest.mark.parametrize("declared", ["", "arguments: {m: kg}"])
def test_a_result_can_be_run_again_whichever_arguments_its_mechanism_declares(tmp_path: Path, declared: str) -> None:
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "rod.urdf.xacro").write_text(ROD)
    (tmp_path / "rod.yaml").write_text(f"pinarm: 1\nrobot: rod.urdf.xacro\n{declared}\n")
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: rod.yaml\narguments: {m: 2 kg}\n"
        "problem: {kind: statics, hold: {pin: 0 deg}}\noutputs: [joint.pin.effort]\n"
    )
    saved = pinarm.load(tmp_path / "s.yaml").run().save(tmp_path / "out", plots=False)
    again = pinarm.load(saved / "scenario.yaml").run()
    assert again["joint.pin.effort"].values == pytest.approx([-9.81 * 2.0 * 0.5], rel=1e-12)  # -m g l0


def test_arguments_in_other_units_than_si_stay_what_they_are(tmp_path: Path) -> None:
    """60 deg are told as 1.05 rad, not as 1.05 deg: in the table, in the summary and in the resolved scenario."""
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "rod.urdf.xacro").write_text(ROD)
    (tmp_path / "rod.yaml").write_text("pinarm: 1\nrobot: rod.urdf.xacro\narguments: {tilt: rad, l0: m}\n")
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: rod.yaml\narguments: {tilt: 60 deg, l0: 400 mm}\n"
        "problem: {kind: statics, hold: {pin: 0 deg}}\noutputs: [joint.pin.effort, tilt, l0]\n"
    )
    saved = pinarm.load(tmp_path / "s.yaml").run().save(tmp_path / "out", plots=False)
    again = pinarm.load(saved / "scenario.yaml").run()
    assert again["joint.pin.effort"].values == pytest.approx([-9.81 * 0.4 * 0.5], rel=1e-12)
    assert [again[name].label for name in ("tilt", "l0")] == ["tilt [rad]", "l0 [m]"]
    summary = json.loads((saved / "summary.json").read_text())
    assert summary["arguments"]["l0"] == {"value": 0.4, "unit": "m"}


@pytest.mark.parametrize("name", ["=cmd|' /C calc'!A0", "+1+1", "-2*alpha", "@SUM(A1)", "\t=1", "\r=1"])
def test_csv_has_no_cell_that_a_spreadsheet_would_run(name: str) -> None:
    [head, _] = csv_reader.reader(io.StringIO(text_of([Series(name, None, np.zeros(1))]), newline=""))
    assert len(head) == 1
    assert head[0][0] not in "=+-@\t\r"
    assert name.strip() in head[0]


def test_csv_keeps_numbers_of_every_size_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every exponent, those that decimals hit hardest, and what is no number; cut in pieces of any length."""
    bits = np.random.default_rng(5).integers(0, 2**64, size=20_000, dtype=np.uint64)
    hard = [0.1, 1 / 3, 5e-324, 2.2250738585072014e-308, 1.7976931348623157e308, 1e16, 9007199254740993.0, -0.0]
    values = np.concatenate([bits.view(float), hard])
    for chunk in (7, 50_000):
        monkeypatch.setattr("pinarm.use.store.save.CHUNK", chunk)
        for part in (values, values[np.isfinite(values)]):
            head, *lines = text_of([Series("x", None, part), Series("y", None, -part)]).splitlines()
            read = np.array([line.split(",") for line in lines], float)
            assert head == "x [?],y [?]"
            for column, expected in ((read[:, 0], part), (read[:, 1], -part)):
                same = column.view(np.uint64) == expected.view(np.uint64)
                assert (same | np.isnan(column) & np.isnan(expected)).all()


def test_npz_needs_no_pickle_and_says_its_units(scenario: Callable[..., Any], folder: Path) -> None:
    result = scenario("inverse").run()
    with np.load(result.save(folder / "out", plots=False) / "trajectory.npz", allow_pickle=False) as arrays:
        assert np.array_equal(arrays["M"], result["M"].values)
        assert all(np.array_equal(arrays[f"state.{x}"], getattr(result.trajectory, x)) for x in ("q", "v", "a", "tau"))
        assert arrays["state.units"].tolist() == [["t", "s"], ["M", "N*m"], ["alpha", "rad"]]


@pytest.mark.parametrize("name", ["q", "state.q", "allow_pickle", "../up"])
def test_npz_keeps_an_output_whatever_its_name(scenario: Callable[..., Any], folder: Path, name: str) -> None:
    """Or the name is refused; it must not be lost behind an array of the same name, nor take the place of states."""
    try:
        result = scenario("statics", f'symbols: {{"{name}": 7*alpha}}\n', ("[M,", f'["{name}", M,')).run()
        saved = result.save(folder / "out", plots=False)
    except InputError:
        return
    with np.load(saved / "trajectory.npz", allow_pickle=False) as arrays:
        wanted = result["7*alpha"].values
        assert any(a.shape == wanted.shape and np.array_equal(a, wanted) for a in (arrays[key] for key in arrays.files))
        assert all(np.array_equal(arrays[f"state.{x}"], getattr(result.trajectory, x)) for x in ("q", "tau"))
    assert set(contents(folder)) - {f"out/{path}" for path in contents(saved)} <= {
        ".pinarm-root", "pendulum.urdf", "pendulum.yaml", "statics.yaml",
    }  # fmt: skip


@pytest.mark.parametrize("name", ["scenario.yaml", "model.urdf"])
def test_the_input_is_never_overwritten(scenario: Callable[..., Any], folder: Path, name: str) -> None:
    """``-o .`` in the folder of the input: the scenario.yaml or model.urdf that stands there is the user's."""
    scenario("inverse")
    renamed = folder / name
    (folder / ("inverse.yaml" if name == "scenario.yaml" else "pendulum.urdf")).rename(renamed)
    if name == "model.urdf":
        (folder / "pendulum.yaml").write_text((folder / "pendulum.yaml").read_text().replace("pendulum.urdf", name))
    before = renamed.read_text()
    run = pinarm.load(renamed if name == "scenario.yaml" else folder / "inverse.yaml").run()
    with pytest.raises(InputError):
        run.save(folder, plots=False)
    assert renamed.read_text() == before


def test_only_tables_that_laws_may_read_are_copied(tmp_path: Path) -> None:
    """Arguments of a model that are called ``law`` and ``file`` name no table, and a table lies below the root."""
    (tmp_path / "secret.csv").write_text("t [s],angle [deg]\n0,0\n1,30\n")
    home = tmp_path / "project"
    (home / "in").mkdir(parents=True)
    (home / ".pinarm-root").touch()
    (home / "t.csv").write_text("t [s],angle [deg]\n0,0\n1,30\n")
    laws = LawTables()
    outside = {"law": "table", "file": "../../secret.csv"}
    assert laws.beside(outside, home / "in")["file"] == str(tmp_path / "secret.csv")
    assert laws.beside({"law": "table"}, home / "in") == {"law": "table"}
    assert not laws.kept
    assert laws.beside({"law": "table", "file": "../t.csv"}, home / "in")["file"] == "law_1_t.csv"
    assert laws.kept == [("law_1_t.csv", home / "t.csv")]

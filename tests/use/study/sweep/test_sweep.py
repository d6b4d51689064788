"""A sweep as a whole: the same table however it came about, nothing solved twice, and every failure told."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm import PinarmError
from pinarm.use.study.sweep.table import report
from pinarm.use.workers.dispatch import Dispatch

MASSES = {"arguments.m": "1:3:5 kg", "arguments.l": "0.5, 1"}


def files(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(folder.rglob("*")) if file.suffix not in (".jsonl", "")}


def entries(folder: Path) -> list[str]:
    lines = (folder / "journal.jsonl").read_text().splitlines()
    return [entry["case"] for entry in map(json.loads, lines) if "case" in entry]


def test_the_table_is_that_of_the_formula(held: pinarm.Scenario) -> None:
    sweep = pinarm.sweep(held, MASSES, results=["M @ end", "M"], workers=1)
    m, l = sweep["arguments.m"].values, sweep["arguments.l"].values
    assert sorted(zip(m, l, strict=True)) == [(m, l) for m in (1, 1.5, 2, 2.5, 3) for l in (0.5, 1)]
    np.testing.assert_allclose(sweep["M @ end"].values, 10 * m * l, rtol=1e-14)
    np.testing.assert_allclose(sweep["max M"].values, 10 * m * l, rtol=1e-14)
    labels = [series.label for series in sweep.table.values()]
    results = ["M @ end [N*m]", "min M [N*m]", "max M [N*m]"]
    worth = ["equilibrium", "power", "return trip", "condition"]
    assert labels == ["arguments.m [kg]", "arguments.l [m]", *results, *worth]
    assert sweep["equilibrium"].values.max() < 1e-13
    assert sweep.errors == {}
    frame = sweep.to_dataframe()
    assert list(frame.columns) == [*labels, "error"]
    assert len(frame) == len(sweep) == 10
    with pytest.raises(PinarmError, match="no column 'N'"):
        sweep["N"]


@pytest.mark.slow
def test_one_worker_or_many_a_pause_or_none_give_the_same_bytes(held: pinarm.Scenario, tmp_path: Path) -> None:
    over = {**MASSES, "arguments.m": "-1:3:5 kg"}
    for workers in (1, 3):
        pinarm.sweep(held, over, workers=workers).save(tmp_path / f"with {workers}")
    paused = tmp_path / "paused"
    pinarm.sweep(held, {**over, "arguments.m": "0:2:2 kg"}, workers=1, folder=paused)
    pinarm.sweep(held, over, workers=2, folder=paused).save(paused)
    assert files(tmp_path / "with 1") == files(tmp_path / "with 3") == files(paused)
    assert len(set(entries(paused))) == len(entries(paused)) == 10
    names = "sweep.yaml cases.csv cases.npz summary.json manifest.json 01_min_M.svg 02_max_M.svg"
    assert set(files(paused)) == set(names.split())


def test_cases_that_are_known_are_not_solved_again(
    held: pinarm.Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = pinarm.sweep(held, MASSES, folder=tmp_path / "out")

    def answers(dispatch: object, jobs: Any) -> Any:
        yield from ()
        assert next(jobs, None) is None, "a case is solved again"

    monkeypatch.setattr(Dispatch, "answers", answers)
    again = pinarm.sweep(held, dict(reversed(MASSES.items())), folder=tmp_path / "out")
    assert sorted(first["max M"].values) == sorted(again["max M"].values)
    with pytest.raises(AssertionError, match="solved again"):
        pinarm.sweep(held, {"arguments.m": "1, 7 kg"}, folder=tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("pendulum.urdf.xacro", 'xyz="0 0 ${-l}"', 'xyz="0 0 ${-2*l}"'), ("pendulum.yaml", "10 m/s^2", "20 m/s^2")],
)
def test_a_model_that_has_changed_is_solved_again(path: Path, tmp_path: Path, name: str, old: str, new: str) -> None:
    before = pinarm.sweep(path, MASSES, folder=tmp_path / "out")
    text = (tmp_path / name).read_text()
    (tmp_path / name).write_text(text.replace(old, new))
    after = pinarm.sweep(path, MASSES, folder=tmp_path / "out")
    np.testing.assert_allclose(after["max M"].values, 2 * before["max M"].values, rtol=1e-14)
    assert len(set(entries(tmp_path / "out"))) == 10 < len(entries(tmp_path / "out")) == 20
    (tmp_path / name).write_text(text)  # back again: the old cases are known
    np.testing.assert_array_equal(
        pinarm.sweep(path, MASSES, folder=tmp_path / "out")["max M"].values, before["max M"].values
    )
    assert len(entries(tmp_path / "out")) == 20


def test_another_question_is_solved_even_where_the_cases_are_the_same(path: Path, tmp_path: Path) -> None:
    def ends(results: list[str], *overrides: str) -> np.ndarray:
        sweep = pinarm.sweep(pinarm.load(path, list(overrides)), MASSES, results=results, folder=tmp_path / "out")
        return np.asarray(sweep[results[0]].values)

    first = ends(["M @ end"])
    np.testing.assert_allclose(ends(["alpha @ end"]), pi / 2)
    np.testing.assert_allclose(ends(["M @ end"], "gravity={direction: -z, magnitude: 5 m/s^2}"), first / 2, rtol=1e-14)
    assert len(set(entries(tmp_path / "out"))) == 30


CONTROL = """
pinarm: 1
title: A wheel turned by 1 rad
mechanism: wheel.urdf
problem:
  kind: forward
  time: {end: 1 s, samples: 5}
  control: [{kind: pid, drive: turn, follows: {law: constant, value: 1 rad}, kp: 50 N*m/rad, kd: 6 N*m*s/rad}]
outputs: [turn]
response: {of: turn, final: 1 rad, band: 0.2}
"""
WHEEL = (
    '<robot name="wheel"><link name="base"/><link name="wheel"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="turn" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint></robot>'
)


def test_what_a_case_does_not_come_to_costs_it_no_other_number(tmp_path: Path) -> None:
    """With 100 N m s/rad the wheel creeps, with 50 N m/rad over them 1/2 s: it does not settle to 20 % in a second."""
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "wheel.urdf").write_text(WHEEL)
    (tmp_path / "s.yaml").write_text(CONTROL)
    damping = {"problem.control.0.kd": "6, 100, -1e9, 20 N*m*s/rad"}
    results = ["response.settling_time", "turn @ max"]
    sweep = pinarm.sweep(tmp_path / "s.yaml", damping, results=results, workers=1, folder=tmp_path / "out")
    assert list(sweep.errors) == [2]
    assert np.isnan(sweep["response.settling_time"].values).tolist() == [False, True, True, False]
    assert np.isnan(sweep["turn @ max"].values).tolist() == [False, False, True, False]
    assert sweep["turn @ max"].values[1] == pytest.approx(1.0 - np.exp(-0.5), abs=0.01)  # creeps: the inertia is small
    sweep.save(tmp_path / "out", plots=False)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [summary["results"][name]["cases"] for name in results] == [2, 3]
    assert summary["failed"] == 1
    said = "missing: response.settling_time is not finite in 1 cases; its statistics are over 2"
    assert said in report(sweep).splitlines()
    before = files(tmp_path / "out")
    again = pinarm.sweep(tmp_path / "s.yaml", damping, results=results, workers=1, folder=tmp_path / "out")
    again.save(tmp_path / "out", plots=False)
    assert files(tmp_path / "out") == before
    assert len(entries(tmp_path / "out")) == 4


def test_a_file_that_changes_while_the_sweep_runs_ends_it(path: Path, tmp_path: Path) -> None:
    def edit(done: int, failed: int, total: int) -> None:
        if done == 3:
            (tmp_path / "pendulum.yaml").write_text((tmp_path / "pendulum.yaml").read_text() + "# edited\n")

    with pytest.raises(PinarmError, match=r"pendulum.yaml has changed while the sweep ran"):
        pinarm.sweep(path, {"arguments.m": "1:3:50 kg"}, workers=1, folder=tmp_path / "out", progress=edit)
    assert 3 <= len(entries(tmp_path / "out")) < 50  # cases of an answer that had come were solved before


def test_failures_are_told_by_reason(held: pinarm.Scenario) -> None:
    ends = pinarm.sweep(held, {"arguments.m": "-1, 1, 2, -2 kg"}, results=["M @ max"], workers=1)
    assert np.isnan(ends["M @ max"].values).tolist() == [True, False, False, True], "both ends fail, not those between"
    sweep = pinarm.sweep(held, {"arguments.m": "-2:2:5 kg"}, results=["M @ end"])
    assert {case: reason.rpartition(": ")[2] for case, reason in sweep.errors.items()} == {
        0: "the mass is negative (-2 kg)", 1: "the mass is negative (-1 kg)"
    }  # fmt: skip
    assert np.isnan(sweep["M @ end"].values).tolist() == [True, True, False, False, False]

    (failure,) = sweep.summary()["failures"]
    assert (failure["cases"], failure["first"]) == (2, [0, 1])
    lines = sweep.csv().splitlines()
    assert re.fullmatch(r"1,-1\.0,,,,.*: the mass is negative \(-1 kg\)", lines[2])
    assert re.fullmatch(r"4,2\.0,20\.0+\d*,.*,", lines[5])


def test_a_sweep_that_is_refused_at_both_ends_is_refused_at_once(held: pinarm.Scenario, tmp_path: Path) -> None:
    for over, message in (
        ({"argument.m": "1, 2 kg"}, "argument.m=1.0 kg: unknown key 'argument'"),
        ({"changes.forces.spring.stiff": "1, 2 N*m"}, "unknown key 'stiff'"),
        ({"problem.over.pivot.samples": "2.5, 3.5"}, "expected: a whole number"),
        (["arguments.m=1, 2 kg"], r"\['arguments.m=1, 2 kg'\] is no map of paths"),
        ({"arguments.m": "1, 2 kg", 'arguments."m"': "4, 5 kg"}, "are one path, and varied twice"),
    ):
        with pytest.raises(PinarmError, match=message):
            pinarm.sweep(held, over)
    (tmp_path / "cases.csv").write_text("arguments.m [kg],arguments.m [kg]\n1,2\n")
    with pytest.raises(PinarmError, match="varied twice"):
        pinarm.sweep(held, cases=tmp_path / "cases.csv")


@pytest.mark.slow
def test_bare_numbers_are_in_the_unit_that_the_files_have(path: Path) -> None:
    def units(**over: str) -> dict[str, str]:
        found = {name.replace("__", "."): text for name, text in over.items()}
        return dict(pinarm.sweep(path, found, workers=1).definition["units"])

    assert units(problem__over__pivot__to="30, 60") == {"problem.over.pivot.to": "deg"}
    assert units(arguments__m="1, 2") == {"arguments.m": "kg"}
    assert units(changes__forces__spring__stiffness="1, 2") == {"changes.forces.spring.stiffness": "N*m/rad"}
    assert units(problem__over__pivot__samples="2, 3") == {}
    path.write_text(path.read_text().replace("{l: 1 m}", "{l: 100 cm}"))
    with pytest.raises(PinarmError, match="'l' is in cm here and in m in the mechanism"):
        units(arguments__l="1, 2")


def test_samples_are_drawn_where_something_is_to_be_drawn(held: pinarm.Scenario) -> None:
    with pytest.raises(PinarmError, match=r"'arguments\.m' is to be drawn"):
        pinarm.sweep(held, {"arguments.m": "normal(2, 0.1)"})
    with pytest.raises(PinarmError, match="1 to 10,000,000"):
        pinarm.sweep(held, {"arguments.m": "normal(2, 0.1)"}, samples=0)
    with pytest.raises(PinarmError, match="nothing to draw"):
        pinarm.sweep(held, {"arguments.m": "1, 2"}, samples=3)
    over = {"arguments.m": "normal(2, 0.1)", "arguments.l": "tolerance(1, 0.01)", "problem.over.pivot.to": "60, 90"}
    sweep = pinarm.sweep(held, over, samples=3, seed=5, results=["M @ end"])
    m, l, to = (sweep[name].values for name in over)
    assert len(sweep) == 6
    assert len(set(m)) == len(set(l)) == 3
    np.testing.assert_allclose(sweep["M @ end"].values, 10 * m * l * np.sin(to * pi / 180), rtol=1e-13)


def test_a_folder_of_something_else_is_left_alone(held: pinarm.Scenario, tmp_path: Path) -> None:
    held.run().save(tmp_path / "run", plots=False)
    with pytest.raises(PinarmError, match="holds a result, no sweep"):
        pinarm.sweep(held, MASSES, folder=tmp_path / "run")
    (tmp_path / "file").touch()
    with pytest.raises(PinarmError, match="cannot be written"):
        pinarm.sweep(held, MASSES, folder=tmp_path / "file" / "out")


def test_two_sweeps_do_not_write_one_journal(held: pinarm.Scenario, tmp_path: Path) -> None:
    def second(done: int, *_: int) -> None:
        if done == 1:
            with pytest.raises(PinarmError, match="another sweep is writing"):
                pinarm.sweep(held, MASSES, folder=tmp_path / "out", workers=1)

    assert not pinarm.sweep(held, MASSES, folder=tmp_path / "out", workers=1, progress=second).errors


def start(path: Path, *arguments: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "pinarm", "sweep", str(path), "--over", "arguments.m=1:3:20000 kg", "--no-plots"]
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a shell's background jobs ignore interrupts
    return subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                            start_new_session=True, preexec_fn=heard)  # fmt: skip


def wait_for(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < deadline, "it takes too long"
        time.sleep(0.02)


def lines(folder: Path) -> int:
    journal = folder / "journal.jsonl"
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


@pytest.mark.slow
def test_an_interrupted_sweep_keeps_what_is_done_and_goes_on(path: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = start(path, "-o", str(out), "-j", "2")
    wait_for(lambda: lines(out) > 42)  # the head and the files among them
    os.killpg(first.pid, signal.SIGINT)  # as a terminal does
    _, said = first.communicate(timeout=120)
    assert first.returncode == 130
    kept = len(entries(out))
    assert 40 <= kept < 20_000
    told = re.search(r"interrupted with (\d+) of 20000 cases solved\n  try: the same command again", said)
    assert told and int(told[1]) <= kept
    assert "Traceback" not in said
    second = start(path, "-o", str(out), "-j", "2")
    second.communicate(timeout=120)
    assert second.returncode == 0
    assert len(entries(out)) == len(set(entries(out))) == 20_000
    assert len((out / "cases.csv").read_text().splitlines()) == 20_001


def test_a_value_that_every_case_replaces_is_refused(path: Path, tmp_path: Path) -> None:
    """It had no effect, and nothing said so."""
    (tmp_path / "cases.csv").write_text("arguments.m [kg]\n1\n2\n")
    for over, cases in (({"arguments.m": "1, 2 kg"}, None), ({}, tmp_path / "cases.csv")):
        with pytest.raises(PinarmError, match=r"'arguments[.]m' is varied, and what is set there would have no effect"):
            pinarm.sweep(path, over, cases=cases, values={"arguments.m": "7 kg"}, workers=1)
    swept = pinarm.sweep(
        path, {"arguments.m": "1, 2 kg"}, values={"arguments.l": "2 m"}, workers=1, results=["M @ max"]
    )
    assert swept["M @ max"].values == pytest.approx([20.0, 40.0])

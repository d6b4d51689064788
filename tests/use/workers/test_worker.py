"""A worker that does not see the files asks for what it was not sent, and says the same as one that does."""

import os
import pickle
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.cases import together
from pinarm.use.cases.case import Case, solve_case
from pinarm.use.study.sweep.sweep_files import csv
from pinarm.use.workers import worker
from pinarm.use.workers.chunk_order import ChunkOrder, packed, read_answer
from pinarm.use.workers.versions import versions
from pinarm.use.workers.worker import work

SCENARIOS = Path(__file__).parents[3] / "scenarios"


class Elsewhere(Executor):
    """Calls functions elsewhere, while a folder is away."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.calls = folder, 0

    def submit(self, function: Any, /, *arguments: Any, **_: Any) -> Future[Any]:
        self.calls += 1
        away, here, future = self.folder.with_name("away"), Path.cwd(), Future[Any]()
        self.folder.rename(away)
        os.chdir("/")
        try:
            future.set_result(function(*arguments))
        finally:
            away.rename(self.folder)
            os.chdir(here)
        return future


class Remote(Executor):
    """Calls functions here, as if this was another machine."""

    def submit(self, function: Any, /, *arguments: Any, **_: Any) -> Future[Any]:
        future = Future[Any]()
        future.set_result(function(*arguments))
        return future


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    """Forget the sessions of this thread."""
    vars(worker._kept).clear()
    yield
    vars(worker._kept).clear()


OVER = {"arguments.m": "-1:3:9 kg", "arguments.l": "0.5, 1"}


def test_files_travel_and_the_table_is_the_same(path: Path, tmp_path: Path) -> None:
    elsewhere = Elsewhere(tmp_path)
    there, here = (pinarm.sweep(path, OVER, executor=executor, workers=1) for executor in (elsewhere, None))
    assert len(here.errors) == 4
    assert csv(there) == csv(here)
    assert f"{tmp_path}/pendulum.urdf.xacro:6:3" in csv(there), "files are called by their names here"


def test_a_scenario_may_be_called_by_a_relative_name(
    tmp_path: Path, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has a table that a law reads, beside it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "law.csv").write_text("t [s],x [rad]\n0,0\n1,1\n2,4\n3,9\n")
    motion = {"pivot": {"law": "table", "file": "law.csv"}}
    values = {"problem": {"kind": "inverse", "time": {"end": "3 s", "samples": 4}, "motion": motion}}
    there, here = (
        pinarm.sweep("held.yaml", OVER, values=values, executor=executor, workers=1)
        for executor in (Elsewhere(tmp_path), None)
    )
    assert csv(there) == csv(here)
    assert len(here.errors) == 4


def test_loops_are_solved_together_where_files_travel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Anchors that failed while a file was on its way begin anew when it is there."""
    alone = list[Case]()
    monkeypatch.setattr(together, "solve_case", lambda task, case: alone.append(case) or solve_case(task, case))
    over = {"arguments.b": "0.34:0.36:9 m"}
    scenario = pinarm.load(SCENARIOS / "crank_rocker_turning.yaml", {"problem.time.samples": 9})
    assert not pinarm.sweep(scenario, over, executor=Remote(), workers=1).errors
    assert len(alone) <= 1  # the one that is compared


def test_what_no_other_case_refers_to_is_sent_as_well(path: Path, tmp_path: Path) -> None:
    """The mechanism is what varies, and one of them is reached by a link."""
    for name in ("second", "third"):
        (tmp_path / name).mkdir()
        text = (tmp_path / "pendulum.yaml").read_text()
        (tmp_path / name / "pendulum.yaml").write_text(text.replace("10 m/s^2", "20 m/s^2"))
        (tmp_path / name / "pendulum.urdf.xacro").symlink_to("../pendulum.urdf.xacro")
    over = {"mechanism": "pendulum.yaml, second/pendulum.yaml, third/pendulum.yaml, fourth/pendulum.yaml"}
    there = pinarm.sweep(path, over, executor=Elsewhere(tmp_path), workers=1, results=["M @ end"])
    np.testing.assert_allclose(there["M @ end"].values[:3], [20, 40, 40], rtol=1e-14)
    assert list(there.errors) == [3] and "does not exist" in there.errors[3]
    assert csv(there) == csv(pinarm.sweep(path, over, workers=1, results=["M @ end"]))


def test_batches_travel_too(path: Path, tmp_path: Path) -> None:
    held = pinarm.load(path, {"problem": {"kind": "forward", "time": {"end": "0.2 s", "samples": 5}}})
    one = pinarm.batch(held, {"pivot": [0.1, 0.2]})
    other = pinarm.batch(held, {"pivot": [0.1, 0.2]}, executor=Elsewhere(tmp_path), workers=1)
    np.testing.assert_array_equal(one["alpha"].values, other["alpha"].values)
    out = tmp_path.with_name("out")
    folders = [batch.save(out / str(k)) for k, batch in enumerate((one, other))]
    files = [{file.name: file.read_bytes() for file in folder.rglob("*.*")} for folder in folders]
    assert files[0] == files[1] and "000001.npz" in files[0]


def test_nothing_is_unpacked_where_versions_differ() -> None:
    assert work({**versions(), "numpy": "0"}, b"no pickle") == versions()
    with pytest.raises(pickle.UnpicklingError):
        work(versions(), b"no pickle")


def name_of(job: int) -> str:
    return f"{job}"


def test_a_thread_keeps_the_function_of_the_last_sessions_only() -> None:
    for session in range(5):
        order = ChunkOrder(str(session), 1, packed(name_of), packed([session]), 1.0)
        assert read_answer(work(versions(), pickle.dumps(order))).parts == [([0], [str(session)])]
    assert list(worker._kept.sessions) == ["3", "4"]

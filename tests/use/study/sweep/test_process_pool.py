"""Processes: every job is answered once, whatever happens to who works on it."""

import os
from collections.abc import Callable
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from pinarm import PinarmError
from pinarm.use.study.sweep.process_pool import HOPELESS, WorkerDeath, distribute

SQUARE = "def job(n):\n    return n * n\n"
KILLED = """
import os, signal
def job(n):
    if n % 10 == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n
"""
ENDING = "import os\ndef job(n):\n    os._exit(7)\n"
SLOW = "import os, time\ndef job(n):\n    time.sleep(0.2)\n    return os.getpid()\n"
MEETING = """
import os, pathlib, time
def job(folder):
    (pathlib.Path(folder) / str(os.getpid())).touch()
    for _ in range(6000):
        if len(os.listdir(folder)) == 2:
            return True
        time.sleep(0.01)
    return False
"""  # each waits, for a minute at most, until another process is in the middle of a job too
THREADS = "import os\ndef job(n):\n    return {k: v for k, v in os.environ.items() if k.endswith('_THREADS')}\n"

Make = Callable[[str], Any]


@pytest.mark.parametrize("workers", [1, 3])
def test_every_job_is_answered_once(module: Make, workers: int) -> None:
    answers = list(distribute(module(SQUARE).job, iter(range(50)), workers))
    assert sorted(answers) == [(n, n * n) for n in range(50)]


def test_no_jobs_need_no_workers() -> None:
    assert list(distribute(print, iter(()), 2)) == []


@pytest.mark.parametrize("workers", [1, 2])
def test_a_worker_that_is_killed_loses_only_its_job(module: Make, workers: int) -> None:
    answers = dict(distribute(module(KILLED).job, iter(range(40)), workers))
    lost = {n: answer for n, answer in answers.items() if isinstance(answer, WorkerDeath)}
    assert lost == dict.fromkeys((3, 13, 23, 33), WorkerDeath("SIGKILL"))
    assert {n: answers[n] for n in answers if n not in lost} == {n: n * n for n in range(40) if n not in lost}


def test_workers_that_all_die_end_the_work_and_say_how(module: Make) -> None:
    jobs = iter(range(1000))
    with pytest.raises(PinarmError, match=f"{HOPELESS} processes died one after the other, the last by exit code 7"):
        list(distribute(module(ENDING).job, jobs, 2))
    assert next(jobs) < HOPELESS + 5


def test_jobs_are_taken_as_they_are_needed_and_workers_end_with_their_master(module: Make) -> None:
    taken = []
    with closing(distribute(module(SLOW).job, (taken.append(n) or n for n in range(1000)), 2)) as answers:
        workers = {process for _, process in islice(answers, 4)}
    assert len(taken) <= 4 + 2 * 2
    assert not {process for process in workers if isinstance(process, int) and Path(f"/proc/{process}").exists()}
    assert len(workers) == 2


def test_both_workers_work_at_the_same_time(module: Make, tmp_path: Path) -> None:
    (tmp_path / "met").mkdir()
    assert all(met for _, met in distribute(module(MEETING).job, iter([str(tmp_path / "met")] * 12), 2))


def test_workers_leave_the_cores_to_one_another(module: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "OMP_NUM_THREADS", "4")
    ((_, threads),) = distribute(module(THREADS).job, iter([0]), 1)
    assert set(threads.values()) == {"1"}
    assert "OPENBLAS_NUM_THREADS" in threads

"""Processes of this machine: whatever happens to one, the others do not notice."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from pinarm import PinarmError
from pinarm.use.workers.chunk_order import LostJob
from pinarm.use.workers.distribute import HOPELESS, NotBegun, WorkerDeath, distribute
from pinarm.use.workers.local_processes import LocalProcesses, _how

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
SIGNALS = "import signal\ndef job(n):\n    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])\n"

Make = Callable[[str], Any]


@pytest.mark.parametrize("number", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_every_job_is_answered_once(module: Make, number: int) -> None:
    answers = list(distribute(module(SQUARE).job, iter(range(50)), LocalProcesses(number)))
    assert sorted(answers) == [(n, n * n) for n in range(50)]


def test_only_the_job_that_kills_is_lost(module: Make) -> None:
    answers = dict(distribute(module(KILLED).job, iter(range(8)), LocalProcesses(2)))
    lost = {n: answer for n, answer in answers.items() if isinstance(answer, LostJob)}
    assert lost == dict.fromkeys((3,), LostJob("its process died by SIGKILL"))
    assert {n: answers[n] for n in answers if n not in lost} == {n: n * n for n in range(8) if n not in lost}


def test_the_call_in_hand_is_blamed_and_the_next_is_not_begun() -> None:
    with closing(LocalProcesses(1)) as workers:
        first, second = workers.submit(time.sleep, 60), workers.submit(os.getpid)
        (process,) = workers._seats
        while not process.executor._processes:
            time.sleep(0.01)
        time.sleep(1.0)  # it takes the call in hand
        os.kill(next(iter(process.executor._processes)), signal.SIGKILL)
        for future in (first, second):
            future.exception(timeout=60)
        assert [workers.outcome(first), workers.outcome(second)] == [WorkerDeath("SIGKILL"), NotBegun()]
        assert workers.submit(os.getpid).result(timeout=60) != os.getpid(), "another process takes its seat"


@pytest.mark.slow
def test_a_signal_that_ends_the_program_leaves_no_warning_of_semaphores() -> None:
    """They are removed, by a process of ``loky`` that listed them on the terminal."""
    program = ("import os, signal; from pinarm.use.workers.local_processes import LocalProcesses; "
               "LocalProcesses(1).submit(os.getpid).result(); os.kill(os.getpid(), signal.SIGTERM)")  # fmt: skip
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr) == (-signal.SIGTERM, "")


@pytest.mark.slow
def test_processes_that_all_die_end_the_work_and_say_how(module: Make) -> None:
    with pytest.raises(PinarmError, match=f"{HOPELESS} workers died one after the other, the last by exit code 7"):
        list(distribute(module(ENDING).job, iter(range(1000)), LocalProcesses(2)))


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="processes are looked up in /proc")
def test_workers_end_with_the_work(module: Make) -> None:
    with closing(distribute(module(SLOW).job, iter(range(1000)), LocalProcesses(2))) as answers:
        workers = {process for _, process in islice(answers, 6)}
    assert len(workers) == 2
    assert not {process for process in workers if Path(f"/proc/{process}").exists()}


@pytest.mark.slow
def test_both_workers_work_at_the_same_time(module: Make, tmp_path: Path) -> None:
    (tmp_path / "met").mkdir()
    jobs = iter([str(tmp_path / "met")] * 12)
    assert all(met is True for _, met in distribute(module(MEETING).job, jobs, LocalProcesses(2)))


def test_workers_leave_the_cores_to_one_another(module: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "OMP_NUM_THREADS", "4")
    before = dict(os.environ)
    ((_, threads),) = distribute(module(THREADS).job, iter([0]), LocalProcesses(1))
    assert set(threads.values()) == {"1"}
    assert "OPENBLAS_NUM_THREADS" in threads
    assert dict(os.environ) == before


def test_interrupts_are_for_this_process(module: Make) -> None:
    assert [blocked for _, blocked in distribute(module(SIGNALS).job, iter([0]), LocalProcesses(1))] == [True]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_interrupts_do_not_reach_the_first_worker_either() -> None:
    """What removes semaphores starts with it, which lets interrupts through again; workers inherit that."""
    program = """
import signal
from contextlib import closing
from pinarm.use.workers.local_processes import LocalProcesses
with closing(LocalProcesses(2)) as workers:
    calls = [workers.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []) for _ in range(2)]
    print([signal.SIGINT in call.result() for call in calls], signal.SIGINT in signal.pthread_sigmask(0, []))
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert ended.stdout == "[True, True] False\n"


def test_nothing_of_the_folder_is_run_and_the_script_not_twice(tmp_path: Path) -> None:
    """The folder has modules of names that workers import, and the script no guard."""
    for name in ("loky", "multiprocessing", "numpy", "threading", "msgspec"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a module of the folder was imported')\n")
    script = tmp_path / "elsewhere" / "script.py"
    script.parent.mkdir()
    script.write_text(
        "print('script')\nimport math\nfrom pinarm.use.workers.distribute import distribute\n"
        "from pinarm.use.workers.local_processes import LocalProcesses\n"
        "print(sum(root for _, root in distribute(math.isqrt, iter([4, 9]), LocalProcesses(1))))\n"
    )
    known = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(
        [sys.executable, "-P", script], cwd=tmp_path, env=known, capture_output=True, text=True, timeout=120, check=True
    )
    assert (done.stdout, done.stderr) == ("script\n5\n", "")


@pytest.mark.parametrize(("said", "how"), [
    ("... workers are {SIGSEGV(-11)}", "SIGSEGV"), ("{EXIT(7)}", "exit code 7"), ("terminated", "an unknown cause"),
])  # fmt: skip
def test_how_a_process_ended_is_said(said: str, how: str) -> None:
    assert _how(said) == how

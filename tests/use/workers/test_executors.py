"""Processes of this machine and executors of the user: whatever happens to one, the others do not notice."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from pinarm.errors import NumericsError
from pinarm.use.workers.dispatch import Dispatch, ExecutorWorkers, LocalProcesses
from pinarm.use.workers.worker import LostJob

KILLED = """
import os, signal
def job(n):
    if n % 10 == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n
"""
SLOW = "import os, time\ndef job(n):\n    time.sleep(0.2)\n    return os.getpid()\n"
THREADS = "import os\ndef job(n):\n    return {k: v for k, v in os.environ.items() if k.endswith('_THREADS')}\n"
Make = Callable[[str], Any]


def square(n: int) -> int:
    return n * n


def distribute(function: Callable[[Any], Any], jobs: Iterable[Any], workers: Any) -> Iterator[tuple[Any, Any]]:
    with closing(Dispatch(function, workers)) as chunks:
        for some, answers in chunks.answers(jobs):
            yield from ((job, answer) for (_, job), answer in zip(some, answers, strict=True))


def test_only_the_job_that_kills_its_process_is_lost(module: Make) -> None:
    answers = dict(distribute(module(KILLED).job, range(8), LocalProcesses(2)))
    lost = {n: answer for n, answer in answers.items() if isinstance(answer, LostJob)}
    assert lost == dict.fromkeys((3,), LostJob("its process died by SIGKILL"))
    assert {n: answers[n] for n in answers if n not in lost} == {n: n * n for n in range(8) if n not in lost}


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="processes are looked up in /proc")
def test_workers_end_with_the_work(module: Make) -> None:
    with closing(distribute(module(SLOW).job, range(1000), LocalProcesses(2))) as answers:
        workers = {process for _, process in islice(answers, 6)}
    assert len(workers) == 2
    assert not {process for process in workers if Path(f"/proc/{process}").exists()}


@pytest.mark.slow
def test_workers_leave_the_cores_to_one_another(module: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "OMP_NUM_THREADS", "4")
    before = dict(os.environ)
    ((_, threads),) = distribute(module(THREADS).job, [0], LocalProcesses(1))
    assert set(threads.values()) == {"1"}
    assert "OPENBLAS_NUM_THREADS" in threads
    assert dict(os.environ) == before


def test_nothing_of_the_folder_is_run_and_the_script_not_twice(tmp_path: Path) -> None:
    """The folder has modules of names that workers import, and the script no guard."""
    for name in ("loky", "multiprocessing", "numpy", "threading", "msgspec"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a module of the folder was imported')\n")
    script = tmp_path / "elsewhere" / "script.py"
    script.parent.mkdir()
    script.write_text(
        "print('script')\nimport math\nfrom pinarm.use.workers.runners import Runners\n"
        "with Runners(1).applying(math.isqrt) as apply:\n    print(sum(apply([4, 9])))\n"
    )
    known = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(
        [sys.executable, "-P", script], cwd=tmp_path, env=known, capture_output=True, text=True, timeout=120, check=True
    )
    assert (done.stdout, done.stderr) == ("script\n5\n", "")


class Failing(Executor):
    """Fails all calls by an error."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        future = Future[Any]()
        future.set_exception(self.error)
        return future


class Refusing(Executor):
    """Takes no calls."""

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        raise RuntimeError("cannot schedule new futures after shutdown")


def test_threads_answer_every_job_once_and_the_executor_stays() -> None:
    with ThreadPoolExecutor(3) as executor:
        workers = ExecutorWorkers(executor)
        assert workers.room() == 6
        assert sorted(distribute(square, range(300), workers)) == [(n, n * n) for n in range(300)]
        assert executor.submit(square, 3).result() == 9


@pytest.mark.parametrize("executor", [Failing(CancelledError()), Failing(BrokenExecutor("gone")), Refusing()])
def test_an_executor_that_is_gone_ends_the_work(executor: Executor) -> None:
    with pytest.raises(
        NumericsError, match=r"the workers are lost \((CancelledError|BrokenE.*: gone|RuntimeError: cannot sch.*)\)"
    ) as caught:
        list(distribute(square, range(9), ExecutorWorkers(executor)))
    assert "the same command" in caught.value.hint


def test_a_worker_that_dies_costs_its_job() -> None:
    answers = distribute(square, [1, 2], ExecutorWorkers(Failing(OSError("killed\nby me")), 1))
    assert list(answers) == [(n, LostJob("its process died by OSError: killed")) for n in (1, 2)]

"""Jobs in chunks: each is answered once, whatever happens to workers, versions and files."""

import pickle
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import pinarm
from pinarm.errors import InputError, NumericsError
from pinarm.input.roots import note_files
from pinarm.use.workers import worker
from pinarm.use.workers.dispatch import HOPELESS, Dispatch, WorkerDeath
from pinarm.use.workers.worker import LostJob, versions, work


def square(n: int) -> int:
    return n * n


def fail(n: int) -> float:
    return 1 / n


def name_of(file: str) -> str:
    note_files([Path(file)])
    return Path(file).name


class Here:
    """Workers that are this thread; ``ends`` says what becomes of the jobs of a chunk in place of their answers."""

    def __init__(self, number: int = 2, ends: Callable[[list[Any]], Any] = lambda jobs: None) -> None:
        self.number, self.ends, self.closed, self.chunks = number, ends, False, list[list[Any]]()

    def room(self) -> int:
        return self.number

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        self.chunks.append(list(pickle.loads(arguments[-1])))
        future = Future[Any]()
        end = self.ends(self.chunks[-1])
        if isinstance(end, Exception):
            future.set_exception(end)
        else:
            future.set_result(end or function(*arguments))
        return future

    def result(self, future: Future[Any]) -> Any:
        return future.result()

    def close(self) -> None:
        self.closed = True


def distribute(function: Callable[[Any], Any], jobs: Iterable[Any], workers: Any) -> Iterator[tuple[Any, Any]]:
    with closing(Dispatch(function, workers)) as chunks:
        for some, answers in chunks.answers(jobs):
            yield from ((job, answer) for (_, job), answer in zip(some, answers, strict=True))


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    vars(worker._kept).clear()
    yield
    vars(worker._kept).clear()


def test_every_job_is_answered_once() -> None:
    for number, jobs in ((1, 500), (3, 500), (2, 0)):
        workers = Here(number)
        assert sorted(distribute(square, range(jobs), workers)) == [(n, n * n) for n in range(jobs)]
        assert workers.closed


def test_only_the_job_that_kills_is_lost() -> None:
    poison = {3, 700}
    workers = Here(2, lambda jobs: WorkerDeath("SIGKILL") if poison & {*jobs} else None)
    answers = dict(distribute(square, range(1000), workers))
    lost = {n: answer for n, answer in answers.items() if isinstance(answer, LostJob)}
    assert lost == dict.fromkeys(poison, LostJob("its process died by SIGKILL"))
    assert {n: answers[n] for n in answers if n not in lost} == {n: n * n for n in range(1000) if n not in lost}
    for n in poison:
        assert sum(n in chunk for chunk in workers.chunks) >= 2, "it is tried again"


def test_a_job_whose_worker_was_killed_from_outside_is_done_again() -> None:
    deaths = iter([WorkerDeath("SIGKILL"), None, WorkerDeath("SIGTERM")])
    workers = Here(1, lambda jobs: next(deaths, None))
    assert sorted(distribute(square, range(9), workers)) == [(n, n * n) for n in range(9)]


def test_workers_that_all_die_end_the_work_and_say_how() -> None:
    workers = Here(2, lambda jobs: WorkerDeath("exit code 7"))
    with pytest.raises(NumericsError, match=f"{HOPELESS} workers died one after the other, the last by exit code 7"):
        list(distribute(square, range(1000), workers))
    assert len(workers.chunks) < HOPELESS + 5
    assert workers.closed


def test_a_fault_of_the_program_costs_one_job() -> None:
    answers = dict(distribute(fail, [1, 0, 2], Here()))
    assert isinstance(answers[0], LostJob)
    assert answers[0].reason.startswith("the program failed: ZeroDivisionError: division by zero (")
    assert (answers[1], answers[2]) == (1.0, 0.5)


def test_other_versions_are_an_error_that_names_both() -> None:
    other = {**versions(), "numpy": "1.0.0"}
    with pytest.raises(InputError, match=f"numpy is {versions()['numpy']} here and 1.0.0 there"):
        list(distribute(square, range(9), Here(1, lambda jobs: other)))
    assert work({**versions(), "numpy": "0"}, "", b"no pickle", (None, {}), b"") == versions(), "nothing is unpacked"
    with pytest.raises(pickle.UnpicklingError):
        work(versions(), "", b"no pickle", (None, {}), b"")


def test_a_file_that_is_another_one_for_a_worker_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its numbers would look right."""
    file = tmp_path / "model.urdf"
    file.write_text("here")
    jobs = [str(file), str(tmp_path / "absent")]
    assert dict(distribute(name_of, jobs, Here(1))) == {job: Path(job).name for job in jobs}
    vars(worker._kept).clear()
    monkeypatch.setattr(worker, "file_digest", lambda file: "of another content")
    with pytest.raises(InputError, match=f"the file {file} is not the same for a worker as here"):
        list(distribute(name_of, jobs, Here(1)))


def test_batches_and_sweeps_are_the_same_by_an_executor(path: Path, tmp_path: Path) -> None:
    from concurrent.futures import ThreadPoolExecutor

    held = pinarm.load(path, {"problem": {"kind": "forward", "time": {"end": "0.2 s", "samples": 5}}})
    over = {"arguments.m": "-1:3:9 kg", "arguments.l": "0.5, 1"}
    out = tmp_path / "out"
    with ThreadPoolExecutor(2) as executor:
        for name, who in (("here", None), ("there", executor)):
            pinarm.batch(held, {"pivot": [0.1, 0.2]}, executor=who).save(out / name / "batch")
            pinarm.sweep(path, over, executor=who).save(out / name / "sweep", plots=False)
    files = [{file.name: file.read_bytes() for file in (out / name).rglob("*.*")} for name in ("here", "there")]
    assert files[0] == files[1] and "000001.npz" in files[0] and "cases.csv" in files[0]

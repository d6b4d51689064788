"""Jobs in chunks: each is answered once, in chunks as large as pays and as small as goes on answering."""

import pickle
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from itertools import islice
from typing import Any

import pytest

from pinarm.errors import InputError, NumericsError
from pinarm.use.workers.chunk_order import ChunkOrder, LostJob
from pinarm.use.workers.distribute import (
    AHEAD,
    DEATHS,
    HOPELESS,
    LEAST_TIME,
    NotBegun,
    Pace,
    Parcel,
    WorkerDeath,
    distribute,
)
from pinarm.use.workers.versions import versions


def square(n: int) -> int:
    return n * n


def rest(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def fail(n: int) -> float:
    return 1 / n


class Here:
    """Workers that are this thread; ``ends`` says what becomes of the jobs of a chunk in place of their answers."""

    def __init__(self, number: int = 2, ends: Callable[[list[Any]], Any] = lambda jobs: None) -> None:
        self.number, self.ends, self.closed, self.chunks = number, ends, False, list[list[Any]]()
        self.files: Parcel | None = None

    def count(self) -> int:
        return self.number

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        order: ChunkOrder = pickle.loads(arguments[1])
        self.chunks.append(list(pickle.loads(order.jobs)))
        future = Future[Any]()
        future.set_result(self.ends(self.chunks[-1]) or function(*arguments))
        return future

    def outcome(self, future: Future[Any]) -> Any:
        return future.result()

    def require(self) -> None: ...

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize("number", [1, 3])
def test_every_job_is_answered_once(number: int) -> None:
    workers = Here(number)
    assert sorted(distribute(square, iter(range(500)), workers)) == [(n, n * n) for n in range(500)]
    assert workers.closed


def test_no_jobs_give_no_chunk() -> None:
    workers = Here()
    assert list(distribute(square, iter(()), workers)) == []
    assert not workers.chunks


def test_chunks_of_short_jobs_grow() -> None:
    workers = Here()
    assert len(list(distribute(square, iter(range(5000)), workers))) == 5000
    assert len(workers.chunks[0]) == 1
    assert len(workers.chunks) < 50


def test_a_worker_gives_back_what_it_has_not_begun_in_time() -> None:
    """After 64 jobs that take nothing come some of 0.15 s: no chunk takes longer than the budget and one job."""
    times, last = [], time.monotonic()
    jobs = [0.0] * 64 + [0.15] * 6
    for _ in distribute(rest, iter(jobs), Here(1)):
        times.append(time.monotonic() - last)
        last = time.monotonic()
    assert len(times) == len(jobs)
    assert max(times) < LEAST_TIME + 0.15 + 0.3  # and what a loaded machine adds; in one chunk 0.9


@pytest.mark.parametrize(("seconds", "size"), [(1e-6, 8), (0.05, 4), (0.15, 2), (10.0, 2)])
def test_the_size_of_a_chunk_grows_at_most_eightfold_and_keeps_to_the_budget(seconds: float, size: int) -> None:
    """But for a second job, which a worker gives back where the first takes all the time."""
    pace = Pace()
    pace.note(1, seconds, 0.2)
    assert pace.size == size


def test_a_faster_job_counts_at_once_and_a_slower_one_half() -> None:
    pace = Pace()
    for seconds, each in ((1.0, 1.0), (0.01, 0.01), (0.03, 0.02)):  # the first one loads
        pace.note(1, seconds, 0.2)
        assert pace.seconds == pytest.approx(each)


@pytest.mark.parametrize(
    ("start", "each", "size"), [(0.0, 0.01, 20), (0.25, 0.005, 256), (0.0, 10.0, 2), (3.0, 1.0, 16)]
)
def test_chunks_grow_while_it_pays_to_solve_more_jobs_at_once(start: float, each: float, size: int) -> None:
    """Of jobs that take start + n each: 1.53 s for 256, of which 0.25 s are in common, though 0.2 s are wanted."""
    pace = Pace()
    pace.note(1, 2.0 + start + each, 0.2)  # the first one loads
    for _ in range(60):
        pace.note(pace.size, start + each * pace.size, 0.2)
    assert pace.size == size


def test_jobs_are_taken_as_they_are_needed() -> None:
    taken = list[int]()
    answers = distribute(square, (taken.append(n) or n for n in range(1000)), Here(2))
    assert [answer for _, answer in islice(answers, 4)] == [0, 1, 4, 9]
    assert len(taken) <= AHEAD
    answers.close()


def test_only_the_job_that_kills_is_lost() -> None:
    poison = {3, 700}
    workers = Here(2, lambda jobs: WorkerDeath("SIGKILL") if poison & {*jobs} else None)
    answers = dict(distribute(square, iter(range(1000)), workers))
    lost = {n: answer for n, answer in answers.items() if isinstance(answer, LostJob)}
    assert lost == dict.fromkeys(poison, LostJob("its process died by SIGKILL"))
    assert {n: answers[n] for n in answers if n not in lost} == {n: n * n for n in range(1000) if n not in lost}
    for n in poison:
        assert sum(n in chunk for chunk in workers.chunks) >= DEATHS


def test_what_waits_with_a_worker_that_dies_is_not_lost_with_the_job_that_kills(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Dask counts a death for every chunk that the worker had, be it in hand or waiting."""

    class Beside(Here):
        """One worker, with which all chunks die that it has."""

        waiting = list[tuple[Future[Any], Callable[[], Any], list[Any]]]()

        def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
            jobs = list(pickle.loads(pickle.loads(arguments[1]).jobs))
            self.waiting.append((Future(), partial(function, *arguments), jobs))
            return self.waiting[-1][0]

        def require(self) -> None:
            dead = any(2 in jobs for _, _, jobs in self.waiting)
            for future, answer, _ in self.waiting:
                future.set_result(WorkerDeath("KilledWorker") if dead else answer())
            self.waiting.clear()

    monkeypatch.setattr("pinarm.use.workers.distribute.PATIENCE", 0.001)
    answers = dict(distribute(square, iter(range(6)), Beside(1)))
    assert answers == {n: LostJob("its process died by KilledWorker") if n == 2 else n * n for n in range(6)}


def test_a_job_whose_worker_was_killed_from_outside_is_done_again() -> None:
    deaths = iter([WorkerDeath("SIGKILL"), NotBegun(), WorkerDeath("SIGTERM")])
    workers = Here(1, lambda jobs: next(deaths, None))
    assert sorted(distribute(square, iter(range(9)), workers)) == [(n, n * n) for n in range(9)]


def test_workers_that_all_die_end_the_work_and_say_how() -> None:
    workers = Here(2, lambda jobs: WorkerDeath("exit code 7"))
    with pytest.raises(NumericsError, match=f"{HOPELESS} workers died one after the other, the last by exit code 7"):
        list(distribute(square, iter(range(1000)), workers))
    assert len(workers.chunks) < HOPELESS + 5
    assert workers.closed


def test_a_job_that_kills_is_no_reason_to_give_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a chunk of 2,048 the first one kills: it takes 11 halvings, with other answers between them."""
    monkeypatch.setattr(Pace, "note", lambda *_: None)
    monkeypatch.setattr(Pace, "size", 2048)
    workers = Here(1, lambda jobs: WorkerDeath("SIGSEGV") if 0 in jobs else None)
    answers = dict(distribute(square, iter(range(2048)), workers))
    assert [n for n, answer in answers.items() if isinstance(answer, LostJob)] == [0]


def test_a_fault_of_the_program_costs_one_job() -> None:
    answers = dict(distribute(fail, iter([1, 0, 2]), Here()))
    assert isinstance(answers[0], LostJob)
    assert answers[0].reason.startswith("the program failed: ZeroDivisionError: division by zero (")
    assert (answers[1], answers[2]) == (1.0, 0.5)


def test_other_versions_are_an_error_that_names_both() -> None:
    other = {**versions(), "numpy": "1.0.0"}
    with pytest.raises(InputError, match=f"numpy is {versions()['numpy']} here and 1.0.0 there"):
        list(distribute(square, iter(range(9)), Here(1, lambda jobs: other)))


def test_no_two_orders_are_the_same() -> None:
    """Dask would take them for one call, and its answer for that of both, also where it is that a worker died."""
    orders, deaths = list[bytes](), iter([WorkerDeath("SIGKILL"), WorkerDeath("SIGKILL")])

    class Noting(Here):
        def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
            orders.append(arguments[1])
            return super().submit(function, *arguments)

    assert len(list(distribute(square, iter([5, 5, 5]), Noting(1, lambda jobs: next(deaths, None))))) == 3
    assert len(orders) == len(set(orders)) >= 4

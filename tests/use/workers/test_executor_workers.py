"""Executors of the user: threads, processes, and what they say when they are lost."""

import os
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from types import SimpleNamespace
from typing import Any

import pytest

from pinarm.engine.dynamics.parallel import cores
from pinarm.errors import InputError, NumericsError
from pinarm.use.workers import executor_workers
from pinarm.use.workers.chunk_order import LostJob
from pinarm.use.workers.distribute import distribute
from pinarm.use.workers.executor_workers import ExecutorWorkers


def square(n: int) -> int:
    return n * n


def end(n: int) -> None:
    os._exit(3)


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
        assert workers.count() == 3
        assert sorted(distribute(square, iter(range(300)), workers)) == [(n, n * n) for n in range(300)]
        assert executor.submit(square, 3).result() == 9


def test_the_workers_of_an_executor_are_counted_or_said() -> None:
    assert ExecutorWorkers(Refusing()).count() == cores()
    assert ExecutorWorkers(Refusing(), 40).count() == 40


def test_an_executor_that_breaks_ends_the_work() -> None:
    lost = pytest.raises(NumericsError, match=r"the workers are lost \(BrokenProcessPool: .*")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor, lost as caught:
        list(distribute(end, iter(range(9)), ExecutorWorkers(executor)))
    assert "the same command" in caught.value.hint


@pytest.mark.parametrize("executor", [Failing(CancelledError()), Refusing()])
def test_an_executor_that_is_gone_ends_the_work(executor: Executor) -> None:
    with pytest.raises(NumericsError, match=r"the workers are lost \((CancelledError|RuntimeError: cannot sch.*)\)"):
        list(distribute(square, iter(range(9)), ExecutorWorkers(executor)))


def test_a_worker_that_dies_costs_its_job() -> None:
    answers = distribute(square, iter([1, 2]), ExecutorWorkers(Failing(OSError("killed\nby me")), 1))
    assert list(answers) == [(n, LostJob("its process died by OSError: killed")) for n in (1, 2)]


def test_a_missing_module_is_named_whatever_it_is_wrapped_in() -> None:
    wrapped = RuntimeError("deserialization")
    wrapped.__cause__ = ModuleNotFoundError("No module named 'pinarm'")
    with pytest.raises(InputError, match="cannot run pinarm: No module named 'pinarm'"):
        list(distribute(square, iter([1]), ExecutorWorkers(Failing(wrapped))))


def test_the_work_is_given_up_where_there_are_no_workers_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    class Client:
        loop = SimpleNamespace(add_callback=lambda call: None)

        def nthreads(self) -> dict[str, int]:
            return {}

        def submit(self, *_: Any, **__: Any) -> Future[Any]:
            return Future[Any]()

    class Empty(Executor):
        _client = Client()

    monkeypatch.setattr(executor_workers, "ABSENCE", 0.05)
    monkeypatch.setattr("pinarm.use.workers.distribute.PATIENCE", 0.1)
    with pytest.raises(NumericsError, match=r"there have been no workers for 0\.05 s"):
        list(distribute(square, iter([1]), ExecutorWorkers(Empty())))


def test_what_has_not_begun_is_called_off() -> None:
    waiting = list[Future[Any]]()

    class Slow(Executor):
        def submit(self, function: Any, /, *given: Any, **_: Any) -> Future[Any]:
            waiting.append(Future[Any]())
            if len(waiting) == 1:
                waiting[0].set_result(function(*given))
            return waiting[-1]

    answers = distribute(square, iter(range(9)), ExecutorWorkers(Slow(), 2))
    assert next(answers) == (0, 0)
    answers.close()
    assert [future.cancelled() for future in waiting] == [False] + [True] * (len(waiting) - 1)


def test_files_are_not_sent_to_threads_which_see_them() -> None:
    with ThreadPoolExecutor(1) as executor:
        assert ExecutorWorkers(executor).files is None
    assert ExecutorWorkers(Refusing()).files is not None

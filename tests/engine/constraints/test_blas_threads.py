"""Threads of linear algebra, as its libraries tell them."""

import os
from collections.abc import Iterator
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

import pinarm
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.constraints.nullspace import SMALL, one_blas_thread
from pinarm.problems.simplify.simplification import Simplification

ROOT = Path(__file__).parents[3]


def threads() -> set[int]:
    return {library["num_threads"] for library in ThreadpoolController().select(user_api="blas").info()}


@pytest.fixture(autouse=True)
def two() -> Iterator[None]:
    """Let libraries use two threads, as on a machine of two cores."""
    with threadpool_limits(2, user_api="blas"):
        assert threads() == {2}
        yield


def test_a_block_has_one_and_what_was_before_comes_back() -> None:
    before = dict(os.environ)
    with one_blas_thread(SMALL + 1):
        assert threads() == {1}
        with one_blas_thread(1000):
            assert threads() == {1}
        assert threads() == {1}
    assert threads() == {2}
    with pytest.raises(ZeroDivisionError), one_blas_thread(1000):
        raise ZeroDivisionError
    assert threads() == {2}
    assert dict(os.environ) == before


def test_blocks_of_threads_that_overlap_leave_nothing_behind() -> None:
    entered, leave = Event(), Event()

    def hold() -> None:
        with one_blas_thread(1000):
            entered.set()
            leave.wait(60)

    with one_blas_thread(1000):
        other = Thread(target=hold)
        other.start()
        assert entered.wait(60)
    leave.set()
    other.join()
    assert threads() == {2}


def test_a_run_of_many_loops_has_one_from_its_solution_to_its_multipliers(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, solve, qr = list[set[int]](), Simplification.solve, np.linalg.qr
    monkeypatch.setattr(Simplification, "solve", lambda *given: seen.append(threads()) or solve(*given))
    scenario = pinarm.load(ROOT / "scenarios" / "forty_four_bars_equal_rods.yaml", {"problem.time.end": "0.05 s"})
    run = scenario.run().trajectory
    monkeypatch.setattr(np.linalg, "qr", lambda *given, **more: seen.append(threads()) or qr(*given, **more))
    least = Multipliers.least(run.closure, run.q, np.zeros_like(run.v), np.zeros((len(run), 0)))
    assert not np.asarray(least).any()
    assert len(seen) >= 2
    assert set.union(*seen) == {1}
    assert threads() == {2}

"""Threads of linear algebra, as its libraries tell them."""

import os
from collections.abc import Iterator
from threading import Event, Thread

import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

from pinarm.engine.constraints.nullspace import SMALL, one_blas_thread


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

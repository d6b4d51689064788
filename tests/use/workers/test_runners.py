"""Jobs are answered in their order, by this process or others."""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import pytest

from pinarm.use.workers import runners
from pinarm.use.workers.runners import HERE, Runners, in_order
from pinarm.use.workers.worker import AnsweredPart


def hurried(n: int) -> int:
    """Take longer for the first of every ten."""
    time.sleep(0.02 if n % 10 == 0 else 0.0)
    return n * n


@dataclass(frozen=True)
class Twice:
    """Answers jobs, and says how many it was given at once."""

    def __call__(self, n: int) -> tuple[int, int]:
        return 2 * n, 1

    def together(self, jobs: Sequence[int]) -> Iterator[AnsweredPart]:
        last = len(jobs) - 1
        yield [last], [(2 * jobs[last], len(jobs))]
        yield range(last), [(2 * n, len(jobs)) for n in jobs[:last]]


def test_this_process_gives_a_function_what_it_solves_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runners, "TOGETHER", 4)
    with HERE.applying(Twice()) as apply:
        assert list(apply(range(6))) == [(0, 4), (2, 4), (4, 4), (6, 4), (8, 2), (10, 2)]
    with HERE.applying(hurried) as apply:
        assert list(apply(iter([3, 1]))) == [9, 1]


def test_parts_in_any_order_are_put_in_order_as_soon_as_they_can_be() -> None:
    taken = list[int]()
    parts = iter([([2], "c"), ([0], "a"), ((1, 4), "be"), ([3], "d")])
    answers = in_order(taken.append(len(taken)) or part for part in parts)
    assert (next(answers), len(taken)) == ("a", 2)
    assert list(answers) == ["b", "c", "d", "e"]


def test_answers_come_in_the_order_of_their_jobs_as_often_as_is_asked() -> None:
    with ThreadPoolExecutor(3) as executor, Runners(executor=executor).applying(hurried) as apply:
        for count in (0, 1, 45):
            assert list(apply(range(count))) == [n * n for n in range(count)]
        assert list(apply(iter(range(250)))) == [n * n for n in range(250)]

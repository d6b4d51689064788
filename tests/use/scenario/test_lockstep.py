"""Searches side by side: the same as one after the other, in fewer turns, and an error ends all."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest

from pinarm.use.scenario.landscape import Trial
from pinarm.use.scenario.lockstep import side_by_side


def doubling(start: float, last: float, run: Callable[[Sequence[Any]], Sequence[Trial]]) -> list[float]:
    """Go on from twice the value of the point before until it is beyond the last."""
    found = [start]
    while found[-1] < last:
        found.append(run([np.array([found[-1]]), np.array([0.0])])[0].objective)
    return found


def test_every_search_gets_what_it_asked_for_and_all_take_turns() -> None:
    turns = list[list[float]]()

    def run(points: Sequence[Any]) -> list[Trial]:
        turns.append([float(point[0]) for point in points])
        return [Trial(2.0 * float(point[0])) for point in points]

    searches = [partial(doubling, 1.0, 4.0), partial(doubling, 9.0, 4.0), partial(doubling, 3.0, 20.0)]
    assert side_by_side(searches, run) == [[1, 2, 4], [9], [3, 6, 12, 24]]
    assert turns == [[1, 0, 3, 0], [2, 0, 6, 0], [12, 0]]


def test_an_error_of_a_run_ends_all_searches_and_is_told() -> None:
    def run(points: Sequence[Any]) -> list[Trial]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        side_by_side([partial(doubling, 1.0, 4.0)] * 3, run)


def test_an_error_of_a_search_is_told_when_the_others_have_ended() -> None:
    def faulty(run: Any) -> list[float]:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        side_by_side([faulty, partial(doubling, 1.0, 4.0)], lambda points: [Trial(9.0)] * len(points))

"""Searches side by side: what each asks for next is run together with what the others ask for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from typing import TypeVar

from pinarm.arrays import Array
from pinarm.use.scenario.landscape import Trial

Run = Callable[[Sequence[Array]], Sequence[Trial]]
"""Points -> what a run with each says."""

FoundT = TypeVar("FoundT")


class _Abandoned(BaseException):
    """The end of a search whose runs have ended with an error."""


def side_by_side(searches: Sequence[Callable[[Run], FoundT]], run: Run) -> list[FoundT]:
    """Return what searches lead to, each as by itself; they take turns, and runs are done in the thread of the caller.

    Args:
        searches: Each is given what runs its points.
        run: Runs the points of several searches, the first one's first.

    Raises:
        Exception: What a run or a search raises; all searches end with it.
    """
    asked = SimpleQueue[tuple[int, Sequence[Array] | None]]()
    replies = [SimpleQueue[Sequence[Trial] | None]() for _ in searches]

    def follow(number: int) -> FoundT:
        def ask(points: Sequence[Array]) -> Sequence[Trial]:
            asked.put((number, points))
            reply = replies[number].get()
            if reply is None:
                raise _Abandoned
            return reply

        try:
            return searches[number](ask)
        finally:
            asked.put((number, None))

    with ThreadPoolExecutor(len(searches)) as threads:
        followed = [threads.submit(follow, number) for number in range(len(searches))]
        try:
            _take_turns(asked, replies, run)
        finally:
            for reply in replies:
                reply.put(None)
    return [one.result() for one in followed]


def _take_turns(
    asked: SimpleQueue[tuple[int, Sequence[Array] | None]], replies: Sequence[SimpleQueue[Sequence[Trial] | None]],
    run: Run,
) -> None:  # fmt: skip
    """Run what all searches under way ask for, until none is under way."""
    under_way, waiting = len(replies), dict[int, Sequence[Array]]()
    while under_way:
        number, points = asked.get()
        if points is None:
            under_way -= 1
        else:
            waiting[number] = points
        if waiting and len(waiting) == under_way:
            order = sorted(waiting)
            trials = iter(run([point for each in order for point in waiting[each]]))
            for each in order:
                replies[each].put([next(trials) for _ in waiting[each]])
            waiting.clear()

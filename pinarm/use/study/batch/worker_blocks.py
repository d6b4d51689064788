"""Blocks of a batch that workers solve."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Generic, TypeVar

from pinarm.arrays import Array
from pinarm.errors import NumericsError, PinarmError
from pinarm.input.roots import file_root, given_root
from pinarm.use.scenario.scenario import Scenario, ScenarioSource
from pinarm.use.study.batch.block import Block, Question, answered
from pinarm.use.study.batch.initial_states import Starts
from pinarm.use.workers.dispatch import Dispatch
from pinarm.use.workers.executors import Workers
from pinarm.use.workers.runners import LostJob

AnswerT = TypeVar("AnswerT")

Job = tuple[int, Array, Array, Array]
"""The number of the first motion of a block, the initial states of all, and what was given of their velocities."""


@dataclass(frozen=True, eq=False)
class Remote(Generic[AnswerT]):
    """What a process is asked of each block; it reads the scenario once.

    Attributes:
        source: What the scenario is read from.
        root: Folder that files may refer to; each file's own where it is ``None``.
        answer: What is asked; importable by its name.
        position: Joints whose coordinates at the start are given.
        velocity: Joints whose velocities there are given.
    """

    source: ScenarioSource
    root: Path | None
    answer: Callable[[Block], AnswerT]
    position: tuple[str, ...]
    velocity: tuple[str, ...]

    @cached_property
    def question(self) -> Question:
        """Return the question of the scenario."""
        return Question.of(self.source.scenario()).giving(self.position, self.velocity)

    def __call__(self, job: Job) -> tuple[AnswerT, dict[int, str]] | PinarmError:
        """Return the answer of a block and why motions of it failed, or why it has none."""
        first, q, v, given = job
        try:
            with file_root(self.root):
                return answered(self.answer, Block(self.question, q, v, given, first))
        except PinarmError as error:
            error.__dict__.pop("partial", None)  # which stays in this process
            return error


def answers(
    scenario: Scenario, starts: Starts, jobs: Sequence[Job], answer: Callable[[Block], AnswerT], workers: Workers
) -> Iterator[tuple[Job, AnswerT, dict[int, str]]]:
    """Yield the answers of blocks as they come, and why motions of each failed.

    Raises:
        PinarmError: A block has no answer.
        NumericsError: Workers died with a block.
    """
    remote = Remote(scenario.source, given_root(), answer, tuple(starts.position), tuple(starts.velocity))
    with closing(Dispatch(remote, workers)) as dispatch:
        for job, answered in dispatch.pairs(jobs):
            if isinstance(answered, LostJob):
                last = job[0] + len(job[1]) - 1
                raise NumericsError(f"the motions {job[0]} to {last} have no answer: {answered.reason}")
            if isinstance(answered, PinarmError):
                raise answered
            yield job, *answered

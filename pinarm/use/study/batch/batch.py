"""Motions of one scenario from many initial states, solved block by block: memory does not grow with their number."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from pinarm.arrays import Array
from pinarm.engine.constraints.blas_threads import one_blas_thread
from pinarm.engine.motion.segmented.ensembles import is_batchable
from pinarm.engine.one_run import one_at_a_time
from pinarm.engine.series import Series
from pinarm.errors import InputError, NumericsError, PinarmError, require_name
from pinarm.input.yaml.values import Values
from pinarm.records import replace
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Given, ScenarioSource, load
from pinarm.use.store.line_table import LineTable
from pinarm.use.study.batch.block import Block, Question, Starts
from pinarm.use.study.batch.reductions import ColumnReduction, numbered, reduced
from pinarm.use.workers.dispatch import Dispatch
from pinarm.use.workers.executors import chosen_workers
from pinarm.use.workers.runners import check_number
from pinarm.use.workers.worker import LostJob

AnswerT = TypeVar("AnswerT")

TOGETHER, ALONE, ROWS = 512, 32, 2**17
"""Motions of a block: as many as fill the calls that they share, or as can be kept where each is taken alone; and the
rows that their tables may have together."""

KEPT = 4
"""Blocks of a batch that is kept once it is solved; one of more is solved again whenever something is asked of it."""


@dataclass(frozen=True, eq=False, repr=False)
class Batch:
    """Motions of one scenario from b initial states, at its n instants.

    They are solved when something is asked, a block of them after the other. Up to 2,048 that are integrated together,
    or 128 that are not, are kept; of more, or where other processes solve them, nothing is: what is asked of those is
    best asked at once.

    Attributes:
        question: What is the same in all of them.
        starts: The initial values that were given.
        q: Configurations at the start, shape (b, nq).
        v: Velocities there, shape (b, nv).
        given: What was given of these, not a number where nothing was.
        workers: Number of processes that solve them, or of the workers of the executor; without it 1 is this process.
        executor: Who solves them in place of processes of this machine.
    """

    question: Question
    starts: Starts
    q: Array
    v: Array
    given: Array
    workers: int | None = None
    executor: Executor | None = None
    _blocks: dict[int, Block] = field(default_factory=dict)
    _failures: dict[int, str] = field(default_factory=dict)
    _looked: set[int] = field(default_factory=set)

    def __repr__(self) -> str:
        """Return of which scenario it is, and how many motions and instants it has."""
        return f"<Batch of '{self.question.scenario.name}': {len(self)} motions, {len(self.t)} instants>"

    def __len__(self) -> int:
        return len(self.q)

    @property
    def t(self) -> Array:
        """Return the instants [s], shape (n,)."""
        return self.question.problem.time.instants()

    def run(self, number: int) -> Result:
        """Return the result of one motion, with its accuracy, as the scenario itself would have it.

        Raises:
            InputError: There is no motion of that number.
            NumericsError: It could not be followed to its end; ``partial`` holds it until then.
        """
        try:
            number = range(len(self))[number]
        except (IndexError, TypeError):
            raise InputError(f"there is no motion {number!r}", expected=f"a number from 0 to {len(self) - 1}") from None
        begin = number - number % self._size if self._small else number
        block = self._block(begin, begin + self._size if self._small else number + 1)
        own = self.question.scenario.merged({"problem": {"initial": self.starts.of_one(number)}})
        try:
            return replace(block.run(number - begin), scenario=own)
        except NumericsError as error:
            if isinstance(error.partial, Result):
                error.partial = replace(error.partial, scenario=own)
            raise

    @property
    def failures(self) -> dict[int, str]:
        """Return why motions could not be followed to their end, by their number."""
        if len(self._looked) < len(self._begins()):
            for _ in self._answers(len):
                pass
        return dict(sorted(self._failures.items()))

    def __getitem__(self, name: str) -> Series:
        """Return a quantity of all motions with its unit, shape (b, n), not a number beyond the end of a motion.

        Args:
            name: A quantity, a symbol or a formula, as of a result.

        Raises:
            InputError: There is no quantity of that name.
        """
        require_name(name)
        return replace(self._require([name])[name], name=name, values=self.values(name)[0])

    def values(self, *names: str) -> Array:
        """Return several quantities of all motions in SI, shape (k, b, n), solved for at once; see ``batch[name]``.

        Raises:
            InputError: There is no quantity of a name.
        """
        self._require(names)
        found = np.empty((len(names), len(self), len(self.t)))
        for part, values in self._answers(partial(Block.values, names=names)):
            found[:, part] = values
        return found

    def states(self) -> tuple[Array, Array]:
        """Return q, shape (b, n, nq), and v, shape (b, n, nv), of the whole mechanism; not a number beyond an end."""
        model, shape = self.question.scenario.mechanism.model, (len(self), len(self.t))
        q, v = np.empty((*shape, model.nq)), np.empty((*shape, model.nv))
        for part, states in self._answers(Block.states):
            q[part], v[part] = states
        return q, v

    def reduced(self, asked: Mapping[str, str | float | Sequence[str | float]]) -> LineTable:
        """Return a few numbers of every motion: ``reduced({"A_y": ["max", 95], "joint.B.velocity": "rms"})``.

        They are taken over the instants of the table that a motion reached, means over time by the trapezoidal rule.
        Motions that could not be followed to their end have none.

        Args:
            asked: Quantity, symbol or formula -> ``min``, ``max``, ``largest`` (in size), ``mean``, ``rms``,
                ``median``, ``start``, ``end``, or a percentage of the instants; one, or several.

        Raises:
            InputError: There is no such quantity, or no such measure.
        """
        wanted = ColumnReduction.read(asked)
        known = self._require([reduction.quantity for reduction in wanted])
        numbers = np.empty((len(self), len(wanted)))
        for part, rows in self._answers(partial(reduced, reductions=wanted)):
            numbers[part] = rows
        pairs = zip(wanted, numbers.T, strict=True)
        columns = [Series(item.label, known[item.quantity].unit, column) for item, column in pairs]
        return self._table(columns, self.failures)

    def numbers(self, *texts: str) -> LineTable:
        """Return numbers of every motion as its own run tells them: ``numbers("C_B @ rms", "limits.least_margin")``.

        Figures of a curve are integrated between the rows, and every section of the scenario has its numbers, which
        takes some ten times as long as ``reduced``. Motions that could not be followed to their end have none, nor have
        those that lack one of the numbers, as at a place that they do not come to.

        Args:
            texts: Numbers as in ``Result.number``.

        Raises:
            InputError: A number cannot be read, or no run has it.
        """
        from pinarm.use.result.section_number import read_number

        scenario = self.question.scenario
        quantities, sections = scenario.quantities(), scenario.content.assessments
        known = [read_number(text).described(quantities, sections) for text in texts]
        rows = [row for _, part in self._answers(partial(numbered, texts=texts)) for row in part]
        lacks = {number: row for number, row in enumerate(rows) if isinstance(row, InputError)}
        if len(lacks) == len(rows):
            raise lacks[0]
        values = np.array([[np.nan] * len(texts) if isinstance(row, InputError) else row for row in rows])
        columns = [Series(text, one.unit, column) for text, one, column in zip(texts, known, values.T, strict=True)]
        return self._table(columns, self.failures | {number: error.message for number, error in lacks.items()})

    def save(self, folder: str | Path) -> Path:
        """Write every motion, block by block, and a table of all.

        The folder gets ``motions.csv`` and ``motions.npz`` (a line per motion: its initial values, the least and
        greatest value of every output, its accuracy and cost, and why it failed if it did), ``summary.json``
        (statistics and failures), and in ``motions`` the outputs of each as ``000042.csv`` and ``000042.npz``, as
        ``run`` writes them.

        Raises:
            InputError: The folder cannot be written, or holds something else.
        """
        from pinarm.use.output.folder import whole_folder
        from pinarm.use.store.files import json_text, write
        from pinarm.use.study.batch.reductions import saved, saved_columns

        outputs = list(dict.fromkeys(self.question.scenario.content.outputs))
        known, home = self._require(outputs), Path(folder)
        lines, errors = list[list[float]](), dict[int, str]()
        with whole_folder(home, "batch") as draft:
            (draft / "motions").mkdir()
            for part, motions in self._answers(saved):
                for number, motion in enumerate(motions, part.start):
                    lines.append(motion.line)
                    errors |= {number: motion.error} if motion.error else {}
                    motion.write(draft / "motions" / f"{number:06d}")
            table = self._table(saved_columns([known[name] for name in outputs], np.array(lines)), errors)
            table.write(draft, "motions")
            write(draft / "summary.json", json_text(table.summary()) + "\n")
        return home

    def _table(self, numbers: Sequence[Series], errors: Mapping[int, str]) -> LineTable:
        scenario = self.question.scenario
        starts = self.starts.columns(scenario.quantities())
        return LineTable(scenario.name, [*starts, *numbers], errors, scenario.content.presentation)

    def _require(self, names: Sequence[str]) -> dict[str, Series]:
        """Return quantities, of no motion yet.

        Raises:
            InputError: There is no quantity of a name.
        """
        quantities = self.question.scenario.quantities()
        with np.errstate(all="ignore"):
            return {name: quantities[name] for name in names}

    def _answers(self, answer: Callable[[Block], AnswerT]) -> Iterator[tuple[slice, AnswerT]]:
        """Yield what every block answers, in order, and which motions it holds; ``answer`` is importable by its name.

        Raises:
            PinarmError: A block has no answer.
            NumericsError: Workers died with a block.
        """
        here = self.executor is None and self.workers in (None, 1)
        for part, answered, failures in (self._answers_here if here else self._answers_of_workers)(answer):
            self._failures.update({part.start + number: why for number, why in failures.items()})
            self._looked.add(part.start)
            yield part, answered

    def _answers_here(self, answer: Callable[[Block], AnswerT]) -> Iterator[tuple[slice, AnswerT, dict[int, str]]]:
        for begin in self._begins():
            block = self._block(begin, begin + self._size)
            yield slice(begin, begin + len(block)), *answered(answer, block)

    def _answers_of_workers(
        self, answer: Callable[[Block], AnswerT]
    ) -> Iterator[tuple[slice, AnswerT, dict[int, str]]]:
        parts = [slice(begin, min(begin + self._size, len(self))) for begin in self._begins()]
        jobs = [(part.start, self.q[part], self.v[part], self.given[part]) for part in parts]
        source, joints = self.question.scenario.source, (tuple(self.starts.position), tuple(self.starts.velocity))
        workers = chosen_workers(self.workers and min(self.workers, len(parts)), self.executor)
        with closing(Dispatch(RemoteAnswer(source, answer, *joints), workers)) as dispatch:
            for part, reply in zip(parts, dispatch.in_order(jobs), strict=True):
                if isinstance(reply, LostJob):
                    said = f"the motions {part.start} to {part.stop - 1} have no answer: {reply.reason}"
                    raise NumericsError(said)
                if isinstance(reply, PinarmError):
                    raise reply
                yield part, *reply

    def _block(self, begin: int, end: int) -> Block:
        """Return some of the motions; those of a small batch stay solved."""
        if begin in self._blocks:
            return self._blocks[begin]
        block = Block(self.question, self.q[begin:end], self.v[begin:end], self.given[begin:end], begin)
        if self._small:
            self._blocks[begin] = block
        return block

    def _begins(self) -> range:
        """Return the first motion of every block."""
        return range(0, len(self), self._size)

    @property
    def _small(self) -> bool:
        """Whether the batch stays solved."""
        return len(self) <= KEPT * self._size

    @property
    def _size(self) -> int:
        """Number of motions in a block."""
        return min(TOGETHER, max(1, ROWS // len(self.t))) if is_batchable(self.question.hybrid) else ALONE


Job = tuple[int, Array, Array, Array]
"""Number of the first motion of a block, the initial states of all, and the velocities that were given."""


def answered(answer: Callable[[Block], AnswerT], block: Block) -> tuple[AnswerT, dict[int, str]]:
    """Return what a block answers, and why motions of it failed."""
    with one_at_a_time(), one_blas_thread(block.question.scenario.mechanism.model.nv):
        return answer(block), block.failures


@dataclass(frozen=True, eq=False)
class RemoteAnswer(Generic[AnswerT]):
    """A function of blocks in another process, which reads the scenario once.

    Attributes:
        source: What the scenario is read from.
        answer: What is asked; importable by its name.
        position: Joints whose coordinates at the start are given.
        velocity: Joints whose velocities there are given.
    """

    source: ScenarioSource
    answer: Callable[[Block], AnswerT]
    position: tuple[str, ...]
    velocity: tuple[str, ...]

    @cached_property
    def question(self) -> Question:
        """The question of the scenario."""
        return Question.of(self.source.scenario()).giving(self.position, self.velocity)

    def __call__(self, job: Job) -> tuple[AnswerT, dict[int, str]] | PinarmError:
        """Return the answer of a block and why motions of it failed, or why it has none."""
        first, q, v, given = job
        try:
            return answered(self.answer, Block(self.question, q, v, given, first))
        except PinarmError as error:
            error.__dict__.pop("partial", None)  # which stays in this process
            return error


def batch(
    scenario: Given, position: Mapping[str, ArrayLike] | None = None,
    velocity: Mapping[str, ArrayLike] | None = None, *, values: Values | None = None, workers: int | None = None,
    executor: Executor | None = None,
) -> Batch:  # fmt: skip
    """Ask a scenario of kind ``forward`` from many initial states.

    Args:
        scenario: The scenario, or its file.
        position: Joint -> its initial coordinates [rad or m], shape (b,) or one for all; other joints begin as in the
            scenario.
        velocity: Joint -> its initial velocities [rad/s or m/s], likewise.
        values: Other values than those of the file, such as ``{"problem.time.end": "3 s"}``; see ``pinarm.load``.
        workers: Processes that solve the motions, as pays where loops are taken one by one; the numbers are the same.
            Of an executor, how many workers it has, where it cannot tell.
        executor: Who solves them in place of processes of this machine; see ``pinarm.sweep``.

    Raises:
        InputError: The scenario is of another kind or looks for something, a joint has not one coordinate or follows a
            law, or the numbers of values differ.
        DynamicsError: Masses do not determine the accelerations.
    """
    check_number(workers)
    question = Question.of(load(scenario, values))
    starts = Starts.of(question.scenario.simplification.solved, question.hybrid, position or {}, velocity or {})
    question = question.giving(starts.position, starts.velocity)
    return Batch(question, starts, *question.begin(starts), workers, executor)

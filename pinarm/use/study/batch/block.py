"""A block of motions: what can be integrated together is, what cannot is taken one by one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TypeVar

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.blas_threads import one_blas_thread
from pinarm.engine.integration.ensemble import Ensemble
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.motion.segmented.ensembles import integrate_together
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.motion.small_motions import is_offset, is_small
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.one_run import one_at_a_time
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, Interrupted, NumericsError
from pinarm.mechanics.laws.motion_law import ROUNDING
from pinarm.problems.batch_table import BatchTable
from pinarm.problems.forward import Forward
from pinarm.records import replace
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario
from pinarm.use.study.batch.initial_states import Starts

AnswerT = TypeVar("AnswerT")


@dataclass(frozen=True, eq=False)
class Question:
    """What is the same in all motions of a batch.

    Attributes:
        scenario: The scenario.
        problem: The question about what is solved.
        hybrid: What is integrated.
    """

    scenario: Scenario
    problem: Forward = field(repr=False)
    hybrid: HybridSystem = field(repr=False)

    @classmethod
    def of(cls, scenario: Scenario) -> Question:
        """Return the question of a scenario.

        Raises:
            InputError: It is of another kind than ``forward``, or looks for something.
        """
        content, problem = scenario.content, scenario.simplification.problem
        if not isinstance(problem, Forward):
            raise InputError(f"the scenario '{scenario.name}' is of kind {problem.kind}", expected="kind: forward")
        if content.find or content.accuracy.target is not None:
            raise InputError(
                f"the scenario '{scenario.name}' looks for numbers, or for the setting that reaches an error",
                expected="neither find nor accuracy.target", hint="accuracy.tolerance",
            )  # fmt: skip
        place = partial(scenario.document.locating, "problem")
        return cls(scenario, problem, problem.prepare(scenario.simplification.solved, content.accuracy, place))

    def giving(self, position: Collection[str], velocity: Collection[str]) -> Question:
        """Return the question of motions of which initial values of these joints are given: they stay free if they can.

        Args:
            position: Joints whose coordinates are given.
            velocity: Joints whose velocities are given.
        """
        joints, initial = self.scenario.simplification.solved.joints, self.hybrid.initial
        positions = tuple(dict.fromkeys([*initial.positions, *(joints[name].v for name in position)]))
        velocities = tuple(dict.fromkeys([*initial.velocities, *(joints[name].v for name in velocity)]))
        return replace(self, hybrid=self.hybrid.beginning(replace(initial, positions=positions, velocities=velocities)))

    def begin(self, starts: Starts) -> tuple[Array, Array, Array]:
        """Return initial states, assembled, of shapes (b, nq) and (b, nv), and what was given of the velocities.

        Raises:
            InputError: One contradicts itself, the laws, or a stop.
            DynamicsError: Masses do not determine the accelerations there.
        """
        given = [*self.problem.initial_states(
            starts.mechanism, self.hybrid.prescribed, starts.position, starts.velocity, starts.size
        )]  # fmt: skip
        q, v = (np.array(x) for x in zip(*map(self.hybrid.begin, given), strict=True))
        self.hybrid.require_masses(q)
        return q, v, np.array([initial.given_rates() for initial in given])


@dataclass(frozen=True, eq=False)
class Block:
    """Motions from b initial states, at n instants; they are solved when something is asked of them.

    Attributes:
        question: What is the same in all of them.
        q: Configurations at the start, assembled, shape (b, nq).
        v: Velocities there, shape (b, nv).
        given: What was given of these; see ``Initial.given_rates``.
        first: Number of the first of them in the batch.
    """

    question: Question
    q: Array = field(repr=False)
    v: Array = field(repr=False)
    given: Array = field(repr=False)
    first: int = 0
    _followed: dict[int, Outcome | NumericsError] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.q)

    @cached_property
    def t(self) -> Array:
        """Return the instants [s], shape (n,)."""
        return self.question.problem.time.instants()

    @cached_property
    def ensemble(self) -> Ensemble | None:
        """Return the motions, as far as no load begins another segment; ``None`` where each is taken alone."""
        with np.errstate(all="ignore"):  # what is not finite is found in the results, and said in words
            return integrate_together(self.question.hybrid, self.q, self.v)

    @cached_property
    def whole(self) -> Ensemble | None:
        """Return the motions where they are integrated together from end to end; none may have to be followed finer."""
        hybrid, ensemble = self.question.hybrid, self.ensemble
        if ensemble is None:
            return None
        reached = zip(ensemble.sizes.tolist(), ensemble.displacements.tolist(), strict=True)
        finer = any(is_small(hybrid, size) or is_offset(hybrid, moved, hybrid.size + size) for size, moved in reached)
        return None if finer else ensemble

    def run(self, number: int) -> Result:
        """Return the result of one motion, with its accuracy.

        Raises:
            NumericsError: It could not be followed to its end; ``partial`` is its result until then.
        """
        scenario, solved = self.question.scenario, self._solved(number)
        try:
            with np.errstate(all="ignore"):
                if isinstance(solved, Outcome):
                    return scenario.measured(solved, scenario.simplification.restored(solved))
                error, kept = copy(solved), self._outcome(number)
                error.partial = None if kept is None else scenario.simplification.restored(kept)
                raise error
        except NumericsError as error:
            if isinstance(error.partial, Outcome):
                error.partial = scenario.broken_off(error.partial, error.message)
            raise

    @cached_property
    def failures(self) -> dict[int, str]:
        """Return why motions could not be followed to their end, by their number."""
        if self.whole is not None:
            return self.whole.failures
        solved = ((number, self._solved(number)) for number in range(len(self)))
        return {number: one.message for number, one in solved if isinstance(one, NumericsError)}

    @cached_property
    def reached(self) -> Flags:
        """Return which motions have come to which instants, shape (b, n)."""
        if self.whole is not None:
            return self.whole.reached(self.t)
        reached = np.zeros((len(self), len(self.t)), dtype=bool)
        for number in range(len(self)):
            if (found := self._outcome(number)) is not None:
                reached[number, _rows(found.rows.grid.t, self.t)[1]] = True
        return reached

    def values(self, names: Sequence[str]) -> Array:
        """Return quantities, shape (k, b, n), not a number beyond the end of a motion.

        Raises:
            InputError: One depends on how several frictions at rest share a load; see ``Quantities.determined``.
        """
        found = np.full((len(names), len(self), len(self.t)), np.nan)
        scenario = self.question.scenario
        for motion, instant, run, rows in self._tables():
            quantities = Quantities(
                scenario.simplification.restored_rows(run), scenario.symbols, scenario.content.undetermined
            )
            with np.errstate(all="ignore"):
                for k, name in enumerate(names):
                    found[k, motion, instant] = quantities.determined(name).values[rows]
        return found

    def states(self) -> tuple[Array, Array]:
        """Return q, shape (b, n, nq), and v, shape (b, n, nv), of the whole mechanism; not a number beyond an end."""
        if self.whole is not None:
            q, v = self.question.hybrid.system().whole(self.t, *self.whole.states(self.t))
        else:
            q, v = (np.full((len(self), len(self.t), x.shape[1]), np.nan) for x in (self.q, self.v))
            for motion, instant, run, rows in self._tables():
                q[motion, instant], v[motion, instant] = run.q[rows], run.v[rows]
        return self.question.scenario.simplification.spread(self.question.hybrid.grid_of_each(self.t), q, v)

    def _tables(self) -> Iterator[tuple[Indices, Indices, Trajectory, Indices]]:
        """Yield motions, the instants that they have come to, trajectories, and where in these they stand."""
        question = self.question
        mechanism = question.scenario.simplification.solved
        lossy = any(drive.efficiency < 1.0 for drive in question.scenario.mechanism.drives.values())
        if self.whole is not None and not lossy:  # whether a motor drives, its own motion tells at standstill
            table = BatchTable.of(question.problem, mechanism, question.hybrid, self.whole)
            yield table.motion, table.instant, table.run, np.arange(len(table.motion))
            return
        for number in range(len(self)):
            if (found := self._outcome(number)) is not None:
                rows, instant = _rows(found.rows.grid.t, self.t)
                yield np.full(len(rows), number), instant, found.rows, rows

    def _outcome(self, number: int) -> Outcome | None:
        """Return as much of one motion of what is solved as there is."""
        found = self._solved(number)
        outcome = found.partial if isinstance(found, NumericsError) else found
        return outcome if isinstance(outcome, Outcome) else None

    def _solved(self, number: int) -> Outcome | NumericsError:
        """Return one motion of what is solved, or why there is none."""
        if number not in self._followed:
            question = self.question
            try:
                self._followed[number] = question.problem.solve_from(
                    question.scenario.simplification.solved, question.hybrid, self.q[number], self.v[number],
                    self.given[number],
                )  # fmt: skip
            except Interrupted:
                raise
            except NumericsError as error:
                self._followed[number] = error.with_traceback(None)  # whose frames hold this block
        return self._followed[number]


def answered(answer: Callable[[Block], AnswerT], block: Block) -> tuple[AnswerT, dict[int, str]]:
    """Return what a block answers, and why motions of it failed."""
    with one_at_a_time(), one_blas_thread(block.question.scenario.mechanism.model.nv):
        return answer(block), block.failures


def _rows(table: Array, t: Array) -> tuple[Indices, Indices]:
    """Return the rows that stand for instants, the last one where there are two, and which instants these are.

    Args:
        table: Instants of a table, shape (n,); where a law jumps they may differ from those asked by rounding.
        t: Instants that are asked [s], shape (m,).
    """
    slack = 2.0 * ROUNDING * (t[-1] - t[0])
    rows = np.maximum(np.searchsorted(table, t + slack, side="right") - 1, 0)
    there = np.abs(table[rows] - t) <= slack
    return rows[there], np.flatnonzero(there)

"""Blocks of motions from many initial states: integrated together where that is possible, else one by one."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.ensemble import Ensemble
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.motion.segmented.ensembles import integrate_together
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.motion.small_motions import is_offset, is_small
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.state_arrays import columns_of
from pinarm.engine.series import Series
from pinarm.errors import InputError, Interrupted, NumericsError, choices, require_map
from pinarm.input.units import unit
from pinarm.mechanics.laws.motion_law import ROUNDING
from pinarm.problems.batch_table import BatchTable
from pinarm.problems.forward import Forward
from pinarm.records import replace
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Starts:
    """Initial values of b motions.

    Attributes:
        mechanism: The mechanism that is solved.
        position: Joint -> initial coordinates [rad or m], shape (b,).
        velocity: Joint -> initial velocities [rad/s or m/s], shape (b,).
        size: b.
    """

    mechanism: Mechanism
    position: Mapping[str, Array]
    velocity: Mapping[str, Array]
    size: int

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        hybrid: HybridSystem,
        position: Mapping[str, ArrayLike],
        velocity: Mapping[str, ArrayLike],
    ) -> Starts:
        """Return initial values, those of single numbers the same for all.

        Raises:
            InputError: A joint has not one coordinate or follows a law, or the numbers of values differ.
        """
        for what, values in (("position", position), ("velocity", velocity)):
            require_map(values, what, f"{what}={{'knee': [0.1, 0.2]}}")
        joints = mechanism.joints
        for name in (*position, *velocity):
            if name not in joints or name in hybrid.prescribed.names:
                expected, hint = choices(name, [joint for joint in joints if joint not in hybrid.prescribed.names])
                said = f"no free joint '{name}' with one coordinate can begin elsewhere"
                raise InputError(said, expected=expected, hint=hint)
        units = {f"position {name}": [joint.unit] for name, joint in joints.items()}
        units |= {f"velocity {name}": [joint.unit / unit("s")] for name, joint in joints.items()}
        given = {f"position {name}": x for name, x in position.items()}
        given |= {f"velocity {name}": x for name, x in velocity.items()}
        shape, columns = columns_of(given, units)
        if len(shape) > 1:
            raise InputError(f"the arrays have {len(shape)} axes", expected="one: a value for every motion")
        for name, column in columns.items():
            if not np.isfinite(column).all():
                raise InputError(f"{name} is not finite", expected="a finite number for every motion")
        if shape == (0,):
            raise InputError("there are no initial values", expected="one motion or more")
        arrays = [np.array(x, ndmin=1) for x in columns.values()]
        positions = dict(zip(position, arrays, strict=False))
        velocities = dict(zip(velocity, arrays[len(position) :], strict=True))
        return cls(mechanism, positions, velocities, *(shape or (1,)))

    def of_one(self, number: int) -> dict[str, dict[str, str]]:
        """Return the initial values of one motion, as a scenario's ``initial`` has them."""
        parts = {"position": (self.position, ""), "velocity": (self.velocity, "/s")}
        return {
            what: {name: f"{float(x[number])!r} {self.mechanism.joints[name].unit}{per}" for name, x in values.items()}
            for what, (values, per) in parts.items()
        }

    def columns(self, quantities: Quantities) -> list[Series]:
        """Return the values as columns of a table; the quantities have their units."""
        values = {f"joint.{name}.position": x for name, x in self.position.items()}
        values |= {f"joint.{name}.velocity": x for name, x in self.velocity.items()}
        return [Series(f"start {name}", quantities[name].unit, x) for name, x in values.items()]


@dataclass(frozen=True, eq=False)
class Question:
    """A scenario of kind ``forward``, prepared for many initial states.

    Attributes:
        scenario: The scenario.
        problem: The question about the mechanism that is solved.
        hybrid: The equations that are integrated.
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
            said = f"the scenario '{scenario.name}' looks for numbers, or for the setting that reaches an error"
            raise InputError(said, expected="neither find nor accuracy.target", hint="accuracy.tolerance")
        place = partial(scenario.document.locating, "problem")
        return cls(scenario, problem, problem.prepare(scenario.simplification.solved, content.accuracy, place))

    def giving(self, position: Collection[str], velocity: Collection[str]) -> Question:
        """Return the question where positions and velocities of these joints are given: they stay if loops allow it."""
        joints, initial = self.scenario.simplification.solved.joints, self.hybrid.initial
        positions = tuple(dict.fromkeys([*initial.positions, *(joints[name].v for name in position)]))
        velocities = tuple(dict.fromkeys([*initial.velocities, *(joints[name].v for name in velocity)]))
        return replace(self, hybrid=self.hybrid.beginning(replace(initial, positions=positions, velocities=velocities)))

    def begin(self, starts: Starts) -> tuple[Array, Array, Array]:
        """Return initial states, assembled, of shapes (b, nq) and (b, nv), and the velocities that were given.

        Raises:
            InputError: One contradicts itself, the laws, or a stop.
            DynamicsError: Masses do not determine the accelerations there.
        """
        wanted = starts.position, starts.velocity, starts.size
        given = [*self.problem.initial_states(starts.mechanism, self.hybrid.prescribed, *wanted)]
        q, v = (np.array(x) for x in zip(*map(self.hybrid.begin, given), strict=True))
        self.hybrid.require_masses(q)
        return q, v, np.array([initial.given_rates() for initial in given])


@dataclass(frozen=True, eq=False)
class Block:
    """Motions from b initial states, at n instants; they are solved when something is asked of them.

    Attributes:
        question: The scenario.
        q: Configurations at the start, assembled, shape (b, nq).
        v: Velocities there, shape (b, nv).
        given: The velocities that were given; see ``Initial.given_rates``.
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
        """The instants [s], shape (n,)."""
        return self.question.problem.time.instants()

    @cached_property
    def ensemble(self) -> Ensemble | None:
        """The motions, as far as no load begins another segment; ``None`` where each is taken alone."""
        with np.errstate(all="ignore"):  # what is not finite is found in the results, and said in words
            return integrate_together(self.question.hybrid, self.q, self.v)

    @cached_property
    def whole(self) -> Ensemble | None:
        """The motions where they are integrated together from end to end; none may have to be followed finer."""
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
        """Why motions could not be followed to their end, by their number."""
        if self.whole is not None:
            return self.whole.failures
        solved = ((number, self._solved(number)) for number in range(len(self)))
        return {number: error.message for number, error in solved if isinstance(error, NumericsError)}

    @cached_property
    def reached(self) -> Flags:
        """Which motions have come to which instants, shape (b, n)."""
        if self.whole is not None:
            return self.whole.reached(self.t)
        reached = np.zeros((len(self), len(self.t)), dtype=bool)
        for number in range(len(self)):
            if (outcome := self._outcome(number)) is not None:
                reached[number, _rows(outcome.rows.grid.t, self.t)[1]] = True
        return reached

    def values(self, names: Sequence[str]) -> Array:
        """Return quantities, shape (k, b, n), not a number beyond the end of a motion.

        Raises:
            InputError: One depends on how several frictions at rest share a load; see ``Quantities.determined``.
        """
        values = np.full((len(names), len(self), len(self.t)), np.nan)
        scenario = self.question.scenario
        for motion, instant, run, rows in self._tables():
            restored = scenario.simplification.restored_rows(run)
            quantities = Quantities(restored, scenario.symbols, scenario.content.undetermined)
            with np.errstate(all="ignore"):
                for k, name in enumerate(names):
                    values[k, motion, instant] = quantities.determined(name).values[rows]
        return values

    def states(self) -> tuple[Array, Array]:
        """Return q, shape (b, n, nq), and v, shape (b, n, nv), of the whole mechanism; not a number beyond an end."""
        if self.whole is not None:
            q, v = self.question.hybrid.system().whole(self.t, *self.whole.states(self.t))
        else:
            q, v = (np.full((len(self), len(self.t), x.shape[1]), np.nan) for x in (self.q, self.v))
            for motion, instant, run, rows in self._tables():
                q[motion, instant], v[motion, instant] = run.q[rows], run.v[rows]
        return self.question.scenario.simplification.spread(q, v)

    def _tables(self) -> Iterator[tuple[Indices, Indices, Trajectory, Indices]]:
        """Yield motions, the instants that they have come to, trajectories, and their rows there."""
        question = self.question
        mechanism = question.scenario.simplification.solved
        lossy = any(drive.efficiency < 1.0 for drive in question.scenario.mechanism.drives.values())
        if self.whole is not None and not lossy:  # whether a motor drives, its own motion tells at standstill
            table = BatchTable.of(question.problem, mechanism, question.hybrid, self.whole)
            yield table.motion, table.instant, table.run, np.arange(len(table.motion))
            return
        for number in range(len(self)):
            if (outcome := self._outcome(number)) is not None:
                rows, instant = _rows(outcome.rows.grid.t, self.t)
                yield np.full(len(rows), number), instant, outcome.rows, rows

    def _outcome(self, number: int) -> Outcome | None:
        """Return as much of one motion as there is."""
        solved = self._solved(number)
        outcome = solved.partial if isinstance(solved, NumericsError) else solved
        return outcome if isinstance(outcome, Outcome) else None

    def _solved(self, number: int) -> Outcome | NumericsError:
        """Return one motion, or why there is none."""
        if number not in self._followed:
            question, start = self.question, (self.q[number], self.v[number], self.given[number])
            solved = question.scenario.simplification.solved
            try:
                self._followed[number] = question.problem.solve_from(solved, question.hybrid, *start)
            except Interrupted:
                raise
            except NumericsError as error:
                self._followed[number] = error.with_traceback(None)  # whose frames hold this block
        return self._followed[number]


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

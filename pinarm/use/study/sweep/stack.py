"""Cases of a sweep that differ by numbers of the model only, solved together as one array.

The first case is solved as any other: its motion is that of all, its checks of names and units hold for all. Masses,
inertias and placements of the others are arrays over the cases, and so are efforts, quantities and measured figures, by
the same functions. The last case of the first stack is solved alone too, and compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.checks.balance import power_balance
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.mechanism_variants import mechanism_variants, require_joint_forces
from pinarm.engine.motion.prescribed_motion import PrescribedMotion
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import PinarmError
from pinarm.input.units import unit
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.use.scenario.failures import failures_in_words
from pinarm.use.study.sweep.axes import Value
from pinarm.use.study.sweep.cases import WORTH, Row, Task, solved_case

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result

NUMBERS = 200_000
"""Numbers of one array over the cases of a stack, at most: larger ones leave the caches of processors."""

AGREED = 1e-10
"""Difference of a case solved with others from the same alone, relative to the largest of its numbers, from which on
none of them is trusted."""

ARGUMENT = "arguments."


Kind = tuple[tuple[str, Value], ...] | None
"""What cases have in common that may be solved together; ``None`` of one that varies no argument."""


def kind_of(values: Mapping[str, Value]) -> Kind:
    """Return the kind of a case: its values but for those of arguments."""
    varied = any(path.startswith(ARGUMENT) for path in values)
    kept = ((path, "" if path.startswith(ARGUMENT) else value) for path, value in values.items())
    return tuple(kept) if varied else None


@dataclass(frozen=True, eq=False)
class Stack:
    """What is the same in cases that are solved together.

    Attributes:
        task: The sweep.
        values: The values of the first case.
        first: Its result, solved alone.
        files: The files that cases refer to.
        motion: The motion of all of them.
    """

    task: Task
    values: Mapping[str, Value]
    first: Result
    files: tuple[str, ...]
    motion: PrescribedMotion

    @classmethod
    def begin(cls, task: Task, values: Mapping[str, Value]) -> tuple[Stack | None, Row]:
        """Solve a first case alone, and return what others need of it, ``None`` for nothing; and its row."""
        solved = solved_case(task, values)
        if solved.result is None or any(entry.number for entry in task.wanted):
            return None, solved.row
        result, motion = solved.result, solved.result.outcome.motion
        if not isinstance(motion, PrescribedMotion) or _is_special(result, motion):
            return None, solved.row
        return cls(task, values, result, solved.row.files, motion), solved.row

    @property
    def most(self) -> int:
        """Number of cases whose arrays are of a size that suits processors."""
        run = self.first.trajectory
        return max(1, NUMBERS // (len(run) * int(run.mechanism.model.njoints) * 6))

    def rows(self, cases: Sequence[Mapping[str, Value]]) -> list[Row | None]:
        """Return the rows of cases; ``None`` of those that are to be solved alone.

        What one of them raises costs the others time only, and is told when it is solved alone.
        """
        try:
            with failures_in_words():
                return self.together(cases)
        except Exception:
            half = len(cases) // 2
            return [*self.rows(cases[:half]), *self.rows(cases[half:])] if half else [None] * len(cases)

    def together(self, cases: Sequence[Mapping[str, Value]]) -> list[Row | None]:
        """Return the same where nothing is raised.

        Raises:
            VariantsDiffer: The cases differ in more than numbers of the model.
            PinarmError: A file may not be read any more, or something cannot be computed in one of them.
        """
        scenario = self.first.scenario
        given = {name: scenario.mechanism.arguments[name] for name in scenario.content.arguments}
        columns = {
            path.removeprefix(ARGUMENT): _column(value, [case[path] for case in (self.values, *cases)])
            for path, value in self.values.items() if path.startswith(ARGUMENT)
        }  # fmt: skip
        mechanism, possible = mechanism_variants(scenario.mechanism, given, columns)
        numbers, finite = self._numbers(mechanism, len(possible))
        rows = zip(numbers[1:].tolist(), (possible & finite)[1:].tolist(), strict=True)
        return [Row(tuple(number + 0.0 for number in row), "", self.files) if kept else None for row, kept in rows]

    def _numbers(self, mechanism: Mechanism, count: int) -> tuple[Array, Flags]:
        """Return results and measures of accuracy, shape (k, columns), and which cases are finite."""
        scenario, run = self.first.scenario, self._run(mechanism)
        quantities = Quantities(run, scenario.symbols, scenario.content.undetermined)
        outputs = [quantities[name].values for name in scenario.content.outputs]
        wanted = [quantities[entry.quantity].values for entry in self.task.wanted]
        finite = np.ones(count, dtype=bool)
        for values in (*outputs, *wanted):
            finite &= np.isfinite(values).all(axis=0)
        figures = {**power_balance(run), **residual_figures(run), **quantities.figures()}
        if figures.keys() != self.first.figures.keys():
            raise VariantsDiffer("which figures can be measured")
        for figure in figures.values():
            finite &= np.isfinite(figure)
        extremes = [extreme for values in wanted for extreme in (values.min(axis=0), values.max(axis=0))]
        columns = [*extremes, *(figures.get(name, np.nan) for name in WORTH)]
        return np.stack([np.broadcast_to(column, count) for column in columns], axis=1), finite

    def _run(self, mechanism: Mechanism) -> Trajectory:
        """Return the states of all cases, with the efforts that the motion takes in each."""
        run, variants = self.first.trajectory, mechanism.model
        forces = self.motion.prescription.dynamics.forces
        require_joint_forces(forces)
        dynamics, closure = Dynamics.of_variants(variants, forces), Closure.of(variants)
        q, v, a = (x[:, None] for x in (run.q, run.v, run.a))
        lam = Multipliers.known(np.zeros((len(q), 1, 0)), 0)
        states = replace(run, mechanism=mechanism, q=q, v=v, a=a, tau=np.zeros_like(v), lam=lam, closure=closure,
                         dynamics=dynamics)  # fmt: skip
        prescription = replace(self.motion.prescription, mechanism=mechanism, dynamics=dynamics)
        return prescription.solved(states, self.motion.pace)

    def agrees(self, values: Mapping[str, Value], alone: Row) -> bool | None:
        """Tell whether a case has the same numbers here as alone; ``None`` where it has none here.

        Raises:
            VariantsDiffer: No cases of its kind have.
        """
        try:
            with failures_in_words():
                (row,) = self.together([values])
        except PinarmError:
            return None
        if row is None or alone.error:
            return None if row is None else False
        own, other = np.array(row.numbers), np.array(alone.numbers)
        size = np.nanmax(np.abs(other), initial=0.0)
        return bool((np.isnan(own) == np.isnan(other)).all() and np.nanmax(np.abs(own - other)) <= AGREED * size)


def _is_special(result: Result, motion: PrescribedMotion) -> bool:
    """Whether more is told of a case, or less is solved, than the states along its motion."""
    asks = result.content.find or result.content.accuracy.target is not None
    told = result.outcome.figures or result.trajectory.columns
    return bool(asks or told or motion.prescription.mechanism is not result.scenario.mechanism)


def _column(first: Value, values: Sequence[Value]) -> list[float]:
    """Return the values of an argument [SI], given as a scenario has them.

    Raises:
        VariantsDiffer: They are not all numbers with the unit of the first.
    """
    if not isinstance(first, str):
        if any(isinstance(value, str | bool) for value in values):
            raise VariantsDiffer("numbers with and without a unit")
        return [float(value) for value in values]
    measured = first.partition(" ")[2]
    factor, size = unit(measured).factor if measured else 1.0, len(measured) + 1 if measured else 0
    texts = [value for value in values if isinstance(value, str) and value.partition(" ")[2] == measured]
    if len(texts) < len(values):
        raise VariantsDiffer("several units")
    try:
        return [float(text[: len(text) - size]) * factor for text in texts]
    except ValueError:
        raise VariantsDiffer("values that are no plain numbers") from None

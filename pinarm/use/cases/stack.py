"""Cases that differ by numbers of the model only, solved together as one array.

The first case is solved as any other: its motion is that of all, its checks of names and units hold for all. Masses,
inertias and placements of the others are arrays over the cases, and so are efforts, quantities and measured figures, by
the same functions. The last case of the first stack is solved alone too, and compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.checks.balance import power_balance
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.checks.sample import sampled
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.mechanism_variants import mechanism_variants, require_joint_forces, some_variants
from pinarm.engine.motion.prescribed_motion import PrescribedMotion
from pinarm.engine.motion.prescribed_variants import prescribed_variants
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import PinarmError
from pinarm.input.units import unit
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.use.cases.case import WORTH, Case, Row, Task, Value, solved_case
from pinarm.use.cases.variant_rows import VariantRows
from pinarm.use.result.failures import failures_in_words

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result

NUMBERS = 400_000
"""Numbers of one array over the cases of a stack, at most: larger ones leave the caches of processors."""

EXPANDED = 1000
"""Cases whose model is expanded at once: to read it for one takes as long as for many."""

JUDGED = 4
"""Rows of each case at which it is looked which components of reactions rigid bodies determine: that belongs to the
structure. The first case is looked at as any other."""

AGREED = 1e-10
"""Difference of a case solved with others from the same alone, relative to the largest of its numbers, from which on
none of them is trusted."""

ARGUMENT = "arguments."


Attempt = Callable[[Callable[[Sequence[Any]], "list[Row | None]"], Sequence[Any]], "list[Row | None]"]
"""Returns what a function says of cases, and what is told of those for which it raises something."""

Kind = tuple[tuple[str, Value], ...] | None
"""What cases have in common that may be solved together; ``None`` of one that varies no argument."""


def kind_of(values: Case) -> Kind:
    """Return the kind of a case: its values but for those of arguments."""
    varied = any(path.startswith(ARGUMENT) for path in values)
    kept = ((path, "" if path.startswith(ARGUMENT) else value) for path, value in values.items())
    return tuple(kept) if varied else None


def of_kind(anchor: Case, values: Case) -> Case | None:
    """Return the arguments of one case with all else of another; ``None`` where it has not the same ones."""
    if {path for path in anchor if path.startswith(ARGUMENT)} != {path for path in values if path.startswith(ARGUMENT)}:
        return None
    return {path: anchor[path] if path.startswith(ARGUMENT) else value for path, value in values.items()}


@dataclass(frozen=True, eq=False)
class Stack:
    """What is the same in cases that are solved together.

    Attributes:
        task: What is the same in all cases.
        values: The values of the first case.
        first: Its result, solved alone.
        files: The files that cases refer to.
        motion: The motion of all of them.
    """

    task: Task
    values: Case
    first: Result
    files: tuple[str, ...]
    motion: PrescribedMotion

    @classmethod
    def begin(cls, task: Task, values: Case) -> tuple[Stack | None, Row]:
        """Solve a first case alone, and return what others need of it, ``None`` for nothing; and its row."""
        solved = solved_case(task, values)
        if solved.result is None:
            return None, solved.row
        result, motion = solved.result, solved.result.outcome.motion
        known = all(entry.known_of_variants(result) for entry in task.wanted)
        if not known or not isinstance(motion, PrescribedMotion) or _is_special(result, motion):
            return None, solved.row
        return cls(task, values, result, solved.row.files, motion), solved.row

    @property
    def follows(self) -> bool:
        """Whether loops of the others are closed from the first case."""
        return bool(self.first.trajectory.mechanism.closure.size)

    @property
    def most(self) -> int:
        """Number of cases that are solved together, whose model is expanded at once."""
        return EXPANDED

    @property
    def block(self) -> int:
        """Number of cases whose arrays are of a size that suits processors."""
        run = self.first.trajectory
        return max(1, NUMBERS // (len(run) * int(run.mechanism.model.njoints) * 6))

    def rows(self, cases: Sequence[Case]) -> list[Row | None]:
        """Return the rows of cases; ``None`` of those that are to be solved alone.

        What one of them raises costs the others time only, and is told when it is solved alone.
        """
        return _tried(lambda some: self._by_blocks(some, _tried), cases)

    def together(self, cases: Sequence[Case]) -> list[Row | None]:
        """Return the same where nothing is raised.

        Raises:
            VariantsDiffer: The cases differ in more than numbers of the model.
            PinarmError: A file may not be read any more, or something cannot be computed in one of them.
        """
        return self._by_blocks(cases, lambda solve, places: solve(places))

    def _by_blocks(self, cases: Sequence[Case], attempt: Attempt) -> list[Row | None]:
        """Return the rows of cases whose model is expanded at once."""
        scenario = self.first.scenario
        given = {name: scenario.mechanism.arguments[name] for name in scenario.content.arguments}
        columns = {
            path.removeprefix(ARGUMENT): _column(value, [case[path] for case in (self.values, *cases)])
            for path, value in self.values.items() if path.startswith(ARGUMENT)
        }  # fmt: skip
        mechanism, possible = mechanism_variants(scenario.mechanism, given, columns)
        require_joint_forces(self.motion.prescription.dynamics.forces)

        def solve(places: Sequence[int]) -> list[Row | None]:
            chosen = np.array([0, *places])  # the first case is the one that the others are followed from
            numbers, finite = self._numbers(some_variants(mechanism, chosen), len(chosen))
            kept = (possible[chosen] & finite)[1:].tolist()
            rows = zip((numbers[1:] + 0.0).tolist(), kept, strict=True)  # -0 becomes 0
            return [Row(tuple(row), "", self.files) if known else None for row, known in rows]

        every, size = range(1, len(cases) + 1), self.block
        blocks = (every[start : start + size] for start in range(0, len(every), size))
        return [row for places in blocks for row in attempt(solve, places)]

    def _numbers(self, mechanism: Mechanism, count: int) -> tuple[Array, Flags]:
        """Return results and measures of accuracy, shape (k, columns), and which cases are finite."""
        scenario = self.first.scenario
        run, sound = prescribed_variants(self.motion, self.first.trajectory, mechanism)
        judged = Quantities(run.some(sampled(len(run), JUDGED)), scenario.symbols, scenario.content.undetermined)
        quantities, finite = judged.of(run), sound.copy()
        outputs = [quantities[name].values for name in scenario.content.outputs]

        def between(places: Indices, grid: Grid) -> tuple[Quantities, Flags]:
            more, kept = prescribed_variants(self.motion, self.motion.at(grid), some_variants(mechanism, places))
            return judged.of(more), kept

        rows = VariantRows(quantities, between)
        wanted = [numbers for entry in self.task.wanted for numbers in entry.of_variants(rows)]
        for values in (*outputs, *(numbers[None] for numbers in wanted)):
            finite &= np.isfinite(values).all(axis=0)
        figures = {**power_balance(run), **residual_figures(run), **quantities.figures()}
        if figures.keys() != self.first.figures.keys():
            raise VariantsDiffer("which figures can be measured")
        for figure in figures.values():
            finite &= np.isfinite(figure)
        columns = [*wanted, *(figures.get(name, np.nan) for name in WORTH)]
        return np.stack([np.broadcast_to(column, count) for column in columns], axis=1), finite

    def agrees(self, values: Case, alone: Row) -> bool | None:
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


def _tried(solve: Callable[[Sequence[Any]], list[Row | None]], cases: Sequence[Any]) -> list[Row | None]:
    """Return the rows of cases; of those for which something is raised ``None``, the others without them."""
    try:
        with failures_in_words():
            return solve(cases)
    except Exception:
        half = len(cases) // 2
        return [*_tried(solve, cases[:half]), *_tried(solve, cases[half:])] if half else [None] * len(cases)


def _is_special(result: Result, motion: PrescribedMotion) -> bool:
    """Whether more is told of a case, or less is solved, than the states along its motion."""
    asks = result.content.find or result.content.accuracy.target is not None
    told = result.outcome.figures or result.trajectory.columns
    other = motion.prescription.mechanism is not result.scenario.mechanism
    chosen = not isinstance(motion.prescription.motion, DeterminedMotion)
    return bool(asks or told or other or chosen)


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

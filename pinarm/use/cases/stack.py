"""Cases that differ by numbers of the model or of laws, solved together as one array.

The first case is solved as any other: its checks of names and units hold for all. Masses, inertias and placements of
the others are arrays over the cases, and so are positions, efforts, quantities and measured figures, by the same
functions; laws are read case by case. The last case of the first stack is solved alone too, and compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.checks.balance import power_balance
from pinarm.engine.checks.figures import sampled
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.mechanism import alike_variants, mechanism_variants, require_joint_forces, some_variants
from pinarm.engine.motion.prescribed_motion import PrescribedMotion, PrescribedTable
from pinarm.engine.motion.variants import PrescribedVariants, follows_alike
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import PinarmError
from pinarm.input.yaml.document import varied
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.use.cases.case import QUADRATURE, WORTH, Case, Row, Task, solved_case
from pinarm.use.cases.case_table import ARGUMENT, CaseTable, RowTable, moving, number_of, numbers_of
from pinarm.use.cases.variant_numbers import VariantNumbers
from pinarm.use.result.failures import failures_in_words
from pinarm.use.result.measures import COSTS

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.use.result.result import Result

NUMBERS = 800_000
"""Most numbers of one array over the cases of a stack: larger ones leave the caches of processors."""

EXPANDED = 10_000
"""Cases whose model is expanded at once: to read it for one takes as long as for many."""

JUDGED = 4
"""Rows of each case at which it is looked which components of reactions rigid bodies determine: that belongs to the
structure. The first case is looked at as any other."""

AGREED = 1e-10
"""Least difference of a case solved with others from the same alone, relative to the largest of its numbers, that makes
all of them be solved alone."""

Numbers = list[tuple[Indices, Array]]
"""Places of cases that can be solved, and their rows of numbers, block by block."""


@dataclass(frozen=True, eq=False)
class Stack:
    """The first of the cases that are solved together.

    Attributes:
        task: What is the same in all cases.
        values: The values of the first case.
        first: Its result, solved alone.
        motion: Its motion.
        files: The files that cases refer to.
    """

    task: Task
    values: Case
    first: Result
    motion: PrescribedMotion
    files: tuple[str, ...]

    @classmethod
    def begin(cls, task: Task, values: Case) -> tuple[Stack | None, Row]:
        """Solve a first case alone; return its stack, ``None`` where others cannot be solved with it, and its row."""
        row, result = solved_case(task, values)
        if row.error or result is None or any(entry.alone for entry in task.wanted):
            return None, row
        content, outcome = result.content, result.outcome
        asks = content.find or content.accuracy.target is not None or result.trajectory.columns or outcome.figures
        if asks or not isinstance(outcome.motion, PrescribedMotion):
            return None, row
        prescription = outcome.motion.prescription
        whole = prescription.mechanism is result.scenario.mechanism
        if not whole or not isinstance(prescription.motion, DeterminedMotion):
            return None, row
        return cls(task, values, result, outcome.motion, row.files), row

    @property
    def follows(self) -> bool:
        """Whether loops of the others are closed from the first case."""
        return bool(self.first.trajectory.mechanism.closure.size)

    @cached_property
    def _table(self) -> PrescribedTable:
        """The laws and rows of the first case."""
        return PrescribedTable(self.motion.prescription, self.first.trajectory.grid, self.motion.start)

    def block_of(self, rows: int) -> int:
        """Return the number of cases with so many rows whose arrays are of a size that suits processors."""
        return max(1, NUMBERS // (rows * int(self.first.trajectory.mechanism.model.njoints) * 6))

    def rows(self, cases: CaseTable) -> tuple[Indices, RowTable]:
        """Return the places of the cases that can be solved so, and their rows; the others are to be solved alone.

        What one of them raises costs the others time only, and is told when it is solved alone.
        """
        parts = _tried(partial(self._solved, cases), np.arange(len(cases)))
        if not parts:
            return np.zeros(0, np.intp), RowTable(np.zeros((0, 0)), self.files)
        places, numbers = zip(*parts, strict=True)
        return np.concatenate(places), RowTable(np.concatenate(numbers), self.files)

    def _solved(self, cases: CaseTable, places: Indices) -> Numbers:
        """Return the numbers of some of the cases, whose model is expanded at once.

        Raises:
            VariantsDiffer: The cases differ in more than numbers of the model.
            PinarmError: A file may not be read any more, or something cannot be computed in one of them.
        """
        some = cases.some(places)
        mechanism, possible = self._mechanism(some)
        require_joint_forces(self.motion.prescription.dynamics.forces)
        size, parts = self.block_of(len(self.first.trajectory)), []
        for start in range(0, len(some), size):
            tables = self._followed(some, range(1 + start, 1 + min(start + size, len(some))))
            chosen = np.array([*tables])  # the first case is the one that the others are compared with
            numbers, finite = self._numbers(some_variants(mechanism, chosen), [*tables.values()])
            sound = possible[chosen] & finite & (chosen > 0)
            parts.append((places[chosen[sound] - 1], numbers[sound] + 0.0))  # -0 becomes 0
        return parts

    def _mechanism(self, cases: CaseTable) -> tuple[Mechanism, Flags]:
        """Return the mechanism in the first case and in others, and which of them can be followed so."""
        scenario = self.first.scenario
        known = {
            name: argument.given if argument.word is not None else scenario.mechanism.arguments[name]
            for name, argument in scenario.content.arguments.items()
        }
        numbers = dict[str, Array]()
        for column in cases.columns:
            if column.path.startswith(ARGUMENT):
                first = self.values[column.path]
                both = np.append(number_of(first, first), numbers_of(column, first))
                numbers[column.path.removeprefix(ARGUMENT)] = both
        if numbers:
            return mechanism_variants(scenario.mechanism, known, numbers)
        return alike_variants(scenario.mechanism, 1 + len(cases)), np.ones(1 + len(cases), dtype=bool)

    def _followed(self, cases: CaseTable, variants: range) -> dict[int, PrescribedTable]:
        """Return the laws and rows of the first case and of some others, by their place among the variants.

        Those that fail, or have other rows, are left out: what is wrong with them is told where they are solved alone.
        """
        columns, tables = moving(cases), {0: self._table}
        if not columns:
            return tables | dict.fromkeys(variants, self._table)
        scenario = self.first.scenario
        for variant in variants:
            with suppress(PinarmError):
                document = varied(scenario.document, {column.path: column.at(variant - 1) for column in columns})
                table = scenario.with_document(document).prescribed_table(scenario)
                if table is not None and follows_alike(table, self._table):
                    tables[variant] = table
        return tables

    def _numbers(self, mechanism: Mechanism, tables: Sequence[PrescribedTable]) -> tuple[Array, Flags]:
        """Return results and measures of accuracy, shape (k, columns), and which cases are finite."""
        scenario, count = self.first.scenario, len(tables)
        variants = PrescribedVariants(self.motion, self.first.trajectory, mechanism, tables)
        run, sound = variants.rows()
        judged = Quantities(run.some(sampled(len(run), JUDGED)), scenario.symbols, scenario.content.undetermined)
        quantities, finite = judged.of(run), sound.copy()
        numbers, quadrature, sound = VariantNumbers(variants, run, quantities, self.block_of).told(
            self.task.wanted, finite
        )
        for values in (*(quantities[name].values for name in scenario.content.outputs), *numbers):
            finite &= np.isfinite(values).all(axis=0) if values.ndim > 1 else np.isfinite(values)
        figures = self._figures(run, quantities, finite) if self.task.measured else {}
        figures[QUADRATURE] = quadrature
        columns = [*numbers, *(figures.get(name, np.nan) for name in WORTH)]
        return np.stack([np.broadcast_to(column, count) for column in columns], axis=1), finite & sound

    def _figures(self, run: Trajectory, quantities: Quantities, finite: Flags) -> dict[str, Array]:
        """Return the measures of accuracy of variants, each of shape (k,) or (1,), and note which are finite.

        Raises:
            VariantsDiffer: They are not those of the first case.
        """
        figures = {**power_balance(run), **residual_figures(run), **quantities.figures()}
        for figure in figures.values():
            finite &= np.isfinite(figure)
        if {name for name, figure in figures.items() if not np.isnan(figure.flat[0])} != (
            self.first.figures.keys() - COSTS
        ):
            raise VariantsDiffer("which figures can be measured")
        return figures

    def agrees(self, values: Case, alone: Row) -> bool | None:
        """Tell whether a case has the same numbers here as alone; ``None`` where it has none here.

        Raises:
            VariantsDiffer: No cases of its kind have.
        """
        try:
            with failures_in_words():
                ((places, numbers),) = self._solved(CaseTable.of([values]), np.arange(1))
        except PinarmError:
            return None
        if not len(places) or alone.error:
            return False if len(places) else None
        here, there = numbers[0], np.array(alone.numbers)
        size, apart = (np.nanmax(np.abs(x), initial=0.0) for x in (there, here - there))
        return bool((np.isnan(here) == np.isnan(there)).all() and apart <= AGREED * size)


def _tried(solve: Callable[[Indices], Numbers], cases: Indices) -> Numbers:
    """Return the numbers of cases, without those for which something is raised."""
    try:
        with failures_in_words():
            return solve(cases)
    except Exception:
        half = len(cases) // 2
        return [*_tried(solve, cases[:half]), *_tried(solve, cases[half:])] if half else []

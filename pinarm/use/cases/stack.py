"""Cases that differ by numbers of the model or of laws, solved together as one array.

The first case is solved as any other: its checks of names and units hold for all. Masses, inertias and placements of
the others are arrays over the cases, and so are positions, efforts, quantities and measured figures, by the same
functions; laws are read case by case. The last case of the first stack is solved alone too, and
compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.checks.balance import power_balance
from pinarm.engine.checks.figures import sampled
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.mechanism import (
    alike_variants,
    mechanism_variants,
    require_joint_forces,
    some_variants,
)
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
    from pinarm.mechanics.forces.force_element import ForceElement
    from pinarm.use.result.result import Result

NUMBERS = 800_000
"""Numbers of one array over the cases of a stack, at most: larger ones leave the caches of processors."""

EXPANDED = 10_000
"""Cases whose model is expanded at once: to read it for one takes as long as for many."""

JUDGED = 4
"""Rows of each case at which it is looked which components of reactions rigid bodies determine: that belongs to the
structure. The first case is looked at as any other."""

AGREED = 1e-10
"""Difference of a case solved with others from the same alone, relative to the largest of its numbers, from which on
none of them is trusted."""

Solve = Callable[[Indices], "list[tuple[Indices, Array]]"]
"""Cases -> those of them that can be solved, and their rows of numbers, block by block."""

Attempt = Callable[[Solve, Indices], "list[tuple[Indices, Array]]"]
"""Returns what a function says of cases, and what is told of those for which it raises something."""


@dataclass(frozen=True, eq=False)
class PrescribedCases:
    """Cases whose laws and rows are those of the first, or each their own.

    Attributes:
        result: The first case.
        motion: Its motion.
    """

    result: Result
    motion: PrescribedMotion

    @classmethod
    def of(cls, result: Result) -> PrescribedCases | None:
        """Return the cases of a first one; ``None`` where more is told of it, or less is solved, than its states."""
        motion = result.outcome.motion
        if not isinstance(motion, PrescribedMotion) or result.outcome.figures:
            return None
        whole = motion.prescription.mechanism is result.scenario.mechanism
        return cls(result, motion) if whole and isinstance(motion.prescription.motion, DeterminedMotion) else None

    @property
    def forces(self) -> Mapping[str, ForceElement]:
        """The force elements of all cases."""
        return self.motion.prescription.dynamics.forces

    @property
    def length(self) -> int:
        """Number of rows."""
        return len(self.result.trajectory)

    @cached_property
    def first(self) -> PrescribedTable:
        """What the first case follows."""
        return PrescribedTable(self.motion.prescription, self.result.trajectory.grid, self.motion.start)

    def read(self, values: Case, mechanism: Mechanism, place: int) -> PrescribedTable | None:
        """Return what a case follows, ``None`` where its rows are others; the same object where it is the first's."""
        if not values:
            return self.first
        scenario = self.result.scenario
        table = scenario.with_document(varied(scenario.document, values)).prescribed_table(scenario)
        return table if table is not None and follows_alike(table, self.first) else None

    def variants(self, mechanism: Mechanism, motions: Sequence[PrescribedTable]) -> PrescribedVariants:
        """Return the motions of variants."""
        return PrescribedVariants(self.motion, self.result.trajectory, mechanism, motions)


@dataclass(frozen=True, eq=False)
class Stack:
    """What is the same in cases that are solved together.

    Attributes:
        task: What is the same in all cases.
        values: The values of the first case.
        first: Its result, solved alone.
        files: The files that cases refer to.
        motions: How all of them move.
    """

    task: Task
    values: Case
    first: Result
    files: tuple[str, ...]
    motions: PrescribedCases

    @classmethod
    def begin(cls, task: Task, values: Case) -> tuple[Stack | None, Row]:
        """Solve a first case alone, and return what others need of it, ``None`` for nothing; and its row."""
        row, result = solved_case(task, values)
        if row.error or result is None or any(entry.alone for entry in task.wanted):
            return None, row
        asks = result.content.find or result.content.accuracy.target is not None or result.trajectory.columns
        motions = None if asks else PrescribedCases.of(result)
        return (cls(task, values, result, row.files, motions) if motions else None), row

    @property
    def follows(self) -> bool:
        """Whether loops of the others are closed from the first case."""
        return bool(self.first.trajectory.mechanism.closure.size)

    def block_of(self, rows: int) -> int:
        """Return the number of cases with so many rows whose arrays are of a size that suits processors."""
        return max(1, NUMBERS // (rows * int(self.first.trajectory.mechanism.model.njoints) * 6))

    def rows(self, cases: CaseTable) -> tuple[Indices, RowTable]:
        """Return the places of the cases that can be solved so, and their rows; the others are to be solved alone.

        What one of them raises costs the others time only, and is told when it is solved alone.
        """
        return self._joined(_tried(lambda places: self._by_blocks(cases, places, _tried), np.arange(len(cases))))

    def together(self, cases: CaseTable) -> tuple[Indices, RowTable]:
        """Return the same where nothing is raised.

        Raises:
            VariantsDiffer: The cases differ in more than numbers of the model.
            PinarmError: A file may not be read any more, or something cannot be computed in one of them.
        """
        return self._joined(self._by_blocks(cases, np.arange(len(cases)), lambda solve, places: solve(places)))

    def _joined(self, blocks: Sequence[tuple[Indices, Array]]) -> tuple[Indices, RowTable]:
        places, numbers = zip(*blocks, strict=True) if blocks else ([np.zeros(0, np.intp)], [np.zeros((0, 0))])
        return np.concatenate(places), RowTable(np.concatenate(numbers), self.files)

    def _by_blocks(self, cases: CaseTable, places: Indices, attempt: Attempt) -> list[tuple[Indices, Array]]:
        """Return what comes of some of the cases, whose model is expanded at once."""
        some = cases.some(places)
        mechanism, possible = self._mechanism(some)
        require_joint_forces(self.motions.forces)

        def solve(variants: Indices) -> list[tuple[Indices, Array]]:
            motions = self._followed(some, mechanism, variants)
            chosen = np.array([*motions])  # the first case is the one that the others are compared with
            numbers, finite = self._numbers(some_variants(mechanism, chosen), [*motions.values()])
            sound = possible[chosen] & finite & (chosen > 0)
            return [(places[chosen[sound] - 1], numbers[sound] + 0.0)]  # -0 becomes 0

        size = self.block_of(self.motions.length)
        blocks = (1 + np.arange(start, min(start + size, len(some))) for start in range(0, len(some), size))
        return [part for variants in blocks for part in attempt(solve, variants)]

    def _mechanism(self, cases: CaseTable) -> tuple[Mechanism, Flags]:
        """Return the mechanism in the first case and in others, and which of them can be followed so."""
        scenario = self.first.scenario
        given = {
            name: own.given if own.word is not None else scenario.mechanism.arguments[name]
            for name, own in scenario.content.arguments.items()
        }
        columns = dict[str, Array]()
        for column in cases.columns:
            if column.path.startswith(ARGUMENT):
                first = self.values[column.path]
                columns[column.path.removeprefix(ARGUMENT)] = np.append(
                    number_of(first, first), numbers_of(column, first)
                )
        if columns:
            return mechanism_variants(scenario.mechanism, given, columns)
        return alike_variants(scenario.mechanism, 1 + len(cases)), np.ones(1 + len(cases), dtype=bool)

    def _followed(self, cases: CaseTable, mechanism: Mechanism, variants: Indices) -> dict[int, Any]:
        """Return how the first case and some others move, by their place among the variants; without those that fail.

        What is wrong with these is told where they are solved alone.
        """
        columns, found = moving(cases), {0: self.motions.first}
        if not columns:
            return found | dict.fromkeys(variants.tolist(), self.motions.first)
        for variant in variants.tolist():
            values = {column.path: column.at(variant - 1) for column in columns}
            with suppress(PinarmError):
                if (motion := self.motions.read(values, mechanism, variant)) is not None:
                    found[variant] = motion
        return found

    def _numbers(self, mechanism: Mechanism, motions: Sequence[Any]) -> tuple[Array, Flags]:
        """Return results and measures of accuracy, shape (k, columns), and which cases are finite."""
        scenario, count = self.first.scenario, len(motions)
        variants = self.motions.variants(mechanism, motions)
        run, sound = variants.rows()
        judged = Quantities(run.some(sampled(len(run), JUDGED)), scenario.symbols, scenario.content.undetermined)
        quantities, finite = judged.of(run), sound.copy()
        told = VariantNumbers(variants, run, quantities, self.block_of).told(self.task.wanted, finite)
        outputs = [quantities[name].values for name in scenario.content.outputs]
        for values in (*outputs, *told.numbers):
            finite &= np.isfinite(values).all(axis=0) if values.ndim > 1 else np.isfinite(values)
        figures = self._figures(variants, run, quantities, finite) if self.task.measured else {}
        figures[QUADRATURE] = told.quadrature
        columns = [*told.numbers, *(figures.get(name, np.nan) for name in WORTH)]
        return np.stack([np.broadcast_to(column, count) for column in columns], axis=1), finite & told.sound

    def _figures(self, variants: Any, run: Trajectory, quantities: Quantities, finite: Flags) -> dict[str, Array]:
        """Return the measures of accuracy of variants, each of shape (k,) or (1,), and note which are finite.

        Raises:
            VariantsDiffer: They are not those of the first case.
        """
        figures = {**power_balance(run), **residual_figures(run), **quantities.figures()}
        for figure in figures.values():
            finite &= np.isfinite(figure)
        if _known_first(figures) != self.first.figures.keys() - COSTS:
            raise VariantsDiffer("which figures can be measured")
        return figures

    def agrees(self, values: Case, alone: Row) -> bool | None:
        """Tell whether a case has the same numbers here as alone; ``None`` where it has none here.

        Raises:
            VariantsDiffer: No cases of its kind have.
        """
        try:
            with failures_in_words():
                _, rows = self.together(CaseTable.of([values]))
        except PinarmError:
            return None
        if not len(rows) or alone.error:
            return False if len(rows) else None
        own, other = rows.numbers[0], np.array(alone.numbers)
        size, apart = (np.nanmax(np.abs(x), initial=0.0) for x in (other, own - other))
        return bool((np.isnan(own) == np.isnan(other)).all() and apart <= AGREED * size)


def _known_first(figures: Mapping[str, Array]) -> set[str]:
    """Return the names of the figures that are known of the first case."""
    return {name for name, figure in figures.items() if not np.isnan(figure.flat[0])}


def _tried(solve: Solve, cases: Indices) -> list[tuple[Indices, Array]]:
    """Return what comes of cases, without those for which something is raised."""
    try:
        with failures_in_words():
            return solve(cases)
    except Exception:
        half = len(cases) // 2
        return [*_tried(solve, cases[:half]), *_tried(solve, cases[half:])] if half else []

"""Cases that differ by numbers of the model, of laws or of initial states, solved together as one array.

The first case is solved as any other: its checks of names and units hold for all. Masses, inertias and placements of
the others are arrays over the cases, and so are positions, efforts, quantities and measured figures, by the same
functions; laws and initial states are read case by case. The last case of the first stack is solved alone too, and
compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.checks.balance import power_balance
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.checks.sample import sampled
from pinarm.engine.mechanism_variants import (
    alike_variants,
    mechanism_variants,
    require_joint_forces,
    some_variants,
)
from pinarm.engine.motion.prescribed_motion import PrescribedMotion
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import PinarmError
from pinarm.input.units import unit
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.use.cases.case import QUADRATURE, WORTH, Case, Row, Task, Value, solved_case
from pinarm.use.cases.columns import ARGUMENT, moving
from pinarm.use.cases.prescribed_cases import PrescribedCases
from pinarm.use.cases.variant_numbers import MovingVariants, VariantNumbers
from pinarm.use.result.failures import failures_in_words
from pinarm.use.result.measures import COSTS
from pinarm.use.result.section_number import SectionNumber

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.mechanics.forces.force_element import ForceElement
    from pinarm.use.result.result import Result

MotionT = TypeVar("MotionT")

NUMBERS = 800_000
"""Numbers of one array over the cases of a stack, at most: larger ones leave the caches of processors."""

EXPANDED = 1000
"""Cases whose model is expanded at once: to read it for one takes as long as for many."""

JUDGED = 4
"""Rows of each case at which it is looked which components of reactions rigid bodies determine: that belongs to the
structure. The first case is looked at as any other."""

AGREED = 1e-10
"""Difference of a case solved with others from the same alone, relative to the largest of its numbers, from which on
none of them is trusted."""

Attempt = Callable[[Callable[[Sequence[Any]], "list[Row | None]"], Sequence[Any]], "list[Row | None]"]
"""Returns what a function says of cases, and what is told of those for which it raises something."""


class Motions(Protocol[MotionT]):
    """How the cases of a stack move."""

    @property
    def forces(self) -> Mapping[str, ForceElement]:
        """The force elements of all of them."""
        ...

    @property
    def length(self) -> int:
        """Number of rows of the first case, or of its steps where these are more: both are kept of many cases."""
        ...

    @property
    def first(self) -> MotionT:
        """The motion of the first case."""
        ...

    def read(self, values: Case, mechanism: Mechanism, place: int) -> MotionT | None:
        """Return how a case moves, ``None`` where it is to be solved alone.

        Args:
            values: Its values but for arguments.
            mechanism: The variants.
            place: Which of them it is.

        Raises:
            PinarmError: It has a mistake, or cannot be followed.
        """
        ...

    def variants(self, mechanism: Mechanism, motions: Sequence[MotionT]) -> MovingVariants:
        """Return the motions of variants."""
        ...

    def figures(self, motions: Sequence[MotionT]) -> dict[str, Array]:
        """Return what is measured of each motion by itself, by name, shape (k,)."""
        ...


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
    motions: Motions[Any]

    @classmethod
    def begin(cls, task: Task, values: Case) -> tuple[Stack | None, Row]:
        """Solve a first case alone, and return what others need of it, ``None`` for nothing; and its row."""
        solved = solved_case(task, values)
        if solved.result is None or any(isinstance(entry.number, SectionNumber) for entry in task.wanted):
            return None, solved.row
        result = solved.result
        asks = result.content.find or result.content.accuracy.target is not None or result.trajectory.columns
        motions = None if asks else _motions(result)
        stack = None if motions is None else cls(task, values, result, solved.row.files, motions)
        return stack, solved.row

    @property
    def follows(self) -> bool:
        """Whether loops of the others are closed from the first case."""
        return bool(self.first.trajectory.mechanism.closure.size)

    @property
    def most(self) -> int:
        """Number of cases that are solved together, whose model is expanded at once."""
        return EXPANDED

    def block_of(self, rows: int) -> int:
        """Return the number of cases with so many rows whose arrays are of a size that suits processors."""
        return max(1, NUMBERS // (rows * int(self.first.trajectory.mechanism.model.njoints) * 6))

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
        mechanism, possible = self._mechanism(cases)
        require_joint_forces(self.motions.forces)

        def solve(places: Sequence[int]) -> list[Row | None]:
            read = {place: self._read(cases[place - 1], mechanism, place) for place in places}
            motions = {0: self.motions.first} | {place: motion for place, motion in read.items() if motion is not None}
            chosen = np.array([*motions])  # the first case is the one that the others are compared with
            numbers, finite = self._numbers(some_variants(mechanism, chosen), [*motions.values()])
            rows = zip(motions, (numbers + 0.0).tolist(), (possible[chosen] & finite).tolist(), strict=True)
            found = {place: Row(tuple(row), "", self.files) for place, row, sound in rows if sound}  # -0 becomes 0
            return [found.get(place) for place in places]

        every, size = range(1, len(cases) + 1), self.block_of(self.motions.length)
        blocks = (every[start : start + size] for start in range(0, len(every), size))
        return [row for places in blocks for row in attempt(solve, places)]

    def _mechanism(self, cases: Sequence[Case]) -> tuple[Mechanism, Flags]:
        """Return the mechanism in the first case and in others, and which of them can be followed so."""
        scenario = self.first.scenario
        given = {name: scenario.mechanism.arguments[name] for name in scenario.content.arguments}
        columns = {
            path.removeprefix(ARGUMENT): _column(value, [case[path] for case in (self.values, *cases)])
            for path, value in self.values.items() if path.startswith(ARGUMENT)
        }  # fmt: skip
        if columns:
            return mechanism_variants(scenario.mechanism, given, columns)
        return alike_variants(scenario.mechanism, 1 + len(cases)), np.ones(1 + len(cases), dtype=bool)

    def _read(self, case: Case, mechanism: Mechanism, place: int) -> Any:
        """Return how a case moves; ``None`` where it is to be solved alone, and tells there what is wrong."""
        try:
            return self.motions.read(moving(case), mechanism, place)
        except PinarmError:
            return None

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
        figures = {**self.motions.figures(motions), **power_balance(run), **residual_figures(run)}
        figures |= quantities.figures()
        if figures.keys() != self.first.figures.keys() - COSTS:
            raise VariantsDiffer("which figures can be measured")
        for figure in figures.values():
            finite &= np.isfinite(figure)
        figures[QUADRATURE] = told.quadrature
        columns = [*told.numbers, *(figures.get(name, np.nan) for name in WORTH)]
        return np.stack([np.broadcast_to(column, count) for column in columns], axis=1), finite & told.sound

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


def _motions(result: Result) -> Motions[Any] | None:
    """Return how cases move that are like a first one; ``None`` where they are solved one by one."""
    if isinstance(result.outcome.motion, PrescribedMotion):
        return PrescribedCases.of(result)
    from pinarm.use.cases.forward_cases import ForwardCases

    return ForwardCases.of(result)


def _tried(solve: Callable[[Sequence[Any]], list[Row | None]], cases: Sequence[Any]) -> list[Row | None]:
    """Return the rows of cases; of those for which something is raised ``None``, the others without them."""
    try:
        with failures_in_words():
            return solve(cases)
    except Exception:
        half = len(cases) // 2
        return [*_tried(solve, cases[:half]), *_tried(solve, cases[half:])] if half else [None] * len(cases)


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
    factor, ending = unit(measured).factor if measured else 1.0, f" {measured}" if measured else ""
    texts = [value for value in values if isinstance(value, str) and value.endswith(ending)]
    if len(texts) < len(values):
        raise VariantsDiffer("several units")
    try:
        return [float(text.removesuffix(ending)) * factor for text in texts]
    except ValueError:
        raise VariantsDiffer("values that are no plain numbers") from None

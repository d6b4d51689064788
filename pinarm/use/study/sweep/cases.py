"""One case of a sweep: the scenario with other values, solved, and a few numbers of its result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import DynamicsError, InputError, Location, PinarmError
from pinarm.input.roots import file_root, note_files, noting_files
from pinarm.input.units import Unit
from pinarm.input.yaml.document import Document
from pinarm.input.yaml.values import varied
from pinarm.records import replace
from pinarm.use.result.measures import MEASURES
from pinarm.use.result.result import Result
from pinarm.use.result.run_number import EXAMPLES
from pinarm.use.result.section_number import AnyNumber, Numbered, measured, names_section, read_number
from pinarm.use.scenario.failures import failures_in_words
from pinarm.use.scenario.scenario import Scenario
from pinarm.use.study.run import run
from pinarm.use.study.sweep.axes import Value

QUADRATURE, GLOBAL_ERROR = "quadrature error", "global error"
WORTH = (*MEASURES, QUADRATURE, GLOBAL_ERROR)
"""What tells the accuracy of a case: the largest error of its figures of curves, relative to them, where there are any;
the global error where the scenario has a target for it."""


NO_SECTIONS: Mapping[str, Numbered] = MappingProxyType({})


@dataclass(frozen=True)
class Wanted:
    """What a sweep takes from the result of each case: a number of the run, or the bounds of a quantity in its rows.

    Attributes:
        quantity: A quantity, a symbol or a formula; of a number, its name.
        number: The number of the run; ``None`` for the least and the greatest value of the rows.
        unit: Of the numbers in every case; ``None`` where it is not known.
    """

    quantity: str
    number: AnyNumber | None = None
    unit: Unit | None = None

    @classmethod
    def read(cls, text: str, sections: Mapping[str, object] = NO_SECTIONS) -> Wanted:
        """Read ``QUANTITY``, or ``QUANTITY @ PLACE`` and the like; see ``read_number``.

        Args:
            text: What is wanted.
            sections: What the sections of the scenario are of, by key.

        Raises:
            InputError: It cannot be read.
        """
        if not text.strip():
            raise InputError("an empty text asks for nothing", expected=EXAMPLES).at(Location("--result"))
        if "@" not in text and not names_section(text, sections):
            return cls(text.strip())
        try:
            number = read_number(text)
        except InputError as error:
            raise error.at(Location(f"--result {text}")) from None
        return cls(number.label, number)

    def labels(self) -> tuple[str, ...]:
        """Return the names of the numbers."""
        return (self.number.label,) if self.number else (f"min {self.quantity}", f"max {self.quantity}")

    def measured(
        self, quantities: Quantities, sections: Mapping[str, Numbered] = NO_SECTIONS
    ) -> tuple[Wanted, list[Series]]:
        """Return the same with its unit, and the columns of its numbers, still empty.

        Args:
            quantities: Those of the scenario, with nothing solved.
            sections: What its sections are of, by key.

        Raises:
            InputError: There is no such quantity.
        """
        try:
            series = self.number.described(quantities, sections) if self.number else quantities[self.quantity]
        except InputError as error:
            raise error.at(Location(f"--result {self.quantity}")) from None
        columns = [replace(series, name=label, values=np.zeros(0)) for label in self.labels()]
        return replace(self, unit=series.unit), columns

    def numbers(self, result: Result) -> list[tuple[float, float]]:
        """Return the numbers [SI], each with the error of its quadrature.

        Raises:
            InputError: The place does not exist in this run, or the quantity is of another kind in this case.
            DynamicsError: A number is not finite.
        """
        quantities = result.quantities
        number = measured(self.number, result) if self.number else None
        unit = (number[0] if number else quantities[self.quantity]).unit
        if self.unit and unit and unit.dimension != self.unit.dimension:
            raise InputError(f"{self.labels()[0]} is in {unit} in this case", expected=f"{self.unit}, as in others")
        if number:
            numbers = [(float(number[0].values[0]), number[1])]
        else:
            least, greatest = quantities.bounds(self.quantity)
            numbers = [(float(least.values.min()), 0.0), (float(greatest.values.max()), 0.0)]
        if not np.isfinite(numbers).all():
            raise DynamicsError(f"{self.labels()[0]} is not finite")
        return [(number + 0.0, error) for number, error in numbers]  # -0 becomes 0


@dataclass(frozen=True)
class Row:
    """What came out of one case.

    Attributes:
        numbers: Results, then the measures of accuracy in the order of ``WORTH``; nothing where the case failed.
        error: Why it failed; empty where it did not.
        files: The files that it refers to.
        final: Whether solving it again would give the same; not so where the program itself failed.
    """

    numbers: tuple[float, ...]
    error: str = ""
    files: tuple[str, ...] = ()
    final: bool = True


@dataclass(frozen=True)
class Task:
    """What is the same in all cases of a sweep.

    Attributes:
        document: The scenario.
        folder: Folder that paths in it are relative to.
        wanted: What to take from each result.
        root: Folder that files may refer to; each file's own where it is ``None``.
    """

    document: Document
    folder: Path
    wanted: tuple[Wanted, ...]
    root: Path | None = None

    def scenario(self, values: Mapping[str, Value]) -> Scenario:
        """Return the scenario of a case, with its mechanism loaded: that of the case before if it is the same.

        Raises:
            PinarmError: It has a mistake.
        """
        document = varied(self.document, values)
        last = self._last[0] if self._last else None
        scenario = last.scenario.with_document(document) if last else Scenario.of(document, self.folder)
        if last and scenario.loaded:
            note_files(last.files)
            return scenario
        with noting_files() as files, failures_in_words():
            assert scenario.mechanism
        self._last[:] = [LoadedCase(scenario, frozenset(files))]
        return scenario

    @cached_property
    def _last(self) -> list[LoadedCase]:
        """The last case that has loaded a mechanism; none before the first."""
        return []


@dataclass(frozen=True, eq=False)
class LoadedCase:
    """A case with its mechanism loaded.

    Attributes:
        scenario: Its scenario.
        files: The files that its mechanism refers to.
    """

    scenario: Scenario
    files: frozenset[Path]


@dataclass(frozen=True, eq=False)
class Solved:
    """A case that has been solved.

    Attributes:
        row: What came out.
        result: The whole of it; ``None`` where the case failed.
    """

    row: Row
    result: Result | None = None


def solve_case(task: Task, values: Mapping[str, Value]) -> Row:
    """Return the row of one case; see ``solved_case``."""
    return solved_case(task, values).row


def solved_case(task: Task, values: Mapping[str, Value]) -> Solved:
    """Solve one case: a function of plain data, for any process on any machine that sees the files.

    Args:
        task: The scenario and what is wanted of it.
        values: Path -> value that replaces that of the scenario.

    Returns:
        The row; that of a case that fails says why, and has no result.
    """
    with file_root(task.root), noting_files() as files:
        try:
            result = run(task.scenario(values))
            numbers = [number for entry in task.wanted for number in entry.numbers(result)]
            quadrature = [error / abs(number) for number, error in numbers if error and number]
            if result.contradiction:
                return Solved(Row((), result.contradiction, _names(files)))
            if result.missed:
                target = result.content.accuracy.target
                said = f"the global error is {result.error:.1e}, not below its target {target:g}"
                return Solved(Row((), said, _names(files)))
            figures = {**result.figures, QUADRATURE: max(quadrature, default=np.nan)}
            figures[GLOBAL_ERROR] = np.nan if result.error is None else result.error
            worth = (figures.get(name, np.nan) for name in WORTH)
            return Solved(Row((*(number for number, _ in numbers), *worth), "", _names(files)), result)
        except PinarmError as error:
            return Solved(Row((), _one_line(error), _names(files)))
        except Exception as error:  # a fault of the program costs one case, and is told as what it is
            said = f"the program failed: {type(error).__name__}: {error}"
            return Solved(Row((), said, _names(files), final=False))


def _names(files: Iterable[Path]) -> tuple[str, ...]:
    return tuple(sorted(map(str, files)))


def _one_line(error: PinarmError) -> str:
    place = f"{error.location}: " if error.location and error.location.line else ""
    return " ".join(f"{place}{error.message}".split())

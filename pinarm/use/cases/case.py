"""Case: a scenario with other values, solved, and a few numbers of its result."""

from __future__ import annotations

import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import plain
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import (
    DynamicsError,
    InputError,
    Interrupted,
    Location,
    NumericsError,
    PinarmError,
    fault,
    of_interrupt,
)
from pinarm.input.roots import note_files, noting_files
from pinarm.input.units import Unit
from pinarm.records import replace
from pinarm.use.result.failures import failures_in_words
from pinarm.use.result.measures import MEASURES
from pinarm.use.result.numbers import EXAMPLES, AnyNumber, measured, names_number, read_number
from pinarm.use.result.section import Numbered

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario, ScenarioSource

Value = int | float | str | bool
"""Value at a path of a case, as a scenario file would have it."""

Case = Mapping[str, Value]
"""Path -> value that replaces that of the scenario."""

QUADRATURE, GLOBAL_ERROR, OPEN = "quadrature error", "global error", "open decisions"
WORTH = (*MEASURES, QUADRATURE, GLOBAL_ERROR, OPEN)
"""Accuracy measures of a case: those of its run; the largest quadrature error of its figures of curves, relative to
them; the global error, where the scenario has a target for it; the number of decisions at thresholds that are not
certain. NaN where a case has none."""


ARGUMENT = "arguments."
"""Prefix of paths to arguments of the model."""

COLUMNS = (ARGUMENT, *(f"problem.{key}." for key in ("motion", "time", "over", "hold", "velocity", "acceleration")))
"""Prefixes of paths to numbers that may differ between cases solved together: of the model, laws, rows and starts."""


@cache
def is_column(path: str) -> bool:
    """Tell whether numbers at a path may differ: numbers of rows may not, which arrays have in common."""
    return path.startswith(COLUMNS) and not path.endswith(".samples")


NO_SECTIONS: Mapping[str, Numbered] = MappingProxyType({})


class Taken(ABC):
    """Numbers that are taken from the result of each case, as many in every case.

    Attributes:
        number: The number of the run that they are, if they are one.
        broken_off: Whether they are taken also from the beginning of a run that failed.
    """

    number: AnyNumber | None = None
    broken_off: ClassVar[bool] = False

    @property
    def alone(self) -> bool:
        """Whether each case has to be solved by itself."""
        return self.number is not None and not self.number.of_curves

    @abstractmethod
    def numbers(self, result: Result) -> list[tuple[float, float]]:
        """Return the numbers [SI], each with the error of its quadrature."""

    def of_rows(self, quantities: Quantities) -> list[Array]:
        """Return the numbers of variants, each of shape (k,) or (1,), from the quantities of their rows."""
        raise NotImplementedError


@dataclass(frozen=True)
class RowValues(Taken):
    """The values of a quantity, a symbol or a formula in all rows."""

    quantity: str

    def numbers(self, result: Result) -> list[tuple[float, float]]:
        values = result.quantities.determined(self.quantity).values
        if not np.isfinite(values).all():
            raise DynamicsError(f"{self.quantity} is not finite")
        return [(float(value), 0.0) for value in values]

    def of_rows(self, quantities: Quantities) -> list[Array]:
        return [*quantities[self.quantity].values]


@dataclass(frozen=True)
class Wanted(Taken):
    """A number of the run, or the bounds of a quantity in its rows.

    Attributes:
        quantity: A quantity, a symbol or a formula; of a number, its name.
        number: The number of the run; ``None`` for the least and the greatest value of the rows.
        optional: Whether a case may lack it, which is NaN then: its other numbers count all the same.
    """

    quantity: str
    number: AnyNumber | None = None
    unit: Unit | None = None
    optional: bool = False

    @classmethod
    def read(cls, text: str, sections: Mapping[str, object] = NO_SECTIONS) -> Wanted:
        """Read ``QUANTITY``, or ``QUANTITY @ PLACE`` and the like; see ``read_number``."""
        if not text.strip():
            raise InputError("an empty text asks for nothing", expected=EXAMPLES).at(Location("--result"))
        if not names_number(text, sections):
            return cls(text.strip())
        try:
            number = read_number(text)
        except InputError as error:
            raise error.at(Location(f"--result {text}")) from None
        return cls(number.label, number)

    def labels(self) -> tuple[str, ...]:
        return (self.number.label,) if self.number else (f"min {self.quantity}", f"max {self.quantity}")

    def measured(
        self, quantities: Quantities, sections: Mapping[str, Numbered] = NO_SECTIONS
    ) -> tuple[Wanted, list[Series]]:
        """Return a copy with its unit, and the empty columns of its numbers, from quantities with nothing solved.

        Raises:
            InputError: There is no such quantity.
        """
        try:
            series = self.number.described(quantities, sections) if self.number else quantities[self.quantity]
        except InputError as error:
            raise error.at(Location(f"--result {self.quantity}")) from None
        columns = [replace(series, name=label, values=np.zeros(0)) for label in self.labels()]
        return replace(self, unit=series.unit), columns

    def of_rows(self, quantities: Quantities) -> list[Array]:
        values = quantities[self.quantity].values
        return [values.min(axis=0), values.max(axis=0)]

    def numbers(self, result: Result) -> list[tuple[float, float]]:
        numbers = self._numbers(result)
        if self.optional:
            return [(number + 0.0, error) if np.isfinite(number) else (np.nan, 0.0) for number, error in numbers]
        if not np.isfinite(numbers).all():
            raise DynamicsError(f"{self.labels()[0]} is {'infinite' if np.isinf(numbers).any() else 'not finite'}")
        return [(number + 0.0, error) for number, error in numbers]  # -0 becomes 0

    def _numbers(self, result: Result) -> list[tuple[float, float]]:
        quantities = result.quantities
        number = measured(self.number, result) if self.number else None
        unit = (number[0] if number else quantities[self.quantity]).unit
        if self.unit and unit and unit.dimension != self.unit.dimension:
            raise InputError(f"{self.labels()[0]} is in {unit} in this case", expected=f"{self.unit}, as in others")
        if number:
            return [(float(number[0].values[0]), number[1])]
        least, greatest = quantities.bounds(self.quantity)
        return [(float(least.values.min()), 0.0), (float(greatest.values.max()), 0.0)]


@dataclass(frozen=True)
class FunctionValue(Taken):
    """The number that a function in Python computes of the result of each case.

    Attributes:
        code: The function, pickled.
        file: The file of an imported function, empty for others; its content is part of what a journal knows.
        unit: SI unit of the number; ``None`` where it is not known.
    """

    name: str
    code: bytes
    file: str
    unit: Unit | None = None
    alone: ClassVar[bool] = True

    @classmethod
    def read(cls, function: Callable[[Any], Any]) -> FunctionValue:
        """Return the number of a function, which workers get as a copy."""
        from inspect import getmodule

        import cloudpickle

        name = getattr(function, "__name__", "")
        if not callable(function) or not name.isidentifier():
            raise InputError(
                f"{function!r} has no name for its column",
                expected="def stroke(result): ...",
                hint="function.__name__ = 'stroke'",
            )
        try:
            code = cloudpickle.dumps(function)
        except Exception as error:  # whatever an object of the user's raises there
            raise InputError(
                f"the function '{name}' cannot be sent to workers: {error}",
                expected="a function that holds plain data only, no open files or locks",
            ) from None
        module = getmodule(function)
        file = getattr(module, "__file__", None) if getattr(module, "__name__", "") != "__main__" else None
        return cls(name, code, file or "")

    @cached_property
    def _function(self) -> Callable[[Any], Any]:
        return pickle.loads(self.code)  # type: ignore[no-any-return]

    def numbers(self, result: Result) -> list[tuple[float, float]]:
        note_files([Path(self.file)] if self.file else [])
        series = self.series(result)
        if self.unit and series.unit and series.unit.dimension != self.unit.dimension:
            raise InputError(f"'{self.name}' is in {series.unit} in this case", expected=f"{self.unit}, as in others")
        return [(float(series.si) + 0.0, 0.0)]  # -0 becomes 0

    def series(self, result: Result) -> Series:
        """Return the value of the function for a result: one number, with a unit if the function returns a ``Series``.

        Raises:
            InputError: The function raises an error, or returns something else.
            DynamicsError: The number is not finite.
        """
        try:
            said = self._function(result)
        except PinarmError:
            raise
        except Exception as error:  # whatever the function of the user raises
            raise InputError(f"the function '{self.name}' raised {type(error).__name__}: {error}") from error
        number = np.asarray(said)
        if number.size != 1 or number.dtype.kind not in "bfiu":
            raise InputError(
                f"the function '{self.name}' returned {str(said)[:60]!r}",
                expected="one number in SI, or a Series of one value",
            )
        if not np.isfinite(number).all():
            raise DynamicsError(f"{self.name} is not finite")
        return Series(self.name, said.unit if isinstance(said, Series) else None, number.astype(float).reshape(()))


@dataclass(frozen=True)
class Row:
    """Results of one case.

    Attributes:
        numbers: Results, then the measures of accuracy in the order of ``WORTH``. A case that failed has none, or the
            numbers that are ``broken_off``.
        error: Why the case failed; empty where it did not.
        files: Files that the case refers to.
        final: Whether solving the case again would give the same results; not so where the program itself failed.
    """

    numbers: tuple[float, ...]
    error: str = ""
    files: tuple[str, ...] = ()
    final: bool = True

    @property
    def taken(self) -> tuple[float, ...]:
        """The numbers without the measures of accuracy."""
        return self.numbers[: -len(WORTH)]

    @property
    def figures(self) -> dict[str, float]:
        """The measures of accuracy that the case has."""
        named = zip(WORTH, self.numbers[-len(WORTH) :], strict=False)
        return {name: figure for name, figure in named if not np.isnan(figure)}


@dataclass(frozen=True)
class Task:
    """Data common to all cases of one scenario.

    Attributes:
        source: Source of the scenario: a process that misses one of its files can report it.
        wanted: Numbers to take from each result.
        anchor: Values of a case that can be solved, beside which cases are solved together; those of the scenario where
            it has none.
        measured: Whether the measures of accuracy are wanted.
    """

    source: ScenarioSource
    wanted: tuple[Taken, ...]
    anchor: Case
    measured: bool

    @classmethod
    def of(
        cls, scenario: Scenario, wanted: Iterable[Taken], anchor: Case | None = None, *, measured: bool = True
    ) -> Task:
        """Return the task of all cases of a scenario, for a process in any folder."""
        return cls(scenario.source, tuple(wanted), dict(anchor or {}), measured)

    @cached_property
    def scenario(self) -> Scenario:
        return self.source.scenario()

    def case(self, values: Case) -> Scenario:
        """Return the scenario of a case, with its mechanism loaded: that of the case before if it is the same."""
        last, known = self._last[0] if self._last else (self.scenario, frozenset[Path]())
        document = self.scenario.varied_document(values)
        document = replace(document, data={key: part for key, part in document.data.items() if key != "expect"})
        scenario = last.with_document(document)
        if self._last and scenario.loaded:
            note_files(known)
            return scenario
        with noting_files() as files, failures_in_words():
            assert scenario.mechanism
        self._last[:] = [(scenario, frozenset(files))]
        return scenario

    @cached_property
    def _last(self) -> list[tuple[Scenario, frozenset[Path]]]:
        """The last case that has loaded a mechanism, and the files that this refers to; none before the first."""
        return []


def solve_case(task: Task, values: Case) -> Row:
    """Return the row of one case; see ``solved_case``."""
    return solved_case(task, values)[0]


def solved_case(task: Task, values: Case) -> tuple[Row, Result | None]:
    """Return the row of one case and its result, where it failed the beginning of it if any; the row says why.

    Raises:
        Interrupted: By the user.
    """
    with noting_files() as files:
        try:
            result = task.case(values).run()
            numbers = [number for entry in task.wanted for number in entry.numbers(result)]
            if result.shortfall:
                return Row((), result.shortfall, _names(files)), None
            if task.measured:
                result = replace(result, figures={**result.figures, **plain(result.quantities.figures())})
            row = Row((*(number for number, _ in numbers), *(_worth(result, numbers) if task.measured else UNMEASURED)))
            return replace(row, files=_names(files)), result
        except Interrupted:
            raise
        except PinarmError as error:
            partial = error.partial if isinstance(error, NumericsError) else None
            begun = partial if hasattr(partial, "quantities") else None
            return Row(_broken_off(task, begun), _one_line(error), _names(files)), begun
        except Exception as error:  # a fault of the program costs one case, and is told as what it is
            if of_interrupt(error):
                raise KeyboardInterrupt from None
            return Row((), f"the program failed: {fault(error)}", _names(files), final=False), None


UNMEASURED = (np.nan,) * len(WORTH)


def _broken_off(task: Task, begun: Result | None) -> tuple[float, ...]:
    """Return the numbers of a run that failed on the way; none where not all of them can be taken."""
    if begun is None or not all(entry.broken_off for entry in task.wanted):
        return ()
    with suppress(PinarmError):
        return (*(number for entry in task.wanted for number, _ in entry.numbers(begun)), *UNMEASURED)
    return ()


def _worth(result: Result, numbers: Iterable[tuple[float, float]]) -> tuple[float, ...]:
    quadrature = [error / abs(number) for number, error in numbers if error and number]
    decisions = result.outcome.decisions
    known = {
        **result.figures,
        QUADRATURE: max(quadrature, default=np.nan),
        GLOBAL_ERROR: np.nan if result.error is None else result.error,
        OPEN: float(sum(decision.is_open for decision in decisions)) if decisions else np.nan,
    }
    return tuple(known.get(name, np.nan) for name in WORTH)


def failure(task: Task, values: Case, row: Row) -> PinarmError:
    """Return the error of a case that failed, with its place: it is solved again."""
    try:
        result = task.case(values).run()
        for entry in task.wanted:
            entry.numbers(result)
    except PinarmError as error:
        return error
    return NumericsError(row.error)


def _names(files: Iterable[Path]) -> tuple[str, ...]:
    return tuple(sorted(map(str, files)))


def _one_line(error: PinarmError) -> str:
    place = f"{error.location}: " if error.location and error.location.line else ""
    return " ".join(f"{place}{error.message}".split())

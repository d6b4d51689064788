"""Numbers of a run as a function of numbers of its scenario."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Protocol

from pinarm.arrays import Array
from pinarm.errors import InputError, UnitError, choices, within
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.input.yaml.document import require_unit
from pinarm.input.yaml.schema import PURE, Measured
from pinarm.use.assessments.sensitivity.tolerance import Tolerance
from pinarm.use.cases.case import Case, Row, Task, Wanted
from pinarm.use.cases.case_table import is_column
from pinarm.use.cases.solving import SolveCases, solving
from pinarm.use.progress import tell
from pinarm.use.result.numbers import AnyNumber

if TYPE_CHECKING:
    from pinarm.use.scenario.scenario import Scenario


DRAWN = "planar.points."
"""Part of the paths to points of a drawing."""


@dataclass(frozen=True)
class Input:
    """A number of a scenario that has a tolerance.

    Attributes:
        name: As it was given.
        path: Where it stands in the scenario.
        value: Its value [SI].
        tolerance: How far it may be from that [SI].
        unit: Its unit in the file; ``None`` for none.
    """

    name: str
    path: str
    value: float
    tolerance: float
    unit: Unit | None

    @property
    def si(self) -> Unit:
        """Its unit in SI."""
        return self.unit.si if self.unit else DIMENSIONLESS

    def text(self, value: float) -> str:
        """Return a value in SI as files write it."""
        return f"{float(value / self.unit.factor)!r} {self.unit}" if self.unit else repr(float(value))

    def given(self, value: float) -> str | float:
        """Return a value in SI as files have it: a number where there is no unit."""
        return self.text(value) if self.unit else float(value)


def path_of(name: str, scenario: Scenario) -> str:
    """Return the path that a name means: ``l2`` is ``arguments.l2``.

    Raises:
        InputError: It is no path, and the model has no argument of that name.
    """
    if "." in name:
        return name
    arguments = scenario.mechanism.arguments
    if name not in arguments:
        expected, hint = choices(name, arguments)
        wanted = f"a path such as problem.time.end, or an argument: {expected}"
        raise InputError(f"the model has no argument '{name}'", expected=wanted, hint=hint)
    return f"arguments.{name}"


def inputs_of(scenario: Scenario, tolerances: Mapping[str, Tolerance]) -> list[Input]:
    """Return the inputs that have tolerances.

    Raises:
        InputError: A path leads to no number, two names mean the same, or a tolerance is none of that number.
    """
    inputs = list[Input]()
    for name, tolerance in tolerances.items():
        with within("to", name):
            path = path_of(name, scenario)
            if path in [other.path for other in inputs]:
                raise InputError(f"'{path}' has two tolerances", expected="one")
            value = scenario.number_at(path)
            _check_unit(tolerance, value, path)
            own = None if value else tolerance.unit
            inputs.append(Input(name, path, float(value), tolerance.size(float(value)), value.unit or own))
    return inputs


def _check_unit(tolerance: Tolerance, value: Measured, path: str) -> None:
    """Raise where a tolerance and its number have different units, or only one of them has a unit; 0 takes any."""
    if tolerance.unit is not None and value.unit is not None:
        tolerance.check(value.unit)
    elif value and tolerance.unit is not None and tolerance.unit.text not in PURE:
        raise UnitError(
            f"the number {float(value):g} at '{path}' has no unit, and the tolerance is in {tolerance.unit}",
            expected="such as 0.05 or 5 %, for a number without a unit",
        )
    elif not tolerance.relative:
        require_unit(tolerance, str(value.unit or ""), path)


class Varied(Protocol):
    """Numbers of a run as a function of changes of its inputs."""

    @property
    def inputs(self) -> Sequence[Input]:
        """The inputs, k of them."""

    def rows(self, changes: Array) -> Iterator[Row]:
        """Yield rows of m numbers [SI], in the order of the changes [SI], shape (n, k); each may have failed."""


@dataclass(frozen=True)
class Variation:
    """Numbers of the runs of a scenario.

    Attributes:
        inputs: Its inputs, k of them.
        solve: Solves cases.
        runs: Counts the runs.
    """

    inputs: Sequence[Input]
    solve: SolveCases = field(repr=False)
    runs: Iterator[int] = field(default_factory=partial(count, 1), repr=False)

    def rows(self, changes: Array) -> Iterator[Row]:
        for row in self.solve(case_of(self.inputs, change) for change in changes.tolist()):
            tell(f"sensitivity: run {next(self.runs)}")
            yield row


def case_of(inputs: Sequence[Input], changes: Sequence[float]) -> Case:
    """Return what a case sets: what changes, and anyway what may differ in cases of one kind."""
    changed = zip(inputs, changes, strict=True)
    return {of.path: of.given(of.value + x) for of, x in changed if x or is_column(of.path)}


@contextmanager
def varied_runs(scenario: Scenario, inputs: Sequence[Input], numbers: Sequence[AnyNumber]) -> Iterator[Variation]:
    """Yield the numbers of a scenario's runs as a function of its inputs, solved by its runners."""
    unchanged = case_of(inputs, [0.0] * len(inputs))
    task = Task.of(scenario, [Wanted(number.label, number) for number in numbers], unchanged)
    with solving(task, scenario.runners) as solve:
        yield Variation(inputs, solve)

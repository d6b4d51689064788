"""Numbers of a run as a function of numbers of its scenario with tolerances.

Files write tolerances as follows:

===========================  =======================================================================================
``250 ± 0.1 mm``             about a value, which has to be that of the file; ``+-`` and ``+/-`` are the same as ``±``
``250 mm ± 5 %``             likewise, a part of the value
``0.1 mm``                   about the value of the file
``5 %``                      a part of the value of the file, of a number without a unit too
``0.15 ± 0.05``              of a number without a unit, such as a coefficient of friction
===========================  =======================================================================================
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any, Self

from pinarm.arrays import Array
from pinarm.errors import InputError, UnitError, choices, within
from pinarm.input.units import DIMENSIONLESS, Unit, read_quantity, unit
from pinarm.input.yaml.document import require_unit
from pinarm.input.yaml.schema import PURE, Measured
from pinarm.use.cases.case import Case, Row, Task, Wanted, is_column
from pinarm.use.cases.solving import SolveCases, solving
from pinarm.use.progress import tell
from pinarm.use.result.numbers import AnyNumber

if TYPE_CHECKING:
    from pinarm.use.scenario.scenario import Scenario

EXAMPLES = "such as 250 ± 0.1 mm, 0.1 mm or 5 %; 0.15 ± 0.05 for a number without a unit"
PERCENT = unit("%")

SAME = 1e-9
"""Relative difference below which the value of a tolerance is that of the file."""

_SIGN = re.compile(r"±|\+/-|\+-")


class Tolerance(Measured):
    """Tolerance of a number about its value: its size in SI, or as a part of the value.

    Attributes:
        relative: Whether it is a part of the value.
        about: The value [SI]; ``None`` for that of the file.
    """

    relative: bool = False
    about: float | None = None

    @classmethod
    def read(cls, value: object, *, bare: bool = True) -> Self:
        """Read a tolerance: see above."""
        if isinstance(value, cls):
            return value
        parts = [part.strip() for part in _SIGN.split(str(value))]
        if isinstance(value, bool) or not isinstance(value, str | int | float) or not 1 <= len(parts) <= 2:
            raise InputError(f"'{str(value)[:80]}' is no tolerance", expected=EXAMPLES)
        size, written = read_quantity(parts[-1])
        relative = written is not None and written == PERCENT and written.text == "%"
        about, unit_of_value = cls._value(parts[0], written, relative) if len(parts) == 2 else (None, written)
        return cls.of(size, None if relative and about is None else unit_of_value, relative, about)

    @staticmethod
    def _value(text: str, written: Unit | None, relative: bool) -> tuple[float, Unit | None]:
        """Return the value [SI] in ``text ± size``, and its unit: that of the size where it has none of its own."""
        number, own = read_quantity(text)
        if own is None and not relative and written is not None:
            return number * written.factor, written
        if own is not None and not relative and (written or DIMENSIONLESS).dimension != own.dimension:
            raise InputError(f"'{text}' and its tolerance are in different units", expected=EXAMPLES)
        return number, own

    @classmethod
    def of(cls, size: float, written: Unit | None, relative: bool, about: float | None) -> Self:
        """Return a tolerance of its parts."""
        if not 0.0 < size < float("inf"):
            raise InputError(f"a tolerance of {size:g} is none", expected=f"more than 0, {EXAMPLES}")
        tolerance = cls(size)
        tolerance.unit, tolerance.relative, tolerance.about = written, relative, about
        return tolerance

    def size(self, value: float) -> float:
        """Return the tolerance [SI] of a value of the file [SI]."""
        if self.about is not None and abs(self.about - value) > SAME * max(abs(value), abs(self.about)):
            raise InputError(
                f"the tolerance is about {self._text(self.about)}, and the value is {self._text(value)}",
                expected="a tolerance about the value of the file",
                hint=EXAMPLES,
            )
        if self.relative and not value:
            raise InputError("a part of 0 is no tolerance", expected="an absolute one, such as 0.1 mm")
        return float(self) * abs(value) if self.relative else float(self)

    def _text(self, value: float) -> str:
        return f"{value / self.unit.factor:.9g} {self.unit}" if self.unit else f"{value:.9g}"

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self).of, (float(self), self.unit, self.relative, self.about)


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
        return self.unit.si if self.unit else DIMENSIONLESS

    def text(self, value: float) -> str:
        return f"{float(value / self.unit.factor)!r} {self.unit}" if self.unit else repr(float(value))

    def given(self, value: float) -> str | float:
        return self.text(value) if self.unit else float(value)


def path_of(name: str, scenario: Scenario) -> str:
    """Return the path that a name means: ``l2`` is ``arguments.l2``."""
    if "." in name:
        return name
    arguments = scenario.mechanism.arguments
    if name not in arguments:
        expected, hint = choices(name, arguments)
        wanted = f"a path such as problem.time.end, or an argument: {expected}"
        raise InputError(f"the model has no argument '{name}'", expected=wanted, hint=hint)
    return f"arguments.{name}"


def inputs_of(scenario: Scenario, tolerances: Mapping[str, Tolerance]) -> list[Input]:
    """Return the inputs that have tolerances."""
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


@dataclass(frozen=True)
class Variation:
    """Numbers of the runs of a scenario as a function of changes of its inputs.

    Attributes:
        inputs: Its inputs, k of them.
        solve: Solves cases.
        runs: Counts the runs.
    """

    inputs: Sequence[Input]
    solve: SolveCases = field(repr=False)
    runs: Iterator[int] = field(default_factory=partial(count, 1), repr=False)

    def rows(self, changes: Array) -> Iterator[Row]:
        """Yield rows of m numbers [SI], in the order of the changes [SI], shape (n, k); each may have failed."""
        for row in self.solve(case_of(self.inputs, change) for change in changes.tolist()):
            tell(f"sensitivity: run {next(self.runs)}")
            yield row


def case_of(inputs: Sequence[Input], changes: Sequence[float]) -> Case:
    """Return the case of changed inputs; inputs that may differ in cases of one kind are set even unchanged."""
    changed = zip(inputs, changes, strict=True)
    return {of.path: of.given(of.value + x) for of, x in changed if x or is_column(of.path)}


@contextmanager
def varied_runs(scenario: Scenario, inputs: Sequence[Input], numbers: Sequence[AnyNumber]) -> Iterator[Variation]:
    """Yield the numbers of a scenario's runs as a function of its inputs, solved by its runners."""
    unchanged = case_of(inputs, [0.0] * len(inputs))
    task = Task.of(scenario, [Wanted(number.label, number) for number in numbers], unchanged)
    with solving(task, scenario.runners) as solve:
        yield Variation(inputs, solve)

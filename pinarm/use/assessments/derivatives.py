"""Derivatives of numbers that whole runs give: differences, extrapolated to steps of 0, with their errors.

With f(h) the number where an input is changed by h, for h, h/2 and h/4:

    c(h) = (f(h) - f(-h)) / 2h = f' + a h² + b h⁴ + ...,    r(h) = (f(h) - f(0)) / h = f' + a h + b h² + ...

Two rounds of Richardson's extrapolation leave ``O(h⁶)`` of the central and ``O(h³)`` of each one-sided derivative. The
last correction tells what is left where h is small. Where it is not, it may be small by accident; of a series whose
terms go down like ``q^n`` the one-sided derivatives keep ``~ q³`` of f' and the central one ``~ q⁶``, the square of it.
So what is left is at least told as ``2 d² / f'`` with the distance d between them. The error e of the numbers
themselves makes ``4 e / h`` of it; both are least together for ``h ~ e^(1/7)``. Where the two one-sided derivatives
differ by more than their errors, the number has a kink there: a maximum that moves from one instant to another.

A step over which the number is no such series, as where an oscillation turns by several radians, may look settled by
accident. So a step is enough only where all three derivatives are about the same; otherwise smaller steps are taken
too, which contradict larger ones by what they differ beyond their own errors. Derivatives of one step that differ, but
for those at a kink that smaller steps confirm, are as wrong as they differ.

Source: Ridders, Accurate computation of F'(x) and F'(x) F''(x), Advances in Engineering Software 4 (1982).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import count, islice
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.errors import InputError, UnitError, choices, within
from pinarm.input.units import DIMENSIONLESS, Unit, read_quantity, unit
from pinarm.input.yaml.document import require_unit
from pinarm.input.yaml.schema import PURE, Measured
from pinarm.records import Record
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


SHRINK, ROUNDS = 16.0, 3
"""Factor by which steps are made smaller where the error is not small yet, and how often that is tried."""

GOOD = 1e-6
"""Error of a derivative, relative to it, that is small enough."""

CONVINCING = 1e-4
"""Error of a derivative, relative to it, that is hardly small by accident: enough where it is that of the numbers."""

REGULAR = 0.05
"""Difference of one-sided derivatives from the central one, over the difference quotients, up to which a step is small
enough for a power series."""

KINK = 1e-3
"""Difference of one-sided derivatives, relative to their sizes, that makes a kink."""

SQUARE = 2.0
"""Error of central differences over the squared error of one-sided ones, both relative to the quotient."""

DOUBT = 2.0
"""Error of a derivative over what smaller steps contradict: these are wrong themselves, by about as much."""

STEPS = np.array([1.0, 0.5, 0.25, -1.0, -0.5, -0.25])
"""Changes of an input that one round takes, relative to the largest."""


class Derivative(Record, frozen=True):
    """A derivative.

    Attributes:
        value: Of central differences; at a kink, that of the steeper side.
        error: Estimate of its error.
        left: Derivative below.
        right: Derivative above.
        kink: Whether these differ.
    """

    value: float
    error: float
    left: float
    right: float
    kink: bool = False


class _Differences(Record, frozen=True):
    """Derivatives of several numbers by steps of one size, and their errors, each of shape (m,).

    ``quotient`` is the larger one-sided quotient of differences over the whole step, ``rounding`` what the noise of the
    numbers makes of a difference over the smallest one.
    """

    central: Array
    central_error: Array
    left: Array
    right: Array
    sided_error: Array
    quotient: Array
    rounding: Array

    @classmethod
    def of(cls, taken: Array, at_zero: Array, step: float, noise: Array) -> _Differences:
        """Return them from the numbers of the runs of a round, shape (6, m)."""
        h = step / 2.0 ** np.arange(3)[:, None]
        ahead, behind, rounding = taken[:3], taken[3:], 4.0 * noise / step
        central, correction = _extrapolated((ahead - behind) / (2.0 * h), 2)
        right, above = _extrapolated((ahead - at_zero) / h, 1)
        left, below = _extrapolated((at_zero - behind) / h, 1)
        quotient = np.maximum(np.abs(ahead[0] - at_zero), np.abs(at_zero - behind[0])) / step
        apart = np.maximum(np.abs(right - central), np.abs(left - central))
        left_out = np.maximum(correction, SQUARE * apart**2 / np.where(quotient > 0.0, quotient, np.inf))
        sided = np.maximum(above, below) + 8.0 * rounding
        return cls(central, left_out + 2.0 * rounding, left, right, sided, quotient, rounding)

    @cached_property
    def kinks(self) -> Flags:
        sizes = np.abs(self.left) + np.abs(self.right)
        return np.asarray(np.abs(self.right - self.left) > KINK * sizes + 10.0 * self.sided_error)

    @cached_property
    def values(self) -> Array:
        steeper = np.where(np.abs(self.right) > np.abs(self.left), self.right, self.left)
        return np.where(self.kinks, steeper, self.central)

    @cached_property
    def errors(self) -> Array:
        return np.where(self.kinks, self.sided_error, self.central_error)

    @cached_property
    def apart(self) -> Array:
        """Distance of the one-sided derivatives from the central one, where that makes the step too large; else 0."""
        apart = np.maximum(np.abs(self.left - self.central), np.abs(self.right - self.central))
        return np.where(apart > REGULAR * self.quotient + 8.0 * self.rounding, apart, 0.0)

    def is_settled(self) -> bool:
        """Tell whether no number needs smaller steps; one that does not depend on the input needs none."""
        sizes = np.abs(self.values)
        small = self.errors <= GOOD * sizes + np.minimum(10.0 * self.rounding, CONVINCING * sizes)
        return bool(((small & (self.apart == 0.0)) | (self.quotient <= self.rounding)).all())

    def contradicted(self, finer: _Differences) -> Array:
        """Return the errors that smaller steps show: of both sides at a kink, which they may be too small to see."""
        sides = np.maximum(np.abs(self.left - finer.left), np.abs(self.right - finer.right))
        middles = DOUBT * np.abs(self.central - finer.central) - finer.central_error
        return np.where(self.kinks, DOUBT * sides - finer.sided_error, middles)


def derivatives(
    varied: Variation, at_zero: Array, step_of: Callable[[Input], float], noise: Array
) -> list[list[Derivative]]:
    """Return the derivatives of several numbers by every input, those of a round solved at once.

    Args:
        varied: The numbers, m of them.
        at_zero: The numbers without a change, shape (m,).
        step_of: Input -> its first and largest change.
        noise: Error of the numbers that changes irregularly from run to run, shape (m,).
    """
    count = len(varied.inputs)
    rounds, failures = [list[_Differences]() for _ in range(count)], [""] * count
    left, first = list(range(count)), [step_of(of) for of in varied.inputs]
    for attempt in range(ROUNDS):
        steps = {k: first[k] / SHRINK**attempt for k in left}
        if not steps:
            break
        rows = varied.rows(np.concatenate([np.outer(step * STEPS, np.eye(count)[k]) for k, step in steps.items()]))
        for k, step in steps.items():
            taken = [*islice(rows, len(STEPS))]
            if reasons := [row.error for row in taken if row.error]:
                failures[k] = reasons[0]
                continue
            numbers = np.array([row.taken for row in taken])
            rounds[k].append(_Differences.of(numbers, at_zero, step, noise))
            if rounds[k][-1].is_settled():
                left.remove(k)
    for own, of, failure in zip(rounds, varied.inputs, failures, strict=True):
        if not own:
            with within("to", of.name):
                raise InputError(
                    f"no run succeeds on both sides of {of.text(of.value)}: {failure}",
                    hint="another value, from which the mechanism can be changed both ways",
                )
    return [_best(own) for own in rounds]


def _best(rounds: list[_Differences]) -> list[Derivative]:
    """Return the derivatives with the least errors, after what smaller steps say of them; largest steps first."""
    errors = np.array([differences.errors for differences in rounds])
    for n, differences in enumerate(rounds):
        finer = rounds[n + 1 :]
        for other in finer:
            errors[n] = np.maximum(errors[n], differences.contradicted(other))
        confirmed = differences.kinks & bool(finer)
        errors[n] = np.maximum(errors[n], np.where(confirmed, 0.0, differences.apart))
    best = []
    for k, n in enumerate(errors.argmin(axis=0).tolist()):
        parts = (rounds[n].values, errors[n], rounds[n].left, rounds[n].right)
        value, error, left, right = (float(part[k]) for part in parts)
        best.append(Derivative(value, error, left, right, bool(rounds[n].kinks[k])))
    return best


def _extrapolated(differences: Array, order: int) -> tuple[Array, Array]:
    """Return three differences of steps halved each time, extrapolated, shape (m,), and the last correction.

    Args:
        differences: Shape (3, m).
        order: Of the first power of the step in them, and the distance to the next.
    """
    first, second = 2.0**order, 2.0 ** (2 * order)
    once = (first * differences[1:] - differences[:-1]) / (first - 1.0)
    twice = (second * once[1] - once[0]) / (second - 1.0)
    return twice, np.abs(twice - once[1])

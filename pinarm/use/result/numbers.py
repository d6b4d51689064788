"""Numbers of a run: ``QUANTITY @ PLACE`` or ``QUANTITY @ FIGURE``, numbers of sections, formulas of them; conditions.

``X @ largest`` is printed with its sign, and ``=`` compares it so; ``<`` and ``>`` compare its size, ``X @ peak``.
A formula combines numbers: ``w @ max - w @ min``, ``loads.A.life.time / loads.B.life.time``. In it ``@`` belongs to the
name, or the parentheses, right before it: ``(C_B*w) @ max / (C_B*w) @ mean``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Literal, Self, TypeVar

import numpy as np

from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import ExpressionError, InputError, PinarmError, choices, require_name, within
from pinarm.input.formulas.expressions import Expression
from pinarm.input.formulas.grammar import CONSTANTS
from pinarm.input.units import DECIMAL, is_whole, read_quantity
from pinarm.input.yaml.schema import AnyQuantity, Measured
from pinarm.records import Record, ValueRecord, replace
from pinarm.use.result.curve_figures import FIGURES, figure, figure_unit, is_figure, stands_alone
from pinarm.use.result.row_lookup import located

if TYPE_CHECKING:
    from pinarm.use.result.row_lookup import Lookup
    from pinarm.use.result.run import Run
    from pinarm.use.result.section import Numbered


EXAMPLES = (
    "C_B @ max, t @ max(C_B), C_B @ t=1.5 s, C_B @ rms, C_B @ p95, C_B @ range, loads.B.life.time of a "
    "section, or a formula of such numbers: C_B @ max - C_B @ mean"
)

MAX_LENGTH = 2000
"""Characters of a text that is read at all."""

T = TypeVar("T")

_PLACE = re.compile(r"(start|end|max|min|largest)(?:\((.*)\))?")


class Number(ValueRecord, frozen=True):
    """A number of a run."""

    @property
    def parts(self) -> Sequence[RunNumber | SectionNumber]:
        """The numbers that it is a formula of: itself, where it is none."""
        assert isinstance(self, RunNumber | SectionNumber)
        return (self,)

    @property
    def of_curves(self) -> bool:
        return all(isinstance(part, RunNumber) for part in self.parts)

    @property
    def amount(self) -> Self:
        """The number as bounds and searches compare it."""
        return self


class RunNumber(Number, frozen=True):
    """A number of a run: a quantity at a place, or a figure of its curve.

    Attributes:
        quantity: A quantity, a symbol or a formula.
        at: A place, as in ``Expectation.at``, or a figure, as in ``curve_figures``.
        of: The quantity whose extreme is meant, where ``at`` is one.
    """

    quantity: str
    at: str | dict[str, str | int | float]
    of: str

    @classmethod
    def read(cls, text: str) -> RunNumber:
        """Read ``QUANTITY @ PLACE`` or ``QUANTITY @ FIGURE``.

        A place is ``start``, ``end``, ``max``, ``min`` or ``largest`` (in size), ``max(OTHER)`` for where another
        quantity is largest, or ``t=1.5 s, side=left`` and the like; a figure is ``mean``, ``rms``, ``integral``,
        ``peak`` or a percentage such as ``p95``.

        Raises:
            InputError: It cannot be read.
        """
        quantity, _, place = (part.strip() for part in text.partition("@"))
        problem = InputError(f"'{text[:200]}' is no number of a run", expected=EXAMPLES)
        if not quantity or not place or len(text) > MAX_LENGTH or not _balanced(quantity) or not _balanced(place):
            raise problem
        if is_figure(place):
            return cls(quantity, place, quantity)
        if named := _PLACE.fullmatch(place):
            if named[2] is not None and (named[1] in ("start", "end") or not named[2].strip()):
                raise problem
            return cls(quantity, named[1], (named[2] or quantity).strip())
        pairs = [tuple(part.strip() for part in pair_text.split("=")) for pair_text in place.split(",")]
        if not all(len(pair) == 2 and all(pair) for pair in pairs):
            raise InputError(problem.message, expected=f"{EXAMPLES}; figures are {', '.join(FIGURES)}, p0 to p100")
        keys: dict[str, str | int | float] = {pair[0]: pair[1] for pair in pairs}
        for value in (value for key, value in pairs if key not in ("side", "occurrence")):
            read_quantity(value)
        if is_whole(occurrence := str(keys.get("occurrence", ""))):
            keys["occurrence"] = int(occurrence)
        return cls(quantity, keys, quantity)

    @property
    def label(self) -> str:
        """Its name; of a quantity at the start that is named without a place, as events are, its own."""
        if self.at == "start" and self.quantity.partition(".")[0] == "event":
            return self.quantity
        if isinstance(self.at, dict):
            return f"{self.quantity} @ {', '.join(f'{key}={value}' for key, value in self.at.items())}"
        return f"{self.quantity} @ {self.at}" + (f"({self.of})" if self.of != self.quantity else "")

    @property
    def figure(self) -> str:
        return self.at if isinstance(self.at, str) else ""

    @property
    def amount(self) -> Self:
        """The number as bounds and searches compare it: of ``@ largest``, which has a sign, the size."""
        return replace(self, at="peak") if self.at == "largest" and self.of == self.quantity else self

    def described(self, quantities: Quantities, sections: Mapping[str, object]) -> Series:
        """Return its name and unit as a series without values.

        Args:
            quantities: Those of the scenario; nothing has to be solved.
            sections: What its sections are of, by key, which a number of a curve does not need.

        Raises:
            InputError: There is no such quantity or place, or the rows are no motion and have no figures.
        """
        series, _ = quantities[self.quantity], quantities[self.of]
        if isinstance(self.at, dict):
            located(self.at, quantities)
        if quantities.trajectory.sampled and is_figure(self.figure) and self.figure != "peak":
            raise stands_alone(quantities.trajectory, self.quantity, self.figure)
        unit = figure_unit(quantities, self.quantity, self.at) if isinstance(self.at, str) else series.unit
        return Series(self.label, unit, np.zeros(0))

    def value(self, result: Run) -> tuple[float, float]:
        """Return the number [SI] and its error: of a quadrature, or of the search for a place; else 0.

        Raises:
            InputError: The place does not exist in this run, the run has no such figure, or the quantity depends on how
                several frictions or stops share a load.
        """
        for name in (self.quantity, self.of):
            result.quantities.determined(name)
        return self.told(result.lookup)

    def told(self, run: Lookup) -> tuple[float, float]:
        if isinstance(self.at, str) and is_figure(self.at):
            curve_figure = figure(run, self.quantity, self.at)
            return curve_figure.value, curve_figure.error
        return run.value(self.at, self.of, self.quantity)


class SectionNumber(Number, frozen=True):
    """A number of a section.

    Attributes:
        key: Key of the scenario that asks for the section, such as ``loads``.
        name: Name of the number in it, such as ``bearing.life.time``.
    """

    key: str
    name: str

    @property
    def label(self) -> str:
        return f"{self.key}.{self.name}"

    def described(self, quantities: Quantities, sections: Mapping[str, Numbered]) -> Series:
        """Return its name and unit as a series without values; see ``RunNumber.described``.

        Raises:
            InputError: The scenario does not ask for this section, or it has no such number.
        """
        if self.key not in sections and quantities.is_quantity(self.label):
            examples = f"{self.label} @ max, {self.label} @ end, or a figure such as {self.label} @ rms"
            raise InputError(f"'{self.label}' has a value at every row", expected=f"the place of one: {examples}")
        units = self._named("section", self.key, sections).units(quantities)
        return Series(self.label, self._named("number", self.name, units), np.zeros(0))

    def value(self, result: Run) -> tuple[float, float]:
        """Return the number [SI] and the error of its quadrature; see ``RunNumber.value``.

        Raises:
            InputError: The section of this run has no such number.
        """
        self._named("section", self.key, result.numbered)
        section = result.section(self.key)
        series = self._named("number", self.name, section.numbers)
        return float(series.values[0]), section.errors.get(self.name, 0.0)

    def _named(self, what: str, name: str, known: Mapping[str, T]) -> T:
        if name not in known:
            expected, hint = choices(name, known)
            raise InputError(f"'{self.label}': there is no {what} '{name}'", expected=expected, hint=hint)
        return known[name]


class CombinedNumber(Number, frozen=True):
    """A formula of numbers, such as ``w @ max - w @ min``.

    Attributes:
        label: As it is written.
        formula: The formula with names ``n_0``, ``n_1``, ... for its numbers.
        operands: These numbers.
    """

    label: str
    formula: str
    operands: tuple[RunNumber | SectionNumber, ...]

    @property
    def parts(self) -> Sequence[RunNumber | SectionNumber]:
        return self.operands

    @classmethod
    def read(cls, text: str) -> CombinedNumber:
        """Read a formula of numbers; ``X @ range`` is ``X @ max - X @ min``.

        Raises:
            InputError: It cannot be read, or ``@`` may belong to several parts of it.
        """
        label, formula, parts, done = " ".join(text.split()), "", list[RunNumber | SectionNumber](), 0
        for sign in re.finditer("@", text[:MAX_LENGTH]):
            begin, end = _begin(text, sign.start()), _end(text, sign.end())
            between, number = text[done:begin], text[begin:end].strip()
            opened = re.split(r"[(,]", between)
            if begin < done or (opened[-1].strip() and (len(opened) > 1 or not done)):
                raise InputError(
                    f"'{label}' does not say what '@' belongs to",
                    expected="parentheses, such as 2*(w @ max), or (2*w) @ max",
                )
            ends = [number] if not re.search(r"@\s*range$", number) else [f"{number[:-5]}max", f"{number[:-5]}min"]
            formula += f"{between}({' - '.join(f'n_{len(parts) + k}' for k in range(len(ends)))})"
            parts += map(RunNumber.read, ends)
            done = end
        formula += text[done:]
        names = cls(label, formula, tuple(parts))._in_words(lambda: Expression.parse(formula).names)
        for name in sorted(names):
            if "." in name:
                formula = re.sub(rf"(?<![\w.]){re.escape(name)}(?![\w.])", f"n_{len(parts)}", formula)
                parts += read_number(name).parts
            elif not re.fullmatch(r"n_\d+", name) and name not in CONSTANTS:
                raise InputError(
                    f"'{name}' in '{label}' has a value at every row",
                    expected=f"a number: {name} @ max; or parentheses around a formula, such as (2*{name}) @ max",
                )
        return cls(label, formula, tuple(parts))

    def described(self, quantities: Quantities, sections: Mapping[str, Numbered]) -> Series:
        """Return its name and unit as a series without values; see ``RunNumber.described``.

        Raises:
            InputError: A number in it does not exist, or dimensions do not go together.
        """
        units = [part.described(quantities, sections).unit for part in self.parts]
        unit = self._in_words(lambda: self._expression.dimension(_named(units)))
        alike = unit == units[0] and len({str(unit) for unit in units}) == 1
        return Series(self.label, units[0] if alike and self._is_proportional else unit, np.zeros(0))

    @property
    def _is_proportional(self) -> bool:
        """Whether it is twice as large where all its numbers are: an angle, and no ratio of angles."""
        values = np.sqrt(np.arange(1.0, 1.0 + len(self.parts)))
        with suppress(ExpressionError):
            single, double = (self._expression.evaluate(_named(factor * values)) for factor in (1.0, 2.0))
            return bool(abs(double - 2.0 * single) <= 1e-9 * abs(double))
        return False

    def value(self, result: Run) -> tuple[float, float]:
        """Return the number [SI] and what the errors of its parts make of it; see ``RunNumber.value``.

        Raises:
            InputError: The run does not have one of its numbers, dimensions do not go together, or it is not finite.
        """
        self.described(result.quantities, result.numbered)
        return self.of([part.value(result) for part in self.parts])

    def told(self, run: Lookup) -> tuple[float, float]:
        return self.of([part.told(run) for part in self.parts if isinstance(part, RunNumber)])

    def of(self, numbers: Sequence[tuple[float, float]]) -> tuple[float, float]:
        """Return the value of the formula, and the sum of what the error of each number changes in it.

        Args:
            numbers: The numbers [SI] and their errors. The value is NaN where one of them is.

        Raises:
            InputError: The value is not finite, as of a division by 0.
        """
        values, errors = np.array(numbers).T
        if np.isnan(values).any():
            return np.nan, 0.0
        moved = values + np.concatenate([np.zeros((1, len(values))), np.diag(errors), -np.diag(errors)])
        formula = self._in_words(lambda: self._expression.evaluate(_named(moved.T)))
        value, *others = np.broadcast_to(np.asarray(formula, float), len(moved)).tolist()
        if not np.isfinite(value):
            raise InputError(f"'{self.label}' is not finite", expected="a formula that does not divide by 0")
        changes = np.abs(np.array(others) - value).reshape(2, -1).max(axis=0)
        return value, float(np.where(np.isnan(changes), np.inf, changes).sum())

    @property
    def _expression(self) -> Expression:
        return Expression.parse(self.formula)

    def _in_words(self, compute: Callable[[], T]) -> T:
        try:
            return compute()
        except PinarmError as error:
            said = re.sub(r"n_(\d+)", lambda name: self.parts[int(name[1])].label, error.message)
            raise InputError(f"'{self.label}': {said}", expected=error.expected, hint=error.hint) from None


def _named(values: Iterable[T]) -> dict[str, T]:
    return {f"n_{k}": value for k, value in enumerate(values)}


def _balanced(text: str) -> bool:
    depths = np.cumsum([(c == "(") - (c == ")") for c in text] or [0])
    return bool(depths.min() >= 0 and depths[-1] == 0)


def _begin(text: str, sign: int) -> int:
    """Return where the operand of an ``@`` begins: a name, or a pair of parentheses with the function before it."""
    operand = text[:sign].rstrip()
    if operand.endswith(")"):
        begins = [k for k, c in enumerate(operand) if c == "(" and _balanced(operand[k:])]
        operand = operand[: begins[-1]] if begins else ""
    return len(operand) - len(re.search(r"[\w.]*$", operand)[0])  # type: ignore[index]  # it fits always


_UNIT_TEXT = r"(?: ?[A-Za-z°%][\w°^]*(?:[*/][A-Za-z][\w^]*)*)?"
_ENTRY = rf"[\w.]+\s*=\s*(?:{DECIMAL}{_UNIT_TEXT}|left|right)"
_PLACE_TEXT = re.compile(rf"\s*(?:{_ENTRY}(?:\s*,\s*{_ENTRY})*|\w+(?:\.\d+)?)")


def _end(text: str, start: int) -> int:
    place = _PLACE_TEXT.match(text, start)
    end = place.end() if place else start
    if text[end : end + 1] == "(":
        end = next((k for k in range(end + 1, len(text) + 1) if _balanced(text[end:k])), len(text))
    return end


AnyNumber = RunNumber | SectionNumber | CombinedNumber

EVENT = "event"
"""First word of quantities that are one number of a run, and need no place: ``event.hit.time``."""

LONGEST = 60
"""Characters of a number's name in names of files."""


def slug(number: AnyNumber) -> str:
    """Return the name of a number as names of numbers and files have it: ``C_B @ max`` as ``C_B_max``."""
    return re.sub(r"\W+", "_", number.label).strip("_")[:LONGEST]


def measured(number: AnyNumber, result: Run) -> tuple[Series, float]:
    """Return a number of a run as a series of one value, with its unit, and the error of its quadrature.

    Raises:
        InputError: The run has no such number.
    """
    series = number.described(result.quantities, result.numbered)
    value, error = number.value(result)
    return replace(series, values=np.array([value])), error


def names_number(text: str, sections: Mapping[str, object]) -> bool:
    """Tell whether a text asks for a number of the run: by ``@``, or by the key of a section in it."""
    return "@" in text or any(key in sections for key in re.findall(r"(?<![\w.])(\w+)\.", text))


def read_number(text: str) -> AnyNumber:
    """Read a number of a curve (see ``RunNumber.read``), ``SECTION.NAME``, ``event.NAME.time``, or a formula of them.

    Raises:
        InputError: It cannot be read.
    """
    require_name(text)
    text = text.strip()
    key, dot, name = text.partition(".")
    if key == EVENT and "@" not in text:
        return RunNumber(text, "start", text)
    if "@" not in text and dot and key.isidentifier() and name and not _FORMULA.search(text):
        return SectionNumber(key, name)
    if text.count("@") > 1 or re.search(r"@\s*range$", text) or ("@" not in text and _FORMULA.search(text)):
        return CombinedNumber.read(text)
    try:
        return RunNumber.read(text)
    except InputError:
        if _FORMULA.search(text.partition("@")[2]) or not _balanced(text.partition("@")[0]):
            return CombinedNumber.read(text)
        raise


_FORMULA = re.compile(r"\s[-+*/]|[-+*/]\s|[()]")
"""Marks of a formula behind a name; names of numbers may have ``-`` between their letters."""


class Condition(Record, frozen=True):
    """A condition on a number of the run: the number, ``<``, ``>`` or ``=``, and the value it is compared with."""

    number: AnyNumber
    relation: Literal["<", ">", "="]
    bound: Measured

    @classmethod
    def read(cls, number: str, text: str) -> Condition:
        """Read ``< 0.52 m``, ``> 0.52 m`` or ``= 0.52 m``; ``<=`` and ``>=`` are the same as ``<`` and ``>``.

        Raises:
            InputError: It cannot be read.
        """
        relations: dict[str, Literal["<", ">", "="]] = {"<": "<", ">": ">", "=": "="}
        if text[:1] not in relations:
            raise InputError(f"'{text[:80]}' is no condition", expected="'< 0.52 m', '> 0.52 m' or '= 0.52 m'")
        value = text[1:].removeprefix("=").strip()
        condition = cls(read_number(number), relations[text[0]], AnyQuantity.read(value, bare=False))
        asked = condition.compared
        if isinstance(asked, RunNumber) and asked.figure == "peak" and condition.bound < 0.0:
            raise InputError(
                f"'{number}' is a size, which is never below {condition.bound_text}",
                expected=f"a bound from 0 on, or {asked.quantity} @ min, @ max",
            )
        return condition

    @property
    def compared(self) -> AnyNumber:
        """The number whose value is compared: a bound is one of an amount."""
        return self.number if self.relation == "=" else self.number.amount

    def __str__(self) -> str:
        return f"{self.number.label} {self.relation} {self.bound_text}"

    @property
    def bound_text(self) -> str:
        return self.measured(float(self.bound))

    def measured(self, value: float) -> str:
        written = self.bound.unit
        return f"{value / written.factor:g} {written}" if written else f"{value:g}"

    def margin(self, value: float) -> float:
        return float(self.bound - value if self.relation == "<" else value - self.bound)


def read_conditions(texts: Mapping[str, str]) -> list[Condition]:
    """Read conditions by their numbers, as files have them.

    Raises:
        InputError: One cannot be read.
    """
    conditions = []
    for number, text in texts.items():
        with within(number):
            conditions.append(Condition.read(number, text))
    return conditions

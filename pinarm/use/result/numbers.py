"""Numbers of a run: ``QUANTITY @ PLACE`` or ``QUANTITY @ FIGURE``, numbers of sections, and conditions on both.

``X @ largest`` is printed with its sign, and ``=`` compares it so; ``<`` and ``>`` compare its size, ``X @ peak``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from pinarm.engine.quantities.names import EXTREMES, OPEN, Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, choices, require_name, within
from pinarm.input.numbers import is_whole
from pinarm.input.yaml.schema import AnyQuantity, Measured
from pinarm.records import Record, ValueRecord, replace
from pinarm.use.result.curve_figures import FIGURES, figure, figure_unit, is_figure, stands_alone
from pinarm.use.result.row_lookup import located

if TYPE_CHECKING:
    from pinarm.use.result.row_lookup import Lookup
    from pinarm.use.result.run import Numbered, Run


EXAMPLES = "C_B @ max, t @ max(C_B), C_B @ t=1.5 s, C_B @ rms, C_B @ p95, or loads.B.life.time of a section"

MAX_LENGTH = 2000
"""Characters of a text that is read at all."""

_PLACE = re.compile(r"(start|end|max|min|largest)(?:\((.*)\))?")


class RunNumber(ValueRecord, frozen=True):
    """What is asked of a run: a quantity at a place, or a figure of its curve.

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
        if not quantity or not place or len(text) > MAX_LENGTH:
            raise problem
        if is_figure(place):
            return cls(quantity, place, quantity)
        if named := _PLACE.fullmatch(place):
            if named[2] is not None and (named[1] in ("start", "end") or not named[2].strip()):
                raise problem
            return cls(quantity, named[1], (named[2] or quantity).strip())
        pairs = [tuple(part.strip() for part in each.split("=")) for each in place.split(",")]
        if not all(len(pair) == 2 and all(pair) for pair in pairs):
            raise InputError(problem.message, expected=f"{EXAMPLES}; figures are {', '.join(FIGURES)}, p0 to p100")
        keys: dict[str, str | int | float] = {pair[0]: pair[1] for pair in pairs}
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
        """The figure of the curve; a place where it is asked at one."""
        return self.at if isinstance(self.at, str) else ""

    @property
    def amount(self) -> RunNumber:
        """What a bound compares and a search makes least: of ``@ largest``, which has a sign, its size."""
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
            InputError: The place does not exist in this run, or the run has no such figure.
        """
        found = self.told(result.lookup)
        if result.trajectory.others and any(
            result.quantities.open_rows(name).any() for name in (self.quantity, self.of)
        ):
            self._require_determined(result, found[0])
        return found

    def told(self, run: Lookup) -> tuple[float, float]:
        """Return the number of a run in which friction leaves nothing open; see ``value``."""
        if isinstance(self.at, str) and is_figure(self.at):
            given = figure(run, self.quantity, self.at)
            return given.value, given.error
        if self.at in ("max", "min", "largest"):
            if self.of != self.quantity:
                return run.at_extreme(self.at, self.of, self.quantity)
            row, error = run.extreme(self.at, self.of)
            return float(row[self.quantity].values[0]), error
        if isinstance(self.at, dict):
            return run.at_instant(self.at, self.quantity)
        return float(run.at(self.at, self.of)[self.quantity].values[0]), 0.0

    def _require_determined(self, result: Run, told: float) -> None:
        """Raise where the number would be another one with other frictions that hold the same motion.

        Raises:
            InputError: Says between which values it lies.
        """
        place = isinstance(self.at, str)
        ends = [
            replace(self, quantity=f"{self.quantity}.{extreme}", of=f"{self.of}.{extreme}" if place else self.of)
            for extreme in EXTREMES
        ]
        bounds = [series.values for series in result.quantities.bounds(self.quantity)]
        endless = place and np.isinf(bounds).any()
        values = np.ravel(bounds if endless else [each.told(result.lookup)[0] for each in ends])
        low, high, finite = values.min(), values.max(), values[np.isfinite(values)]
        if high - low > OPEN * max(np.abs(finite).max(initial=0.0), abs(told)):
            unit = result[self.quantity].unit
            raise InputError(
                f"'{self.label}' is not determined: several frictions or stops hold one motion, and it lies between "
                f"{low:.6g} and {high:.6g} {unit or ''}",
                expected="a number that does not depend on which of them holds how much",
                hint=f"'{ends[0].label}' or '{ends[1].label}'",
            )


class SectionNumber(ValueRecord, frozen=True):
    """A number of a section.

    Attributes:
        key: Key of the scenario that asks for the section, such as ``loads``.
        name: Name of the number in it, such as ``bearing.life.time``.
    """

    key: str
    name: str

    @property
    def label(self) -> str:
        """Its name."""
        return f"{self.key}.{self.name}"

    @property
    def figure(self) -> str:
        """The last part of its name: ``rms`` and ``peak`` mean what they mean for curves."""
        return self.name.rpartition(".")[2]

    @property
    def amount(self) -> SectionNumber:
        """The number itself; see ``RunNumber.amount``."""
        return self

    def described(self, quantities: Quantities, sections: Mapping[str, Numbered]) -> Series:
        """Return its name and unit as a series without values; see ``RunNumber.described``.

        Raises:
            InputError: The scenario does not ask for this section, or it has no such number.
        """
        if self.key not in sections:
            raise self._without_place(quantities) or self._unknown(sections)
        units = sections[self.key].units(quantities)
        if self.name not in units:
            raise self._missing(units)
        return Series(self.label, units[self.name], np.zeros(0))

    def value(self, result: Run) -> tuple[float, float]:
        """Return the number [SI] and the error of its quadrature; see ``RunNumber.value``.

        Raises:
            InputError: The section of this run has no such number.
        """
        if self.key not in result.numbered:
            raise self._unknown(result.numbered)
        section = result.section(self.key)
        if self.name not in section.numbers:
            raise self._missing(section.numbers)
        return float(section.numbers[self.name].values[0]), section.errors.get(self.name, 0.0)

    def _unknown(self, sections: Mapping[str, object]) -> InputError:
        expected = f"one of its sections: {', '.join(sections)}" if sections else "QUANTITY @ PLACE"
        return InputError(f"the scenario has no section '{self.key}' for '{self.label}'", expected=expected)

    def _without_place(self, quantities: Quantities) -> InputError | None:
        """Return that a quantity is meant, which is a number at a place only; ``None`` where it is none."""
        try:
            quantities[self.label]
        except InputError as error:
            names = [name for name in quantities.names() if name.partition(".")[0] in (self.key, EVENT)]
            expected, hint = choices(self.label, names)
            return InputError(error.message, expected=expected, hint=hint) if hint else None
        return InputError(f"'{self.label}' has a value at every row", expected=f"the place of one: {self.label} @ max, "
                          f"{self.label} @ end, or a figure such as {self.label} @ rms")  # fmt: skip

    def _missing(self, numbers: Mapping[str, object]) -> InputError:
        expected, hint = choices(self.name, numbers)
        return InputError(f"the section '{self.key}' has no number '{self.name}'", expected=expected, hint=hint)


AnyNumber = RunNumber | SectionNumber

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


def names_section(text: str, sections: Mapping[str, object]) -> bool:
    """Tell whether a text, without ``@``, begins with the key of a section and so asks for a number of it."""
    key, dot, _ = text.strip().partition(".")
    return "@" not in text and bool(dot) and key in sections


def read_number(text: str) -> AnyNumber:
    """Read a number of a curve (see ``RunNumber.read``), ``SECTION.NAME``, or ``event.NAME.time``.

    Raises:
        InputError: It cannot be read.
    """
    require_name(text)
    key, dot, name = text.strip().partition(".")
    if key == EVENT and "@" not in text:
        return RunNumber(text.strip(), "start", text.strip())
    if "@" in text or not dot or not key.isidentifier() or not name:
        return RunNumber.read(text)
    return SectionNumber(key, name)


class Condition(Record, frozen=True):
    """What a number of the run must keep to.

    Attributes:
        number: The number.
        relation: ``<``, ``>`` or ``=``.
        bound: What it is compared with.
    """

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
        if condition.compared.figure == "peak" and isinstance(condition.compared, RunNumber) and condition.bound < 0.0:
            raise InputError(f"'{number}' is a size, which is never below {condition.bound_text}",
                             expected=f"a bound from 0 on, or {condition.compared.quantity} @ min, @ max")  # fmt: skip
        return condition

    @property
    def compared(self) -> AnyNumber:
        """The number whose value is compared: a bound is one of an amount."""
        return self.number if self.relation == "=" else self.number.amount

    def __str__(self) -> str:
        return f"{self.number.label} {self.relation} {self.bound_text}"

    @property
    def bound_text(self) -> str:
        """The bound as files write it, with its unit."""
        return self.measured(float(self.bound))

    def measured(self, value: float) -> str:
        """Return a value in SI in the unit of the bound."""
        written = self.bound.unit
        return f"{value / written.factor:g} {written}" if written else f"{value:g}"

    def margin(self, value: float) -> float:
        """Return by how much it holds, negative where it does not; for ``=`` the difference."""
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

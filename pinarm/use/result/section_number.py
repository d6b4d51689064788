"""A number of a section, as ``KEY.NAME`` asks for it: the life of a bearing, the reserve of a motor."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, choices, require_name
from pinarm.input.units import Unit
from pinarm.records import ValueRecord, replace
from pinarm.use.result.run_number import RunNumber

if TYPE_CHECKING:
    from pinarm.use.result.result import Result


class Numbered(Protocol):
    """What tells numbers of a run in a section: an assessment, or a search for an optimum."""

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        """Return the names of the numbers that its section may have, and their units, with nothing solved.

        Args:
            quantities: Those of one row.

        Raises:
            InputError: It asks for something that does not exist.
        """
        ...


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

    def value(self, result: Result) -> tuple[float, float]:
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


def measured(number: AnyNumber, result: Result) -> tuple[Series, float]:
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

"""Tolerances of numbers, as files write them.

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
from typing import Any, Self

from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS, Unit, read_quantity, unit
from pinarm.input.yaml.schema import Measured

EXAMPLES = "such as 250 ± 0.1 mm, 0.1 mm or 5 %; 0.15 ± 0.05 for a number without a unit"
PERCENT = unit("%")

SAME = 1e-9
"""Relative difference below which the value of a tolerance is that of the file."""

_SIGN = re.compile(r"±|\+/-|\+-")


class Tolerance(Measured):
    """How far a number may be from its value: its size in SI, or as a part of the value.

    Attributes:
        relative: Whether it is a part of the value.
        about: The value [SI]; ``None`` for that of the file.
    """

    relative: bool = False
    about: float | None = None

    @classmethod
    def read(cls, value: object, *, bare: bool = True) -> Self:
        """Read a tolerance: see above.

        Raises:
            UnitError: A unit is unknown, or value and size have different dimensions.
            InputError: It is no tolerance, or not positive.
        """
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
        """Return a tolerance of its parts.

        Raises:
            InputError: It is not positive and finite.
        """
        if not 0.0 < size < float("inf"):
            raise InputError(f"a tolerance of {size:g} is none", expected=f"more than 0, {EXAMPLES}")
        tolerance = cls(size)
        tolerance.unit, tolerance.relative, tolerance.about = written, relative, about
        return tolerance

    def size(self, value: float) -> float:
        """Return the tolerance [SI] of a value of the file [SI].

        Raises:
            InputError: It is about another value, or a part of 0.
        """
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
        """Say how another process makes the same tolerance."""
        return type(self).of, (float(self), self.unit, self.relative, self.about)

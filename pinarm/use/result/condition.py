"""A condition on a number of a run: ``C_B @ rms: < 30 N*m``.

``X @ largest`` is printed with its sign, and ``=`` compares it so; ``<`` and ``>`` compare its size, ``X @ peak``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from pinarm.errors import InputError, within
from pinarm.input.yaml.schema import AnyQuantity, Measured
from pinarm.use.result.run_number import RunNumber
from pinarm.use.result.section_number import AnyNumber, read_number


@dataclass(frozen=True)
class Condition:
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

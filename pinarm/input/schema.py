"""The base of everything that is read from files: validated, immutable, and strict about units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationInfo, WithJsonSchema

from pinarm.errors import UnitError
from pinarm.input.units import Unit, read_quantity, unit

FROM_FILE = {"units": "required"}
"""Validation context of documents: a bare number other than 0 is refused where a unit belongs."""


class Model(BaseModel):
    """An immutable piece of input; keys it does not know are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True, populate_by_name=True, strict=False)


class Measured(float):
    """A float in SI that remembers the unit it was written in; ``None`` where it was a bare number."""

    unit: Unit | None = None

    @classmethod
    def read(cls, value: Any, info: ValidationInfo, *, example: str = "") -> Measured:
        """Read ``"30 deg"``, or a number: SI from Python, in a file only zero; ``example`` is a unit that would fit."""
        if isinstance(value, Measured):
            return value
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError("a number with a unit, such as '30 deg', is expected")
        try:
            number, read = read_quantity(value) if isinstance(value, str) else (float(value), None)
        except OverflowError:
            raise ValueError("a finite number is expected") from None
        if number - number != 0.0:
            raise ValueError("a finite number is expected")
        if read is None and number != 0.0 and (info.context or {}).get("units") == "required":
            hint = f"{value} {example}" if example else ""
            raise UnitError(f"'{value}' has no unit", expected="a number with its unit, such as 30 deg", hint=hint)
        measured = cls(number)
        measured.unit = read
        return measured

    def check(self, expected: Unit) -> None:
        """Raise where the unit that was written has another dimension than the expected one.

        Raises:
            UnitError: The dimensions differ.
        """
        if self.unit is not None and self.unit.dimension != expected.dimension:
            raise UnitError(f"'{self.unit}' is not a unit of this quantity", expected=f"a unit such as {expected}")


@dataclass(frozen=True)
class Derivative:
    """Marks a field of a motion law as the ``order``-th time derivative of the quantity that the law is about."""

    order: int


def quantity(text: str) -> Any:
    """Return the annotation of a float whose unit must have the dimension of ``text``."""
    expected = unit(text)

    def read(value: Any, info: ValidationInfo) -> Measured:
        measured = Measured.read(value, info, example=text)
        measured.check(expected)
        return measured

    return Annotated[float, PlainValidator(read), described(f"in {text}")]


def described(description: str) -> WithJsonSchema:
    """Return the JSON Schema of a number or text."""
    return WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}], "description": description})


def _any(value: Any, info: ValidationInfo) -> Measured:
    return Measured.read(value, info)


AnyQuantity = Annotated[float, PlainValidator(_any), described("a number with its unit")]
Level = Annotated[AnyQuantity, Derivative(0)]
Rate = Annotated[AnyQuantity, Derivative(1)]
SecondRate = Annotated[AnyQuantity, Derivative(2)]
Time = quantity("s")
Duration: Any = Annotated[Time, Field(gt=0)]
Angle, Pulsation, Length = quantity("rad"), quantity("rad/s"), quantity("m")
Force, Moment, Acceleration, Inertia = quantity("N"), quantity("N*m"), quantity("m/s^2"), quantity("kg*m^2")
Stiffness, Damping = quantity("N/m"), quantity("N*s/m")
